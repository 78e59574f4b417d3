"""Thrust that all rotors lose as time goes on."""

from __future__ import annotations

from thrustmargin.models.effects.base import Effect, Kind, Parameter

THRUST_DRIFT = Effect(
    name="thrust_drift",
    kind=Kind.COEFFICIENT,
    parameters=(
        # Smallest: air that warms by 3 K in 10 minutes.
        Parameter(name="rate", unit="1/s", lower=-1e-3, upper=2e-3, scale=1e-4, smallest=1.7e-5),
    ),
    source="icing, fouling or dust: all rotors lose thrust as time goes on",
    distinguished_by="hover 60 s full and 60 s empty, then again with the tank held level",
    apply=lambda p, x: 1.0 - p["rate"] * x.time_s,
)

EFFECTS = (THRUST_DRIFT,)
