"""A flight beside the forecast of its plan, and which assumption of that was off."""
