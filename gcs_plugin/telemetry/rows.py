"""From a Recording and its signals to a FlightLog: its rows, and every channel on them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.airborne import airborne
from thrustmargin.gcs_plugin.telemetry.channel_report import channel_report
from thrustmargin.gcs_plugin.telemetry.motors import MotorMap, motor_map
from thrustmargin.gcs_plugin.telemetry.position import position_of
from thrustmargin.gcs_plugin.telemetry.power import power, spraying_of
from thrustmargin.gcs_plugin.telemetry.recording import FlightLog, LogQuality, Recording
from thrustmargin.gcs_plugin.telemetry.resample import (
    GRID,
    Sampling,
    known_rows,
    sample,
    thinned,
)
from thrustmargin.gcs_plugin.telemetry.signals import Signals, best
from thrustmargin.gcs_plugin.telemetry.tank_source import TankContext, tank_level
from thrustmargin.gcs_plugin.telemetry.timeline import pauses
from thrustmargin.models.errors import LogError
from thrustmargin.models.flight import TRACK_CHANNELS, FlightTrack, Floats
from thrustmargin.models.physics.airframe import Airframe

_LONGEST = 7 * 86_400.0  # s; a log that seems longer has damaged times


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """How to read: see `logs.read_log`."""

    airframe: Airframe | None = None
    sampling: Sampling = "linear"
    tank: str = "auto"
    tank_start_kg: float | None = None


def assemble(recording: Recording, signals: Signals, options: Options) -> FlightLog:
    """The flight of one vehicle as a table.

    Raises LogError when nothing in it makes a flight, AirframeError when the airframe given has
    another number of rotors.
    """
    motors = motor_map(recording, signals, options.airframe)
    notes = [*recording.notes, *motors.notes]
    chosen = _chosen(recording, signals, motors, options, notes)
    clock_s = _row_times(recording, signals, motors, chosen)
    channels = {name: sample(name, s, clock_s, options.sampling) for name, s in chosen.items()}
    sources = {name: signal.source for name, signal in chosen.items()}
    reported: dict[str, list[Signal]] = {name: [signal] for name, signal in chosen.items()}

    speeds = motors.rotor_speed(signals)
    outputs = motors.throttle(signals, recording.parameters)
    for name, by_rotor in (("rotor_speed_rpm", speeds), ("throttle", outputs)):
        channels[name] = _columns(name, by_rotor, clock_s, options.sampling)
        reported[name] = [signal for signal in by_rotor if signal is not None]
    if reported["rotor_speed_rpm"]:
        sources["rotor_speed_rpm"] = motors.rotor_speed_words(speeds)
    if reported["throttle"]:
        sources["throttle"] = motors.throttle_words(outputs, recording.parameters)
    flying, sources["flying"] = airborne(signals, clock_s, channels)
    place = position_of(signals, clock_s, flying, options.sampling)
    if place.position_ned is not None and place.signal is not None:
        channels["position_ned"] = place.position_ned
        sources["position_ned"] = place.words
        reported["position_ned"] = [place.signal]

    start = recording.unix_minus_clock
    track = FlightTrack.of(
        name=recording.path.name,
        time_s=clock_s - clock_s[0],
        rotor_count=motors.rotor_count,
        flying=flying,
        origin=place.origin,
        start_unix_s=None if start is None else float(start + clock_s[0]),
        sources=sources,
        notes=tuple(notes),
        **channels,
    )
    return FlightLog(
        track=_with_absences(track),
        quality=recording.quality,
        channels=tuple(channel_report(track, n, reported.get(n, [])) for n in TRACK_CHANNELS),
        waypoints=recording.waypoints,
        messages=tuple((time - float(clock_s[0]), text) for time, text in recording.messages),
        parameters=recording.parameters,
        clock_start_s=float(clock_s[0]),
        vehicle=recording.vehicle,
        vehicles=recording.vehicles,
        autopilot=recording.autopilot,
        format=recording.format,
        path=recording.path,
    )


def _chosen(
    recording: Recording,
    signals: Signals,
    motors: MotorMap,
    options: Options,
    notes: list[str],
) -> dict[str, Signal]:
    """The source of every channel but those by rotor and position; adds to `notes`."""
    chosen = {}
    for channel, column in TRACK_CHANNELS.items():
        found = best(signals, channel) if column.direct else None
        if found is not None:
            chosen[channel] = found
    chosen |= power(signals, notes)
    context = TankContext(
        airframe=options.airframe,
        parameters=recording.parameters,
        start_kg=options.tank_start_kg,
        pump_output=motors.pump_output,
    )
    tank = tank_level(signals, context, options.tank)
    notes += tank.notes
    spraying = spraying_of(signals, context, tank.signal, notes)
    for channel, signal in (("tank_kg", tank.signal), ("spraying", spraying)):
        if signal is not None:
            chosen[channel] = signal
    return chosen


def log_of_track(track: FlightTrack, path: Path, size: int) -> FlightLog:
    """A FlightLog of a track that was read as a table."""
    channels = []
    for name in TRACK_CHANNELS:
        signal = Signal(name, track.sources.get(name, ""), track.time_s, getattr(track, name))
        channels.append(channel_report(track, name, [signal] if track.reports(name) else []))
    return FlightLog(
        track=_with_absences(track),
        quality=LogQuality(bytes=size, frames=track.time_s.size, gaps=pauses(track.time_s)),
        channels=tuple(channels),
        waypoints=(),
        messages=(),
        parameters={},
        clock_start_s=float(track.time_s[0]),
        vehicle=1,
        vehicles=(1,),
        autopilot="unknown",
        format="CSV",
        path=path,
    )


def _row_times(
    recording: Recording, signals: Signals, motors: MotorMap, chosen: dict[str, Signal]
) -> Floats:
    """(T,) vehicle's clock of the rows: rotor speed reports, else attitude, else a 10 Hz grid."""
    speeds = [s for s in motors.rotor_speed(signals) if s is not None]
    if speeds:
        rhythm = max(speeds, key=lambda s: int(known_rows(s.values).sum()))
        time_s = thinned(rhythm.time_s)
    elif "attitude" in chosen:
        time_s = thinned(chosen["attitude"].time_s)
    else:
        ends = [s.time_s for s in chosen.values()]
        ends += [s.time_s for s in signals.get("geodetic", ())]
        ends = [e[np.isfinite(e)] for e in ends]
        ends = [e for e in ends if e.size]
        if not ends:
            raise LogError(
                f"{recording.path.name}: {recording.quality.frames} messages, but none with rotor "
                "speed, attitude, position or tank level; there is no flight to show"
            )
        first, last = min(e[0] for e in ends), max(e[-1] for e in ends)
        if last - first > _LONGEST:
            raise LogError(
                f"{recording.path.name}: its times span {(last - first) / 86_400:.0f} days; "
                "the log is too damaged"
            )
        time_s = np.arange(first, last + GRID / 2, GRID)
    if time_s.size == 0:
        raise LogError(f"{recording.path.name}: no row has a time; the log is too damaged")
    return time_s


def _columns(
    channel: str, signals: list[Signal | None], clock_s: Floats, sampling: Sampling
) -> Floats:
    empty = np.full(clock_s.size, np.nan)
    parts = [empty if s is None else sample(channel, s, clock_s, sampling) for s in signals]
    return np.stack(parts, axis=-1) if parts else np.empty((clock_s.size, 0))


def _with_absences(track: FlightTrack) -> FlightTrack:
    """The track with notes of what a reader of a report must know is not there."""
    if not track.reports("rotor_speed_rpm"):
        note = "no ESC telemetry in the log: rotor speeds are unknown"
        return replace(track, notes=(*track.notes, note))
    silent = [
        str(k + 1)
        for k in range(track.rotor_count)
        if not np.isfinite(track.rotor_speed_rpm[:, k]).any()
    ]
    if not silent:
        return track
    return replace(track, notes=(*track.notes, f"no rotor speed of motor {', '.join(silent)}"))
