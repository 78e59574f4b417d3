"""Make a FlightLog from a Recording and its signals, or from a table."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.mavlink.text import clean
from thrustmargin.gcs_plugin.telemetry.motors import motor_map
from thrustmargin.gcs_plugin.telemetry.power import esc_voltage_offsets, stated_battery
from thrustmargin.gcs_plugin.telemetry.recording import (
    ChannelReport,
    FlightLog,
    LogHeader,
    LogQuality,
    Recording,
    pauses,
)
from thrustmargin.gcs_plugin.telemetry.resample import known_rows
from thrustmargin.gcs_plugin.telemetry.rotor_speeds import (
    measured_speeds,
    rejected_readings,
    stopped_in_flight,
)
from thrustmargin.gcs_plugin.telemetry.rows import FlightRows, flight_rows
from thrustmargin.gcs_plugin.telemetry.settings.vehicle_kind import vehicle_facts
from thrustmargin.gcs_plugin.telemetry.signals import Signals, best, by_index
from thrustmargin.gcs_plugin.telemetry.vehicle_events import (
    EventKind,
    Options,
    arming_events,
    flag_events,
    text_events,
)
from thrustmargin.models.checks.speed_readings import speed_resolution
from thrustmargin.models.errors import LogError
from thrustmargin.models.flight import TRACK_CHANNELS, FlightTrack
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


def assemble(recording: Recording, signals: Signals, options: Options) -> FlightLog:
    """Return the flight of one vehicle as a log; raise the errors of `tabulate`."""
    return log_of_rows(tabulate(recording, signals, options), recording, signals)


def tabulate(recording: Recording, signals: Signals, options: Options) -> FlightRows:
    """Return the rows of one vehicle's flight, without rotors if it is no multirotor.

    Raise LogError if no row can be made, AirframeError if the airframe has another number of
    rotors.
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
    """Build the log of a flight from its rows, with channel reports, events and texts."""
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
    """Return the FlightLog of a track that was read as a table of `size` bytes.

    Invalid rotor speeds are removed. `format` is the name of its LogFormat. A table has no system
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
    """Add a note on motors without rotor speeds, and a statement if the speeds' resolution is
    coarse."""
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
    """Return the log with another track, and new reports for channels that only this track has."""
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

    `unused` is the reason for a channel without values.
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
