"""Effects on the moments: how the rotors share the collective thrust. FRD axes, N m."""

from __future__ import annotations

from thrustmargin.models.effects.base import Effect, Kind, Parameter
from thrustmargin.models.effects.channels import (
    RATE_SPAN,
    Channels,
    derivative_look,
    lag_weights,
    shifts_look,
)


def _cg_fixed(p, x: Channels, thrust, xp):  # noqa: ARG001
    return -p["y"] * thrust, p["x"] * thrust, 0.0 * thrust


def _cg_with_tank(p, x: Channels, thrust, xp):  # noqa: ARG001
    full = x.tank_kg / x.tank_capacity_kg
    return -p["y_full"] * full * thrust, p["x_full"] * full * thrust, 0.0 * thrust


def _yaw_trim(p, x: Channels, thrust, xp):  # noqa: ARG001
    return 0.0 * thrust, 0.0 * thrust, p["moment"] + 0.0 * thrust


def _manoeuvre(p, x: Channels, thrust, xp):
    weights = lag_weights(p["lag"] - x.delay, xp)
    tilt, yaw = (
        lag_weights(p["lag"] - x.delay, xp, p[f"sharpening_{of}"]) for of in ("tilt", "yaw")
    )
    loaded = (thrust / x.empty_weight) ** p["load_exponent"]
    names, sharp = ("roll", "pitch", "yaw"), (tilt, tilt, yaw)
    axes = zip(names, x.rate_shifts, x.acceleration_shifts, sharp, strict=True)
    return tuple(
        acceleration @ (p[f"inertia_{axis}"] * sharpened) * loaded
        + rate @ (p[f"damping_{axis}"] * weights)
        for axis, rate, acceleration, sharpened in axes
    )


def _offset(name: str) -> Parameter:
    return Parameter(
        name=name,
        unit="m",
        absent=0.0,
        start=0.0,
        lower=-0.5,
        upper=0.5,
        scale=0.05,
        smallest=0.003,
        accuracy=0.01,  # lift of forward flight adds to each rotor's thrust, here it multiplies it
    )


def _turning(kind: str, axis: str, unit: str) -> Parameter:
    return Parameter(
        name=f"{kind}_{axis}",
        unit=unit,
        absent=0.0,
        start=0.0,
        lower=-60.0,
        upper=60.0,
        scale=5.0,
        smallest=0.2,
        accuracy=0.04,  # of the derivative of a rate that is sampled and noisy
    )


def _sharpening(of: str) -> Parameter:
    return Parameter(
        name=f"sharpening_{of}",
        unit="1",
        absent=None,
        start=1.0 / 12.0,
        lower=-0.33,
        upper=0.5,
        scale=0.2,
        detail=True,
    )


CG_OFFSET = Effect(
    name="cg_offset",
    kind=Kind.MOMENTS,
    parameters=(_offset("x"), _offset("y")),
    needs=(),
    shape_channels=("tank_kg",),
    source="balance of moments: thrust stands off the centre of gravity by (x, y)",
    tell="hover 60 s full and 60 s empty; then swap the rotor pair in question",
    apply=_cg_fixed,
)

CG_OFFSET_TANK = Effect(
    name="cg_offset",
    variant="tank",
    kind=Kind.MOMENTS,
    parameters=(_offset("x_full"), _offset("y_full")),
    needs=("tank_kg",),
    shape_channels=("tank_kg",),
    source="balance of moments: a tank mounted off centre shifts the balance as it fills",
    tell="hover 60 s full and 60 s empty",
    apply=_cg_with_tank,
)

YAW_TRIM = Effect(
    name="yaw_trim",
    kind=Kind.MOMENTS,
    parameters=(
        Parameter(
            name="moment",
            unit="N m",
            absent=0.0,
            start=0.0,
            lower=-20.0,
            upper=20.0,
            scale=1.0,
            smallest=0.1,
        ),
    ),
    needs=(),
    shape_channels=(),
    source="a tilted motor turns part of its thrust into a constant yaw moment",
    tell="measure the tilt of the arms, or hover 60 s at two tank levels",
    apply=_yaw_trim,
)

MANOEUVRE_MOMENT = Effect(
    name="manoeuvre_moment",
    kind=Kind.MOMENTS,
    parameters=(
        *(_turning("inertia", axis, "kg m^2") for axis in ("roll", "pitch", "yaw")),
        *(_turning("damping", axis, "N m s") for axis in ("roll", "pitch", "yaw")),
        Parameter(
            name="load_exponent",
            unit="1",
            absent=None,
            start=0.0,
            lower=-2.0,
            upper=2.0,
            scale=0.5,
            detail=True,
        ),
        *(_sharpening(of) for of in ("tilt", "yaw")),
        Parameter(
            name="lag",
            unit="s",
            absent=None,
            start=0.02,
            lower=0.0,
            upper=0.3,
            scale=0.1,
            detail=True,
        ),
    ),
    needs=("rate_shifts",),
    shape_channels=("yaw_acceleration", "yaw_rate"),
    source="Euler: moment = I d(omega)/dt + damping x omega; I goes with the load, as liquid and "
    "hidden mass change it; sharpening gives back what differences of a sampled rate smooth away",
    tell="sharp turns about each axis in a hover",
    apply=_manoeuvre,
    looks=lambda p: shifts_look(p["lag"], derivative_look(RATE_SPAN)),
)
