"""Air through the rotors that changes their thrust: climbing, in forward flight, near ground."""

from __future__ import annotations

import numpy as np

from thrustmargin.models.effects.base import Effect, Kind, Parameter
from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.physics.forward_flight import induced_ratio

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
    apply=lambda p, x: 1.0 - p["slope"] * x.advance_ratio,
    weight=_weight,
)


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
    apply=_kappa,
)

GROUND_EFFECT = Effect(
    name="ground_effect",
    kind=Kind.COEFFICIENT,
    parameters=(
        # Ground never takes thrust away. Smallest: what slopes and crops change of a lone rotor's.
        Parameter(
            name="strength", unit="1", start=0.0625, lower=0.0, upper=3.0, scale=0.2, smallest=0.02
        ),
    ),
    needs=("radius_over_height",),
    neutral={"radius_over_height": 0.0},
    source="Cheeseman and Bennett: 1/kappa = 1 - k (R/z)^2, k = 1/16 for one rotor",
    apply=lambda p, x: 1.0 / (1.0 - p["strength"] * x.radius_over_height**2),
)

EFFECTS = (CLIMB_INFLOW, TRANSLATIONAL_LIFT, GROUND_EFFECT)
