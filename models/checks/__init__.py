"""Can the measured numbers be believed: motor order, unit of speed, readings that are none."""
