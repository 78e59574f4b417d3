"""Drag area that the model lacks, as of a hose or an open hatch."""

from __future__ import annotations

import numpy as np

from thrustmargin.models.effects.base import Effect, Kind, Parameter
from thrustmargin.models.effects.channels import ALONG_SPAN, Channels, derivative_look
from thrustmargin.models.physics.atmosphere import G0


def _dragged(p, x: Channels, thrust):
    area = p["drag_area"]
    pressure = 0.5 * x.density * x.airspeed**2
    pushed = 2.0 * pressure * area * thrust / G0 * x.along_acceleration
    square = thrust**2 + pressure**2 * area * abs(area) + pushed
    floor = 0.25 * thrust**2
    return np.sqrt(np.where(square > floor, square, floor))


PARASITE_DRAG = Effect(
    name="parasite_drag",
    kind=Kind.DEMAND,
    parameters=(
        Parameter(
            name="drag_area",
            unit="m^2",
            start=0.5,
            lower=-1.0,  # no more than the model itself can have of it
            upper=6.0,
            scale=1.0,
            smallest=0.05,  # hoses, wet covers, and wind that nobody reports
        ),
    ),
    needs=("airspeed", "density"),
    neutral={"airspeed": 0.0},
    of_every_aircraft=True,
    source="thrust carries weight, drag and acceleration: |m (a - g) - D|, D = rho CdA V^2 / 2, so "
    "its square has D^2 and, while speeding up along the way, 2 D m a",
    apply=_dragged,
    looks=lambda p: (derivative_look(ALONG_SPAN), derivative_look(ALONG_SPAN)),
)

EFFECTS = (PARASITE_DRAG,)
