"""An airspeed that reads too much or too little: by as much at any speed, or in proportion."""

from __future__ import annotations

import numpy as np

from thrustmargin.models.effects.base import Effect, Kind, Parameter, instrument_gain
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.physics.airframe import Airframe

REPEATED = 0.05  # m/s: rounding of three messages to 0.01 m/s, and what they are apart in time
MOSTLY = 0.9  # of the rows; a sensor in the rotors' flow scatters by more in nearly all


def of_sensor(track: FlightTrack, airframe: Airframe, start: None = None) -> tuple[Floats, None]:
    """The airspeed, (T,) m/s; all NaN where it only repeats velocity minus wind.

    Without a pitot tube the autopilot works airspeed out from its own velocity and wind (none
    known: still air). Then there is no sensor that could be off; the wind may be.
    """
    del airframe
    through = track.velocity_ned - np.nan_to_num(track.wind_ned)
    off = np.abs(track.airspeed - np.linalg.norm(through, axis=1))
    both = np.isfinite(off)
    repeats = both.any() and float(np.mean(off[both] < REPEATED)) > MOSTLY
    return np.full_like(track.airspeed, np.nan) if repeats else track.airspeed, start


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
    needs=("airspeed", "airspeed_bias"),
    own_channel=of_sensor,
    source="a sensor whose zero is off: true airspeed = shown + bias, and never below nothing",
    apply=lambda p, x, airspeed, tank_kg: (np.clip(airspeed + p["bias"], 0.0, None), tank_kg),
)

AIRSPEED_GAIN = Effect(
    name="airspeed_gain",
    kind=Kind.INPUT,
    # Smallest: half the share by which air is thinner on a warm day or a hill.
    parameters=(instrument_gain(0.03),),
    needs=("airspeed", "airspeed_gain"),
    own_channel=of_sensor,
    source="a pitot tube in the rotors' flow, or thin air read as dense: true airspeed = gain x "
    "shown",
    apply=lambda p, x, airspeed, tank_kg: (airspeed * p["gain"], tank_kg),
)

EFFECTS = (AIRSPEED_BIAS, AIRSPEED_GAIN)
