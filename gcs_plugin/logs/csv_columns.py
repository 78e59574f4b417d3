"""Tables with headings and units of others: `columns.toml` beside a CSV says what they are.

A line a column of ours (`gcs_plugin/logs/csv_table.py`), in the file `columns.toml` of the CSV's
folder, or `NAME.columns.toml` for `NAME.csv` alone:

    time_s = "t"                                             # already in our unit
    rotor_speed_rpm_1 = { column = "m1_rads", unit = "rad/s" }
    voltage = { column = "Vbat", unit = "mV" }
    position_down = { column = "z", factor = -1 }            # z is up there
    throttle_1 = { column = "pwm1", factor = 0.001, offset = -1 }    # 1000 to 2000 us
    tank_kg = 0                                              # the same in all rows
    quaternion_w = "qw"                                      # and _x, _y, _z: roll, pitch and yaw

What is ours is column x unit x factor + offset. The quaternion turns vectors of the body (forward,
right, down) into north, east, down; where both have x forward or north, y left or west, and z up,
the factor of y and z is -1. Where a channel comes from is its column, or what the table's comment
line states of it.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.mavlink.decode import attitude_from_quaternion
from thrustmargin.gcs_plugin.mavlink.text import clean
from thrustmargin.gcs_plugin.telemetry.resample import plausible
from thrustmargin.models.errors import LogError
from thrustmargin.models.flight import TRACK_CHANNELS, FlightTrack, Floats
from thrustmargin.models.json_values import from_json_values
from thrustmargin.models.provenance import Provenance, Rejected, SourceKind
from thrustmargin.models.units import UNITS, Scale
from thrustmargin.models.whole_file import regular

FILE = "columns.toml"
#: Share of the numbers of a column, zeros aside, out of range, beyond which it has another unit.
_OTHER_UNIT = 0.2
QUATERNION = tuple(f"quaternion_{part}" for part in "wxyz")


@dataclass(frozen=True, slots=True)
class TheirColumn:
    """What a column of ours is made of: `factor` times `column`, and `offset` in our unit."""

    column: str  # heading in the table; empty where the offset alone is the value
    factor: float = 1.0
    offset: float = 0.0


def stated_columns(path: Path, unit_of: Callable[[str], str | None]) -> dict[str, TheirColumn]:
    """What the file of columns beside the table `path` states; empty without one.

    `unit_of` gives the unit of a column of ours, None for a name that is none. Raises LogError that
    names the line that is wrong.
    """
    places = (path.with_name(f"{path.stem}.{FILE}"), path.with_name(FILE))
    file = next((place for place in places if place.exists()), None)
    if file is None:
        return {}
    try:
        lines = tomllib.loads(regular(file).read_text(encoding="utf-8"))
    except OSError as error:
        raise LogError(f"{file.name} cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:  # TOML, UTF-8, too many digits; nested too deep
        raise LogError(f"{file.name}: not a file of columns: {error}") from error
    units = {name: "" if name in QUATERNION else unit_of(name) for name in lines}
    return {name: _their(file.name, name, line, units[name]) for name, line in lines.items()}


def _number(value: Any) -> float | None:
    """Return a finite number of TOML; None for anything else, and for what no float can hold."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if isfinite(number) else None


def _their(file: str, name: str, line: Any, own: str | None) -> TheirColumn:
    if own is None:
        raise LogError(f"{file}: {name!r} is no column of ours; docs/tables.md lists them")
    if (number := _number(line)) is not None:
        return TheirColumn("", offset=number)
    line = {"column": line} if isinstance(line, str) else line
    if not isinstance(line, dict) or not isinstance(line.get("column"), str) or not line["column"]:
        raise LogError(f'{file}: {name} needs a number, or a heading such as "t"')
    known = {"column", "unit", "factor", "offset"}
    if extra := sorted(line.keys() - known):
        raise LogError(f"{file}: {name} has {extra[0]!r}; it may have {', '.join(sorted(known))}")
    factor, offset = _number(line.get("factor", 1.0)), _number(line.get("offset", 0.0))
    if factor is None or offset is None:
        raise LogError(f"{file}: factor and offset of {name} must be numbers")
    unit, units = line.get("unit", own), {own: Scale(), **UNITS[own]}
    if not isinstance(unit, str) or unit not in units:
        listed = ", ".join(u for u in units if u)
        raise LogError(
            f"{file}: {name} has the unit {unit!r}, which is not one of {listed or 'none'}; state "
            "it by a factor"
        )
    scale = units[unit]
    return TheirColumn(line["column"], factor * scale.factor, offset + scale.offset)


def in_our_columns(
    stated: Mapping[str, TheirColumn], table: Mapping[str, Floats], rows: int
) -> dict[str, Floats]:
    """Our columns (T,) of a table that has their headings; a quaternion becomes three angles."""
    found = {
        name: np.full(rows, one.offset)
        if not one.column
        else one.factor * table[one.column] + one.offset
        for name, one in stated.items()
    }
    if all(part in found for part in QUATERNION):
        parts = np.stack([found[part] for part in QUATERNION])
        with np.errstate(invalid="ignore", divide="ignore"):
            angles = attitude_from_quaternion(*(parts / np.linalg.norm(parts, axis=0)))
        found |= dict(zip(("roll", "pitch", "yaw"), angles.T, strict=True))
    return {name: values for name, values in found.items() if name not in QUATERNION}


def check_headings(path: Path, stated: Mapping[str, TheirColumn], names: Sequence[str]) -> None:
    """Raise LogError when a stated column is not in the table, or a quaternion is there in part."""
    absent = [one.column for one in stated.values() if one.column and one.column not in names]
    if absent:
        found = clean(", ".join(names)[:200])
        raise LogError(f"{path.name}: no column {absent[0]!r}, which {FILE} names; found {found}")
    parts = [part for part in QUATERNION if part in stated]
    if parts and len(parts) < len(QUATERNION):
        raise LogError(
            f"{path.name}: {FILE} has {parts[0]}, but not all of {', '.join(QUATERNION)}"
        )


def column_source(name: str) -> Provenance:
    """The source of a channel that is a column, or of which this is the first of several."""
    return Provenance(kind=SourceKind.COLUMN, name=name)


def written_sources(path: Path, written: Any) -> dict[str, Provenance]:
    """The sources that the file states of its channels."""
    if not isinstance(written, dict):
        return {}
    try:
        return {
            clean(channel): _cleaned(from_json_values(Provenance, data, f"the source of {channel}"))
            for channel, data in written.items()
        }
    except ValueError as error:
        wanted = "leave `sources` out of it, or write the table with this version again"
        raise LogError(f"{path.name}: in its comment line {error}; {wanted}") from error


def _cleaned(source: Provenance) -> Provenance:
    """The same without what could do harm on a screen."""
    return replace(
        source,
        name=clean(source.name),
        fields=tuple(map(clean, source.fields)),
        instance=clean(source.instance),
        unit=clean(source.unit),
        parts=tuple(map(_cleaned, source.parts)),
        rejected=tuple(Rejected(_cleaned(r.source), r.reason) for r in source.rejected),
        remarks=tuple(map(clean, source.remarks)),
    )


def plausible_channels(track: FlightTrack) -> tuple[dict[str, Floats], list[str]]:
    """The channels without numbers that cannot be true, and which are of another unit.

    Of a column in another unit those in range are as wrong as the rest: percent of an output that
    idles look like its share.
    """
    found, notes = {}, []
    for name, limit in TRACK_CHANNELS.items():
        read = getattr(track, name)
        columns, kept = (v.reshape(read.shape[0], -1) for v in (read, plausible(name, read)))
        numbers = np.isfinite(columns) & (columns != 0.0)
        outside = np.sum(numbers & np.isnan(kept), axis=0)
        other = outside > _OTHER_UNIT * np.sum(numbers, axis=0)
        found[name] = np.where(other, np.nan, kept).reshape(read.shape)
        if other.any():
            unit = f" {limit.unit}" if limit.unit[0].isalpha() else ""
            notes.append(
                f"{name}: {outside.max()} of {read.shape[0]} rows are not within {limit.low:g} to "
                f"{limit.high:g}{unit}: not used; a file columns.toml beside it states units"
            )
    return found, notes
