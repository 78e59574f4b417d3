"""Thrust that falls as air comes in from above."""

from __future__ import annotations

import numpy as np

from thrustmargin.models.effects.base import Effect, Kind, Parameter
from thrustmargin.models.effects.channels import Channels

CLIMB_SHARE = 0.15  # of the scatter of axial inflow, that must be climbing to be called so


def _weight(p, x: Channels):
    inflow = np.std(x.advance_ratio)
    return np.std(x.climb_ratio) / (CLIMB_SHARE * inflow) if inflow > 0.0 else 0.0


CLIMB_INFLOW = Effect(
    name="climb_inflow",
    kind=Kind.COEFFICIENT,
    # Smallest: 0.3 % of the thrust at 2 m/s, by up- and downdraughts.
    parameters=(
        Parameter(name="slope", unit="1", lower=-2.0, upper=6.0, scale=1.0, smallest=0.05),
    ),
    needs=("advance_ratio",),
    neutral={"advance_ratio": 0.0},
    of_every_aircraft=True,
    source="blade element: thrust falls with the advance ratio of the axial inflow, J = w 60/(N D)",
    distinguished_by="climb and descend at a steady rate at one tank level",
    apply=lambda p, x: 1.0 - p["slope"] * x.advance_ratio,
    weight=_weight,
)

EFFECTS = (CLIMB_INFLOW,)
