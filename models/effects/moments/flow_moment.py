"""The rotors' own moment in forward flight: it lifts the side that meets the air."""

from __future__ import annotations

import numpy as np

from thrustmargin.models.effects.base import Effect, Kind, Parameter
from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.physics.airframe import Airframe


def flow(track: FlightTrack, airframe: Airframe, start: None = None) -> tuple[Floats, None]:
    """Level speed through the air forward and right, (T, 2) m/s.

    NaN without a wind, still air included: `drag_moment` then has the flow by the lean.
    """
    north, east, _ = (track.velocity_ned - track.wind_ned).T
    yaw = track.attitude[:, 2]
    forward = north * np.cos(yaw) + east * np.sin(yaw)
    return np.stack([forward, east * np.cos(yaw) - north * np.sin(yaw)], axis=1), start


def _lifted(p, x: Channels, thrust):
    forward, right = x.own["flow_moment"].T
    lever = thrust * x.propeller_diameter / x.hover_induced_velocity
    return p["roll"] * right * lever, -p["pitch"] * forward * lever, 0.0 * thrust


def _gain(name: str) -> Parameter:
    """Smallest: a wind of half a m/s that nobody reports."""
    return Parameter(name=name, unit="1", lower=-1.0, upper=1.0, scale=0.1, smallest=0.01)


FLOW_MOMENT = Effect(
    name="flow_moment",
    kind=Kind.MOMENTS,
    parameters=(_gain("roll"), _gain("pitch")),
    needs=("flow_moment", "hover_induced_velocity"),
    neutral={"flow_moment": 0.0},
    of_every_aircraft=True,
    source="flapping of advancing and retreating blades, and front rotors in cleaner air than rear "
    "ones: moment = gain x thrust x propeller diameter x speed / induced velocity of hover",
    # Slow under its load, a sprayer shows too little of it: looked for there, it takes the place
    # of a speed channel that is late.
    with_tank=False,
    own_channel=flow,
    apply=_lifted,
)

EFFECTS = (FLOW_MOMENT,)
