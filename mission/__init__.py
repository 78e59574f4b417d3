"""Mission layer: where the vehicle flew and sprayed. Imports models only.

Frames: `_ned` is north, east, down in metres from the track's origin; a plan view is (north, east).
"""
