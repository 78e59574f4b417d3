"""What the thrust carries: mass that the tank gauge does not see, and turns, climbs and gusts."""

from __future__ import annotations

from dataclasses import replace

from thrustmargin.models.effects.base import Effect, Kind, Parameter, shaping
from thrustmargin.models.effects.channels import LOAD_LOOK, Channels, lag_weights, shifts_look

EXTRA_MASS = Effect(
    name="extra_mass",
    kind=Kind.DEMAND,
    parameters=(
        # Smallest: 0.5 % of the empty aircraft, by what is taken along or left in hoses.
        Parameter(name="mass", unit="kg", lower=-10.0, upper=20.0, scale=2.0, smallest=0.1),
    ),
    needs=("total_mass",),
    source="weight: mass that the tank gauge does not see",
    apply=lambda p, x, thrust: thrust * (1.0 + p["mass"] / x.total_mass),
    on_airframe=lambda p, airframe, rotor: replace(
        airframe, empty_mass=airframe.empty_mass + float(p["mass"])
    ),
)


def _loaded(p, x: Channels, thrust):
    weights = lag_weights(p["lag"] - x.delay, p["derivative_correction"])
    kinematic = x.load_factor_shifts @ weights
    felt = x.manoeuvre_load_shifts @ weights
    blend = kinematic + p["imu_share"] * (felt - kinematic)
    return thrust * (1.0 + p["gain"] * (blend - 1.0))


LOAD_FACTOR = Effect(
    name="load_factor",
    kind=Kind.DEMAND,
    parameters=(
        Parameter(
            name="gain",
            unit="1",
            start=0.5,
            lower=-0.5,
            upper=2.0,
            scale=1.0,
            smallest=0.05,  # by how well a velocity a few times a second shows an acceleration
            accuracy=0.05,  # of the derivative of a velocity that is sampled and noisy
        ),
        shaping("imu_share", "1", start=0.5, lower=0.0, upper=1.0, scale=1.0),
        shaping("derivative_correction", "1", start=0.0, lower=-0.33, upper=0.5, scale=0.2),
        shaping("lag", "s", start=0.05, lower=0.0, upper=0.3, scale=0.2),
    ),
    needs=("load_factor_shifts",),
    neutral={"load_factor_shifts": 1.0, "manoeuvre_load_shifts": 1.0},
    of_every_aircraft=True,
    source="Newton: thrust over weight is |specific force| / g in turns, climbs and gusts; "
    "the derivative correction gives back what reports a few times a second smooth away, or "
    "smooths their noise",
    apply=_loaded,
    change=lambda effect, has, scatter: None,  # Newton's law is the same on every day
    looks=lambda p: shifts_look(p["lag"], LOAD_LOOK),
)

EFFECTS = (EXTRA_MASS, LOAD_FACTOR)
