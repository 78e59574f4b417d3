"""Yaw moments: a steady one, as of a tilted motor, and that of air from the side."""

from __future__ import annotations

from thrustmargin.models.effects.base import GUESSED_TORQUE, Effect, Kind, Parameter
from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.effects.moments.flow_moment import flow
from thrustmargin.models.physics.atmosphere import G0


def _tilted(p, x: Channels, thrust):
    at_half_a_tank = x.empty_weight + G0 * x.tank_capacity_kg / 2.0
    return 0.0 * thrust, 0.0 * thrust, p["moment"] * thrust / at_half_a_tank


YAW_TRIM = Effect(
    name="yaw_trim",
    kind=Kind.MOMENTS,
    parameters=(
        Parameter(
            name="moment",
            unit="N m",
            lower=-20.0,
            upper=20.0,
            scale=1.0,
            smallest=0.1,  # one motor tilted by 0.1 degrees
            accuracy=GUESSED_TORQUE,
            of_torque=True,
        ),
    ),
    of_every_aircraft=True,
    source="a tilted motor turns part of its thrust into a yaw moment, in proportion to it; the "
    "moment is that of a hover with half a tank",
    apply=_tilted,
)


def _turned(p, x: Channels, thrust):
    right = x.own["weathervane"][:, 1]
    return 0.0 * thrust, 0.0 * thrust, -p["lever"] * right / x.hover_induced_velocity * thrust


WEATHERVANE = Effect(
    name="weathervane",
    kind=Kind.MOMENTS,
    parameters=(
        Parameter(
            name="lever",
            unit="m",
            lower=-0.2,
            upper=0.2,
            scale=0.02,
            smallest=0.002,  # a wind of half a m/s that nobody reports
            accuracy=GUESSED_TORQUE,
            of_torque=True,
        ),
    ),
    needs=("weathervane", "hover_induced_velocity"),
    neutral={"weathervane": 0.0},
    of_every_aircraft=True,
    source="drag that acts ahead of the centre of gravity or behind it: moment = lever x thrust x "
    "sideways speed / induced velocity of hover",
    with_tank=False,  # as the moment of flow
    own_channel=flow,
    apply=_turned,
)

EFFECTS = (YAW_TRIM, WEATHERVANE)
