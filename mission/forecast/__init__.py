"""Forecast the flight of a plan before take-off: its course in time, its thrust utilisation, tank
and battery.
"""
