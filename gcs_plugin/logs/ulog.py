"""Read PX4's .ulg logs, through pyulog, into a Recording and its signals."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.logs.read import LogFormat
from thrustmargin.gcs_plugin.logs.ulog_messages import whole_messages
from thrustmargin.gcs_plugin.logs.ulog_motors import ulog_motors
from thrustmargin.gcs_plugin.logs.ulog_topics import TOPICS, Topic, ulog_signals, with_vectors
from thrustmargin.gcs_plugin.mavlink.text import clean
from thrustmargin.gcs_plugin.telemetry.recording import (
    LogQuality,
    Recording,
    damage_of,
    longest,
    pauses,
    serial_digits,
    stretches,
    without_leaps,
)
from thrustmargin.gcs_plugin.telemetry.settings.parameter_values import whole_number
from thrustmargin.gcs_plugin.telemetry.signals import Signals, collected
from thrustmargin.gcs_plugin.telemetry.sorties import sorties_of
from thrustmargin.gcs_plugin.telemetry.vehicle_events import parameter_events
from thrustmargin.models.errors import LogError

MAGIC = b"ULog\x01\x12\x35"


def read_ulog(path: Path, *, vehicle: int | None = None) -> tuple[Recording, Signals]:
    """The needed topics of a PX4 log and their signals.

    Raises LogError when the file is damaged beyond reading or `vehicle` is not its own.
    """
    from pyulog import ULog

    whole = whole_messages(path.read_bytes(), TOPICS)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            log = ULog(io.BytesIO(whole.data), disable_str_exceptions=True)
    except Exception as error:
        # pyulog meets what it cannot read with whatever its parsing runs into.
        raise LogError(
            f"{path.name}: damaged PX4 log, {type(error).__name__} while reading it; "
            "download it from the vehicle again"
        ) from error
    topics: dict[str, list[Topic]] = {}
    for data in sorted(log.data_list, key=lambda d: d.multi_id):
        if "timestamp" in data.data:
            columns = _columns(data.data, whole.rows[data.msg_id])
            topics.setdefault(data.name, []).append(_ordered(columns, path.name))
    parameters = {
        str(name): float(value)
        for name, value in log.initial_parameters.items()
        if isinstance(value, (int, float))
    }
    own = whole_number(parameters, "MAV_SYS_ID") or 1
    if vehicle is not None and vehicle != own:
        raise LogError(f"{path.name}: no vehicle {vehicle}; it is the log of vehicle {own}")
    initial = [(-np.inf, name, value) for name, value in parameters.items()]
    changed = [(at * 1e-6, str(name), float(to)) for at, name, to in log.changed_parameters]
    motors = ulog_motors(topics, parameters)
    signals = {**ulog_signals(topics), **collected(motors.signals)}
    notes = motors.notes
    if log.dropouts:
        lost = sum(d.duration for d in log.dropouts) * 1e-3
        notes.append(f"{len(log.dropouts)} dropouts while logging, {lost:.1f} s in all")
    times = [t["timestamp"] for group in topics.values() for t in group]
    seconds = np.sort(np.concatenate(times), kind="stable") * 1e-6 if times else np.empty(0)
    recording = Recording(
        path=path,
        format="ULog",
        streams={},
        parameters=parameters,
        messages=tuple((m.timestamp * 1e-6, clean(str(m.message))) for m in log.logged_messages),
        events=tuple(parameter_events([*initial, *changed], first=True)),
        parameters_sent=(*initial, *changed),
        unix_minus_clock=_unix_offset(topics),
        quality=LogQuality(
            bytes=path.stat().st_size,
            frames=int(sum(t.size for t in times)),
            **damage_of(whole.skipped, np.empty(0, np.int64), np.empty(0)),
            gaps=pauses(seconds),
        ),
        vehicle=own,
        vehicles=(own,),
        autopilot="PX4",
        mav_type=_mav_type(topics, parameters),
        motor_order=motors.motor_order,
        esc_order=motors.esc_order,
        unused=motors.unused,
        notes=tuple(notes),
        hardware_id=serial_digits(str(log.msg_info_dict.get("sys_uuid", ""))),
        firmware=" ".join(filter(None, ("PX4", log.get_version_info_str()))),
    )
    return recording, signals


def _columns(first: Topic, rows: NDArray[np.uint8]) -> Topic:
    """The columns of all `rows` (n, bytes of one) of a topic, as those of its `first` are read."""
    form = np.dtype([(name, column.dtype) for name, column in first.items()])
    table = np.ascontiguousarray(rows[:, : form.itemsize]).view(form)[:, 0]
    return {name: table[name] for name in first}


def _ordered(data: Topic, name: str) -> Topic:
    """One topic with whole rows only and, after a restart of time, its longest stretch."""
    size = min(len(column) for column in data.values())
    time_s = without_leaps(data["timestamp"][:size].astype(np.float64) * 1e-6)
    known = np.isfinite(time_s)
    if not known.all():
        data = {field: column[:size][known] for field, column in data.items()}
        time_s = time_s[known]
    stretch = longest(stretches(time_s, name))
    rows = slice(stretch.first, stretch.last + 1)
    return with_vectors({field: column[:size][rows] for field, column in data.items()})


def _mav_type(topics: Mapping[str, list[Topic]], parameters: Mapping[str, float]) -> int | None:
    """The vehicle type that the vehicle reports, else the one that it is set to."""
    for status in topics.get("vehicle_status", []):
        if "system_type" in status and status["system_type"].size:
            return int(status["system_type"][-1])
    return whole_number(parameters, "MAV_TYPE")


def _unix_offset(topics: Mapping[str, list[Topic]]) -> float | None:
    for topic in topics.get("vehicle_gps_position", []):
        if "time_utc_usec" not in topic:
            continue
        unix = topic["time_utc_usec"] * 1e-6
        known = unix > 1e9
        if known.any():
            return float(np.median((unix - topic["timestamp"] * 1e-6)[known]))
    return None


FORMAT = LogFormat(
    name="ULog",
    known_by="a PX4 log (.ulg, it begins with ULog)",
    suffixes=(".ulg", ".ulog"),
    likeness=lambda begins: float(begins.head.startswith(MAGIC)),
    read=lambda path, vehicle, options: sorties_of([read_ulog(path, vehicle=vehicle)], options),
)
