"""A tank gauge whose slope is wrong."""

from __future__ import annotations

from thrustmargin.models.effects.base import Effect, Kind, Parameter

TANK_SCALE = Effect(
    name="tank_scale",
    kind=Kind.INPUT,
    parameters=(
        Parameter(
            name="gain",
            unit="1",
            absent=1.0,
            start=1.0,
            lower=0.5,
            upper=2.0,
            scale=0.1,
            smallest=0.02,
        ),
    ),
    needs=("tank_kg",),
    shape_channels=("tank_kg",),
    source="a gauge whose slope is wrong: true mass = gain x shown mass",
    distinguished_by="hover 60 s full and 60 s empty",
    apply=lambda p, x, airspeed, tank_kg, xp: (airspeed, tank_kg * p["gain"]),
)

EFFECTS = (TANK_SCALE,)
