"""Find how a flight differs from what the flights of its aircraft before it lead one to expect.

Three things count: an offset of a mode beyond what the walk allows, rotor speeds outside their
interval more often than chance allows, and a rotor whose offsets since the last repair add up to a
loss. What the difference is by nature is the search's question (`models.identification`), whose
answer is an `ChangeCause`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from statistics import NormalDist

import numpy as np

from thrustmargin.models.flight import Floats
from thrustmargin.models.model.mode_walk import FALSE_CHANGE, WalkStep, mode_columns
from thrustmargin.models.model.offset_total import RotorTotal
from thrustmargin.models.model.rotor_model import Interval
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0

NAN = math.nan
INTERVAL = NormalDist().inv_cdf(0.95)  # standard errors of a 90 % interval
#: Prior standard deviation of a flight's coverage, and the number of flights that it counts for.
#: Source: flights of Quiver PT1, 86 to 100 % each.
COVERAGE_SPREAD, SPREAD_FLIGHTS = 0.06, 5


class ChangeKind(StrEnum):
    """Kinds of difference of a flight from the flights before it, the gravest first."""

    WEAK_ROTOR = "weak_rotor"  # offsets since the last repair add up to a rotor's loss
    OFFSET = "offset"  # of a mode, beyond what the walk allows
    COVERAGE = "coverage"  # fewer rotor speeds inside their interval than by chance


class ChangeMode(StrEnum):
    """The mode in which rotor speeds are offset."""

    COLLECTIVE = "collective"
    ROLL = "roll"
    PITCH = "pitch"
    YAW = "yaw"
    OTHER = "other"  # of layouts with more than four rotors


class CauseKind(StrEnum):
    """Outcome of the search over effects for the cause of a change."""

    NAMED = "named"
    UNEXPLAINED = "unexplained"
    NOT_SEARCHED = "not_searched"  # too little flight for a search


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeChange:
    """The offset of one mode from the state before the flight, rpm, with its 90 % interval."""

    mode: ChangeMode
    rpm: float
    low_rpm: float
    high_rpm: float
    faster: tuple[int, ...]  # rotors, from 0, that turn faster than before
    slower: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class CausingEffect:
    """An effect that the identification reports, with its main parameter and 95 % interval."""

    effect: str  # key of the effect
    rotor: int | None  # from 0
    parameter: str
    unit: str
    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangeCause:
    """Result of the search over effects on the flights since a change, from the state before it."""

    kind: CauseKind
    flights: int
    effects: tuple[CausingEffect, ...] = ()
    error_before_rpm: float = NAN  # RMS of rotor speed, cross-validated
    error_after_rpm: float = NAN


@dataclass(frozen=True, slots=True, kw_only=True)
class AircraftChange:
    """Difference of a flight from the flights of its aircraft before it."""

    kind: ChangeKind
    modes: tuple[ModeChange, ...] = ()  # those beyond what the walk allows, the largest first
    since_unix_s: float = NAN  # start of the first flight with the change
    since_log: str = ""  # its log
    #: Share of rotor speeds inside the interval of the state before, and the least by chance.
    coverage: float = NAN
    coverage_by_chance: float = NAN
    #: Mass, kg, that would make the change of the collective mode, with its 90 % interval; NaN
    #: without a change of that mode.
    mass_kg: float = NAN
    mass_low_kg: float = NAN
    mass_high_kg: float = NAN
    rotor: RotorTotal | None = None
    explanation: ChangeCause | None = None


def aircraft_change(
    step: WalkStep,
    airframe: Airframe,
    *,
    speed_rpm: float,
    weight: float,
    coverage: float,
    interval: Interval,
    rotor: RotorTotal | None,
) -> AircraftChange | None:
    """Return how a flight differs from earlier flights of the aircraft; None where it does not.

    `step` compares the flight with the mode state of the earlier ones, `speed_rpm` is its mean
    predicted rotor speed, `weight` its median weight, N, and `coverage` the share (0 to 1) of its
    speeds inside the model's `interval`. `rotor` is the weak rotor that the offsets of all flights
    add up to, if any.
    """
    least = least_coverage(interval)
    if rotor is not None:
        kind = ChangeKind.WEAK_ROTOR
    elif step.changed:
        kind = ChangeKind.OFFSET
    elif coverage < least:
        kind = ChangeKind.COVERAGE
    else:
        return None
    modes = [_mode_change(step, mode, airframe, speed_rpm) for mode in step.changed]
    mass = (NAN,) * 3
    if 0 in step.changed:
        value, error = _difference(step, 0)
        known = step.before.offset[0]
        mass = tuple(
            weight / G0 * (((1.0 + known + end) / (1.0 + known)) ** 2 - 1.0)
            for end in (value, value - INTERVAL * error, value + INTERVAL * error)
        )
    return AircraftChange(
        kind=kind,
        modes=tuple(sorted(modes, key=lambda one: -abs(one.rpm))),
        since_unix_s=step.flight.start_unix_s,
        coverage=coverage,
        coverage_by_chance=least,
        mass_kg=mass[0],
        mass_low_kg=mass[1],
        mass_high_kg=mass[2],
        rotor=rotor,
    )


def least_coverage(interval: Interval) -> float:
    """Return the interval coverage that a fault-free flight is below with probability FALSE_CHANGE.

    The spread between flights is estimated from the held-out flights of `interval`, with a prior
    standard deviation of COVERAGE_SPREAD that weighs as much as SPREAD_FLIGHTS flights.
    """
    held = np.array(() if interval.measured is None else interval.measured.per_flight)
    squares = SPREAD_FLIGHTS * COVERAGE_SPREAD**2 + float(np.sum((held - interval.coverage) ** 2))
    spread = math.sqrt(squares / (SPREAD_FLIGHTS + held.size))
    return interval.coverage - NormalDist().inv_cdf(1.0 - FALSE_CHANGE) * spread


def _difference(step: WalkStep, mode: int) -> tuple[float, float]:
    """Return the offset of a mode from the state before a flight, and the standard error of both,
    shares of rotor speed.

    The error leaves out the step that the walk expects from one flight to the next.
    """
    error = math.hypot(step.known[mode], step.flight.error[mode])
    return step.flight.offset[mode] - step.before.offset[mode], error


def _mode_change(step: WalkStep, mode: int, airframe: Airframe, speed_rpm: float) -> ModeChange:
    """Return the change of mode number `mode` over `step`, with its interval, in rpm at
    `speed_rpm`, the flight's mean rotor speed.

    It also lists the rotors, from 0, that turn faster and slower by it; rotors with hardly any
    share are in neither.
    """
    value, error = _difference(step, mode)
    column: Floats = math.copysign(1.0, value) * mode_columns(airframe)[:, mode]
    names = tuple(ChangeMode)
    return ModeChange(
        mode=names[min(mode, len(names) - 1)],
        rpm=speed_rpm * value,
        low_rpm=speed_rpm * (value - INTERVAL * error),
        high_rpm=speed_rpm * (value + INTERVAL * error),
        faster=tuple(np.flatnonzero(column > 0.1).tolist()),
        slower=tuple(np.flatnonzero(column < -0.1).tolist()),
    )
