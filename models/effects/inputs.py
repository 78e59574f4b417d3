"""Effects on the inputs: what the airspeed and the tank mass really were."""

from __future__ import annotations

from math import cos, pi, sin

from thrustmargin.models.effects.base import Effect, Kind, Parameter
from thrustmargin.models.effects.channels import Channels, lag_weights, shifts_look

LEAST_AIRSPEED_ERROR = 0.8  # m/s RMS: a gust or two off is no missing wind


def _wind(p, x: Channels, airspeed, tank_kg, xp):  # noqa: ARG001
    north = x.velocity_north - p["wind_north"]
    east = x.velocity_east - p["wind_east"]
    return xp.sqrt(north**2 + east**2 + 1e-6), tank_kg


def _wind_weight(p, x: Channels, xp):
    airspeed, _ = _wind(p, x, x.airspeed, x.tank_kg, xp)
    return xp.sqrt(xp.mean((airspeed - x.airspeed) ** 2)) / LEAST_AIRSPEED_ERROR


def _tank_scale(p, x: Channels, airspeed, tank_kg, xp):  # noqa: ARG001
    return airspeed, tank_kg * p["gain"]


def _sensor_lag(p, x: Channels, airspeed, tank_kg, xp):
    late = lag_weights(p["lag"] - x.delay, xp) - lag_weights(-x.delay, xp)
    return airspeed + x.airspeed_shifts @ late, tank_kg


def _rotor_speed_lag(p, x: Channels, airspeed, tank_kg, xp):
    late = lag_weights(-p["lag"], xp) - lag_weights(0.0 * p["lag"], xp)
    return airspeed + x.airspeed_shifts @ late, tank_kg


WIND = Effect(
    name="wind",
    kind=Kind.INPUT,
    parameters=tuple(
        Parameter(
            name=f"wind_{axis}",
            unit="m/s",
            absent=None,
            start=0.0,
            lower=-20.0,
            upper=20.0,
            scale=5.0,
            smallest=1.0,
            per_flight=True,
        )
        for axis in ("north", "east")
    ),
    needs=("airspeed", "velocity_north", "velocity_east"),
    shape_channels=("velocity_north", "velocity_east"),
    source="airspeed is the speed over ground less the wind",
    tell="one line flown both ways at the same speed and tank level",
    apply=_wind,
    weight=_wind_weight,
    affine=True,
    seeds=tuple(
        {"wind_north": 5.0 * cos(pi * k / 4), "wind_east": 5.0 * sin(pi * k / 4)} for k in range(8)
    ),
)

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
    tell="hover 60 s full and 60 s empty",
    apply=_tank_scale,
)

SENSOR_LAG = Effect(
    name="sensor_lag",
    kind=Kind.INPUT,
    parameters=(
        Parameter(
            name="lag",
            unit="s",
            absent=0.0,
            start=0.0,
            lower=-0.5,
            upper=0.5,
            scale=0.2,
            smallest=0.05,
        ),
    ),
    needs=("airspeed",),
    shape_channels=("airspeed",),
    source="the airspeed channel reports late by `lag`",
    tell="quick changes of speed: accelerate and brake on a straight line",
    apply=_sensor_lag,
    looks=lambda p: shifts_look(p["lag"]),
)

ROTOR_SPEED_LAG = Effect(
    name="sensor_lag",
    variant="rotor speed",
    kind=Kind.INPUT,
    parameters=(
        Parameter(
            name="lag",
            unit="s",
            absent=0.0,
            start=0.0,
            lower=-0.2,
            upper=1.4,
            scale=0.2,
            smallest=0.05,
            resolution=0.01,
        ),
    ),
    needs=("airspeed_shifts",),
    shape_channels=("airspeed", "yaw_rate", "yaw_acceleration", "load_factor"),
    source="the rotor speeds are reported late by `lag`: telemetry that queues or comes rarely",
    tell="quick changes of speed and heading: accelerate, brake and turn",
    apply=_rotor_speed_lag,
    looks=lambda p: shifts_look(0.0),  # noqa: ARG005
    delays=True,
)
