"""Words of plans before they are flown."""
