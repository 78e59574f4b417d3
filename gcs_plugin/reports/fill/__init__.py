"""Report of how much may be filled: the table for a day's air and battery, as page and as JSON."""
