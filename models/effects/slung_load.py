"""A load on a cable: it swings, so its pull is not its share of the aircraft's own load factor."""

from __future__ import annotations

from math import log

from thrustmargin.models.effects.base import Effect, Kind, Parameter
from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.effects.pendulum import LENGTHS, RATIO, SHORTEST, cable_pull
from thrustmargin.models.effects.size import ARM
from thrustmargin.models.physics.atmosphere import G0

BRACKETS = 7  # pieces of the range of lengths, each searched from its middle
OVERLAP = 1.1


def _slung_load(p, x: Channels, thrust, xp):
    columns = xp.arange(LENGTHS, dtype=xp.float64)
    u = xp.abs(xp.log(p["cable"] / x.shortest_cable + 0.0 * columns) / log(RATIO) - columns)
    near = (1.5 * u - 2.5) * u * u + 1.0  # cubic convolution (Keys 1981), as for delays
    far = ((-0.5 * u + 2.5) * u - 4.0) * u + 2.0
    weights = xp.where(u < 1, near, xp.where(u < 2, far, 0.0 * u))
    return thrust + p["mass"] * G0 * (x.own["slung_load"] @ weights)


def _bracket(number: int) -> Effect:
    """The effect with the cable in one piece of the range: the fit follows a swing's phase only
    from a length near the true one."""
    width = RATIO ** ((LENGTHS - 1) / BRACKETS)
    low, longest = SHORTEST * width**number, SHORTEST * RATIO ** (LENGTHS - 1)
    return Effect(
        name="slung_load",
        variant=f"cable of {low:.0f} to {low * width:.0f} arms",
        kind=Kind.DEMAND,
        parameters=(
            Parameter(
                name="mass",
                unit="kg",
                absent=0.0,
                start=0.0,
                lower=-2.0,
                upper=20.0,
                scale=2.0,
                smallest=0.15,
            ),
            Parameter(
                name="cable",
                unit="m",
                absent=None,
                start=low * width**0.5 * ARM,
                lower=max(SHORTEST, low / OVERLAP) * ARM,
                upper=min(longest, low * width * OVERLAP) * ARM,
                scale=0.2 * low * ARM,
                detail=True,
            ),
        ),
        needs=("slung_load",),
        shape_channels=(),
        source="a load on a cable swings as a spherical pendulum below the aircraft, driven by the "
        "specific force that the aircraft feels; its mass is part of the weight already",
        tell="hover until the load hangs still, then stop sharply and let it swing",
        apply=_slung_load,
        own_channel=cable_pull,
    )


SLUNG_LOADS: tuple[Effect, ...] = tuple(_bracket(k) for k in range(BRACKETS))
