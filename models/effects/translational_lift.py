"""Lift of forward flight that the model lacks."""

from __future__ import annotations

from thrustmargin.models.effects.base import Effect, Kind, Parameter
from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.physics.forward_flight import induced_ratio


def _kappa(p, x: Channels):
    return 1.0 + p["gain"] * (1.0 - induced_ratio(x.airspeed / x.hover_induced_velocity))


TRANSLATIONAL_LIFT = Effect(
    name="translational_lift",
    kind=Kind.COEFFICIENT,
    # Smallest: a wind of 1 m/s that nobody reports.
    parameters=(Parameter(name="gain", unit="1", lower=-0.5, upper=1.0, scale=0.1, smallest=0.01),),
    needs=("airspeed", "hover_induced_velocity"),
    neutral={"airspeed": 0.0},
    of_every_aircraft=True,
    source="Glauert: induced velocity in forward flight, v_i/v_h = sqrt(sqrt(1 + m^4/4) - m^2/2), "
    "m = V/v_h",
    distinguished_by="a straight line flown fast and slow at the same tank level",
    apply=_kappa,
)

EFFECTS = (TRANSLATIONAL_LIFT,)
