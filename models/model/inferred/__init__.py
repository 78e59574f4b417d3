"""Estimate channels that a flight does not report: load, rotor speeds, and their errors."""
