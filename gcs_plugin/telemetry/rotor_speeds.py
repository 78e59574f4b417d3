"""Rotor speeds as measured: the readings of every ESC without those that are no measurement."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.resample import last_before
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

IDLE = 0.12  # of the motor output; ArduPilot's motors turn when armed at 0.1
SPIN_UP = 1.0  # s for which the output must be above idle before a standing rotor is a surprise
FRESH = 2.0  # s for which a motor output is believed without being repeated
_TAIL = TRACK_CHANNELS["rotor_speed_rpm"].max_age  # s of readings that later rows may still use


@dataclass(frozen=True, slots=True, eq=False)
class RotorMemory:
    """One rotor up to the last reading that was looked at."""

    last: LastReading = field(default_factory=LastReading)
    tail: Signal | None = None  # its last measured readings


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredSpeeds:
    """One signal a rotor without what is no measurement; None where no ESC reports."""

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
    """The readings of `speeds` (rpm, one signal a rotor) that measure the rotor's speed.

    `outputs` are the motor outputs from 0 to 1. Readings up to `heard_s` were looked at
    before, with what `memory` holds of them. `look_ahead`: the signals are of the whole flight.
    """
    if len(memory) != len(speeds):
        memory = [RotorMemory()] * len(speeds)
    known = [None if s is None else _known(s) for s in speeds]
    signals: list[Signal | None] = []
    rejected: dict[tuple[int, int], Floats] = {}
    after: list[RotorMemory] = []
    for rotor, signal in enumerate(known):
        if signal is None:
            signals.append(None)
            after.append(RotorMemory())
            continue
        new = signal.time_s > heard_s
        time_s, rpm = signal.time_s[new], signal.values[new]
        output, asked = _demand(outputs[rotor], time_s)
        others = _median_of([s for k, s in enumerate(known) if k != rotor], time_s)
        verdict, last = checked_readings(
            time_s,
            rpm,
            output=output,
            asked=asked,
            others=others,
            before=memory[rotor].last,
            look_ahead=look_ahead,
        )
        if airframe is not None:
            verdict[too_fast(rpm, others, airframe.propeller_diameter)] = LONE
        good = verdict == MEASURED
        made = replace(signal, time_s=time_s[good], values=rpm[good])
        tail = memory[rotor].tail
        if tail is not None:
            times = np.concatenate([tail.time_s, made.time_s])
            made = replace(made, time_s=times, values=np.concatenate([tail.values, made.values]))
        signals.append(made)
        recent = made.time_s >= (time_s[-1] if time_s.size else heard_s) - _TAIL
        tail = replace(made, time_s=made.time_s[recent], values=made.values[recent])
        after.append(RotorMemory(last, tail))
        for why in np.unique(verdict[~good]).tolist():
            rejected[rotor, why] = time_s[verdict == why]
    return MeasuredSpeeds(signals=signals, rejected=MappingProxyType(rejected), memory=tuple(after))


def lifting(speeds: Floats, outputs: Floats) -> Bools:
    """(T,) False where all outputs (T, R) are idle; where none is known, where all rotors stand."""
    known = np.isfinite(outputs).any(axis=1)
    driven = (np.nan_to_num(outputs) > IDLE).any(axis=1)
    stand = np.isfinite(speeds).any(axis=1) & (np.abs(np.nan_to_num(speeds)) < TURNING).all(axis=1)
    return np.where(known, driven, ~stand)


def standing_in_flight(speeds: Floats, outputs: Floats, flying: Bools) -> Bools:
    """(T, R) rows in flight at zero speed of a rotor whose motor output is not known."""
    with np.errstate(invalid="ignore"):
        return flying[:, None] & (np.abs(speeds) < TURNING) & ~np.isfinite(outputs)


def rejected_words(
    measured: MeasuredSpeeds, hidden: Bools, clock_s: Floats, flying: Bools, *, counted: bool
) -> tuple[str, ...]:
    """What was no measurement in flight: a sentence for each rotor and reason, or for all rotors.

    `hidden` (T, R) are the rows of `standing_in_flight`, `clock_s` and `flying` (T,) the rows.
    `counted` gives the number of readings, which a listener cannot know yet.
    """
    found: dict[int, dict[int, int]] = {why: {} for why in REASONS}
    for (rotor, why), time_s in measured.rejected.items():
        row = np.searchsorted(clock_s, time_s, side="right") - 1
        count = int(np.sum(flying[np.maximum(row, 0)]))
        if count:
            found[why][rotor] = count
    for rotor in np.flatnonzero(hidden.any(axis=0)).tolist():
        found[ZERO][rotor] = found[ZERO].get(rotor, 0) + int(hidden[:, rotor].sum())
    said = []
    for why, counts in found.items():
        whole = {-1: sum(counts.values())} if len(counts) == hidden.shape[1] > 1 else counts
        for rotor, count in sorted(whole.items()):
            whose = "every rotor" if rotor < 0 else f"rotor {rotor + 1}"
            many = f"{count} readings in flight, " if counted else ""
            said.append(f"{whose}: {many}no measurement: {REASONS[why]}")
    return tuple(said)


def _known(signal: Signal) -> Signal:
    rows = np.isfinite(signal.values) & np.isfinite(signal.time_s)
    return replace(signal, time_s=signal.time_s[rows], values=signal.values[rows])


def _demand(output: Signal | None, time_s: Floats) -> tuple[Floats, Bools]:
    """(n,) motor output at each time, NaN where unknown, and whether it has been above idle."""
    if output is None:
        return np.full(time_s.size, np.nan), np.zeros(time_s.size, dtype=np.bool_)
    output = _known(output)
    said_s = last_before(replace(output, values=output.time_s), time_s)
    share = last_before(output, time_s)
    share = np.where(time_s - said_s <= FRESH, share, np.nan)
    idle = output.values <= IDLE
    idle_s = last_before(
        replace(output, time_s=output.time_s[idle], values=output.time_s[idle]), time_s
    )
    with np.errstate(invalid="ignore"):
        return share, (share > IDLE) & ~(time_s - idle_s < SPIN_UP)


def _median_of(others: Sequence[Signal | None], time_s: Floats) -> Floats:
    """(n,) median of the last speeds of the other rotors at each time; NaN where none is known."""
    last = [np.abs(last_before(s, time_s)) for s in others if s is not None and s.time_s.size]
    if not last:
        return np.full(time_s.size, np.nan)
    stack = np.sort(last, axis=0)  # NaN at the end; np.nanmedian takes ten times as long
    count, at = np.isfinite(stack).sum(axis=0), np.arange(time_s.size)
    return (stack[np.maximum(count - 1, 0) // 2, at] + stack[count // 2, at]) / 2.0
