"""Channels that come late: the airspeed, or all rotor speeds."""

from __future__ import annotations

from thrustmargin.models.effects.base import Effect, Kind, Parameter
from thrustmargin.models.effects.channels import Channels, lag_weights, shifts_look
from thrustmargin.models.effects.inputs.airspeed_sensor import of_sensor


def _airspeed_late(p, x: Channels, airspeed, tank_kg):
    late = lag_weights(p["lag"] - x.delay) - lag_weights(-x.delay)
    return airspeed + x.airspeed_shifts @ late, tank_kg


def _rotor_speed_late(p, x: Channels, airspeed, tank_kg):
    late = lag_weights(-p["lag"]) - lag_weights(0.0)
    return airspeed + x.airspeed_shifts @ late, tank_kg


SENSOR_LAG = Effect(
    name="sensor_lag",
    kind=Kind.INPUT,
    parameters=(Parameter(name="lag", unit="s", lower=-0.5, upper=0.5, scale=0.2, smallest=0.05),),
    needs=("airspeed", "sensor_lag"),
    own_channel=of_sensor,
    neutral={"airspeed_shifts": lambda p, x: x.airspeed[:, None]},
    source="the airspeed channel reports late by `lag`",
    apply=_airspeed_late,
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
            lower=-0.2,
            upper=1.4,
            scale=0.2,
            smallest=0.05,  # half an interval of telemetry at 10 Hz
            resolution=0.01,
        ),
    ),
    needs=("airspeed_shifts",),
    neutral={"airspeed_shifts": lambda p, x: x.airspeed[:, None]},
    source="the rotor speeds are reported late by `lag`: telemetry that queues or comes rarely",
    apply=_rotor_speed_late,
    looks=lambda p: shifts_look(0.0),
    delays=True,
)

EFFECTS = (SENSOR_LAG, ROTOR_SPEED_LAG)
