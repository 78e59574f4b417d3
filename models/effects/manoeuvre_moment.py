"""Moments that turning takes: inertia and damping. FRD axes."""

from __future__ import annotations

from thrustmargin.models.effects.base import GUESSED_TORQUE, Effect, Kind, Parameter, shaping
from thrustmargin.models.effects.channels import (
    RATE_SPAN,
    Channels,
    derivative_look,
    lag_weights,
    shifts_look,
)

SAMPLED = 0.04  # what the derivative of a rate that is sampled and noisy is good for
MOST_DAMPING = 300.0  # a rate loop answers gusts: where speeds are commands, against the rate
AXES = ("roll", "pitch", "yaw")


def _turned(p, x: Channels, thrust):
    weights = lag_weights(p["lag"] - x.delay)
    tilt, yaw = (lag_weights(p["lag"] - x.delay, p[f"sharpening_{of}"]) for of in ("tilt", "yaw"))
    loaded = (thrust / x.empty_weight) ** p["load_exponent"]
    axes = zip(AXES, x.rate_shifts, x.acceleration_shifts, (tilt, tilt, yaw), strict=True)
    return tuple(
        acceleration @ (p[f"inertia_{axis}"] * sharpened) * loaded
        + rate @ (p[f"damping_{axis}"] * weights)
        for axis, rate, acceleration, sharpened in axes
    )


def _turning(name: str, unit: str, most: float) -> Parameter:
    return Parameter(
        name=name,
        unit=unit,
        lower=-most,
        upper=most,
        scale=5.0,
        smallest=0.2,  # liquid that moves, and air that the turn stirs
        accuracy=GUESSED_TORQUE if name.endswith("yaw") else SAMPLED,
        of_torque=name.endswith("yaw"),
    )


MANOEUVRE_MOMENT = Effect(
    name="manoeuvre_moment",
    kind=Kind.MOMENTS,
    parameters=(
        *(_turning(f"inertia_{axis}", "kg m^2", 60.0) for axis in AXES),
        *(_turning(f"damping_{axis}", "N m s", MOST_DAMPING) for axis in AXES),
        shaping("load_exponent", "1", start=0.0, lower=-2.0, upper=2.0, scale=0.5),
        shaping("sharpening_tilt", "1", start=1.0 / 12.0, lower=-0.33, upper=0.5, scale=0.2),
        shaping("sharpening_yaw", "1", start=1.0 / 12.0, lower=-0.33, upper=0.5, scale=0.2),
        shaping("lag", "s", start=0.02, lower=0.0, upper=0.3, scale=0.1),
    ),
    needs=("rate_shifts",),
    neutral={"rate_shifts": 0.0, "acceleration_shifts": 0.0},
    source="Euler: moment = I d(omega)/dt + damping x omega; I goes with the load, as liquid and "
    "hidden mass change it; sharpening gives back what differences of a sampled rate smooth away",
    distinguished_by="sharp turns about each axis in a hover",
    apply=_turned,
    looks=lambda p: shifts_look(p["lag"], derivative_look(RATE_SPAN)),
)

EFFECTS = (MANOEUVRE_MOMENT,)
