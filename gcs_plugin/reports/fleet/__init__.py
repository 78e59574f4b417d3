"""The season of a fleet: which aircraft to look at first and why, as page, table, JSON and CSV."""
