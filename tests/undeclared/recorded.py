"""Sealed data sets made of recorded ArduCopter SITL flights, with a change put into their reports.

The flights are the good ones of the campaign, with the noise, gusts and turns of that simulator.
A change alters rotor speeds through thrust, by its own law, or what the tank gauge shows. The model
that they are judged against has seen these flights without the change: what is tested is naming,
intervals and silence.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from tests.undeclared.changes import NAMED, Change
from tests.undeclared.missions import FINE_STEP
from tests.undeclared.outside import OUTSIDE, Outside, draw_outside, faulty_sensor, outside_push
from tests.undeclared.physics import (
    GRAVITY,
    QUAD,
    SEA_LEVEL_DENSITY,
    Array,
    Attitude,
    Layout,
    Motion,
    Physics,
    Surroundings,
    air_density,
    standard_air,
)
from tests.undeclared.truth import ASKED_FROM_RPM, Missing, rms
from thrustmargin.models.flight import FlightTrack

CAMPAIGN = Path(__file__).resolve().parents[2] / "sitl_logs" / "campaign"
#: Changes whose law needs no more than a log has.
IMPLANTS = (
    "air_density",
    "tank_scale",
    "extra_mass",
    "rotor_degradation",
    "rotor_degradation/warm",
    "thrust_drift",
    "battery_voltage",
    "cg_offset",
    "cg_offset/tank",
    "yaw_trim",
    "sensor_lag",
)
OUTSIDE_IMPLANTS = tuple(name for name in OUTSIDE if name not in ("thermals", "slosh"))
RECORDED_KINDS = ("none", *IMPLANTS, *OUTSIDE_IMPLANTS)


@dataclass(frozen=True, kw_only=True, eq=False)
class Implanted:
    """A recorded flight with a change, and what the change did to its rotor speeds."""

    track: FlightTrack
    change_rpm: Array  # (T, R)


@cache
def hosts() -> tuple[FlightTrack, ...]:
    """The good flights of the campaign, in the order of their names."""
    from thrustmargin.gcs_plugin.logs import read_log

    return tuple(read_log(path).track for path in sorted(CAMPAIGN.glob("*.tlog")))


def implant_named(track: FlightTrack, physics: Physics, change: Change | None) -> FlightTrack:
    """The track as it would have been reported with these numbers of the aircraft changed."""
    mixing = np.linalg.pinv(QUAD.mixing)
    curve = physics.thrust_coefficient
    thrust = curve * track.rotor_speed_rpm**2
    felt = np.linalg.norm(track.specific_force_frd, axis=1)
    felt = np.where(np.isfinite(felt), felt, GRAVITY)
    thrust = thrust + (physics.hidden_mass * felt / QUAD.rotors)[:, None]
    whole = thrust.sum(axis=1)
    filled = track.tank_kg / physics.tank_capacity
    ahead = physics.balance[0] + physics.balance_full_tank[0] * filled
    aside = physics.balance[1] + physics.balance_full_tank[1] * filled
    trim = np.full_like(whole, physics.yaw_trim)
    thrust = thrust + np.column_stack([0.0 * whole, -aside * whole, ahead * whole, trim]) @ mixing.T
    share = np.ones_like(thrust)
    share[track.time_s >= physics.loss_from_flight_time, physics.lossy_rotor] -= physics.rotor_loss
    share *= (1.0 - physics.fouling_rate * track.time_s)[:, None]
    share *= ((track.voltage / physics.full_voltage) ** physics.pack_exponent)[:, None]
    if change is not None and change.altitude is not None:
        pressure, temperature = standard_air(change.altitude)
        temperature += change.warmer
        share *= air_density(pressure, temperature) / SEA_LEVEL_DENSITY
        track = replace(
            track,
            pressure=track.pressure * pressure / 101325.0,
            temperature=track.temperature + temperature - 288.15,
            altitude=track.altitude + change.altitude,
        )
    rpm = np.sqrt(np.maximum(thrust / share, 0.0) / curve)
    rpm = at_time(track.time_s, rpm, track.time_s - physics.reporting_delay)
    rpm = np.where(track.flying[:, None], rpm, track.rotor_speed_rpm)
    return replace(track, rotor_speed_rpm=rpm, tank_kg=track.tank_kg / physics.gauge_gain)


def at_time(time: Array, values: Array, wanted: Array) -> Array:
    """Columns of (T, C) interpolated at other times."""
    return np.stack([np.interp(wanted, time, column) for column in values.T], axis=1)


def implant_outside(track: FlightTrack, outside: Outside, rng: np.random.Generator) -> FlightTrack:
    """The track with the push or the sensor's fault of a change that no table names."""
    fine = np.arange(track.time_s[0], track.time_s[-1], FINE_STEP)

    def smooth(values: Array) -> Array:
        return at_time(track.time_s, np.nan_to_num(values.reshape(values.shape[0], -1)), fine)

    tank = np.interp(fine, track.time_s, np.nan_to_num(track.tank_kg))
    zero = np.zeros_like(fine)
    thrust = 2.011e-5 * smooth(track.rotor_speed_rpm) ** 2
    heading = smooth(np.unwrap(np.nan_to_num(track.attitude[:, 2])))[:, 0]
    position, velocity = smooth(track.position_ned), smooth(track.velocity_ned)
    motion = Motion(
        fine, position, velocity, 0.0 * velocity, heading, zero, zero, np.ones(fine.size, np.bool_)
    )
    around = Surroundings(0.0 * velocity, SEA_LEVEL_DENSITY, tank, zero, 0.0, np.zeros((1, 4)))
    attitude = Attitude(
        smooth(track.attitude),
        smooth(track.angular_rate_frd),
        np.zeros((1, 3, 3)),
        thrust.sum(axis=1),
    )
    push = at_time(fine, outside_push(outside, motion, around, attitude), track.time_s)
    apparent = track.rotor_speed_rpm**2 + push @ np.linalg.pinv(QUAD.mixing).T / 2.011e-5
    rpm = faulty_sensor(outside, np.sqrt(np.maximum(apparent, 0.0)), rng)
    return replace(
        track, rotor_speed_rpm=np.where(track.flying[:, None], rpm, track.rotor_speed_rpm)
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedSet:
    """As `datasets.DataSet`, of recorded flights; how well the truth can be known is not known."""

    seed: int
    kind: str
    fit: tuple[Implanted, ...]
    held_out: tuple[Implanted, ...]
    missing: tuple[Missing, ...]
    outside_rpm: float
    base: str = "shipped"
    layout: Layout = QUAD
    floor_rpm: float = float("nan")
    knowing_rmse_rpm: float = float("nan")

    @property
    def asked(self) -> tuple[Missing, ...]:
        return tuple(m for m in self.missing if m.asked)


def build_recorded(kind: str, seed: int, *, tries: int = 100) -> RecordedSet:
    """Draw recorded flights and a change, until it asks to be found.

    Raises ValueError for a kind that cannot be put into a recording.
    """
    if kind not in RECORDED_KINDS:
        raise ValueError(
            f"{kind!r} cannot be put into a recording; {', '.join(RECORDED_KINDS)} can"
        )
    rng = np.random.default_rng([seed, 4, zlib.crc32(kind.encode())])
    for _ in range(tries):
        chosen = [hosts()[i] for i in rng.choice(len(hosts()), 5, replace=False)]
        change, outside, physics = None, None, Physics()
        if kind in IMPLANTS:
            change = NAMED[kind](rng, physics)
            physics = change.on(physics)
        elif kind != "none":
            outside = draw_outside(kind, rng, QUAD.rotors)
        flights = [implanted(t, physics, change, outside, rng) for t in chosen]
        fit, held_out = tuple(flights[:4]), tuple(flights[4:])
        signal = signal_rpm(fit, chosen, physics)
        if kind == "none" or signal >= ASKED_FROM_RPM:
            return RecordedSet(
                seed=seed,
                kind=kind,
                fit=fit,
                held_out=held_out,
                missing=() if change is None else (missing_of(change, signal),),
                outside_rpm=signal if outside is not None else 0.0,
            )
    raise RuntimeError(f"no recorded data set of kind {kind!r} asks for its change")


def implanted(
    host: FlightTrack,
    physics: Physics,
    change: Change | None,
    outside: Outside | None,
    rng: np.random.Generator,
) -> Implanted:
    track = host if change is None else implant_named(host, physics, change)
    if outside is not None:
        track = implant_outside(track, outside, rng)
    return Implanted(track=track, change_rpm=track.rotor_speed_rpm - host.rotor_speed_rpm)


def signal_rpm(fit: Sequence[Implanted], hosts: Sequence[FlightTrack], physics: Physics) -> float:
    """What the change does to the rotor speeds beside what the reported tank lets expect."""
    parts = []
    for flight, host in zip(fit, hosts, strict=False):
        shown, true = flight.track.tank_kg, host.tank_kg
        weigh = np.sqrt((physics.empty_mass + shown) / (physics.empty_mass + true))
        moved = flight.change_rpm - (weigh[:, None] - 1.0) * host.rotor_speed_rpm
        rows = host.flying & np.all(np.isfinite(moved), axis=1)
        parts.append(moved[rows])
    return rms(parts)


def missing_of(change: Change, signal: float) -> Missing:
    return Missing(
        name=change.name,
        variant=change.variant,
        rotor=change.rotor,
        truth=change.truth,
        signal_rpm=signal,
        drawn=True,
    )
