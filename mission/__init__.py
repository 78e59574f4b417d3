"""Represent missions: plans, routes over fields, and the places where a vehicle flew and
sprayed.
"""

SPRAY_SPEED = 5.0  # m/s over the ground while spraying, unless another is stated
