"""A plan flown in time by the vehicle's own limits, and what the model says of that flight."""
