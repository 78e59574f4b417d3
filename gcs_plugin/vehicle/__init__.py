"""Fetch missions and logs from the vehicle itself, through MAVSDK."""
