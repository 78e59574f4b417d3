"""What only the view of aircraft that fly now has."""
