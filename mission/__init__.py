"""Mission layer: plans, routes over fields, and where the vehicle flew and sprayed.

Frames: `_ned` is north, east, down in metres from the track's origin; a plan view is (north, east).
"""
