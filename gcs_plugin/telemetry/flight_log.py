"""Make the FlightLog of each sortie from a Recording and its signals, or one log from a table.

A sortie ends where the vehicle restarts, or where the aircraft is on the ground disarmed, for long,
or while its tank or battery becomes fuller. A short touch-down ends none.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.airborne import ON_GROUND
from thrustmargin.gcs_plugin.telemetry.battery_and_tank import esc_voltage_offsets, stated_battery
from thrustmargin.gcs_plugin.telemetry.motors import (
    IDLE,
    measured_speeds,
    motor_map,
    rejected_readings,
    stopped_in_flight,
)
from thrustmargin.gcs_plugin.telemetry.recording import (
    ChannelReport,
    FlightLog,
    LogHeader,
    LogQuality,
    Recording,
    pauses,
)
from thrustmargin.gcs_plugin.telemetry.rows import FlightRows, flight_rows
from thrustmargin.gcs_plugin.telemetry.settings.vehicle_kind import vehicle_facts
from thrustmargin.gcs_plugin.telemetry.signals import Signals, best, by_index, known_rows
from thrustmargin.gcs_plugin.telemetry.vehicle_events import (
    EventKind,
    Options,
    arming_events,
    flag_events,
    text_events,
)
from thrustmargin.gcs_plugin.wording.language import clean
from thrustmargin.models.checks.loss_of_control import loss_of_control
from thrustmargin.models.checks.speed_readings import speed_resolution
from thrustmargin.models.errors import LogError
from thrustmargin.models.flight import TRACK_CHANNELS, FlightTrack, Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.smoothing import known_median
from thrustmargin.models.provenance import NOT_REPORTED
from thrustmargin.models.statement import Statement, state
from thrustmargin.models.vehicle_facts import VehicleFacts

#: Channels of the table whose reports have another name.
_REPORTED_AS = {
    "voltage": "battery_voltage",
    "current": "battery_current",
    "rotor_speed_rpm": "esc_rpm",
    "throttle": "servo_us",
}
_LONGEST = 7 * 86_400.0  # s; a log that seems longer has damaged times
LONG_DOWN = 60.0  # s on the ground after which, armed or not, the next flight is another sortie
SERVICE = 10.0  # s, the least in which a tank or battery is changed
REFILL_KG = 2.0  # more in the tank after a stay on the ground than before it; a gauge sloshes less
FRESH = 0.05  # share of voltage, the same of the battery; one that rests recovers less
LOOK = 5.0  # s of flight whose medians are compared
REST = 30.0  # s on the ground that belong to the flight before or after
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
            parts = (_cut(recording, signals, span) for span in spans)
            flown += (log_of_rows(tabulate(*part, options), *part) for part in parts)
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
    on_ground = landed_s[landed == ON_GROUND]
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
    """Return times and finite values (n,) of a channel's reports from `start` to `end`, both
    inclusive, s.

    Both arrays are empty without a report.
    """
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


def tabulate(recording: Recording, signals: Signals, options: Options) -> FlightRows:
    """Return the rows of one vehicle's flight; with no rotors if rotors do not lift it.

    `signals` are those of the recording, by channel. Raise LogError if no row can be made or times
    span over a week, AirframeError if the airframe has another number of rotors.
    """
    name = clean(recording.path.name)
    facts = vehicle_facts(
        recording.parameters,
        mav_type=recording.mav_type,
        texts=(*recording.earlier_texts, *(text for _, text in recording.messages)),
        whole=recording.parameters_whole,
    )
    motors = motor_map(
        name,
        recording.parameters,
        signals,
        options.airframe,
        facts=facts,
        motor_order=recording.motor_order,
        esc_order=recording.esc_order,
    )
    rows = flight_rows(
        signals,
        motors,
        recording.parameters,
        options,
        name=name,
        unix_minus_clock=recording.unix_minus_clock,
        notes=(*recording.notes, *motors.notes),
    )
    if rows is None:
        raise LogError(
            f"{name}: {recording.quality.frames} messages, but none with rotor speed, attitude, "
            "position or tank level and a time; there is no flight to show"
        )
    if rows.track.duration > _LONGEST:
        days = rows.track.duration / 86_400
        raise LogError(f"{name}: its times span {days:.0f} days; the log is too damaged")
    return rows


#: Channels in which an ESC reports on itself, and the text of the report.
ESC_FLAGS = {"esc_failure": "failure flags", "esc_edt2": "EDT2 status"}


def log_of_rows(rows: FlightRows, recording: Recording, signals: Signals) -> FlightLog:
    """Build the log of a flight from its rows, with channel reports, events and texts.

    `signals` are those of the `recording`, by channel. Times become s from the first row.
    """
    track, motors = rows.track, rows.motors
    start_s = float(rows.clock_s[0])
    # What is reported and not in the table, then what a reader met and could not use.
    unused = {
        name: state(
            "not used", source=silent[0].source, why=state(_unused_reason(name, silent, rows))
        )
        for name in TRACK_CHANNELS
        if (silent := signals.get(name) or signals.get(_REPORTED_AS.get(name, "")))
    } | dict(recording.unused)
    texts, armed = text_events(recording.messages), best(signals, "armed")
    failures = [
        event
        for channel, text in ESC_FLAGS.items()
        for motor, esc in enumerate(motors.escs)
        if (sent := by_index(signals, channel).get(esc)) is not None
        for event in flag_events(
            EventKind.ESC_FAILURE, sent.time_s, sent.values, str(motor + 1), text
        )
    ]
    events = [*recording.events, *texts, *failures, *arming_events(armed)]
    events = sorted(events, key=lambda e: e.time_s)
    flown_s = rows.clock_s[track.flying]
    up_s, down_s = (flown_s[0], flown_s[-1]) if flown_s.size else (np.inf, np.inf)
    # On the ground parameters are set and sent anew.
    events = [e for e in events if e.kind is not EventKind.PARAMETER or up_s < e.time_s < down_s]
    header = {part.name: getattr(recording, part.name) for part in fields(LogHeader)} | {
        "messages": tuple((time - start_s, text) for time, text in recording.messages),
        "events": tuple(replace(event, time_s=event.time_s - start_s) for event in events),
    }
    return FlightLog(
        **header,
        track=_with_absences(track),
        channels=tuple(
            channel_report(track, n, rows.reported.get(n, []), unused.get(n))
            for n in TRACK_CHANNELS
        ),
        clock_start_s=start_s,
        facts=replace(motors.facts, battery=stated_battery(signals)),
        esc_voltage_offset_v=esc_voltage_offsets(signals, motors.escs),
        unmeasured=rows.unmeasured,
    )


def log_of_track(
    track: FlightTrack,
    path: Path,
    size: int,
    airframe: Airframe | None = None,
    *,
    format: str = "CSV",
) -> FlightLog:
    """Return the FlightLog of a track that was read from a table at `path`, a file of `size` bytes.

    Invalid rotor speeds become NaN. `format` is the name of its LogFormat. A table has no system
    id: `vehicles` is empty.
    """
    speeds, outputs = (
        [Signal(name, NOT_REPORTED, track.time_s, values) for values in getattr(track, name).T]
        for name in ("rotor_speed_rpm", "throttle")
    )
    measured = measured_speeds(speeds, outputs, airframe, look_ahead=True)
    rpm = np.abs(track.rotor_speed_rpm)
    for rotor, signal in enumerate(measured.signals):
        if signal is not None:
            rpm[~np.isin(track.time_s, signal.time_s), rotor] = np.nan
    hidden = stopped_in_flight(rpm, track.throttle, track.flying)
    rpm[hidden] = np.nan
    unmeasured = rejected_readings(measured, rpm, hidden, track.time_s, track.flying, counted=True)
    track = replace(track, rotor_speed_rpm=rpm, notes=(*track.notes, *unmeasured))
    return FlightLog(
        path=path,
        format=format,
        vehicles=(),
        quality=LogQuality(bytes=size, frames=track.time_s.size, gaps=pauses(track.time_s)),
        track=_with_absences(track),
        channels=tuple(
            channel_report(track, name, [_as_signal(track, name)]) for name in TRACK_CHANNELS
        ),
        clock_start_s=float(track.time_s[0]),
        facts=VehicleFacts(rotor_count=track.rotor_count, rotor_evidence=state("own columns")),
        unmeasured=unmeasured,
    )


def _with_absences(track: FlightTrack) -> FlightTrack:
    """Return a copy of the track with a note on missing rotor speeds, of all or of some motors, and
    a statement if the speeds are coarse, scattered or slow."""
    if not track.reports("rotor_speed_rpm"):
        silent = "rotor_speed_rpm" not in track.sources
        note = state("no ESC telemetry" if silent else "no ESC telemetry that measures")
        return replace(track, notes=(*track.notes, note))
    silent = [
        str(k + 1)
        for k in range(track.rotor_count)
        if not np.isfinite(track.rotor_speed_rpm[:, k]).any()
    ]
    notes = [state("motors without speed", motors=", ".join(silent))] if silent else []
    coarse = speed_resolution(track)
    statements = (*track.statements, *((coarse,) if coarse else ()))
    return replace(track, notes=(*track.notes, *notes), statements=statements)


def with_track(log: FlightLog, track: FlightTrack) -> FlightLog:
    """Return the log with another track, and new reports for channels that only this track has.

    Other channels keep their reports.
    """
    channels = tuple(
        channel_report(track, report.name, [_as_signal(track, report.name)])
        if report.samples == 0 and track.reports(report.name)
        else report
        for report in log.channels
    )
    return replace(log, track=track, channels=channels)


def _as_signal(track: FlightTrack, channel: str) -> Signal:
    return Signal(channel, track.source(channel), track.time_s, getattr(track, channel))


def _unused_reason(name: str, silent: Iterable[Signal], rows: FlightRows) -> str:
    """Return the kind of the reason why a reported channel has no value in the table."""
    if not any(np.isfinite(signal.values).any() for signal in silent):
        return "no value"
    if TRACK_CHANNELS[name].per_rotor and name not in rows.track.sources:
        return "of no known motor"
    return "no plausible value in time"


def channel_report(
    track: FlightTrack, name: str, signals: list[Signal], unused: Statement | None = None
) -> ChannelReport:
    """Return rate and pauses of a channel's reports, and the range of its values in the track.

    `signals` are the sources used; that with most reports counts. `unused` is the reason for a
    channel without values, of which all figures are NaN and `samples` 0.
    """
    values, source = getattr(track, name), track.source(name)
    finite = values[np.isfinite(values)]
    if not signals or finite.size == 0:
        signals, finite = [], np.full(1, np.nan)
    signal = max(signals, key=lambda s: s.time_s.size, default=None)
    known_s = np.empty(0) if signal is None else signal.time_s[known_rows(signal.values)]
    step = np.diff(known_s)
    step = step[step > 0]
    return ChannelReport(
        name=name,
        unit=TRACK_CHANNELS[name].unit,
        source=source,
        unused=unused if signal is None else None,
        samples=known_s.size,
        rate_hz=1.0 / known_median(step) if step.size else float("nan"),
        gaps=int(np.sum(step > TRACK_CHANNELS[name].max_age)),
        longest_gap_s=float(step.max()) if step.size else float("nan"),
        minimum=float(finite.min()),
        median=known_median(finite),
        maximum=float(finite.max()),
    )
