"""What several commands ask, read and print in the same way."""
