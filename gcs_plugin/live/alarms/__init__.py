"""Alarms of a vehicle: their type, the rules that raise them, and the list of active ones."""
