"""Small flights of an F16 that flies lines to and fro, with a change put into its rotor speeds.

Rotor speeds are those that carry the weight by the thrust curve, with white noise of the sensors;
a change is put in by its own law, not by the code that looks for it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from thrustmargin.models.effects import CATALOGUE
from thrustmargin.models.flight import FlightTrack, Origin
from thrustmargin.models.model.rotor_model import RotorModel, physics_model
from thrustmargin.models.physics.airframe import load_airframe

F16 = load_airframe("topxgun-f16-sitl")
STEP_S, LEG_S = 0.1, 12.0
NOISE_RPM = 8.0


def made_flight(
    seed: int,
    *,
    tank_kg: float = 12.0,
    speed: float = 4.0,
    duration: float = 60.0,
    hidden_mass: float = 0.0,
    loss: float = 0.0,
    rotor: int = 0,
    loss_from: float = 0.0,
    name: str | None = None,
) -> FlightTrack:
    """A flight; `loss` is the share of thrust that `rotor` (0-based) lacks from `loss_from` on."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, duration, STEP_S)
    rows = time_s.size
    leg = (time_s // LEG_S).astype(int)
    in_leg = time_s - leg * LEG_S
    pace = speed * np.clip(np.minimum(in_leg, LEG_S - in_leg) / 2.0, 0.1, 1.0)
    way = np.where(leg % 2 == 0, 1.0, -1.0)
    velocity = np.column_stack([way * pace, np.full(rows, 0.2), 0.05 * rng.standard_normal(rows)])
    position = np.cumsum(velocity, axis=0) * STEP_S
    position[:, 2] = -3.0 + 0.02 * rng.standard_normal(rows)
    tank = np.maximum(0.0, tank_kg - 0.03 * time_s)
    turning = np.gradient(np.unwrap(np.where(way > 0, 0.0, np.pi)), STEP_S) * 0.02
    load = (F16.empty_mass + hidden_mass + tank) * 9.80665 / 4
    rpm = np.sqrt(load / F16.thrust_coefficient)[:, None] * np.ones(4)
    rpm[time_s >= loss_from, rotor] /= np.sqrt(1.0 - loss)
    rpm = np.round(rpm + NOISE_RPM * rng.standard_normal(rpm.shape))
    return FlightTrack.of(
        name=name or f"made_{seed}.csv",
        time_s=time_s,
        rotor_count=4,
        position_ned=position,
        velocity_ned=velocity,
        attitude=np.column_stack([np.zeros((rows, 2)), np.where(way > 0, 0.0, np.pi)]),
        angular_rate_frd=np.column_stack([0.01 * rng.standard_normal((rows, 2)), turning]),
        specific_force_frd=np.column_stack(
            [0.1 * rng.standard_normal((rows, 2)), -9.80665 + 0.1 * rng.standard_normal(rows)]
        ),
        airspeed=np.hypot(velocity[:, 0], velocity[:, 1]),
        tank_kg=tank,
        rotor_speed_rpm=rpm,
        voltage=58.0 - 0.02 * time_s,
        pressure=np.full(rows, 101325.0),
        temperature=np.full(rows, 288.15),
        altitude=np.full(rows, 3.0),
        height_agl=-position[:, 2],
        origin=Origin(latitude_deg=36.65, longitude_deg=116.9, altitude=0.0),
    )


def made_flights(count: int, **change) -> list[FlightTrack]:
    """Flights that differ in fill and speed, all with the same change."""
    return [
        made_flight(k, tank_kg=15.0 - 2.0 * (k % 6), speed=2.0 + 2.0 * (k % 3), **change)
        for k in range(count)
    ]


def curve_model() -> RotorModel:
    """Weight and thrust curve of the F16."""
    return physics_model(F16)


def table(names: Sequence[str]):
    """The effects of these keys, to search only among them."""
    return tuple(e for e in CATALOGUE if e.key in names)


def level_flight(rows: int = 100, name: str = "level", **channels) -> FlightTrack:
    """Ten rows a second at 3 m, all known."""
    velocity = np.zeros((rows, 3))
    given = {
        "velocity_ned": velocity,
        "airspeed": np.full(rows, 4.0),
        "tank_kg": np.full(rows, 9.0),
        "rotor_speed_rpm": np.full((rows, 4), 1900.0) + np.arange(rows)[:, None],
        "height_agl": np.full(rows, 3.0),
        "angular_rate_frd": np.zeros((rows, 3)),
        **channels,
    }
    return FlightTrack.of(name=name, time_s=np.arange(rows) / 10.0, rotor_count=4, **given)
