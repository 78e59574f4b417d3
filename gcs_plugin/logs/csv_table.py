"""Read a flight from a CSV table, with the project's column names or with any described in
`columns.toml`.

The project's own format has one row a time. Columns are in SI but for rpm, all but `time_s`
optional, empty where unknown: `time_s`; `position_north/_east/_down`; `velocity_north/_east/_down`;
`roll`, `pitch`, `yaw` (rad); `roll_rate`, `pitch_rate`, `yaw_rate` (rad/s);
`specific_force_forward/_right/_down` (m/s², (0, 0, -9.81) at rest); `airspeed`, without it from
velocity and wind; `wind_north/_east/_down` (the velocity of the air); `tank_kg`;
`rotor_speed_rpm_1` to `_R` and `throttle_1` to `_R` in motor order, and so `esc_voltage_1`,
`esc_current_1`, `esc_temperature_1`, `motor_temperature_1` (K), `vibration_per_rev_1` (m/s², the
body's at the frequency of that rotor) and `esc_lost_1` (share of that ESC's telemetry frames);
`vibration` (m/s², the autopilot's level), `clipping` (times that the accelerometer was at its
limit); `voltage`, `current`, `pressure` (Pa), `temperature` (K, of the air or of a warm board:
`train` learns which), `altitude` (m AMSL), `height_agl` (m), `spraying` (1 or 0), `flying` (1 or
0). A first line `# {...}` contains what has no column: the origin of
positions, the start in Unix time, the source of each channel.

Tables of other programs are read too: separated by commas, semicolons or tabs; with a decimal point
or comma; in quotes; in UTF-8 or UTF-16. A heading may end with our unit in brackets, as in a margin
report, of which the first flight is read.

Any other headings and units are described in a file `columns.toml` in the CSV's folder, or
`NAME.columns.toml` for `NAME.csv` alone, one line a column of ours:

    time_s = "t"                                             # already in our unit
    rotor_speed_rpm_1 = { column = "m1_rads", unit = "rad/s" }
    voltage = { column = "Vbat", unit = "mV" }
    position_down = { column = "z", factor = -1 }            # z is up there
    throttle_1 = { column = "pwm1", factor = 0.001, offset = -1 }    # 1000 to 2000 us
    tank_kg = 0                                              # the same in all rows
    quaternion_w = "qw"                                      # and _x, _y, _z: roll, pitch and yaw

Our value is column x unit x factor + offset. The quaternion turns vectors of the body (forward,
right, down) into north, east, down; where both have x forward or north, y left or west, and z up,
the factor of y and z is -1. The source of a channel is its column, or the source stated in the
table's comment line.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.logs.read import Beginning, LogFormat, decoded
from thrustmargin.gcs_plugin.mavlink.decode import attitude_from_quaternion
from thrustmargin.gcs_plugin.telemetry.airborne import airborne
from thrustmargin.gcs_plugin.telemetry.flight_log import log_of_track
from thrustmargin.gcs_plugin.telemetry.recording import FlightLog
from thrustmargin.gcs_plugin.telemetry.signals import plausible
from thrustmargin.gcs_plugin.telemetry.vehicle_events import Options, stated_track
from thrustmargin.gcs_plugin.wording.check_words import SENTENCES, statement_words
from thrustmargin.gcs_plugin.wording.language import clean
from thrustmargin.models.checks.motion_units import motion_units
from thrustmargin.models.errors import AirframeError, LogError
from thrustmargin.models.flight import (
    TRACK_CHANNELS,
    FlightTrack,
    Floats,
    FlyingBy,
    Origin,
    known_date,
)
from thrustmargin.models.json_values import from_json_values
from thrustmargin.models.provenance import Meaning, Provenance, Rejected, SourceKind
from thrustmargin.models.statement import Statement, Value, state
from thrustmargin.models.units import UNITS, Scale
from thrustmargin.models.whole_file import regular

FILE = "columns.toml"
#: Share of the numbers of a column, zeros not counted, out of range, beyond which it has another
#: unit.
_OTHER_UNIT = 0.2
QUATERNION = tuple(f"quaternion_{part}" for part in "wxyz")


@dataclass(frozen=True, slots=True)
class TheirColumn:
    """The rule for one column of ours: `factor` times the file's `column`, plus `offset`, in our
    unit."""

    column: str  # heading in the table; empty where the offset alone is the value
    factor: float = 1.0
    offset: float = 0.0


def stated_columns(path: Path, unit_of: Callable[[str], str | None]) -> dict[str, TheirColumn]:
    """Read the rules of NAME.columns.toml, else columns.toml, in the folder of the table `path`.

    Return each column name of this program with its rule; empty without a file. `unit_of` returns a
    column's unit ("" for a number without unit, None for an unknown name). Raise LogError, naming
    the file and the wrong column.
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


def _column_number(value: Any) -> float | None:
    """Return a finite TOML number as float; None for anything else, or if it overflows."""
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
    if (number := _column_number(line)) is not None:
        return TheirColumn("", offset=number)
    line = {"column": line} if isinstance(line, str) else line
    if not isinstance(line, dict) or not isinstance(line.get("column"), str) or not line["column"]:
        raise LogError(f'{file}: {name} needs a number, or a heading such as "t"')
    known = {"column", "unit", "factor", "offset"}
    if extra := sorted(line.keys() - known):
        raise LogError(f"{file}: {name} has {extra[0]!r}; it may have {', '.join(sorted(known))}")
    factor, offset = (
        _column_number(line.get("factor", 1.0)),
        _column_number(line.get("offset", 0.0)),
    )
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
    """Convert foreign columns to this program's names and units, each (T,), T = `rows`.

    `stated` maps a name of this program to its rule, `table` a heading of the file to numbers (T,).
    A complete quaternion is replaced by roll, pitch and yaw, rad, NaN where it is zero or NaN.
    """
    columns = {
        name: np.full(rows, one.offset)
        if not one.column
        else one.factor * table[one.column] + one.offset
        for name, one in stated.items()
    }
    if all(part in columns for part in QUATERNION):
        parts = np.stack([columns[part] for part in QUATERNION])
        with np.errstate(invalid="ignore", divide="ignore"):
            angles = attitude_from_quaternion(*(parts / np.linalg.norm(parts, axis=0)))
        columns |= dict(zip(("roll", "pitch", "yaw"), angles.T, strict=True))
    return {name: values for name, values in columns.items() if name not in QUATERNION}


def check_headings(path: Path, stated: Mapping[str, TheirColumn], names: Sequence[str]) -> None:
    """Raise LogError if a stated column is missing, or only part of a quaternion is stated.

    `stated` maps columns of this program to their rules, `names` are the headings of the table
    `path`.
    """
    absent = [one.column for one in stated.values() if one.column and one.column not in names]
    if absent:
        missing = clean(", ".join(names)[:200])
        raise LogError(f"{path.name}: no column {absent[0]!r}, which {FILE} names; found {missing}")
    parts = [part for part in QUATERNION if part in stated]
    if parts and len(parts) < len(QUATERNION):
        raise LogError(
            f"{path.name}: {FILE} has {parts[0]}, but not all of {', '.join(QUATERNION)}"
        )


def column_source(name: str) -> Provenance:
    """Return the source of a channel read from the column `name`, or from several, of which it
    is the first."""
    return Provenance(kind=SourceKind.COLUMN, name=name)


def written_sources(path: Path, written: Any) -> dict[str, Provenance]:
    """Return the source of each channel from `written`, the `sources` of the file's comment line.

    Empty if `written` is no JSON object; raise LogError if a source in it is malformed.
    """
    if not isinstance(written, dict):
        return {}
    try:
        return {
            clean(channel): _cleaned(from_json_values(Provenance, data, f"the source of {channel}"))
            for channel, data in written.items()
        }
    except ValueError as error:
        remedy = "leave `sources` out of it, or write the table with this version again"
        raise LogError(f"{path.name}: in its comment line {error}; {remedy}") from error


def _as_written(text: str) -> Statement:
    """Return a text that a table contains as a Statement, with unprintable characters as spaces."""
    return Statement.of_text(clean(text))


def _cleaned_remark(remark: Statement) -> Statement:
    """Return the remark with unprintable characters in all its texts, also of nested ones, replaced
    by spaces.

    A remark of a kind that this program does not know becomes plain text.
    """

    def cleaned(value: Value) -> Value:
        if isinstance(value, Statement):
            return _cleaned_remark(value)
        if isinstance(value, tuple):
            return tuple(map(_cleaned_remark, value))
        return clean(value) if isinstance(value, str) else value

    if any(kind not in SENTENCES for kind in (remark.kind, *remark.clauses)):
        return _as_written(str(remark))
    return replace(remark, values=tuple((key, cleaned(value)) for key, value in remark.values))


def _cleaned(source: Provenance) -> Provenance:
    """Return the source with unprintable characters in all texts replaced by spaces."""
    return replace(
        source,
        name=clean(source.name),
        fields=tuple(map(clean, source.fields)),
        instance=clean(source.instance),
        unit=clean(source.unit),
        parts=tuple(map(_cleaned, source.parts)),
        rejected=tuple(Rejected(_cleaned(r.source), r.reason) for r in source.rejected),
        remarks=tuple(map(_cleaned_remark, source.remarks)),
    )


def plausible_channels(track: FlightTrack) -> tuple[dict[str, Floats], list[Statement]]:
    """Return each channel in its shape, with NaN for values out of range, and notes on wrong units.

    Ranges are those of TRACK_CHANNELS. If more than 20 % of a column's numbers other than 0 are out
    of range, it probably has another unit: all of it becomes NaN, and one note for its channel is
    added.
    """
    passed, notes = {}, []
    for name, limit in TRACK_CHANNELS.items():
        read = getattr(track, name)
        columns, kept = (v.reshape(read.shape[0], -1) for v in (read, plausible(name, read)))
        numbers = np.isfinite(columns) & (columns != 0.0)
        outside = np.sum(numbers & np.isnan(kept), axis=0)
        other = outside > _OTHER_UNIT * np.sum(numbers, axis=0)
        passed[name] = np.where(other, np.nan, kept).reshape(read.shape)
        if other.any():
            notes.append(
                state(
                    "column of another unit",
                    name=name,
                    outside=float(outside.max()),
                    rows=float(read.shape[0]),
                    low=limit.low,
                    high=limit.high,
                    unit=f" {limit.unit}" if limit.unit[0].isalpha() else "",
                )
            )
    return passed, notes


_NED = ("north", "east", "down")
_FRD = ("forward", "right", "down")
#: channel -> its columns, without those numbered by rotor
COLUMNS: Mapping[str, tuple[str, ...]] = {
    "position_ned": tuple(f"position_{a}" for a in _NED),
    "velocity_ned": tuple(f"velocity_{a}" for a in _NED),
    "attitude": ("roll", "pitch", "yaw"),
    "asked_attitude": ("asked_roll", "asked_pitch"),
    "angular_rate_frd": ("roll_rate", "pitch_rate", "yaw_rate"),
    "specific_force_frd": tuple(f"specific_force_{a}" for a in _FRD),
    "wind_ned": tuple(f"wind_{a}" for a in _NED),
    **{name: (name,) for name, c in TRACK_CHANNELS.items() if not (c.axes or c.per_rotor)},
}
#: Channels with a column for each rotor, in the order of files.
OF_ROTOR = tuple(name for name, c in TRACK_CHANNELS.items() if c.per_rotor)
_ROTOR = re.compile(rf"({'|'.join(OF_ROTOR)})_([1-9][0-9]?)")
_WITH_UNIT = re.compile(r"(\w+) \[(.*)\]")  # a heading of a margin report's CSV
_SHOWN = 50  # rows by which the decimal sign is known
_DECIMAL_COMMA = re.compile(r"[-+]?[0-9]*,[0-9]+(e[-+]?[0-9]+)?", re.IGNORECASE)
_NULLS = {"", "-", "nan", "NaN", "NAN", "null", "NULL", "None", "NA", "N/A", "#N/A"}
_STATES = {"true": "1", "false": "0"}
_ROWS = 4096  # that are held as text at a time


def _likeness(begins: Beginning) -> float:
    """Return 0.9 for the beginning of a flight table, else 0.0 of any other file.

    A table is text named .csv, or beginning with comment lines, or with a heading time_s.
    """
    if begins.text is None:
        return 0.0
    comments, names, _, _ = _parts(begins.text)
    return 0.9 if begins.suffix == ".csv" or comments or "time_s" in names else 0.0


def _read(path: Path, _vehicle: int | None, options: Options) -> tuple[FlightLog, ...]:
    craft = options.airframe
    track, unread = read_csv(path, 0 if craft is None else craft.rotor_count)
    return (replace(table_log(track, path, options, format=FORMAT.name), unflown=unread),)


def table_log(track: FlightTrack, path: Path, options: Options, *, format: str) -> FlightLog:
    """Return the FlightLog of a track read from the table `path`, with the options applied.

    `format` is the name of its LogFormat. Values out of range become NaN; columns that seem to have
    another unit are listed in `other_units`. Rows in flight are detected if the track does not
    state them. Raise AirframeError if the airframe has another number of rotors.
    """
    craft = options.airframe
    if craft is not None and track.rotor_count != craft.rotor_count:
        raise AirframeError(
            f"{path.name}: columns of {track.rotor_count} rotors, but airframe {craft.name} has "
            f"{craft.rotor_count}; choose another with --airframe"
        )
    known, unlike = plausible_channels(track)
    track = replace(track, **known, notes=(*track.notes, *unlike))
    if track.flying_by is FlyingBy.NOT_KNOWN:
        off = airborne({}, track.time_s, known, craft)
        track = replace(track, flying=off.flying, flying_by=off.by)
    track = stated_track(track, options)
    log = log_of_track(track, path, path.stat().st_size, craft, format=format)
    return replace(log, other_units=tuple(unlike))


FORMAT = LogFormat(
    name="CSV",
    known_by="a CSV with time_s",
    suffixes=(".csv",),
    is_text=True,
    likeness=_likeness,
    read=_read,
)


def read_csv(path: Path, rotor_count: int) -> tuple[FlightTrack, tuple[Statement, ...]]:
    """Read the first flight of a CSV file; also return a note on how many flights follow, if any.

    `rotor_count` is for a file without rotor columns. Raise LogError, naming the wrong column or
    row.
    """
    comments, names, body, separator = _parts(decoded(path.read_bytes()))
    stated = stated_columns(path, unit_of_column)
    if "time_s" not in stated and "time_s" not in names:
        first = clean(body.split("\n", 1)[0][:60])
        raise LogError(
            f"{path.name}: its first line names no column time_s; found {first!r}; say which "
            "column is which, and in what unit, in a file columns.toml beside it: docs/tables.md"
        )
    check_headings(path, stated, names)
    theirs = {one.column for one in stated.values()}
    used = [name for name in names if name in theirs or (_known(name) and name not in stated)]
    twice = next((name for name in used if used.count(name) > 1), None)
    if twice is not None:
        raise LogError(f"{path.name}: column {twice!r} is there twice; keep one")
    states = {stated[n].column if n in stated else n for n in ("flying", "spraying")}
    try:
        table, torn = _columns(body, separator, names, used, states)
    except (ValueError, csv.Error) as error:
        reason = clean(" ".join(str(error).split())[:160])
        raise LogError(f"{path.name}: not a table of numbers: {reason}") from error
    rows = next((column.size for column in table.values()), 0)
    columns = {n: column for n, column in table.items() if _known(n) and n not in stated}
    columns |= in_our_columns(stated, table, rows)
    unused = [name for name in names if name not in used]
    stated_about, notes = _statements(comments, path), []
    if torn:
        notes.append(state("torn rows", count=float(torn)))
    if unused:
        notes.append(state("columns not used", names=clean(", ".join(unused)[:200])))
    unread: tuple[Statement, ...] = ()
    if "flight_number" in columns:
        columns, unread = _first_flight(columns)
    return _track(path, columns, (*notes, *unread), stated_about, rotor_count), unread


def _known(name: str) -> bool:
    return name == "flight_number" or unit_of_column(name) is not None


def unit_of_column(name: str) -> str | None:
    """Return the unit of a column of this program, "" without one (a flag or a plain number); None
    for any other name."""
    if rotor := _ROTOR.fullmatch(name):
        return TRACK_CHANNELS[rotor[1]].unit
    if name in ("time_s", "flying"):
        return "s" if name == "time_s" else ""
    channel = next((c for c, names in COLUMNS.items() if name in names), None)
    unit = None if channel is None else TRACK_CHANNELS[channel].unit
    return "" if unit == "0/1" else unit


def _columns(
    body: str, separator: str, names: Sequence[str], used: Sequence[str], states: set[str]
) -> tuple[dict[str, Floats], int]:
    """Return the columns `used` as numbers (T,), NaN where empty, and the count of skipped rows.

    `body` is the table with its heading line, `names` all its headings; columns in `states` may
    hold true and false. A row with another number of cells is skipped. Raise ValueError if these
    are more than 1 + 1 % of the rows, or a cell is no number; csv.Error if the text is no table.
    """
    first_rows = csv.reader(body.split("\n", _SHOWN)[1:_SHOWN], delimiter=separator)
    comma = any(_DECIMAL_COMMA.fullmatch(cell.strip()) for row in first_rows for cell in row)
    rows = csv.reader(io.StringIO(body, newline=""), delimiter=separator)
    next(rows, None)
    places = {name: names.index(name) for name in used}
    pieces: dict[str, list[Floats]] = {name: [] for name in used}
    torn = whole = 0
    while read := list(islice(rows, _ROWS)):
        fit = [row for row in read if len(row) == len(names)]
        torn += sum(map(bool, read)) - sum(map(bool, fit))  # an empty line is none
        whole += len(fit)
        for (name, place), piece in zip(places.items(), pieces.values(), strict=True):
            number = _state if name in states else _number
            piece.append(np.array([number(row[place], comma, name) for row in fit]))
    # One is what is left when a logger is switched off, or where two writes met.
    if torn > (1 + whole // 100 if whole else 0):
        raise ValueError(
            f"{torn} rows have another number of columns than the {len(names)} of its heading"
        )
    return {n: np.concatenate(p) if p else np.empty(0) for n, p in pieces.items()}, torn


def _number(cell: str, comma: bool, name: str) -> float:
    """Parse a cell of the column `name`, NaN if empty; raise ValueError for anything else.

    `comma`: the table has decimal commas, so that a point is an error.
    """
    cell = cell.strip()
    if cell in _NULLS:
        return math.nan
    # Python's own float takes underscores; and a point is no decimal sign where a comma is one.
    try:
        if "_" in cell or (comma and "." in cell):
            raise ValueError
        return float(cell.replace(",", ".") if comma else cell)
    except ValueError:
        raise ValueError(f"{cell[:40]!r} in column {name}") from None


def _state(cell: str, comma: bool, name: str) -> float:
    """Parse a cell as 1, 0 or NaN, from true, false, a number or nothing."""
    return _number(_STATES.get(cell.strip().lower(), cell), comma, name)


def _parts(text: str) -> tuple[list[str], list[str], str, str]:
    """Return a table's comment lines, headings, text from the heading line on, and separator.

    Comment lines lose their first character; headings lose a unit in brackets if it is this
    program's. The separator is the most frequent of comma, semicolon and tab. No headings if they
    cannot be parsed.
    """
    comments: list[str] = []
    while text.startswith(("#", "sep=")):
        line, _, text = text.partition("\n")
        comments.append(line[1:].strip())
    heading = text.split("\n", 1)[0]
    separator = max(",;\t", key=heading.count)
    try:
        names = next(csv.reader([heading], delimiter=separator), [])
    except csv.Error:  # a cell of more than 131,072 characters
        names = []
    return comments, [_without_unit(name.strip()) for name in names], text, separator


def _without_unit(heading: str) -> str:
    """Remove the unit in brackets from a heading if it is the column's own."""
    match = _WITH_UNIT.fullmatch(heading)
    own = None if match is None else unit_of_column(match[1])
    return heading if match is None or own is None or match[2] != (own or "0/1") else match[1]


def _statements(comments: Sequence[str], path: Path) -> dict[str, Any]:
    """Return the JSON object of the last comment line that begins with "{"; empty if there is none.

    Raise LogError if one is not JSON.
    """
    statements: dict[str, Any] = {}
    for text in comments:
        if text.startswith("{"):
            try:
                statements = json.loads(text)
            except (ValueError, RecursionError) as error:
                raise LogError(f"{path.name}: its comment line is not JSON: {error}") from error
    return statements


def _first_flight(columns: Mapping[str, Floats]) -> tuple[dict[str, Floats], tuple[Statement, ...]]:
    """Return the rows of the first row's flight, and a note with the count of flights if several.

    `columns`, each (T,), must include flight_number, which is left out of the result, as are
    columns without a finite value in these rows, except time_s.
    """
    numbers = columns["flight_number"]
    first = numbers == numbers[0] if numbers.size else numbers == numbers
    count, unread = 1 + np.unique(numbers[~first]).size, ()
    if count > 1:
        unread = (state("further flights", count=float(count)),)
    kept = {name: values[first] for name, values in columns.items() if name != "flight_number"}
    # Columns that only another flight fills, of a channel or of a rotor that this one has not.
    some = {n: values for n, values in kept.items() if n == "time_s" or np.isfinite(values).any()}
    return some, unread


def _track(
    path: Path,
    columns: Mapping[str, Floats],
    notes: Sequence[Statement],
    statements: Mapping[str, Any],
    rotor_count: int,
) -> FlightTrack:
    time_s = columns["time_s"]
    if time_s.size == 0:
        raise LogError(f"{path.name}: a header and no rows; there is no flight to show")
    wrong = np.flatnonzero(~np.isfinite(time_s) | (np.diff(time_s, prepend=-np.inf) <= 0))
    if wrong.size:
        raise LogError(
            f"{path.name}: time_s must grow from row to row; row {wrong[0] + 1} has "
            f"{time_s[wrong[0]]:g}"
        )
    numbers = [int(m[2]) for m in map(_ROTOR.fullmatch, columns) if m]
    rotors = max(numbers, default=rotor_count)
    channels: dict[str, Floats] = {}
    nothing = np.full(time_s.size, np.nan)
    for channel, names in COLUMNS.items():
        if any(name in columns for name in names):
            parts = [columns.get(name, nothing) for name in names]
            channels[channel] = parts[0] if len(parts) == 1 else np.stack(parts, axis=-1)
    sources: dict[str, Provenance] = {}
    # A file that we wrote has every channel that its track has.
    if not statements and "velocity_ned" in channels and "airspeed" not in channels:
        wind, over_ground = channels.get("wind_ned"), column_source("velocity_north")
        sources["airspeed"] = replace(over_ground, meaning=Meaning.GROUND_SPEED)
        if wind is not None:
            sources["airspeed"] = Provenance(
                kind=SourceKind.INFERRED,
                parts=(over_ground, column_source("wind_north")),
                remarks=(state("velocity less wind"),),
            )
        relative = channels["velocity_ned"] - (0.0 if wind is None else wind)
        channels["airspeed"] = np.linalg.norm(relative, axis=1)
    for channel in OF_ROTOR:
        names = [f"{channel}_{k + 1}" for k in range(rotors)]
        if any(name in columns for name in names):
            channels[channel] = np.stack([columns.get(n, nothing) for n in names], axis=-1)
    if not channels:
        raise LogError(f"{path.name}: no column but time_s is known; docs/tables.md has the names")
    flying, name = columns.get("flying"), statements.get("name")
    start = statements.get("start_unix_s")
    written = statements.get("notes")
    written = written if isinstance(written, list) else []
    notes = (*(_as_written(n) for n in written if isinstance(n, str)), *notes)
    for channel in channels.keys() - sources.keys():
        sources[channel] = column_source(COLUMNS.get(channel, (channel,))[0])
    track = FlightTrack.of(
        name=clean(name if isinstance(name, str) else path.name),
        time_s=time_s,
        rotor_count=rotors,
        flying=np.ones(time_s.size, dtype=np.bool_) if flying is None else flying > 0.5,
        flying_by=FlyingBy.NOT_KNOWN if flying is None else FlyingBy.GIVEN,
        origin=_origin(path, statements.get("origin")),
        start_unix_s=known_date(start) if isinstance(start, int | float) else None,
        sources=sources | written_sources(path, statements.get("sources")),
        notes=notes,
        **channels,
    )
    if wrong := motion_units(replace(track, **plausible_channels(track)[0])):
        raise LogError(
            f"{path.name}: {statement_words(wrong)}; a file columns.toml beside it states other "
            "units (docs/tables.md)"
        )
    return track


def _origin(path: Path, given: Any) -> Origin | None:
    if given is None:
        return None
    try:
        origin = from_json_values(Origin, given, "origin")
        if not (abs(origin.latitude_deg) <= 90.0 and abs(origin.longitude_deg) <= 180.0):
            raise ValueError(f"origin is at {origin.latitude_deg}, {origin.longitude_deg} degrees")
        return origin
    except ValueError as error:
        remedy = "give latitude_deg, longitude_deg and altitude"
        raise LogError(f"{path.name}: in its comment line {error}; {remedy}") from error
