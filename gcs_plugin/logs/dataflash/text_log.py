"""Read ArduPilot's DataFlash logs as text (.log), as ground stations convert them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.logs.dataflash.binary import recording_of, sorties_by
from thrustmargin.gcs_plugin.logs.dataflash.columns import (
    DataFlashColumns,
    Units,
    filled_clock,
    own_clock,
)
from thrustmargin.gcs_plugin.logs.dataflash.dataflash_table import MESSAGES
from thrustmargin.gcs_plugin.logs.dataflash.message_scan import Format, make_format
from thrustmargin.gcs_plugin.logs.read import LogFormat
from thrustmargin.gcs_plugin.telemetry.recording import (
    LogQuality,
    Recording,
    damage_of,
    pauses,
    restarts,
    stretches,
    without_leaps,
)
from thrustmargin.models.errors import LogError
from thrustmargin.models.flight import Floats

_TEXT_LETTERS = frozenset("nNZM")


@dataclass(slots=True, eq=False)
class _Lines:
    """What the lines hold: formats by name, cells and file offsets by message, and the rest."""

    formats: dict[str, Format] = field(default_factory=dict)
    cells: dict[str, list[list[str]]] = field(default_factory=dict)
    offsets: dict[str, list[int]] = field(default_factory=dict)
    skipped: list[tuple[int, int]] = field(default_factory=list)  # (offset, length)
    kept: int = 0


def dataflash_text_boots(path: Path, *, vehicle: int | None = None) -> Iterator[Recording]:
    """The needed messages of a DataFlash log in text form: a recording from restart to restart.

    Raises LogError when it describes no message (FMT), or `vehicle` is not the one in the log.
    """
    text = path.read_bytes()
    lines = _lines(text)
    if len(lines.formats) < 2:
        raise LogError(f"{path.name}: no FMT line describes a message; is it an ArduPilot .log?")
    tables: dict[str, tuple[dict[str, NDArray[Any]], Floats, NDArray[np.int64]]] = {}
    for name, cells in lines.cells.items():
        table, good = _table(lines.formats[name], cells)
        at = np.array(lines.offsets[name])
        lines.skipped += [(int(at[i]), len(",".join(cells[i]))) for i in np.flatnonzero(~good)]
        lines.kept -= int(np.sum(~good))
        tables[name] = (table, _clock(table), at[good])
    units = Units.of(lambda name: tables[name][0] if name in tables else {})
    clocks, places = np.empty(0), np.empty(0, dtype=np.int64)
    if tables:
        clocks = np.concatenate([clock for _, clock, _ in tables.values()])
        places = np.concatenate([at for _, _, at in tables.values()])
        order = np.argsort(places, kind="stable")
        if not any("TimeUS" in table for table, _, _ in tables.values()):
            clocks[order] = filled_clock(clocks[order])
            ends = np.cumsum([at.size for _, _, at in tables.values()])
            filled = zip(tables.items(), np.split(clocks, ends[:-1]), strict=True)
            tables = {name: (table, own, at) for (name, (table, _, at)), own in filled}
        order = order[np.isfinite(clocks[order])]
        clocks, places = clocks[order], places[order]
    parts = stretches(clocks, path.name)

    def lookup(first: int, end: int, name: str) -> tuple[DataFlashColumns, Floats] | None:
        if name not in tables:
            return None
        table, clock, at = tables[name]
        inside = (at >= first) & (at < end)
        if own_clock(tuple(table)) is not None:
            inside &= np.isfinite(clock)
        if not inside.any():
            return None
        scale, label = units.describe(lines.formats[name], text=True)
        chosen = {column: values[inside] for column, values in table.items()}
        return DataFlashColumns(chosen, scale, label), clock[inside]

    # What has no time of its own, between two starts, belongs to the later one.
    ends = [*(int(places[part.last]) + 1 for part in parts[:-1]), len(text)]
    for part, (first, end) in zip(parts, pairwise([0, *ends]), strict=True):
        quality = LogQuality(
            bytes=len(text),
            frames=lines.kept,
            **damage_of(lines.skipped, lambda _: float("nan")),
            clock_jumps=restarts(clocks, parts),
            gaps=pauses(clocks[part.first : part.last + 1]),
        )
        found = partial(lookup, first, end)
        yield recording_of(path, "DataFlash text", found, quality, vehicle)


def _lines(text: bytes) -> _Lines:
    found = _Lines()
    wanted = {*MESSAGES, "FMTU", "UNIT", "MULT"}
    end = 0
    for line in text.splitlines(keepends=True):
        begin, end = end, end + len(line)
        head, _, rest = line.partition(b",")
        name = head.strip().decode("latin-1")
        if name == "FMT":
            form = _format(rest)
            if form is not None:
                found.formats.setdefault(form.name, form)
                found.kept += 1
                continue
        form = found.formats.get(name)
        cells = []
        if form is not None:
            cells = rest.decode("utf-8", "replace").split(",", max(len(form.columns) - 1, 0))
        if form is None or len(cells) != len(form.columns):
            if line.strip():
                found.skipped.append((begin, len(line)))
            continue
        found.kept += 1
        if name in wanted:
            found.cells.setdefault(name, []).append([cell.strip() for cell in cells])
            found.offsets.setdefault(name, []).append(begin)
    return found


def _format(rest: bytes) -> Format | None:
    parts = [p.strip() for p in rest.decode("latin-1").split(",", 4)]
    if len(parts) < 5 or not parts[0].isdigit() or not parts[1].isdigit():
        return None
    columns = ",".join(c.strip() for c in parts[4].split(","))
    return make_format(int(parts[0]), int(parts[1]), parts[2], parts[3], columns)


def _table(
    form: Format, cells: list[list[str]]
) -> tuple[dict[str, NDArray[Any]], NDArray[np.bool_]]:
    """Columns of the lines whose every cell fits its letter, and which lines those are."""
    good = np.ones(len(cells), dtype=np.bool_)
    columns: dict[str, NDArray[Any]] = {}
    for number, (name, letter) in enumerate(zip(form.columns, form.letters, strict=True)):
        words = [row[number] for row in cells]
        if letter in _TEXT_LETTERS or letter == "a":
            columns[name] = np.array([w.encode() for w in words], dtype="S64")
            continue
        try:
            columns[name] = np.array(words, dtype=np.float64)
        except ValueError:
            values = np.array([_number(w) for w in words])
            good &= np.array([w.lower() in ("nan", "qnan") for w in words]) | ~np.isnan(values)
            columns[name] = values
    return {name: values[good] for name, values in columns.items()}, good


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return float("nan")


def _clock(table: Mapping[str, NDArray[Any]]) -> Floats:
    clock = own_clock(tuple(table))
    if clock is not None:
        return without_leaps(table[clock[0]] * clock[1])
    size = len(next(iter(table.values()))) if table else 0
    return np.full(size, np.nan)


FORMAT = LogFormat(
    name="DataFlash text",
    known_by="a DataFlash log (FMT lines)",
    suffixes=(".log", ".txt"),
    is_text=True,
    likeness=lambda begins: float(begins.text is not None and b"FMT," in begins.head),
    read=partial(sorties_by, dataflash_text_boots),
)
