"""Interpret a vehicle's parameters: kind of vehicle, pulse range of its outputs, airframe."""
