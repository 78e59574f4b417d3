"""Moments of the air on an aircraft that leans into a wind which nothing measures.

In a steady wind, or at speed, an aircraft leans until thrust and drag balance. The drag over its
mass is the specific force in the rotors' plane, which attitude and acceleration show without an
airspeed sensor:

    f = R^T (a - g)     roll moment = -h_roll f_right/g T     pitch moment = h_pitch f_forward/g T

R from body to NED, a from the velocity, T thrust. The height h at which that force would have to
act above the centre of gravity holds the rotors' own moment in flow too (blades that flap, front
rotors in cleaner air than rear ones), which is the larger part: an aircraft is some centimetres
high and h is about the length of an arm.
"""

from __future__ import annotations

import numpy as np

from thrustmargin.models.effects.base import Effect, Kind, Parameter
from thrustmargin.models.effects.channels import (
    LAG_STEP,
    VELOCITY_SPAN,
    Channels,
    derivative_look,
    froude_time_scale,
)
from thrustmargin.models.flight import FlightTrack, Floats, body_axes
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0
from thrustmargin.models.physics.smoothing import derivative, moving_mean

MEAN_SPAN = (
    2.0  # s of an aircraft of the F16's size: the lean into wind is slow, reports of it noisy
)
LOOK = derivative_look(VELOCITY_SPAN) + MEAN_SPAN / 2 + LAG_STEP


def lean(track: FlightTrack, airframe: Airframe, start: None = None) -> tuple[Floats, None]:
    """Specific force forward and right, (T, 2) in g, by attitude and velocity.

    NaN in rows where a wind is reported: the moment of flow is then known from the velocity.
    """
    leaning = np.full((track.time_s.size, 2), np.nan)
    quick = froude_time_scale(airframe)
    force = derivative(track.time_s, track.velocity_ned, VELOCITY_SPAN * quick) - [0.0, 0.0, G0]
    forward, right, _ = body_axes(track.attitude)
    for k, axis in enumerate((forward, right)):
        along = np.sum(force * axis, axis=1) / G0
        leaning[:, k] = moving_mean(track.time_s, along, MEAN_SPAN * quick)
    leaning[np.isfinite(track.wind_ned).any(axis=1)] = np.nan
    return leaning, start


def _leaning(p, x: Channels, thrust):
    forward, right = x.own["drag_moment"].T
    return -p["roll"] * right * thrust, p["pitch"] * forward * thrust, 0.0 * thrust


def _height(name: str) -> Parameter:
    return Parameter(name=name, unit="m", lower=-4.0, upper=4.0, scale=0.5, smallest=0.05)


DRAG_MOMENT = Effect(
    name="drag_moment",
    kind=Kind.MOMENTS,
    parameters=(_height("roll"), _height("pitch")),
    needs=("drag_moment",),
    neutral={"drag_moment": 0.0},
    of_every_aircraft=True,
    source="balance of forces in wind: the force in the rotors' plane is drag, which acts at a "
    "height above the centre of gravity that holds the rotors' own moment in flow",
    # As the moment of flow: a sprayer, slow under its load, shows too little of it.
    with_tank=False,
    looks=lambda p: (LOOK, LOOK),
    own_channel=lean,
    apply=_leaning,
)

EFFECTS = (DRAG_MOMENT,)
