"""Commands on the flights of many aircraft over a season."""
