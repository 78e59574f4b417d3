"""A centre of gravity that is not where the airframe file has it. FRD axes."""

from __future__ import annotations

from thrustmargin.models.effects.base import Effect, Kind, Parameter
from thrustmargin.models.effects.channels import Channels


def _fixed(p, x: Channels, thrust):
    return -p["y"] * thrust, p["x"] * thrust, 0.0 * thrust


def _with_tank(p, x: Channels, thrust):
    full = x.tank_kg / x.tank_capacity_kg
    return -p["y_full"] * full * thrust, p["x_full"] * full * thrust, 0.0 * thrust


def _offset(name: str) -> Parameter:
    return Parameter(
        name=name,
        unit="m",
        lower=-0.5,
        upper=0.5,
        scale=0.05,
        smallest=0.0025,  # by how a battery is put in
        accuracy=0.01,  # lift of forward flight adds to each rotor's thrust, here it multiplies it
    )


CG_OFFSET = Effect(
    name="cg_offset",
    kind=Kind.MOMENTS,
    parameters=(_offset("x"), _offset("y")),
    of_every_aircraft=True,
    source="balance of moments: thrust stands off the centre of gravity by (x, y)",
    apply=_fixed,
)

CG_OFFSET_TANK = Effect(
    name="cg_offset",
    variant="tank",
    kind=Kind.MOMENTS,
    parameters=(_offset("x_full"), _offset("y_full")),
    needs=("tank_kg",),
    of_every_aircraft=True,
    source="balance of moments: a tank mounted off centre shifts the balance as it fills",
    apply=_with_tank,
)

EFFECTS = (CG_OFFSET, CG_OFFSET_TANK)
