"""Effects on the demand: the collective thrust that the flight asks for."""

from __future__ import annotations

from thrustmargin.models.effects.base import Effect, Kind, Parameter
from thrustmargin.models.effects.channels import (
    ALONG_SPAN,
    LOAD_LOOK,
    Channels,
    derivative_look,
    lag_weights,
    shifts_look,
)
from thrustmargin.models.physics.atmosphere import G0


def _extra_mass(p, x: Channels, thrust, xp):  # noqa: ARG001
    return thrust * (1.0 + p["mass"] / x.total_mass)


def _parasite_drag(p, x: Channels, thrust, xp):
    area = p["drag_area"]
    pressure = 0.5 * x.density * x.airspeed**2
    pushed = 2.0 * pressure * area * thrust / G0 * x.along_acceleration
    square = thrust**2 + pressure**2 * area * xp.abs(area) + pushed
    floor = 0.25 * thrust**2
    return xp.sqrt(xp.where(square > floor, square, floor))


def _load_factor(p, x: Channels, thrust, xp):
    weights = lag_weights(p["lag"] - x.delay, xp, p["sharpening"])
    kinematic = x.load_factor_shifts @ weights
    felt = x.manoeuvre_load_shifts @ weights
    blend = kinematic + p["imu_share"] * (felt - kinematic)
    return thrust * (1.0 + p["gain"] * (blend - 1.0))


EXTRA_MASS = Effect(
    name="extra_mass",
    kind=Kind.DEMAND,
    parameters=(
        Parameter(
            name="mass",
            unit="kg",
            absent=0.0,
            start=0.0,
            lower=-10.0,
            upper=20.0,
            scale=2.0,
            smallest=0.15,
        ),
    ),
    needs=("total_mass",),
    shape_channels=("tank_kg",),
    source="weight: mass that the tank gauge does not see",
    tell="weigh the aircraft, or hover 60 s full and 60 s empty",
    apply=_extra_mass,
)

PARASITE_DRAG = Effect(
    name="parasite_drag",
    kind=Kind.DEMAND,
    parameters=(
        Parameter(
            name="drag_area",
            unit="m^2",
            absent=0.0,
            start=0.5,
            lower=-4.0,
            upper=6.0,
            scale=1.0,
            smallest=0.05,
        ),
    ),
    needs=("airspeed", "density"),
    shape_channels=("airspeed",),
    source="thrust carries weight, drag and acceleration: |m (a - g) - D|, D = rho CdA V^2 / 2, so "
    "its square has D^2 and, while speeding up along the way, 2 D m a",
    tell="a straight line flown fast and slow at the same tank level",
    apply=_parasite_drag,
    looks=lambda p: (derivative_look(ALONG_SPAN),) * 2,  # noqa: ARG005
    affine=True,
)

LOAD_FACTOR = Effect(
    name="load_factor",
    kind=Kind.DEMAND,
    parameters=(
        Parameter(
            name="gain",
            unit="1",
            absent=0.0,
            start=0.5,
            lower=-0.5,
            upper=2.0,
            scale=1.0,
            smallest=0.05,
            accuracy=0.05,  # of the derivative of a velocity that is sampled and noisy
        ),
        Parameter(
            name="imu_share",
            unit="1",
            absent=None,
            start=0.5,
            lower=0.0,
            upper=1.0,
            scale=1.0,
            detail=True,
        ),
        Parameter(
            name="sharpening",
            unit="1",
            absent=None,
            start=0.0,
            lower=-0.33,
            upper=0.5,
            scale=0.2,
            detail=True,
        ),
        Parameter(
            name="lag",
            unit="s",
            absent=None,
            start=0.05,
            lower=0.0,
            upper=0.3,
            scale=0.2,
            detail=True,
        ),
    ),
    needs=("load_factor_shifts",),
    shape_channels=("load_factor",),
    source="Newton: thrust over weight is |specific force| / g in turns, climbs and gusts; "
    "sharpening gives back what reports a few times a second smooth away, or smooths their noise",
    tell="sharp stops and pull-ups at one tank level",
    apply=_load_factor,
    looks=lambda p: shifts_look(p["lag"], LOAD_LOOK),
    affine=True,
)
