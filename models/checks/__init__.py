"""Can the measured numbers be believed: motor order, unit of speed, stuck sensors."""
