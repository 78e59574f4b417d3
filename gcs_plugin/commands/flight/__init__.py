"""Commands on one flight, as it is flown or from its log."""
