"""One rotor that makes less thrust at a speed: all along, from a moment on, or for a while."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from thrustmargin.models.effects.base import (
    TORQUE_SHARE,
    Effect,
    Kind,
    Parameter,
    Values,
    shaping,
)
from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.physics.airframe import Airframe

LONG_BEFORE = 1e4  # s


def _kappa(p, x: Channels):
    return 1.0 - p["loss"] * _after_onset(p, x)


def _torque(p, x: Channels):
    return 1.0 - p["loss"] * p["torque_share"] * _after_onset(p, x)


def _after_onset(p, x: Channels):
    if "onset_clock" in p:
        began = _risen(x.clock_s - p["onset_clock"])
        return began * _risen(p["end_clock"] - x.clock_s) if "end_clock" in p else began
    if "onset_time" not in p:
        return 1.0 + 0.0 * x.time_s
    began = _risen(x.time_s - p["onset_time"])
    return began * _risen(p["end_time"] - x.time_s) if "end_time" in p else began


def _risen(seconds):
    """0 well before a moment and 1 well after it."""
    return 1.0 / (1.0 + np.exp(-np.clip(4.0 * seconds, -40.0, 40.0)))


def _weaker(p: Values, airframe: Airframe, rotor: int | None) -> Airframe:
    effectiveness = airframe.rotor_effectiveness.copy()
    effectiveness[rotor] *= 1.0 - float(p["loss"])
    return replace(airframe, rotor_effectiveness=effectiveness)


#: Smallest: propellers differ by 0.3 to 0.5 % as they are balanced, folded and warm.
LOSS = Parameter(name="loss", unit="1", lower=-0.3, upper=0.7, scale=0.05, smallest=0.004)

ONSET_TIME = replace(
    shaping("onset_time", "s", start=0.0, lower=0.0, upper=1e5, scale=60.0), resolution=0.3
)

ROTOR_DEGRADATION = Effect(
    name="rotor_degradation",
    kind=Kind.COEFFICIENT,
    parameters=(LOSS, TORQUE_SHARE),
    source="a worn, chipped or dirty propeller makes less thrust at a speed",
    apply=_kappa,
    torque=_torque,
    of_one_rotor=True,
    on_airframe=_weaker,
)

ROTOR_DEGRADATION_ONSET = replace(
    ROTOR_DEGRADATION,
    variant="onset",
    parameters=tuple(replace(p, per_flight=True) for p in (LOSS, ONSET_TIME, TORQUE_SHARE)),
    source="a propeller that chips in flight makes less thrust from then on",
    begins=True,
    afterwards=ROTOR_DEGRADATION,
)

ROTOR_DEGRADATION_WHILE = replace(
    ROTOR_DEGRADATION_ONSET,
    variant="for a while",
    parameters=tuple(
        replace(p, per_flight=True)
        for p in (LOSS, ONSET_TIME, replace(ONSET_TIME, name="end_time"), TORQUE_SHARE)
    ),
    source="a motor, an ESC or ice that takes thrust from a rotor and lets it come back",
    afterwards=None,
)

ROTOR_DEGRADATION_EACH = replace(
    ROTOR_DEGRADATION_ONSET,
    variant="in each flight",
    parameters=(LOSS, ONSET_TIME, TORQUE_SHARE),
    source="a rotor that weakens at the same time after each start, as one that gets warm",
    afterwards=None,
)

_CLOCK = replace(ONSET_TIME, name="onset_clock", upper=1e11)

ROTOR_DEGRADATION_SINCE = replace(
    ROTOR_DEGRADATION_EACH,
    variant="since",
    parameters=(LOSS, _CLOCK, TORQUE_SHARE),
    needs=("clock_s",),
    neutral={"clock_s": lambda p, x: p["onset_clock"] - LONG_BEFORE},
    source="a propeller that chips in one flight stays so in the flights after it",
    afterwards=ROTOR_DEGRADATION,
)

ROTOR_DEGRADATION_UNTIL = replace(
    ROTOR_DEGRADATION_SINCE,
    variant="until repaired",
    parameters=(LOSS, _CLOCK, replace(_CLOCK, name="end_clock"), TORQUE_SHARE),
    source="a propeller that was weak in some flights in a row and was replaced after them",
    afterwards=None,
    gone=True,
)

#: A rotor that goes bad at a moment: in one flight, in it for a while, in each at one time, in one
#: and all later, in some flights in a row.
ONSETS = (
    ROTOR_DEGRADATION_ONSET,
    ROTOR_DEGRADATION_WHILE,
    ROTOR_DEGRADATION_EACH,
    ROTOR_DEGRADATION_SINCE,
    ROTOR_DEGRADATION_UNTIL,
)
EFFECTS = (ROTOR_DEGRADATION, *ONSETS)
