"""Effects on the reported inputs: errors of airspeed, tank gauge and wind, and late channels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from thrustmargin.models.effects.base import Effect, Kind, Parameter, instrument_gain
from thrustmargin.models.effects.channels import Channels, lag_weights, shifts_look
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.physics.airframe import Airframe

REPEATED = 0.05  # m/s: rounding of three messages to 0.01 m/s, and what they are apart in time
MOSTLY = 0.9  # share of rows; a sensor in the rotors' flow scatters by more in nearly all


def sensor_airspeed(
    track: FlightTrack, airframe: Airframe, start: None = None
) -> tuple[Floats, None]:
    """Return the airspeed (T,) m/s of a sensor; all NaN where it only repeats velocity minus wind.

    Without a pitot tube the autopilot computes airspeed from its own velocity and wind (still air
    if unknown). Then no sensor can be wrong, only the wind.
    """
    del airframe
    through = track.velocity_ned - np.nan_to_num(track.wind_ned)
    off = np.abs(track.airspeed - np.linalg.norm(through, axis=1))
    both = np.isfinite(off)
    repeats = both.any() and float(np.mean(off[both] < REPEATED)) > MOSTLY
    return np.full_like(track.airspeed, np.nan) if repeats else track.airspeed, start


AIRSPEED_BIAS = Effect(
    name="airspeed_bias",
    kind=Kind.INPUT,
    parameters=(
        Parameter(
            name="bias",
            unit="m/s",
            lower=-5.0,
            upper=5.0,
            scale=1.0,
            smallest=0.3,  # zero of a pressure sensor, light wind in an estimate
        ),
    ),
    needs=("airspeed", "airspeed_bias"),
    own_channel=sensor_airspeed,
    source="a sensor whose zero is off: true airspeed = shown + bias, and never below nothing",
    apply=lambda p, x, airspeed, tank_kg: (np.clip(airspeed + p["bias"], 0.0, None), tank_kg),
)

AIRSPEED_GAIN = Effect(
    name="airspeed_gain",
    kind=Kind.INPUT,
    # Smallest: half the share by which air is thinner on a warm day or a hill.
    parameters=(instrument_gain(0.03),),
    needs=("airspeed", "airspeed_gain"),
    own_channel=sensor_airspeed,
    source="a pitot tube in the rotors' flow, or thin air read as dense: true airspeed = gain x "
    "shown",
    apply=lambda p, x, airspeed, tank_kg: (airspeed * p["gain"], tank_kg),
)


def _delayed_airspeed(p, x: Channels, airspeed, tank_kg):
    """Undo a delay of the airspeed channel."""
    late = lag_weights(p["lag"] - x.delay) - lag_weights(-x.delay)
    return airspeed + x.airspeed_shifts @ late, tank_kg


def _delayed_rotor_speed(p, x: Channels, airspeed, tank_kg):
    """Shift the airspeed to the time of rotor speeds that are reported late."""
    late = lag_weights(-p["lag"]) - lag_weights(0.0)
    return airspeed + x.airspeed_shifts @ late, tank_kg


SENSOR_LAG = Effect(
    name="sensor_lag",
    kind=Kind.INPUT,
    parameters=(Parameter(name="lag", unit="s", lower=-0.5, upper=0.5, scale=0.2, smallest=0.05),),
    needs=("airspeed", "sensor_lag"),
    own_channel=sensor_airspeed,
    neutral={"airspeed_shifts": lambda p, x: x.airspeed[:, None]},
    source="the airspeed channel reports late by `lag`",
    apply=_delayed_airspeed,
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
    apply=_delayed_rotor_speed,
    looks=lambda p: shifts_look(0.0),
    delays=True,
)


LEAST_SPREAD = 0.02  # share of the tank, between flights: a smaller spread is a mass on board


def _offset_spread(p, x: Channels):
    """Return the spread of offsets between flights over the least that is reported."""
    return np.std(p["offset"]) / (LEAST_SPREAD * x.tank_capacity_kg)


TANK_SCALE = Effect(
    name="tank_scale",
    kind=Kind.INPUT,
    # Smallest: density of the liquid, and slope of a level or load sensor.
    parameters=(instrument_gain(0.01),),
    needs=("tank_kg",),
    source="a gauge whose slope is wrong: true mass = gain x shown mass",
    apply=lambda p, x, airspeed, tank_kg: (airspeed, tank_kg * p["gain"]),
)

TANK_ZERO = Effect(
    name="tank_zero",
    kind=Kind.INPUT,
    parameters=(
        Parameter(
            name="offset",
            unit="kg",
            lower=-5.0,
            upper=5.0,
            scale=0.5,
            smallest=0.1,  # how well a load cell is set to zero, and what stays in the hoses
            per_flight=True,  # set anew at each start; what never changes is a mass on board
        ),
    ),
    needs=("tank_kg",),
    source="a gauge that is set to zero anew before each flight: true mass = shown mass + offset",
    apply=lambda p, x, airspeed, tank_kg: (airspeed, tank_kg + p["offset"]),
    weight=_offset_spread,
    by_flights=True,
)

TANK_DRIFT = Effect(
    name="tank_drift",
    kind=Kind.INPUT,
    parameters=(
        Parameter(
            name="rate",
            unit="kg/s",
            lower=-0.02,
            upper=0.02,
            scale=1e-3,
            smallest=1.5e-4,  # 0.1 kg in 10 minutes: a load cell that warms, a flow meter's share
        ),
    ),
    needs=("tank_kg",),
    source="a gauge that drifts, or adds up a flow that is wrong: true mass = shown mass + rate x "
    "time since the start",
    apply=lambda p, x, airspeed, tank_kg: (airspeed, tank_kg + p["rate"] * x.time_s),
)


LEAST_AIRSPEED_ERROR = 0.8  # m/s RMS: less may be gusts


def _through_air(p, x: Channels, airspeed, tank_kg):
    """Return the airspeed (T,) m/s by ground velocity and the wind's parameters."""
    north = x.velocity_north - p["wind_north"]
    east = x.velocity_east - p["wind_east"]
    return np.sqrt(north**2 + east**2 + 1e-6), tank_kg


def _wind_weight(p, x: Channels):
    """Return the RMS change of airspeed over the least that is reported."""
    airspeed, _ = _through_air(p, x, x.airspeed, x.tank_kg)
    return np.sqrt(np.mean((airspeed - x.airspeed) ** 2)) / LEAST_AIRSPEED_ERROR


def _wind_component(name: str) -> Parameter:
    """Return the parameter of one component of the wind."""
    return Parameter(
        name=name,
        unit="m/s",
        absent=None,
        lower=-20.0,
        upper=20.0,
        scale=5.0,
        smallest=1.0,  # what gusts leave of a mean over a flight
        per_flight=True,
    )


WIND = Effect(
    name="wind",
    kind=Kind.INPUT,
    parameters=(_wind_component("wind_north"), _wind_component("wind_east")),
    needs=("airspeed", "velocity_north", "velocity_east"),
    neutral={
        "velocity_north": lambda p, x: p["wind_north"] + x.airspeed,
        "velocity_east": lambda p, x: p["wind_east"],
    },
    source="airspeed is the speed over ground less the wind",
    apply=_through_air,
    weight=_wind_weight,
)

#: A wind beyond the training range, which the reported airspeed already contains.
FOLLOWED_WIND = replace(WIND, variant="already followed")


EFFECTS = (
    AIRSPEED_BIAS,
    AIRSPEED_GAIN,
    SENSOR_LAG,
    ROTOR_SPEED_LAG,
    TANK_SCALE,
    TANK_ZERO,
    TANK_DRIFT,
    WIND,
)
