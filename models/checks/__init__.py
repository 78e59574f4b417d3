"""Checks of measured values: motor order, units, clocks, frozen or broken instruments, airframe
match."""
