"""Reject ESC readings that do not measure a rotor's speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.models.checks.speed_readings import (
    LONE,
    MEASURED,
    REASONS,
    TURNING,
    ZERO,
    LastReading,
    checked_readings,
    too_fast,
)
from thrustmargin.models.flight import TRACK_CHANNELS, Bools, Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.statement import Statement, state

IDLE = 0.12  # of the motor output; ArduPilot's motors turn when armed at 0.1
SPIN_UP = 1.0  # s for which the output must be above idle before a stopped rotor is a surprise
FEW_READINGS = 0.1  # of the readings of another rotor: with fewer they are dropped
SILENT = 0.05  # of the rows with a speed: from here on a rotor without one is reported
FRESH = 2.0  # s for which a motor output is believed without being repeated
_TAIL = TRACK_CHANNELS["rotor_speed_rpm"].max_age  # s of readings that later rows may still use


@dataclass(frozen=True, slots=True, eq=False)
class RotorMemory:
    """The state of one rotor after the last reading processed."""

    last: LastReading = field(default_factory=LastReading)
    tail: Signal | None = None  # its last measured readings


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredSpeeds:
    """The valid readings, one signal a rotor (None without an ESC), and the times of rejected
    ones."""

    signals: list[Signal | None]
    rejected: Mapping[tuple[int, int], Floats]  # (rotor, why) -> times of the readings
    memory: tuple[RotorMemory, ...]


def measured_speeds(
    speeds: Sequence[Signal | None],
    outputs: Sequence[Signal | None],
    airframe: Airframe | None,
    *,
    look_ahead: bool,
    heard_s: float = -np.inf,
    memory: Sequence[RotorMemory] = (),
) -> MeasuredSpeeds:
    """Divide the readings of `speeds` (rpm, one signal a rotor) into true and rejected ones.

    `outputs` are the motor outputs from 0 to 1, None where unknown. Readings up to `heard_s`, s on
    the signals' clock, were processed by an earlier call, whose result's `memory` is passed again.
    `look_ahead`: the signals are of the whole flight, so later readings may be used. With an
    `airframe` speeds too high for its propeller are rejected too.
    """
    if len(memory) != len(speeds):
        memory = [RotorMemory()] * len(speeds)
    known = [None if s is None else _known(s) for s in speeds]
    at_s, last_rpm = np.empty(0), np.empty((0, 0))
    tails: dict[int, tuple[Floats, Floats]] = {}  # of rotors that report together
    signals: list[Signal | None] = []
    rejected: dict[tuple[int, int], Floats] = {}
    after: list[RotorMemory] = []
    for rotor, signal in enumerate(known):
        if signal is None:
            signals.append(None)
            after.append(RotorMemory())
            continue
        first = int(signal.time_s.searchsorted(heard_s, side="right"))
        time_s, rpm = signal.time_s[first:], signal.values[first:]
        if not last_rpm.size or not np.array_equal(time_s, at_s):  # most report all rotors at once
            at_s, last_rpm, tails = time_s, last_speeds(known, time_s), {}
        output, demand = _demand(outputs[rotor], at_s)
        others = median_speeds(last_rpm[[k for k in range(len(known)) if k != rotor]])
        before = memory[rotor]
        verdict, last = checked_readings(
            at_s,
            rpm,
            output=output,
            asked=demand,
            others=others,
            before=before.last,
            look_ahead=look_ahead,
        )
        if airframe is not None:
            verdict[too_fast(rpm, others, airframe.propeller_diameter)] = LONE
        good = verdict == MEASURED
        whole = bool(good.all())
        new = signal._replace(time_s=at_s if whole else at_s[good], values=rpm[good])
        since = (at_s[-1] if at_s.size else heard_s) - _TAIL
        tail_ended, tail = _after_tail(before.tail, new, since, tails if whole else {})
        signals.append(tail_ended)
        after.append(RotorMemory(last, tail))
        for why in set(verdict[~good].tolist()):
            rejected[rotor, why] = time_s[verdict == why]
    return MeasuredSpeeds(signals=signals, rejected=MappingProxyType(rejected), memory=tuple(after))


def _after_tail(
    tail: Signal | None, new: Signal, since: float, times: dict[int, tuple[Floats, Floats]]
) -> tuple[Signal, Signal]:
    """Return the readings of `tail` and `new`, rpm, joined, and their part from `since` on.

    `since` is in s. `times` caches the joined times, because rotors that report together share
    them.
    """
    rpm, key = new.values, 0
    if tail is not None:
        rpm, key = np.concatenate([tail.values, rpm]), id(tail.time_s)
    if key not in times:
        time_s = new.time_s if tail is None else np.concatenate([tail.time_s, new.time_s])
        times[key] = time_s, time_s[int(time_s.searchsorted(since)) :]
    time_s, recent_s = times[key]
    recent = rpm[rpm.size - recent_s.size :]
    return new._replace(time_s=time_s, values=rpm), new._replace(time_s=recent_s, values=recent)


def lifting(speeds: Floats, outputs: Floats) -> Bools:
    """Flag rows (T,) in which hover motors run: some output (T, R) is above idle.

    Where no output is known, a rotor must turn (`speeds` (T, R), rpm) or no speed be known.
    """
    known = np.isfinite(outputs).any(axis=1)
    driven = (np.nan_to_num(outputs) > IDLE).any(axis=1)
    stand = np.isfinite(speeds).any(axis=1) & (np.abs(np.nan_to_num(speeds)) < TURNING).all(axis=1)
    return np.where(known, driven, ~stand)


def stopped_in_flight(speeds: Floats, outputs: Floats, flying: Bools) -> Bools:
    """Flag rows (T, R) in flight at which a rotor reads zero speed and its output is unknown."""
    return flying[:, None] & (np.abs(speeds) < TURNING) & ~np.isfinite(outputs)


def rejected_readings(
    measured: MeasuredSpeeds,
    speeds: Floats,
    hidden: Bools,
    clock_s: Floats,
    flying: Bools,
    *,
    counted: bool,
) -> tuple[Statement, ...]:
    """Return statements on the readings rejected in flight, one for each rotor and reason.

    A reason that concerns every rotor makes one statement. `hidden` (T, R) flags a zero speed in
    flight with unknown output; `clock_s`, s, and `flying` are (T,). `counted` adds the number of
    readings, which a listener cannot know yet, and the rotors that lack a reading in more than
    SILENT of the rows in which another has one (`speeds`, (T, R)).
    """
    rows_by_rotor: dict[int, dict[int, int]] = {why: {} for why in REASONS}
    for (rotor, why), time_s in measured.rejected.items():
        row = np.searchsorted(clock_s, time_s, side="right") - 1
        count = int(np.sum(flying[np.maximum(row, 0)]))
        if count:
            rows_by_rotor[why][rotor] = count
    for rotor in np.flatnonzero(hidden.any(axis=0)).tolist():
        rows_by_rotor[ZERO][rotor] = rows_by_rotor[ZERO].get(rotor, 0) + int(hidden[:, rotor].sum())
    found = []
    for why, counts in rows_by_rotor.items():
        counts = {r: n for r, n in counts.items() if n >= FEW_READINGS * max(counts.values())}
        whole = {-1: sum(counts.values())} if len(counts) == hidden.shape[1] > 1 else counts
        for rotor, count in sorted(whole.items()):
            many = ("readings counted",) if counted else ()
            kinds = "every rotor" if rotor < 0 else "one rotor", *many, "no measurement"
            values = {"rotor": str(rotor + 1), "count": float(count), "why": state(REASONS[why])}
            found.append(state(*kinds, **values))
    rows = np.isfinite(speeds[flying & np.isfinite(speeds).any(axis=1)])
    lacks = 1.0 - rows.mean(axis=0) if counted and len(rows) else np.zeros(speeds.shape[1])
    rejected = {rotor for rotors in rows_by_rotor.values() for rotor in rotors}
    for rotor in np.flatnonzero((lacks > SILENT) & (lacks < 1.0)).tolist():
        if rotor not in rejected:
            lacking = {"rotor": str(rotor + 1), "percent": 100.0 * float(lacks[rotor])}
            found.append(state("one rotor", "no reading", **lacking))
    return tuple(found)


def _known(signal: Signal) -> Signal:
    rows = np.isfinite(signal.values) & np.isfinite(signal.time_s)
    if rows.all():
        return signal
    return signal._replace(time_s=signal.time_s[rows], values=signal.values[rows])


def _demand(output: Signal | None, time_s: Floats) -> tuple[Floats, Bools]:
    """Return the motor output (n,), 0 to 1, at each time, and flags (n,) of a lasting demand.

    The output is NaN where none was reported within FRESH s before. A flag is True where it has
    been above idle for SPIN_UP s.
    """
    if output is None:
        return np.full(time_s.size, np.nan), np.zeros(time_s.size, dtype=np.bool_)
    output = _known(output)
    places = output.time_s.searchsorted(time_s, side="right")
    reported_s = np.append(-np.inf, output.time_s)[places]
    share = np.where(time_s - reported_s <= FRESH, np.append(np.nan, output.values)[places], np.nan)
    idle = output.time_s[output.values <= IDLE]
    idle_s = np.append(-np.inf, idle)[idle.searchsorted(time_s, side="right")]
    return share, (share > IDLE) & ~(time_s - idle_s < SPIN_UP)


def last_speeds(known: Sequence[Signal | None], time_s: Floats) -> Floats:
    """Return each rotor's last absolute speed (R, n), rpm, at each of the times (n,), s.

    `known` has one signal of finite readings for each of R rotors, None without; NaN before the
    first.
    """
    last = np.full((len(known), time_s.size), np.nan)
    for values, signal in zip(last, known, strict=True):
        if signal is not None and signal.time_s.size:
            places = signal.time_s.searchsorted(time_s, side="right")
            values[:] = np.where(places > 0, np.abs(signal.values)[places - 1], np.nan)
    return last


def median_speeds(values: Floats) -> Floats:
    """Return the median (n,) of R finite `values` (R, n); NaN where none is finite."""
    if not values.size:
        return np.full(values.shape[1], np.nan)
    stack = np.sort(values, axis=0)  # NaN at the end; np.nanmedian takes ten times as long
    count, columns = np.isfinite(stack).sum(axis=0), np.arange(stack.shape[1])
    return (stack[np.maximum(count - 1, 0) // 2, columns] + stack[count // 2, columns]) / 2.0
