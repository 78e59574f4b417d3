"""The flying aircraft and its instruments: from `Physics` and a mission to a FlightTrack.

What a real log has and no law here explains is part of it: turbulence, uneven pushes of gusts,
rotor speed noise, an autopilot thermometer that is warm by its own heat, a tank gauge with an
offset and a gain of its own each flight, late sensors, air that differs a little from day to day.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.undeclared.days import Day, surroundings
from tests.undeclared.missions import FINE_STEP, Style, motion_of
from tests.undeclared.outside import Outside, faulty_sensor, outside_push
from tests.undeclared.physics import (
    FIRST_ROW,
    GRAVITY,
    Array,
    Attitude,
    Motion,
    Physics,
    Surroundings,
    rotor_speeds,
)
from thrustmargin.models.flight import FlightTrack, Origin

SEASON_START = 1.78e9  # s, Unix time of the season's clock
ROW_STEP = 0.1  # s between rows of a track
SENSOR_LAG = 0.06  # s of rotor speeds, gyro, accelerometer and attitude alike


@dataclass(frozen=True, kw_only=True, eq=False)
class Flight:
    """A track as a log would give it, and beside it what was true."""

    track: FlightTrack
    physics: Physics
    motion: Motion  # fine base
    around: Surroundings
    true_rpm: Array  # (T, R) turned by the rotors at each row's sensor time, gusts and all
    lawful_rpm: Array  # (T, R) the same without gusts and without a change outside the table
    outside_rpm: Array  # (T, R) what a change outside the table adds to the report
    rows: Array  # (T,) s on the fine base
    day: Day


def late(motion: Motion, values: Array, rows: Array, lag: float) -> Array:
    """Values of the fine base as a sensor that is late by `lag` seconds reports them at `rows`."""
    at = (rows - lag) / FINE_STEP
    below = np.clip(np.floor(at).astype(int), 0, motion.time.size - 2)
    part = np.clip(at - below, 0.0, 1.0)
    if values.ndim > 1:
        part = part.reshape(-1, *([1] * (values.ndim - 1)))
    return values[below] * (1.0 - part) + values[below + 1] * part


def fly(
    physics: Physics,
    style: Style,
    day: Day,
    rng: np.random.Generator,
    name: str,
    outside: Outside | None = None,
) -> Flight:
    """Fly one mission and log it at 10 Hz."""
    motion = motion_of(style, rng)
    around = surroundings(physics, motion, day, rng)
    return log_flight(physics, motion, around, day, rng, name, outside)


def log_flight(
    physics: Physics,
    motion: Motion,
    around: Surroundings,
    day: Day,
    rng: np.random.Generator,
    name: str,
    outside: Outside | None = None,
) -> Flight:
    """What the instruments report of a flight whose motion and surroundings are given."""
    rows = np.arange(FIRST_ROW, motion.time[-1], ROW_STEP)
    lag = SENSOR_LAG + physics.reporting_delay
    turned, attitude, _ = rotor_speeds(physics, motion, around)
    lawful, _, _ = rotor_speeds(physics, motion, around._replace(push=np.zeros_like(around.push)))
    healthy_rpm = true_rpm = late(motion, turned, rows, lag)
    if outside is not None:
        push = around.push + outside_push(outside, motion, around, attitude)
        turned, _, _ = rotor_speeds(physics, motion, around._replace(push=push))
        true_rpm = late(motion, turned, rows, lag)
    reported = true_rpm if outside is None else faulty_sensor(outside, true_rpm, rng)
    measured = reported + day.rotor_noise_rpm * rng.standard_normal(reported.shape)
    track = FlightTrack.of(
        name=name,
        time_s=rows - rows[0],
        rotor_count=physics.layout.rotors,
        rotor_speed_rpm=np.maximum(np.round(measured), 0.0),
        start_unix_s=SEASON_START + around.clock_start + float(rows[0]),
        origin=Origin(latitude_deg=32.0, longitude_deg=118.8, altitude=day.altitude),
        flying=late(motion, motion.flying.astype(float), rows, 0.0) > 0.5,
        sources={"rotor_speed_rpm": "plant", "tank_kg": "plant"},
        **instruments(motion, around, attitude, turned, physics, day, rows, rng),
    )
    return Flight(
        track=track,
        physics=physics,
        motion=motion,
        around=around,
        true_rpm=true_rpm,
        lawful_rpm=late(motion, lawful, rows, lag),
        outside_rpm=reported - healthy_rpm,
        rows=rows,
        day=day,
    )


def instruments(
    motion: Motion,
    around: Surroundings,
    attitude: Attitude,
    turned: Array,
    physics: Physics,
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
            return late(motion, values, rows, lag)
        beats = np.arange(rows[0] - every, rows[-1] + 2 * every, every)
        sampled = late(motion, values, beats, lag)
        if values.ndim == 1:
            return np.interp(rows, beats, sampled)
        return np.stack([np.interp(rows, beats, column) for column in sampled.T], axis=1)

    force = np.einsum(
        "tji,tj->ti", attitude.rotation, motion.acceleration - np.array([0.0, 0.0, GRAVITY])
    )
    air = motion.velocity - around.air_velocity
    airspeed = np.linalg.norm(motion.velocity if physics.blind_to_wind else air, axis=1)
    gauge = seen(around.tank / physics.gauge_gain, 0.1, 0.4)
    height = seen(motion.height, SENSOR_LAG, 0.2)
    altitude = day.altitude - seen(motion.position[:, 2], SENSOR_LAG, 0.2)
    unknown = np.full(count, np.nan)
    wind = seen(around.air_velocity, 1.0, 0.4) + noise(0.15, 3)
    wind[:, 2] = 0.0
    spin = late(motion, turned, rows, SENSOR_LAG)
    reached = late(motion, around.voltage, rows, SENSOR_LAG)
    return {
        "position_ned": seen(motion.position, SENSOR_LAG, 0.2) + noise(0.02, 3),
        "velocity_ned": seen(motion.velocity, SENSOR_LAG, 0.2) + noise(0.03, 3),
        "attitude": seen(attitude.euler, SENSOR_LAG) + noise(0.002, 3),
        "angular_rate_frd": seen(attitude.rate, SENSOR_LAG) + noise(0.002, 3),
        "specific_force_frd": seen(force, SENSOR_LAG)
        + noise(0.05, 3)
        + 0.01 * rng.standard_normal(3),
        "airspeed": np.maximum(seen(airspeed, 0.1, 0.2) + noise(0.1), 0.0),
        "wind_ned": wind if day.wind_reported else np.full((count, 3), np.nan),
        "tank_kg": np.maximum(gauge * day.gauge_gain + day.gauge_offset + noise(0.02), 0.0),
        "voltage": np.round(reached + noise(0.03), 2),
        "pressure": day.pressure
        - 12.0 * (altitude - day.altitude) * day.density / 1.225
        + noise(4.0)
        if day.barometer
        else unknown,
        "temperature": np.full(count, day.temperature + day.board_heat) + noise(0.05)
        if day.thermometer
        else unknown,
        "altitude": altitude + noise(0.05),
        "height_agl": height + noise(0.03),
        "throttle": motor_output((spin / 3000.0 * physics.full_voltage / reached[:, None]) ** 2),
        # 1122 W at 2127 rpm: momentum theory with a figure of merit of 0.6.
        "current": 1122.0 * np.sum((spin / 2127.0) ** 3, axis=1) / reached + noise(0.5),
        "spraying": np.round(late(motion, motion.spraying, rows, 0.0)),
    }


def motor_output(thrust_share: Array) -> Array:
    """Output from 0 to 1 for a share of full thrust, by ArduPilot's default curve (exponent 0.65
    between MOT_SPIN_MIN 0.15 and MOT_SPIN_MAX 0.95)."""
    share, expo = np.clip(thrust_share, 0.0, 1.0), 0.65
    root = np.sqrt((1.0 - expo) ** 2 + 4.0 * expo * share)
    return 0.15 + 0.8 * (root - (1.0 - expo)) / (2.0 * expo)
