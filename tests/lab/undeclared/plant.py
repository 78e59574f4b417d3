"""The flying aircraft and its instruments: from a craft, a condition and a day to a FlightTrack.

What a real log has and no law explains is part of it: turbulence, uneven pushes of gusts, rotor
speed noise, a warm thermometer, a gauge with a zero and a gain of its own each flight, late
sensors, a centre of gravity and a battery that differ a little from flight to flight.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tests.lab.undeclared.conditions import Condition
from tests.lab.undeclared.crafts import GRAVITY, RPM, SEA_LEVEL_DENSITY, Craft
from tests.lab.undeclared.days import Day, Surroundings, surroundings
from tests.lab.undeclared.flight_laws import Attitude, rotor_speeds
from tests.lab.undeclared.missions import FINE_STEP, Motion, Style, motion_of
from tests.lab.undeclared.rotor_aero import Array
from tests.made_sources import sent
from thrustmargin.models.flight import FlightTrack, Origin

SEASON_START = 1.78e9  # s, Unix time of the season's clock
FIRST_ROW = 0.5  # s of a mission at which its track begins
ROW_STEP = 0.1  # s between rows of a track
SOLVE_EVERY = 3  # fine steps
SENSOR_LAG = 0.06  # s of rotor speeds, gyro, accelerometer and attitude alike
MOTOR_LAG = 0.05  # s by which a rotor follows its output
EXPO, SPIN_MIN, SPIN_MAX = 0.65, 0.15, 0.95  # ArduPilot's MOT_THST_EXPO, MOT_SPIN_MIN, MOT_SPIN_MAX


@dataclass(frozen=True, kw_only=True, eq=False)
class Flight:
    """A track as a log would give it, and beside it what was true."""

    track: FlightTrack
    dense: float  # ln of the air's density over standard


def sampled(values: Array, step: float, at: Array) -> Array:
    """Columns of values given each `step` seconds from 0, at other times."""
    place = at / step
    below = np.clip(np.floor(place).astype(int), 0, len(values) - 2)
    part = np.clip(place - below, 0.0, 1.0).reshape(-1, *([1] * (values.ndim - 1)))
    return values[below] * (1.0 - part) + values[below + 1] * part


def motor_output(craft: Craft, rpm: Array, voltage: Array) -> Array:
    """Output 0..1 that turns a rotor at a speed: ArduPilot's thrust curve, inverted.

    Full output at a full battery turns it at the craft's largest speed, in proportion to voltage.
    Source: AP_Motors_Thrust_Linearization.cpp.
    """
    full = craft.max_rpm * voltage / (4.2 * craft.cells)
    share = np.clip(rpm / full[:, None], 0.0, 1.0) ** 2
    c = (EXPO - 1.0 + np.sqrt((1.0 - EXPO) ** 2 + 4.0 * EXPO * share)) / (2.0 * EXPO)
    return np.where(rpm > 0.5 * craft.hover_rpm, SPIN_MIN + (SPIN_MAX - SPIN_MIN) * c, SPIN_MIN)


def fly(
    craft: Craft, condition: Condition, style: Style, day: Day, seed: list[int], name: str
) -> Flight:
    """Fly one mission and log it at 10 Hz; the same seed gives the same air, way and noise."""
    of_way, of_air, of_noise = (np.random.default_rng([*seed, k]) for k in range(3))
    motion = motion_of(style, of_way)
    x, y = (c + craft.arm * d for c, d in zip(condition.cg, day.cg, strict=True))
    condition = replace(condition, cg=(x, y))
    around = surroundings(craft, condition, motion, day, of_air)
    mass = craft.empty_mass + craft.typical_mass * day.mass + around.tank
    mass = mass + condition.hidden_mass + condition.hung
    turned, attitude = rotor_speeds(craft, condition, motion, around, mass, SOLVE_EVERY)
    rows = np.arange(FIRST_ROW, motion.time[-1], ROW_STEP)
    clean = reported_speeds(craft, condition, turned, around, rows)
    noisy = clean + day.noise * craft.hover_rpm * of_noise.standard_normal(clean.shape)
    noisy = as_telemetry(craft, condition, noisy, of_noise)
    track = FlightTrack.of(
        name=name,
        time_s=rows - rows[0],
        rotor_count=craft.rotors,
        rotor_speed_rpm=np.maximum(np.round(noisy), 0.0),
        start_unix_s=SEASON_START + around.clock_start + float(rows[0]),
        origin=Origin(latitude_deg=32.0, longitude_deg=118.8, altitude=day.altitude),
        flying=sampled(motion.flying.astype(float), FINE_STEP, rows) > 0.5,
        sources={"rotor_speed_rpm": sent("plant"), "tank_kg": sent("plant")},
        **instruments(craft, condition, motion, around, attitude, turned, day, rows, of_noise),
    )
    return Flight(track=track, dense=float(np.log(day.density / SEA_LEVEL_DENSITY)))


def reported_speeds(
    craft: Craft, condition: Condition, turned: Array, around: Surroundings, rows: Array
) -> Array:
    """(T, R) rpm that a late ESC reports, without noise; its clock may go with the battery."""
    at = rows - SENSOR_LAG - condition.speed_delay
    speed = sampled(turned, SOLVE_EVERY * FINE_STEP, at)
    sag = sampled(around.voltage, FINE_STEP, at) / (3.8 * craft.cells) - 1.0
    return speed * (1.0 + condition.speed_with_voltage * sag)[:, None]


def as_telemetry(craft: Craft, condition: Condition, rpm: Array, rng: np.random.Generator) -> Array:
    """Speeds as a slow, coarse or repeating telemetry link leaves them."""
    rows = np.arange(len(rpm))
    if condition.period:
        rows = rows - rows % round(condition.period / ROW_STEP)
    if condition.repeats:
        fresh = rng.random(len(rpm)) >= condition.repeats
        rows = np.maximum.accumulate(np.where(fresh, rows, 0))
    rpm = rpm[rows]
    if condition.quantum:
        step = condition.quantum * craft.hover_rpm
        rpm = step * np.round(rpm / step)
    return rpm


def instruments(
    craft: Craft,
    condition: Condition,
    motion: Motion,
    around: Surroundings,
    attitude: Attitude,
    turned: Array,
    day: Day,
    rows: Array,
    rng: np.random.Generator,
) -> dict[str, Array]:
    """Every channel but the rotor speeds, as reported at `rows`."""
    count = rows.size

    def noise(size: float, columns: int = 0) -> Array:
        return size * rng.standard_normal((count, columns) if columns else count)

    def seen(values: Array, lag: float, every: float = 0.0) -> Array:
        """A late channel; one that comes every few rows only is interpolated between them."""
        if not every:
            return sampled(values, FINE_STEP, rows - lag)
        ticks = np.arange(rows[0] - every, rows[-1] + 2 * every, every)
        between = sampled(values, FINE_STEP, np.maximum(ticks - lag, 0.0))
        return sampled(between, every, rows - ticks[0])

    still = motion.acceleration - np.array([0.0, 0.0, GRAVITY])
    force = np.einsum("tji,tj->ti", attitude.rotation, still)
    air = motion.velocity if condition.blind_to_wind else motion.velocity - around.air_velocity
    airspeed = seen(np.linalg.norm(air, axis=1), 0.1, 0.2) + condition.airspeed_bias
    drift = day.gauge_offset + condition.gauge_drift * rows / 300.0
    gauge = seen(around.tank, 0.1, 0.4) / condition.gauge_gain
    wind = seen(around.air_velocity * [1.0, 1.0, 0.0], 1.0, 0.4) + noise(0.15, 3) * [1, 1, 0]
    at_solver = SOLVE_EVERY * FINE_STEP
    spin = sampled(turned, at_solver, rows)
    ahead = spin + MOTOR_LAG * sampled(np.gradient(turned, at_solver, axis=0), at_solver, rows)
    volts = seen(around.voltage, SENSOR_LAG)
    altitude = day.altitude - seen(motion.position[:, 2], SENSOR_LAG, 0.2)
    torque = craft.hover_coefficients[1] / craft.hover_coefficients[0][0]
    power = craft.thrust_coefficient * craft.radius * torque * spin**2 * spin / RPM / 0.85
    return {
        "position_ned": seen(motion.position, SENSOR_LAG, 0.2) + noise(0.02, 3),
        "velocity_ned": seen(motion.velocity, SENSOR_LAG, 0.2) + noise(0.03, 3),
        "attitude": seen(attitude.euler, SENSOR_LAG) + noise(0.002, 3),
        "angular_rate_frd": seen(attitude.rate, SENSOR_LAG) + noise(0.002, 3),
        "specific_force_frd": seen(force, SENSOR_LAG)
        + noise(0.05, 3)
        + 0.01 * rng.standard_normal(3),
        "airspeed": np.maximum(airspeed + noise(0.1), 0.0),
        "wind_ned": wind if day.wind_reported and not condition.blind_to_wind else np.nan * wind,
        "tank_kg": np.maximum(
            gauge * day.gauge_gain + craft.tank_litres * (drift + noise(0.0012)), 0.0
        ),
        "voltage": np.round((volts + noise(0.03)) * (1.0 + condition.voltage_offset), 2),
        "pressure": day.pressure - 9.8 * day.density * (altitude - day.altitude) + noise(4.0),
        "temperature": np.full(count, day.temperature + day.board_heat + condition.warm)
        + noise(0.05),
        "altitude": altitude + noise(0.05),
        "height_agl": seen(motion.height, SENSOR_LAG, 0.2) + noise(0.03),
        "throttle": motor_output(craft, ahead, volts),
        "current": power.sum(axis=1) / volts * (1.0 + 0.01 * rng.standard_normal(count)),
        "spraying": np.round(seen(motion.spraying, 0.0)),
    }
