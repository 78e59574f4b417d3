"""parts.csv: which propeller, motor or battery was where and when, and what it has flown.

    part,aircraft,position,installed at,removed at
    P-17,sprayer-7,propeller 2,2026-05-02,

A position is `propeller N`, `motor N` (as screens number rotors) or `battery`; times are ISO 8601,
UTC without a zone; one that is empty is open.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from thrustmargin.gcs_plugin.mavlink.text import clean
from thrustmargin.models.errors import DataError
from thrustmargin.models.identification.season.season_changes import Trend
from thrustmargin.models.whole_file import not_utf8

COLUMNS = ("part", "aircraft", "position", "installed_at", "removed_at")
NAN = float("nan")
POSITION = re.compile(r"(propeller|motor) ([1-9][0-9]?)|battery(?: [1-9][0-9]?)?")


#: Characters of a name or a time.
LONGEST_CELL = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """One part in one place for a time."""

    name: str
    aircraft: str
    position: str
    installed_s: float  # Unix time; -inf where it was there from the start
    removed_s: float  # inf where it is still there

    @property
    def rotor(self) -> int | None:
        """From 1; None of a battery."""
        found = POSITION.fullmatch(self.position)
        return int(found[2]) if found and found[2] else None

    def flights(self, started: Sequence[float | None]) -> list[int]:
        """Which flights it flew, by their Unix times."""
        inside = (
            k
            for k, at in enumerate(started)
            if at is not None and self.installed_s <= at < self.removed_s
        )
        return list(inside)


@dataclass(frozen=True, slots=True, kw_only=True)
class PartHistory:
    """What one part has flown on all aircraft, and how its rotor or it does."""

    name: str  # empty: an aircraft's battery that parts.csv does not name
    position: str  # where it is, or was last
    aircraft: str
    stays: tuple[str, ...]  # aircraft that it flew on
    flights: int
    hours: float
    loss: float = NAN  # mean of its last flights, NaN where unknown
    loss_error: float = NAN
    battery: Trend | None = None


def read_parts(data: bytes, name: str) -> list[Part]:
    """The parts of a file in UTF-8. Raises DataError with the line that is wrong."""
    try:
        rows = csv.DictReader(io.StringIO(data.decode("utf-8-sig")))
        return _parts(rows, name)
    except UnicodeDecodeError as error:
        raise DataError(not_utf8(name, error)) from error
    except csv.Error as error:
        raise DataError(f"{name} line {rows.line_num}: {error}; is it a table of parts?") from error


def _parts(rows: csv.DictReader, name: str) -> list[Part]:
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
    if not text:
        return otherwise
    try:
        when = datetime.fromisoformat(text)
    except ValueError:
        raise DataError(
            f"{where} {text!r} is no time; write 2026-06-12 or 2026-06-12T14:30"
        ) from None
    return (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp()
