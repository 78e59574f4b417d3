"""A plan before take-off as a file."""
