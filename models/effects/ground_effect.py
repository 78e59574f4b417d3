"""More thrust near the ground."""

from __future__ import annotations

from thrustmargin.models.effects.base import Effect, Kind, Parameter

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
    distinguished_by="hover at one and at five rotor radii above ground",
    apply=lambda p, x: 1.0 / (1.0 - p["strength"] * x.radius_over_height**2),
)

EFFECTS = (GROUND_EFFECT,)
