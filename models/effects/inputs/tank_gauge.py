"""A tank gauge that is wrong: its slope, its zero, or its reading as time goes on."""

from __future__ import annotations

import numpy as np

from thrustmargin.models.effects.base import Effect, Kind, Parameter, instrument_gain
from thrustmargin.models.effects.channels import Channels

LEAST_SPREAD = 0.02  # of the tank, from flight to flight: below it, it is a mass on board


def _spread(p, x: Channels):
    return np.std(p["offset"]) / (LEAST_SPREAD * x.tank_capacity_kg)


TANK_SCALE = Effect(
    name="tank_scale",
    kind=Kind.INPUT,
    # Smallest: density of the liquid, and slope of a level or load sensor.
    parameters=(instrument_gain(0.01),),
    needs=("tank_kg",),
    source="a gauge whose slope is wrong: true mass = gain x shown mass",
    apply=lambda p, x, airspeed, tank_kg: (airspeed, tank_kg * p["gain"]),
)

TANK_ZERO = Effect(
    name="tank_zero",
    kind=Kind.INPUT,
    parameters=(
        Parameter(
            name="offset",
            unit="kg",
            lower=-5.0,
            upper=5.0,
            scale=0.5,
            smallest=0.1,  # how well a load cell is set to zero, and what stays in the hoses
            per_flight=True,  # set anew at each start; what never changes is a mass on board
        ),
    ),
    needs=("tank_kg",),
    source="a gauge that is set to zero anew before each flight: true mass = shown mass + offset",
    apply=lambda p, x, airspeed, tank_kg: (airspeed, tank_kg + p["offset"]),
    weight=_spread,
    by_flights=True,
)

TANK_DRIFT = Effect(
    name="tank_drift",
    kind=Kind.INPUT,
    parameters=(
        Parameter(
            name="rate",
            unit="kg/s",
            lower=-0.02,
            upper=0.02,
            scale=1e-3,
            smallest=1.5e-4,  # 0.1 kg in 10 minutes: a load cell that warms, a flow meter's share
        ),
    ),
    needs=("tank_kg",),
    source="a gauge that drifts, or adds up a flow that is wrong: true mass = shown mass + rate x "
    "time since the start",
    apply=lambda p, x, airspeed, tank_kg: (airspeed, tank_kg + p["rate"] * x.time_s),
)

EFFECTS = (TANK_SCALE, TANK_ZERO, TANK_DRIFT)
