"""Read ArduPilot's DataFlash logs in text form (.log), as ground stations convert them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.logs.dataflash.boots import Messages, Times, boots_of, sorties_by
from thrustmargin.gcs_plugin.logs.dataflash.columns import UNITS_OF, filled_clock, own_clock
from thrustmargin.gcs_plugin.logs.dataflash.dataflash_table import MESSAGES
from thrustmargin.gcs_plugin.logs.dataflash.message_scan import Format, make_format
from thrustmargin.gcs_plugin.logs.read import LogFormat
from thrustmargin.gcs_plugin.telemetry.recording import Recording, without_leaps
from thrustmargin.models.errors import LogError
from thrustmargin.models.flight import Bools

_TEXT_LETTERS = frozenset("nNZMa")


@dataclass(slots=True, eq=False)
class _Lines:
    """The content of the lines: formats by name, cells and file offsets by message, and damage."""

    formats: dict[str, Format] = field(default_factory=dict)
    cells: dict[str, list[list[str]]] = field(default_factory=dict)
    offsets: dict[str, list[int]] = field(default_factory=dict)
    skipped: list[tuple[int, int]] = field(default_factory=list)  # (offset, length)
    kept: int = 0


def dataflash_text_boots(path: Path, *, vehicle: int | None = None) -> Iterator[Recording]:
    """Yield a recording of a DataFlash log in text form for each run between restarts.

    `vehicle` is a system id, None for that of the log. Raise LogError if no line describes a
    message (FMT), or `vehicle` is not the one in the log.
    """
    text = path.read_bytes()
    lines = _lines(text)
    if len(lines.formats) < 2:
        raise LogError(f"{path.name}: no FMT line describes a message; is it an ArduPilot .log?")
    messages: dict[str, Messages] = {}
    for name, cells in lines.cells.items():
        form, offsets = lines.formats[name], np.array(lines.offsets[name])
        table, good = _table(form, cells)
        lines.skipped += [(int(offsets[i]), len(",".join(cells[i]))) for i in np.flatnonzero(~good)]
        clock, scale = own_clock(form.columns) or ("", 0.0)
        clock_s = table[clock] * scale if clock else np.full(len(table), np.nan)
        messages[name] = Messages(form, table, clock_s, offsets[good])
        lines.kept -= int(np.sum(~good))
    streams = messages.values()
    place = np.concatenate([np.empty(0, np.int64), *(one.place for one in streams)])
    order = np.argsort(place, kind="stable")
    clocks = np.concatenate([np.empty(0), *(one.clock_s for one in streams)])[order]
    timed = np.isfinite(clocks)
    clocks[timed] = without_leaps(clocks[timed])
    if not any("TimeUS" in one.form.columns for one in streams):
        clocks = filled_clock(clocks)
    of_message = np.empty_like(clocks)
    of_message[order] = clocks
    parts = np.split(of_message, np.cumsum([one.place.size for one in streams]))  # one more: empty
    named = zip(messages.items(), parts, strict=False)
    messages = {name: one._replace(clock_s=clock_s) for (name, one), clock_s in named}
    known = np.isfinite(clocks)
    yield from boots_of(
        path,
        "DataFlash text",
        messages,
        Times(clocks[known], place[order][known]),
        size=len(text),
        kept=lines.kept,
        skipped=lines.skipped,
        vehicle=vehicle,
    )


def _lines(text: bytes) -> _Lines:
    scanned = _Lines()
    needed = {*MESSAGES, *UNITS_OF}
    end = 0
    for line in text.splitlines(keepends=True):
        begin, end = end, end + len(line)
        head, _, rest = line.partition(b",")
        name = head.strip().decode("latin-1")
        if name == "FMT":
            form = _format(rest)
            if form is not None:
                scanned.formats.setdefault(form.name, form)
                scanned.kept += 1
                continue
        form = scanned.formats.get(name)
        cells = []
        if form is not None:
            cells = rest.decode("utf-8", "replace").split(",", max(len(form.columns) - 1, 0))
        if form is None or len(cells) != len(form.columns):
            if line.strip():
                scanned.skipped.append((begin, len(line)))
            continue
        scanned.kept += 1
        if name in needed:
            scanned.cells.setdefault(name, []).append([cell.strip() for cell in cells])
            scanned.offsets.setdefault(name, []).append(begin)
    return scanned


def _format(rest: bytes) -> Format | None:
    parts = [p.strip() for p in rest.decode("latin-1").split(",", 4)]
    if len(parts) < 5 or not parts[0].isdigit() or not parts[1].isdigit():
        return None
    columns = ",".join(c.strip() for c in parts[4].split(","))
    return make_format(int(parts[0]), int(parts[1]), parts[2], parts[3], columns)


def _table(form: Format, cells: list[list[str]]) -> tuple[NDArray[np.void], Bools]:
    """Return the lines whose every cell fits its format letter, and their flags (n,) among all.

    `cells` are the cells of each line of one message. The lines are a structured array with float64
    or S64 columns; NaN is a number.
    """
    good = np.ones(len(cells), dtype=np.bool_)
    texts = {
        name: letter in _TEXT_LETTERS
        for name, letter in zip(form.columns, form.letters, strict=True)
    }
    kinds = [(name, "S64" if is_text else "f8") for name, is_text in texts.items()]
    table = np.zeros(len(cells), dtype=kinds)
    for number, (name, is_text) in enumerate(texts.items()):
        words = [row[number] for row in cells]
        try:
            table[name] = [word.encode() for word in words] if is_text else words
        except ValueError:
            table[name] = values = np.array([_number(word) for word in words])
            good &= np.array([w.lower() in ("nan", "qnan") for w in words]) | ~np.isnan(values)
    return table[good], good


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return float("nan")


FORMAT = LogFormat(
    name="DataFlash text",
    known_by="a DataFlash log (FMT lines)",
    suffixes=(".log", ".txt"),
    is_text=True,
    likeness=lambda begins: float(begins.text is not None and b"FMT," in begins.head),
    read=partial(sorties_by, dataflash_text_boots),
)
