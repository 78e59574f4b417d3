"""Read parts.csv: which propeller, motor or battery was on which aircraft, and when.

    part,aircraft,position,installed at,removed at
    P-17,sprayer-7,propeller 2,2026-05-02,

A position is `propeller N`, `motor N` (as screens number rotors) or `battery`; times are ISO 8601,
UTC without a zone. An empty time means "from the start" or "still there".
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from thrustmargin.gcs_plugin.wording.language import clean
from thrustmargin.models.errors import DataError
from thrustmargin.models.identification.season.season_changes import Trend
from thrustmargin.models.whole_file import not_utf8

COLUMNS = ("part", "aircraft", "position", "installed_at", "removed_at")
NAN = float("nan")
POSITION = re.compile(r"(propeller|motor) ([1-9][0-9]?)|battery(?: [1-9][0-9]?)?")


#: Characters of a name or a time, at most.
LONGEST_CELL = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A part in one place, from its installation to its removal."""

    name: str
    aircraft: str
    position: str
    installed_s: float  # Unix time; -inf where it was there from the start
    removed_s: float  # inf where it is still there

    @property
    def rotor(self) -> int | None:
        """Return the rotor, from 1, of a propeller or motor; None for a battery."""
        found = POSITION.fullmatch(self.position)
        return int(found[2]) if found and found[2] else None

    def flights(self, started: Sequence[float | None]) -> list[int]:
        """Return the indices of the flights that started while this part was installed.

        `started` are the flights' start times, Unix s; a flight with None is never among them.
        """
        inside = (
            k
            for k, at in enumerate(started)
            if at is not None and self.installed_s <= at < self.removed_s
        )
        return list(inside)


@dataclass(frozen=True, slots=True, kw_only=True)
class PartHistory:
    """The flights of one part on all aircraft, and the loss of its rotor or its resistance."""

    name: str  # empty for an aircraft's battery that parts.csv does not name
    position: str  # of its last flight
    aircraft: str  # of its last flight
    stays: tuple[str, ...]  # all aircraft that it flew on
    flights: int
    hours: float
    loss: float = NAN  # share of thrust lost, mean of its last flights; NaN if unknown
    loss_error: float = NAN  # standard error
    battery: Trend | None = None  # resistance, ohm, over its flights


def read_parts(data: bytes, name: str) -> list[Part]:
    """Parse the content of parts.csv, UTF-8 bytes, and return the parts in it.

    `name` is the file's name for errors. Raises DataError with the line that is wrong.
    """
    try:
        rows = csv.DictReader(io.StringIO(data.decode("utf-8-sig")))
        return _parts(rows, name)
    except UnicodeDecodeError as error:
        raise DataError(not_utf8(name, error)) from error
    except csv.Error as error:
        raise DataError(f"{name} line {rows.line_num}: {error}; is it a table of parts?") from error


def _parts(rows: csv.DictReader, name: str) -> list[Part]:
    """Return the parts (battery, motor or propeller) in all rows of a table, with place and dates.

    `name` is the file's, for errors. Raises DataError if a column is missing, if two parts are at
    one place of an aircraft at a time, or if a part is at two places at a time.
    """
    rows.fieldnames = [(f or "").strip().lower().replace(" ", "_") for f in rows.fieldnames or []]
    if missing := [c for c in COLUMNS if c not in rows.fieldnames]:
        raise DataError(f"{name} has no column {missing[0]!r}; it needs {', '.join(COLUMNS)}")
    parts = []
    for row in rows:
        part = _part(row, where := f"{name} line {rows.line_num}")
        for other in parts:
            both = part.installed_s < other.removed_s and other.installed_s < part.removed_s
            if both and (part.aircraft, part.position) == (other.aircraft, other.position):
                raise DataError(
                    f"{where}: {other.name} is still at {other.position} of {other.aircraft}; "
                    "say when it was removed"
                )
            if both and part.name == other.name:
                raise DataError(
                    f"{where}: {part.name} is still at {other.position} of {other.aircraft}; say "
                    "when it was removed, or give the other part a name of its own"
                )
        parts.append(part)
    return parts


def _part(row: dict[str, Any], where: str) -> Part:
    """Return the part in one row of parts.csv; an empty date means always installed or never
    removed.

    Raises DataError, beginning with `where` (file and line), for a wrong cell.
    """
    for column in COLUMNS:
        if len(row[column] or "") > LONGEST_CELL:
            raise DataError(
                f"{where}: {column} has {len(row[column])} characters, more than {LONGEST_CELL}; "
                "is it a table of parts?"
            )
    part, aircraft, position, installed, removed = (clean(row[c] or "").strip() for c in COLUMNS)
    if not POSITION.fullmatch(position.lower()):
        raise DataError(
            f"{where}: position {position!r} is none; write propeller 2, motor 2 or battery"
        )
    first = _time(installed, f"{where}: installed at", float("-inf"))
    last = _time(removed, f"{where}: removed at", float("inf"))
    if last <= first:
        raise DataError(f"{where}: {part} is removed before it is installed")
    return Part(
        name=part, aircraft=aircraft, position=position.lower(), installed_s=first, removed_s=last
    )


def _time(text: str, where: str, otherwise: float) -> float:
    """Return the Unix time, s, of an ISO 8601 text, in UTC unless it states a zone.

    `otherwise` is returned for an empty text. Raises DataError, beginning with `where`, for another
    text.
    """
    if not text:
        return otherwise
    try:
        when = datetime.fromisoformat(text)
    except ValueError:
        raise DataError(
            f"{where} {text!r} is no time; write 2026-06-12 or 2026-06-12T14:30"
        ) from None
    return (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp()
