"""Turn the messages of a DataFlash log, binary or text, into a Recording for each run between
restarts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.logs.dataflash.columns import DataFlashColumns, Units, own_clock
from thrustmargin.gcs_plugin.logs.dataflash.dataflash_table import (
    MESSAGES,
    REQUIRED,
    columns_of,
    dataflash_signals,
    without_monitors_off,
)
from thrustmargin.gcs_plugin.logs.dataflash.message_scan import Format
from thrustmargin.gcs_plugin.mavlink.scan import Index
from thrustmargin.gcs_plugin.telemetry.flight_log import sorties_of
from thrustmargin.gcs_plugin.telemetry.recording import (
    FlightLog,
    LogQuality,
    Recording,
    damage_of,
    pauses,
    placed,
    restarts,
    stretches,
)
from thrustmargin.gcs_plugin.telemetry.signals import Signals, Stream
from thrustmargin.gcs_plugin.telemetry.vehicle_events import (
    Options,
    VehicleEvent,
    error_events,
    parameter_events,
)
from thrustmargin.mission.plan_check import parameter
from thrustmargin.mission.plan_items import PlanItem
from thrustmargin.models.errors import LogError
from thrustmargin.models.flight import Floats

_GPS_EPOCH = 315964800.0  # Unix s of 1980-01-06
_LEAP_SECONDS = 18.0  # GPS time ahead of UTC since 2017
_WEEK = 604800.0
_GPS_TIME = (("GWk", "GMS"), ("Week", "TimeMS"))  # later, and up to ArduCopter 3.2
_TIMELESS = ("PARM", "CMD")


class Messages(NamedTuple):
    """All messages of one type, arrays (n,)."""

    form: Format
    table: NDArray[np.void]
    clock_s: Floats  # since boot; NaN unknown
    place: Index  # offset in the file

    def slice(self, first: int, end: int) -> Messages:
        """Return the messages from byte `first` up to `end`, without those whose time is missing.

        Types without a clock keep all messages.
        """
        rows = (self.place >= first) & (self.place < end)
        if own_clock(self.form.columns) is not None:
            rows &= np.isfinite(self.clock_s)
        return Messages(self.form, self.table[rows], self.clock_s[rows], self.place[rows])


class Times(NamedTuple):
    """The vehicle's clock along the file: (n,) s since boot, and the file offsets (n,)."""

    clock_s: Floats
    place: Index


def boots_of(
    path: Path,
    format_name: str,
    messages: Mapping[str, Messages],
    times: Times,
    *,
    size: int,
    kept: int,
    skipped: Sequence[tuple[int, int]],
    vehicle: int | None,
) -> Iterator[Recording]:
    """Yield a recording for each run between restarts of a file of `size` bytes.

    `format_name` is that of its LogFormat. `messages` are the needed ones and the three that define
    units, by name; `times` the clock along the file; `kept` the number of all messages; `skipped`
    the (offset, length) of damage. Raise LogError if `vehicle`, if not None, is not the one in the
    log.
    """
    in_text = format_name != "DataFlash"
    units = Units.from_tables(lambda name: messages[name].table if name in messages else None)
    parts = stretches(times.clock_s, path.name)

    quality = LogQuality(
        bytes=size,
        frames=kept,
        **damage_of(skipped, times.place, times.clock_s),
        clock_jumps=restarts(times.clock_s, parts),
    )
    # What has no time of its own, between two starts, belongs to the later one.
    ends = [*(int(times.place[part.last]) + 1 for part in parts[:-1]), size]
    for part, (first, end) in zip(parts, pairwise([0, *ends]), strict=True):
        of_boot = {n: messages[n].slice(first, end) for n in MESSAGES if n in messages}
        of_messages = {name: _stream(own, units, in_text=in_text) for name, own in of_boot.items()}
        streams = {name: stream for name, stream in of_messages.items() if stream is not None}
        gaps = pauses(times.clock_s[part.first : part.last + 1])
        yield _recording_of(path, format_name, streams, replace(quality, gaps=gaps), vehicle)


def _stream(messages: Messages, units: Units, *, in_text: bool) -> Stream | None:
    """Return the messages as a Stream; None if there are none, or a time or column is missing.

    `in_text`: they are from a text log, whose numbers are scaled already. Parameters and mission
    items need no time.
    """
    name = messages.form.name
    scale, label = units.describe(messages.form, text=in_text)
    if not messages.place.size or any(column not in scale for column in REQUIRED.get(name, ())):
        return None
    # A damaged description can hide a message's time; parameters and missions need none.
    if name not in _TIMELESS and not np.isfinite(messages.clock_s).all():
        return None
    return Stream(messages.clock_s, DataFlashColumns(messages.table, scale, label))


def _recording_of(
    path: Path,
    format_name: str,
    streams: Mapping[str, Stream],
    quality: LogQuality,
    vehicle: int | None,
) -> Recording:
    """Return the Recording of the streams of one boot, by message name.

    The system id is MAV_SYSID, else 1; raise LogError if `vehicle`, if not None, is another one.
    """
    parameters: dict[str, float] = {}
    sent: tuple[tuple[float, str, float], ...] = ()
    if "PARM" in streams:
        columns = columns_of(streams["PARM"])
        names, values = columns.texts("Name"), columns.number("Value").tolist()
        parameters = dict(zip(names, values, strict=True))
        sent = tuple(zip(streams["PARM"].time_s.tolist(), names, values, strict=True))
    own = parameter(parameters, "MAV_SYSID")
    own = int(own) if 0 < own < 256 else 1
    if vehicle is not None and vehicle != own:
        raise LogError(f"{path.name}: no vehicle {vehicle}; it is the log of vehicle {own}")
    return Recording(
        path=path,
        format=format_name,
        streams=streams,
        parameters=parameters,
        waypoints=_waypoints(streams.get("CMD")),
        messages=_texts(streams.get("MSG")),
        events=(*_errors(streams.get("ERR")), *parameter_events(sent)),
        parameters_sent=sent,
        unix_minus_clock=_unix_offset(streams.get("GPS")),
        quality=quality,
        vehicle=own,
        vehicles=(own,),
        autopilot="ArduPilot",
    )


def _texts(stream: Stream | None) -> tuple[tuple[float, str], ...]:
    if stream is None:
        return ()
    texts = columns_of(stream).texts("Message")
    return tuple(zip(stream.time_s.tolist(), texts, strict=True))


def _errors(stream: Stream | None) -> tuple[VehicleEvent, ...]:
    if stream is None:
        return ()
    part, code = (columns_of(stream).number(name) for name in REQUIRED["ERR"])
    return tuple(error_events(stream.time_s, part, code))


def _unix_offset(stream: Stream | None) -> float | None:
    """Return Unix time minus the vehicle's clock, s, the median over the messages GPS with a week.

    None without such a message.
    """
    if stream is None:
        return None
    columns = columns_of(stream)
    names = next((n for n in _GPS_TIME if all(name in columns for name in n)), None)
    if names is None:
        return None
    week = columns.number(names[0])
    known = week > 1000
    if not known.any():
        return None
    unix = _GPS_EPOCH + week * _WEEK + columns.si(names[1], "ms") - _LEAP_SECONDS
    return float(np.median((unix - stream.time_s)[known]))


def _waypoints(stream: Stream | None) -> tuple[PlanItem, ...]:
    """Return the mission items as last logged in messages CMD, in order; empty if none is."""
    if stream is None:
        return ()
    columns = columns_of(stream)
    items: dict[int, PlanItem] = {}
    names = [*REQUIRED["CMD"], *(["Frame"] if "Frame" in columns else [])]
    table = {name: columns.number(name) for name in names}
    whole = np.isfinite(table["CNum"]) & np.isfinite(table["CId"])
    for row in np.flatnonzero(whole).tolist():
        item = {name: float(values[row]) for name, values in table.items()}
        number = int(item["CNum"])
        items[number] = PlanItem(
            number=number,
            command=int(item["CId"]),
            frame=int(np.nan_to_num(item.get("Frame", 3.0), nan=3.0)),
            parameters=(
                *(item["Prm1"], item["Prm2"], item["Prm3"], item["Prm4"]),
                *placed(round(item["Lat"], 7), round(item["Lng"], 7)),
                item["Alt"],
            ),
        )
    return tuple(items[number] for number in sorted(items))


def sorties_by(
    reader: Callable[..., Iterator[Recording]], path: Path, vehicle: int | None, options: Options
) -> tuple[FlightLog, ...]:
    """Return the sorties of a DataFlash log, read by `reader`."""
    return sorties_of(map(_with_signals, reader(path, vehicle=vehicle)), options)


def _with_signals(boot: Recording) -> tuple[Recording, Signals]:
    signals, unused = without_monitors_off(dataflash_signals(boot.streams), boot.parameters)
    return replace(boot, unused=unused), signals
