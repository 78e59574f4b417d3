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
from thrustmargin.models.effects.spin_up import slowed_yaw_rate, spun_up

SAMPLED = 0.04  # what the derivative of a rate that is sampled and noisy is good for
MOST_DAMPING = 300.0  # a rate loop answers gusts: where speeds are commands, against the rate
AXES = ("roll", "pitch", "yaw")


def _turned(p, x: Channels, thrust):
    lag, loaded = p["lag"] - x.delay, (thrust / x.empty_weight) ** p["load_exponent"]
    weights = lag_weights(lag)
    tilt, yaw = (lag_weights(lag, p[f"sharpening_{of}"]) for of in ("tilt", "yaw"))
    axes = zip(AXES, x.rate_shifts, x.acceleration_shifts, (tilt, tilt, yaw), strict=True)
    roll, pitch, at_once = (
        acceleration @ (p[f"inertia_{axis}"] * sharpened) * loaded
        + rate @ (p[f"damping_{axis}"] * weights)
        for axis, rate, acceleration, sharpened in axes
    )
    about_yaw = spun_up(
        x,
        x.own["manoeuvre_moment"],
        at_once,
        inertia=p["inertia_yaw"] * loaded,
        damping=p["damping_yaw"],
        lag=lag,
        constant=p["spin_up"],
    )
    return roll, pitch, about_yaw


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
        Parameter(name="spin_up", unit="s", lower=0.0, upper=1.0, scale=0.2, detail=True),
    ),
    needs=("rate_shifts",),
    neutral={"rate_shifts": 0.0, "acceleration_shifts": 0.0, "manoeuvre_moment": 0.0},
    own_channel=slowed_yaw_rate,
    source="Euler: moment = I d(omega)/dt + damping x omega; I goes with the load, as liquid and "
    "hidden mass change it; sharpening gives back what differences of a sampled rate smooth away; "
    "about yaw the rotors' own inertia acts too, by `spin_up`",
    distinguished_by="sharp turns about each axis in a hover",
    apply=_turned,
    looks=lambda p: shifts_look(p["lag"], derivative_look(RATE_SPAN)),
)

EFFECTS = (MANOEUVRE_MOMENT,)
