"""Read ArduPilot's binary DataFlash logs (.BIN) into a Recording."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.logs.dataflash.columns import DataFlashColumns, Units
from thrustmargin.gcs_plugin.logs.dataflash.dataflash_table import (
    MESSAGES,
    REQUIRED,
    columns_of,
    dataflash_signals,
)
from thrustmargin.gcs_plugin.logs.dataflash.message_scan import (
    FMT_HEAD,
    PADDING,
    FoundMessages,
    scan,
)
from thrustmargin.gcs_plugin.logs.read import Beginning, LogFormat
from thrustmargin.gcs_plugin.mavlink.scan import gather, read_bytes
from thrustmargin.gcs_plugin.telemetry.flight_log import assemble
from thrustmargin.gcs_plugin.telemetry.recording import (
    FlightLog,
    LogQuality,
    NotThisFormat,
    Recording,
    Stream,
    Waypoint,
    damage_of,
    longest_stretch,
    pauses,
    without_leaps,
)
from thrustmargin.gcs_plugin.telemetry.statements import Options
from thrustmargin.gcs_plugin.telemetry.vehicle_events import VehicleEvent, error_events
from thrustmargin.models.errors import LogError
from thrustmargin.models.flight import Floats

_GPS_EPOCH = 315964800.0  # Unix s of 1980-01-06
_LEAP_SECONDS = 18.0  # GPS time ahead of UTC since 2017
_WEEK = 604800.0

_TIMELESS = ("PARM", "CMD")

#: Message name to its columns and times (s since boot, NaN unknown), or None.
Lookup = Callable[[str], tuple[DataFlashColumns, Floats] | None]


def read_dataflash(path: Path, *, vehicle: int | None = None) -> Recording:
    """The needed messages of a binary DataFlash log.

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
    stretch = longest_stretch(clock[timed], path.name)
    if stretch.jumps:
        known = np.flatnonzero(timed)
        usable[: known[stretch.first]] = False
        usable[known[stretch.last] + 1 :] = False

    def columns(name: str) -> Mapping[str, NDArray[Any]]:
        rows, form = found.rows_of(name)
        table = None if form is None or rows.size == 0 else found.table(rows, form)
        return {} if form is None or table is None else {c: table[c] for c in form.columns}

    units = Units.of(columns)

    def lookup(name: str) -> tuple[DataFlashColumns, Floats] | None:
        rows, form = found.rows_of(name)
        rows = rows[usable[rows]]
        if form is None or rows.size == 0:
            return None
        scale, label = units.describe(form, text=False)
        return DataFlashColumns(found.table(rows, form), scale, label), clock[rows]

    def time_before(byte: int) -> float:
        row = int(np.searchsorted(found.start, byte)) - 1
        earlier = np.flatnonzero(timed[max(row - 1000, 0) : row + 1])
        return float(clock[max(row - 1000, 0) + earlier[-1]]) if earlier.size else float("nan")

    quality = LogQuality(
        bytes=size,
        frames=int(found.start.size),
        **damage_of(found.skipped, time_before),
        clock_jumps=stretch.jumps,
        gaps=pauses(clock[timed & usable]),
    )
    return recording_of(path, "DataFlash", lookup, quality, vehicle, stretch.notes)


def _clock(found: FoundMessages) -> tuple[Floats, NDArray[np.bool_]]:
    """(n,) s since boot of each message, NaN where it has none; (n,) False where it is damaged."""
    clock = np.full(found.start.size, np.nan)
    usable = np.ones(found.start.size, dtype=np.bool_)
    in_us, in_ms = (np.zeros(256, dtype=np.bool_) for _ in range(2))
    for number, form in found.formats.items():
        in_us[number] = form.columns[:1] == ("TimeUS",) and form.letters[:1] in ("Q", "q")
        in_ms[number] = form.columns[:1] == ("TimeMS",) and form.letters[:1] == "I"
    # Logs from before 2015 count milliseconds.
    for timed, width, kind, unit in ((in_us, 8, "<u8", 1e-6), (in_ms, 4, "<u4", 1e-3)):
        rows = np.flatnonzero(timed[found.type])
        if rows.size:
            raw = gather(found.data, found.start[rows] + 3, width).view(kind).ravel()
            clock[rows] = without_leaps(raw * unit)
            usable[rows] = np.isfinite(clock[rows])
    return clock, usable


def recording_of(
    path: Path,
    format_name: str,
    lookup: Lookup,
    quality: LogQuality,
    vehicle: int | None,
    notes: tuple[str, ...],
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
    own = parameters.get("SYSID_THISMAV", parameters.get("MAV_SYSID", 1.0))
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
        notes=notes,
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
    if any(name not in columns for name in ("GWk", "GMS")):
        return None
    week = columns.number("GWk")
    known = week > 1000
    if not known.any():
        return None
    unix = _GPS_EPOCH + week * _WEEK + columns.si("GMS", "ms") - _LEAP_SECONDS
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
            latitude_deg=item["Lat"] if placed else float("nan"),
            longitude_deg=item["Lng"] if placed else float("nan"),
            altitude=item["Alt"],
            parameters=(item["Prm1"], item["Prm2"], item["Prm3"], item["Prm4"]),
        )
    return tuple(items[number] for number in sorted(items))


def _likeness(begins: Beginning) -> float:
    if begins.text is not None:
        return 0.0
    described = begins.head.count(FMT_HEAD) >= 3 or begins.suffix in FORMAT.suffixes
    return 0.8 if described else 0.2


def flight_of(
    reader: Callable[..., Recording], path: Path, vehicle: int | None, options: Options
) -> FlightLog:
    """The flight of a DataFlash log, binary or text by its `reader`."""
    recording = reader(path, vehicle=vehicle)
    return assemble(recording, dataflash_signals(recording.streams), options)


FORMAT = LogFormat(
    name="DataFlash",
    known_by="an ArduPilot log (.BIN, it begins with descriptions FMT)",
    suffixes=(".bin", ".log"),
    likeness=_likeness,
    read=partial(flight_of, read_dataflash),
)
