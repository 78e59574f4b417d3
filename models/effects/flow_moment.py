"""The rotors' own moment in forward flight: it lifts the side that meets the air."""

from __future__ import annotations

from thrustmargin.models.effects.base import Effect, Kind, Parameter
from thrustmargin.models.effects.channels import Channels


def _flow_moment(p, x: Channels, thrust, xp):
    east, north = xp.sin(x.heading), xp.cos(x.heading)
    forward = x.velocity_north * north + x.velocity_east * east
    right = x.velocity_east * north - x.velocity_north * east
    lever = thrust * x.propeller_diameter / x.hover_induced_velocity
    return p["roll"] * right * lever, -p["pitch"] * forward * lever, 0.0 * thrust


def _gain(axis: str) -> Parameter:
    return Parameter(
        name=axis,
        unit="1",
        absent=0.0,
        start=0.0,
        lower=-1.0,
        upper=1.0,
        scale=0.1,
        smallest=0.01,
    )


FLOW_MOMENT = Effect(
    name="flow_moment",
    kind=Kind.MOMENTS,
    parameters=(_gain("roll"), _gain("pitch")),
    needs=("velocity_north", "velocity_east", "heading", "hover_induced_velocity"),
    shape_channels=("airspeed",),
    source="flapping of advancing and retreating blades, and front rotors in cleaner air than rear "
    "ones: moment = gain x thrust x propeller diameter x speed / induced velocity of hover, taken "
    "in still air",
    tell="a straight line flown forwards, backwards and sideways at one speed",
    apply=_flow_moment,
)
