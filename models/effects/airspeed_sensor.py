"""An airspeed that reads too much or too little: by as much at any speed, or in proportion."""

from __future__ import annotations

import numpy as np

from thrustmargin.models.effects.base import Effect, Kind, Parameter, instrument_gain

AIRSPEED_BIAS = Effect(
    name="airspeed_bias",
    kind=Kind.INPUT,
    parameters=(
        Parameter(
            name="bias",
            unit="m/s",
            lower=-5.0,
            upper=5.0,
            scale=1.0,
            smallest=0.3,  # zero of a pressure sensor, light wind in an estimate
        ),
    ),
    needs=("airspeed",),
    source="a sensor whose zero is off: true airspeed = shown + bias, and never below nothing",
    distinguished_by="hover in still air, then fly a straight line both ways at two speeds",
    apply=lambda p, x, airspeed, tank_kg: (np.clip(airspeed + p["bias"], 0.0, None), tank_kg),
)

AIRSPEED_GAIN = Effect(
    name="airspeed_gain",
    kind=Kind.INPUT,
    # Smallest: half the share by which air is thinner on a warm day or a hill.
    parameters=(instrument_gain(0.03),),
    needs=("airspeed",),
    source="a pitot tube in the rotors' flow, or thin air read as dense: true airspeed = gain x "
    "shown",
    distinguished_by="fly a straight line both ways at two speeds in still air",
    apply=lambda p, x, airspeed, tank_kg: (airspeed * p["gain"], tank_kg),
)

EFFECTS = (AIRSPEED_BIAS, AIRSPEED_GAIN)
