"""Mass that the tank gauge does not see."""

from __future__ import annotations

from dataclasses import replace

from thrustmargin.models.effects.base import Effect, Kind, Parameter

EXTRA_MASS = Effect(
    name="extra_mass",
    kind=Kind.DEMAND,
    parameters=(
        # Smallest: 0.5 % of the empty aircraft, by what is taken along or left in hoses.
        Parameter(name="mass", unit="kg", lower=-10.0, upper=20.0, scale=2.0, smallest=0.1),
    ),
    needs=("total_mass",),
    source="weight: mass that the tank gauge does not see",
    distinguished_by="weigh the aircraft, or hover 60 s full and 60 s empty",
    apply=lambda p, x, thrust: thrust * (1.0 + p["mass"] / x.total_mass),
    on_airframe=lambda p, airframe, rotor: replace(
        airframe, empty_mass=airframe.empty_mass + float(p["mass"])
    ),
)

EFFECTS = (EXTRA_MASS,)
