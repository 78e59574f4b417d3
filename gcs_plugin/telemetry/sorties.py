"""Divide a log into sorties.

A sortie ends where the vehicle restarts, or where the aircraft is on the ground disarmed, for long,
or while its tank or battery becomes fuller. A short touch-down ends none.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.flight_log import assemble, log_of_rows, tabulate
from thrustmargin.gcs_plugin.telemetry.recording import FlightLog, Recording
from thrustmargin.gcs_plugin.telemetry.rotor_speeds import IDLE
from thrustmargin.gcs_plugin.telemetry.signals import Signals, best
from thrustmargin.gcs_plugin.telemetry.vehicle_events import Options
from thrustmargin.models.checks.loss_of_control import loss_of_control
from thrustmargin.models.errors import LogError
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.physics.smoothing import known_median
from thrustmargin.models.statement import Statement, state

LONG_DOWN = 60.0  # s on the ground after which, armed or not, the next flight is another sortie
SERVICE = 10.0  # s, the least in which a tank or battery is changed
REFILL_KG = 2.0  # more in the tank after a stay on the ground than before it; a gauge sloshes less
FRESH = 0.05  # share of voltage, the same of the battery; one that rests recovers less
LOOK = 5.0  # s of flight whose medians are compared
REST = 30.0  # s on the ground that belong to the flight before or after
_ON_GROUND = 1  # MAV_LANDED_STATE
#: Channels that are reported when they change: a sortie needs their last report before it.
_LASTING = (
    *("home", "ekf_origin", "landed", "armed"),
    *("battery_cells", "battery_nominal", "battery_capacity"),
)

Span = tuple[float, float]


def sorties_of(
    boots: Iterable[tuple[Recording, Signals]], options: Options
) -> tuple[FlightLog, ...]:
    """Return the numbered sorties of a log from its recordings and signals, one pair for each boot.

    An aircraft that turned over before it rose makes a sortie too. If nothing flew, return the
    recording with most rows alone. Raise LogError if no recording makes a table, AirframeError if
    the airframe has another number of rotors.
    """
    flown: list[FlightLog] = []
    idle: list[FlightLog] = []
    failed: list[LogError] = []
    for recording, signals in boots:
        try:
            whole = tabulate(recording, signals, options)
        except LogError as error:
            failed.append(error)
            continue
        if not is_sortie(whole.track, signals):
            idle.append(log_of_rows(whole, recording, signals))
            continue
        spans = flight_spans(whole.track, float(whole.clock_s[0]), signals)
        if len(spans) == 1:
            flown.append(log_of_rows(whole, recording, signals))
        else:
            del whole  # as large as its sorties together
            flown += (assemble(*_cut(recording, signals, span), options) for span in spans)
    if not flown and not idle:
        raise failed[0]
    if not flown:
        longest = max(idle, key=lambda log: log.track.time_s.size)
        flown = [longest]
        idle.remove(longest)
    unflown = _unflown([log.track.duration for log in idle], list(map(str, failed)))
    return tuple(
        _numbered(replace(log, sortie=k, sorties=len(flown), unflown=unflown))
        for k, log in enumerate(flown, 1)
    )


def _unflown(seconds: Sequence[float], reasons: Sequence[str]) -> tuple[Statement, ...]:
    """Return a note on the parts of a log without flight, and one on each part that is unreadable.

    `seconds` are the durations, s, of the former, `reasons` the errors of the latter.
    """
    idle = ()
    if seconds:
        kind = "stretch without flight" if len(seconds) == 1 else "stretches without flight"
        idle = (state(kind, count=float(len(seconds)), total_duration=sum(seconds)),)
    return (*idle, *(state("stretch unreadable", reason=reason) for reason in reasons))


def _numbered(log: FlightLog) -> FlightLog:
    """Return the log with the sortie's number in its track's name, and notes on the rest of the
    file.
    """
    track, restarts = log.track, len(log.quality.clock_jumps)
    notes = (state("restarts", count=float(restarts)),) if restarts else ()
    name = f"{track.name}{log.sortie_suffix}"
    return replace(log, track=replace(track, name=name, notes=(*notes, *log.unflown, *track.notes)))


def is_sortie(track: FlightTrack, signals: Signals) -> bool:
    """Return True if the aircraft flew, or turned over before it could."""
    return has_flight(track, signals) or bool(loss_of_control(track))


def has_flight(track: FlightTrack, signals: Signals) -> bool:
    """Return True if a row is off the ground, and the motors ran above idle.

    False if the vehicle was never armed, or no output in flight is above IDLE.
    """
    armed = best(signals, "armed")
    output = track.throttle[track.flying]
    off = armed is not None and not np.any(armed.values > 0)
    idle = np.any(np.isfinite(output)) and not np.any(output > IDLE)
    return bool(track.flying.any()) and not off and not idle


def flight_spans(track: FlightTrack, clock_start_s: float, signals: Signals) -> list[Span]:
    """Return start and end, s of the vehicle's clock, of each sortie of one boot.

    `clock_start_s` is that clock at the track's time 0. Each span includes at most REST s of ground
    before and after. The first starts at -inf and the last ends at inf, to include all rows.
    """
    clock_s = clock_start_s + track.time_s
    flying = np.concatenate([[False], track.flying, [False]])
    starts, ends = (np.flatnonzero(np.diff(flying.astype(np.int8)) == step) for step in (1, -1))
    edges = [-np.inf]
    for end, start in zip(ends[:-1].tolist(), starts[1:].tolist(), strict=True):
        stay = _stay(track, clock_s, slice(end, start + 1), signals)
        if stay is not None:
            down, up = stay
            middle = 0.5 * (down + up)
            edges += [min(down + REST, middle), max(up - REST, middle)]
    edges.append(np.inf)
    return list(zip(edges[::2], edges[1::2], strict=True))


def _stay(track: FlightTrack, clock_s: Floats, rows: slice, signals: Signals) -> Span | None:
    """Return start and end, s of the vehicle's clock, of a stay on the ground that ends a sortie.

    It ends one if the vehicle was disarmed, landed for LONG_DOWN s or more, or serviced; else None.
    `clock_s` (T,) is the clock of the track's rows; `rows` run from the first on the ground to the
    first in the air again.
    """
    down, up = float(clock_s[rows.start]), float(clock_s[rows.stop - 1])
    # In a pause of the log it may have been disarmed before the first row on the ground.
    armed_s, armed = _samples_between(signals, "armed", float(clock_s[rows.start - 1]), up)
    if np.any(armed == 0):
        off = np.flatnonzero(armed == 0)
        rearmed = armed_s[off[-1] + 1 :]
        return float(armed_s[off[0]]), float(rearmed[0]) if rearmed.size else up
    landed_s, landed = _samples_between(signals, "landed", down, up)
    on_ground = landed_s[landed == _ON_GROUND]
    if on_ground.size and up - on_ground[0] >= LONG_DOWN:
        return float(on_ground[0]), up
    return (down, up) if serviced(track, clock_s, down, up) else None


def serviced(track: FlightTrack, clock_s: Floats, down: float, up: float) -> bool:
    """Return True if tank or battery were fuller after a stay of at least SERVICE s than before it.

    The stay is from `down` to `up`, s of `clock_s` (T,), the clock of the track's rows. False where
    the levels are unknown.
    """
    before = (clock_s > down - LOOK) & (clock_s < down)
    after = (clock_s >= up) & (clock_s < up + LOOK)
    refilled = known_median(track.tank_kg[after]) - known_median(track.tank_kg[before]) >= REFILL_KG
    fresh = known_median(track.voltage[after]) >= (1.0 + FRESH) * known_median(
        track.voltage[before]
    )
    return up - down >= SERVICE and bool(refilled or fresh)


def _samples_between(
    signals: Signals, channel: str, start: float, end: float
) -> tuple[Floats, Floats]:
    """Return times and finite values (n,) of a channel's reports from `start` to `end`; empty
    without a report."""
    signal = best(signals, channel)
    if signal is None:
        return np.empty(0), np.empty(0)
    rows = (signal.time_s >= start) & (signal.time_s <= end) & np.isfinite(signal.values)
    return signal.time_s[rows], signal.values[rows]


def _cut(recording: Recording, signals: Signals, span: Span) -> tuple[Recording, Signals]:
    """Return recording and signals restricted to a sortie's `span`, s of the vehicle's clock.

    Signals that are reported only on changes include all reports before it.
    """
    start, end = span
    quality = recording.quality
    gaps = tuple(gap for gap in quality.gaps if start <= gap[0] < end)
    messages = tuple(message for message in recording.messages if start <= message[0] < end)
    part = replace(
        recording,
        messages=messages,
        events=tuple(event for event in recording.events if start <= event.time_s < end),
        earlier_texts=tuple(text for time_s, text in recording.messages if time_s < start),
        parameters=_parameters_at(recording, end),
        quality=replace(quality, gaps=gaps),
    )
    return part, dict(_cut_signals(signals, span))


def _parameters_at(recording: Recording, end: float) -> dict[str, float]:
    """Return the parameters' last values before `end`, s of the vehicle's clock, by name.

    A parameter first sent later has its first value, the best known for this sortie.
    """
    known = dict(recording.parameters)
    first: dict[str, float] = {}
    last: dict[str, float] = {}
    for time_s, name, value in recording.parameters_sent:
        first.setdefault(name, value)
        if not time_s >= end:
            last[name] = value
    return known | first | last


def _cut_signals(signals: Signals, span: Span) -> Iterator[tuple[str, tuple[Signal, ...]]]:
    for channel, channel_signals in signals.items():
        start = -np.inf if channel in _LASTING else span[0]
        kept: list[Signal] = []
        whole, time_s, rows = None, np.empty(0), slice(0)
        for signal in channel_signals:
            if signal.time_s is not whole:
                whole = signal.time_s
                rows = slice(*whole.searchsorted((start, span[1])))
                time_s = whole[rows]  # of several signals at once: they stay so
            if time_s.size:
                kept.append(signal._replace(time_s=time_s, values=signal.values[rows]))
        if kept:
            yield channel, tuple(kept)
