"""Read ArduPilot's binary DataFlash logs (.BIN) into a Recording."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.logs.dataflash.columns import (
    DataFlashColumns,
    Units,
    filled_clock,
    own_clock,
)
from thrustmargin.gcs_plugin.logs.dataflash.dataflash_table import (
    MESSAGES,
    REQUIRED,
    columns_of,
    dataflash_signals,
    without_monitors_off,
)
from thrustmargin.gcs_plugin.logs.dataflash.message_scan import (
    FMT_HEAD,
    LETTERS,
    PADDING,
    FoundMessages,
    scan,
)
from thrustmargin.gcs_plugin.logs.read import Beginning, LogFormat
from thrustmargin.gcs_plugin.mavlink.scan import gather, read_bytes
from thrustmargin.gcs_plugin.telemetry.recording import (
    FlightLog,
    LogQuality,
    NotThisFormat,
    Recording,
    Stream,
    Waypoint,
    damage_of,
    pauses,
    restarts,
    stretches,
    without_leaps,
)
from thrustmargin.gcs_plugin.telemetry.settings.parameter_values import parameter
from thrustmargin.gcs_plugin.telemetry.signals import Signals
from thrustmargin.gcs_plugin.telemetry.sorties import sorties_of
from thrustmargin.gcs_plugin.telemetry.statements import Options
from thrustmargin.gcs_plugin.telemetry.vehicle_events import VehicleEvent, error_events
from thrustmargin.models.errors import LogError
from thrustmargin.models.flight import Bools, Floats

_GPS_EPOCH = 315964800.0  # Unix s of 1980-01-06
_LEAP_SECONDS = 18.0  # GPS time ahead of UTC since 2017
_WEEK = 604800.0
_GPS_TIME = (("GWk", "GMS"), ("Week", "TimeMS"))  # later, and up to ArduCopter 3.2

_TIMELESS = ("PARM", "CMD")
#: Columns of the vehicle's clock: their letters, bytes, type and s of one.
_CLOCKS = (
    ("TimeUS", ("Q", "q"), 8, "<u8", 1e-6),
    ("TimeMS", ("I",), 4, "<u4", 1e-3),
    ("T", ("I",), 4, "<u4", 1e-3),
)

#: Message name to its columns and times (s since boot, NaN unknown), or None.
Lookup = Callable[[str], tuple[DataFlashColumns, Floats] | None]


def dataflash_boots(path: Path, *, vehicle: int | None = None) -> Iterator[Recording]:
    """The needed messages of a binary DataFlash log: a recording from restart to restart.

    Raises LogError when no message can be made out, or `vehicle` is not the one in the log.
    """
    data, size = read_bytes(path, PADDING)
    found = scan(data, size)
    if found.start.size == 0 or len(found.formats) < 2:
        raise NotThisFormat(
            f"{path.name}: no DataFlash message in {size} bytes; is its start missing?"
        )
    clock, usable = _clock(found)
    timed = np.isfinite(clock)
    known = np.flatnonzero(timed)
    parts = stretches(clock[known], path.name)
    jumps = restarts(clock[known], parts)

    def columns(name: str) -> Mapping[str, NDArray[Any]]:
        rows, form = found.rows_of(name)
        table = None if form is None or rows.size == 0 else found.table(rows, form)
        return {} if form is None or table is None else {c: table[c] for c in form.columns}

    units = Units.of(columns)

    def lookup(inside: Bools, name: str) -> tuple[DataFlashColumns, Floats] | None:
        rows, form = found.rows_of(name)
        rows = rows[inside[rows]]
        if form is None or rows.size == 0:
            return None
        scale, label = units.describe(form, text=False)
        return DataFlashColumns(found.table(rows, form), scale, label), clock[rows]

    def time_before(byte: int) -> float:
        row = int(np.searchsorted(found.start, byte)) - 1
        earlier = np.flatnonzero(timed[max(row - 1000, 0) : row + 1])
        return float(clock[max(row - 1000, 0) + earlier[-1]]) if earlier.size else float("nan")

    # What has no time of its own, between two starts, belongs to the later one.
    ends = [*(int(known[part.last]) + 1 for part in parts[:-1]), found.start.size]
    for first, end in pairwise([0, *ends]):
        inside = usable.copy()
        inside[:first] = inside[end:] = False
        quality = LogQuality(
            bytes=size,
            frames=int(found.start.size),
            **damage_of(found.skipped, time_before),
            clock_jumps=jumps,
            gaps=pauses(clock[timed & inside]),
        )
        yield recording_of(path, "DataFlash", partial(lookup, inside), quality, vehicle)


def _clock(found: FoundMessages) -> tuple[Floats, NDArray[np.bool_]]:
    """(n,) s since boot of each message, NaN where it has none; (n,) False where it is damaged."""
    clock = np.full(found.start.size, np.nan)
    usable = np.ones(found.start.size, dtype=np.bool_)
    for column, letters, width, kind, unit in _CLOCKS:
        # Where in a message its clock is, 0 in those that have none in this unit.
        offset = np.zeros(256, dtype=np.int64)
        for number, form in found.formats.items():
            own = own_clock(form.columns)
            at = form.columns.index(column) if own is not None and own[0] == column else -1
            if at >= 0 and form.letters[at] in letters:
                before = form.letters[:at]
                offset[number] = 3 + sum(np.dtype(LETTERS[x][0]).itemsize for x in before)
        rows = np.flatnonzero(offset[found.type])
        if rows.size:
            start = found.start[rows] + offset[found.type[rows]]
            raw = gather(found.data, start, width).view(kind).ravel()
            clock[rows] = without_leaps(raw * unit)
            usable[rows] = np.isfinite(clock[rows])
    old = not any(form.columns[:1] == ("TimeUS",) for form in found.formats.values())
    return filled_clock(clock) if old else clock, usable


def recording_of(
    path: Path,
    format_name: str,
    lookup: Lookup,
    quality: LogQuality,
    vehicle: int | None,
) -> Recording:
    """A Recording from the columns of each message, binary or text.

    Raises LogError when `vehicle` is not the one in the log.
    """
    streams: dict[str, Stream] = {}
    for name in MESSAGES:
        found = lookup(name)
        if found is None or any(c not in found[0] for c in REQUIRED.get(name, ())):
            continue
        columns, time_s = found
        # A damaged description can hide a message's time; parameters and missions need none.
        if name in _TIMELESS or np.isfinite(time_s).all():
            streams[name] = Stream(time_s, columns)
    parameters: dict[str, float] = {}
    if "PARM" in streams:
        columns = columns_of(streams["PARM"])
        values = columns.number("Value").tolist()
        parameters = dict(zip(columns.texts("Name"), values, strict=True))
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
        events=_errors(streams.get("ERR")),
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
    """Seconds from the vehicle's clock to Unix time by the GPS week; None without a fix."""
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


def _waypoints(stream: Stream | None) -> tuple[Waypoint, ...]:
    """The mission as last logged, by item number."""
    if stream is None:
        return ()
    columns = columns_of(stream)
    items: dict[int, Waypoint] = {}
    names = [*REQUIRED["CMD"], *(["Frame"] if "Frame" in columns else [])]
    table = {name: columns.number(name) for name in names}
    whole = np.isfinite(table["CNum"]) & np.isfinite(table["CId"])
    for row in np.flatnonzero(whole).tolist():
        item = {name: float(values[row]) for name, values in table.items()}
        placed = (item["Lat"], item["Lng"]) != (0.0, 0.0)
        number = int(item["CNum"])
        items[number] = Waypoint(
            number=number,
            command=int(item["CId"]),
            frame=int(np.nan_to_num(item.get("Frame", 3.0), nan=3.0)),
            latitude_deg=round(item["Lat"], 7) if placed else float("nan"),
            longitude_deg=round(item["Lng"], 7) if placed else float("nan"),
            altitude=item["Alt"],
            parameters=(item["Prm1"], item["Prm2"], item["Prm3"], item["Prm4"]),
        )
    return tuple(items[number] for number in sorted(items))


def _likeness(begins: Beginning) -> float:
    if begins.text is not None:
        return 0.0
    described = begins.head.count(FMT_HEAD) >= 3 or begins.suffix in FORMAT.suffixes
    return 0.8 if described else 0.2


def sorties_by(
    reader: Callable[..., Iterator[Recording]], path: Path, vehicle: int | None, options: Options
) -> tuple[FlightLog, ...]:
    """The sorties of a DataFlash log, binary or text by its `reader`."""
    return sorties_of(map(_with_signals, reader(path, vehicle=vehicle)), options)


def _with_signals(boot: Recording) -> tuple[Recording, Signals]:
    signals, unused = without_monitors_off(dataflash_signals(boot.streams), boot.parameters)
    return replace(boot, unused=unused), signals


FORMAT = LogFormat(
    name="DataFlash",
    known_by="an ArduPilot log (.BIN, it begins with descriptions FMT)",
    suffixes=(".bin", ".log"),
    likeness=_likeness,
    read=partial(sorties_by, dataflash_boots),
)
