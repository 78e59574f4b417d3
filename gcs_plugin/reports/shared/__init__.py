"""What all pages that are written to files share."""
