"""Pages, tables and figures that are written to files."""
