"""The rotors' own moment in forward flight: it lifts the side that meets the air."""

from __future__ import annotations

from thrustmargin.models.effects.base import Effect, Kind, Parameter
from thrustmargin.models.effects.channels import Channels


def _lifted(p, x: Channels, thrust, xp):
    east, north = xp.sin(x.heading), xp.cos(x.heading)
    forward = x.velocity_north * north + x.velocity_east * east
    right = x.velocity_east * north - x.velocity_north * east
    lever = thrust * x.propeller_diameter / x.hover_induced_velocity
    return p["roll"] * right * lever, -p["pitch"] * forward * lever, 0.0 * thrust


def _gain(name: str) -> Parameter:
    """Smallest: a wind of half a m/s that nobody reports."""
    return Parameter(name=name, unit="1", lower=-1.0, upper=1.0, scale=0.1, smallest=0.01)


FLOW_MOMENT = Effect(
    name="flow_moment",
    kind=Kind.MOMENTS,
    parameters=(_gain("roll"), _gain("pitch")),
    needs=("velocity_north", "velocity_east", "heading", "hover_induced_velocity"),
    neutral={"velocity_north": 0.0, "velocity_east": 0.0, "heading": 0.0},
    shape_channels=("airspeed",),
    source="flapping of advancing and retreating blades, and front rotors in cleaner air than rear "
    "ones: moment = gain x thrust x propeller diameter x speed / induced velocity of hover, taken "
    "in still air",
    distinguished_by="a straight line flown forwards, backwards and sideways at one speed",
    # Slow under its load, a sprayer shows too little of it: looked for there, it takes the place
    # of a speed channel that is late.
    with_tank=False,
    apply=_lifted,
)

EFFECTS = (FLOW_MOMENT,)
