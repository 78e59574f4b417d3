"""What identification and a season say, in words."""
