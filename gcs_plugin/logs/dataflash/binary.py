"""Read ArduPilot's binary DataFlash logs (.BIN) into a Recording."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.logs.dataflash.boots import Messages, Times, boots_of, sorties_by
from thrustmargin.gcs_plugin.logs.dataflash.columns import UNITS_OF, filled_clock, own_clock
from thrustmargin.gcs_plugin.logs.dataflash.dataflash_table import MESSAGES
from thrustmargin.gcs_plugin.logs.dataflash.message_scan import (
    FMT_HEAD,
    LETTERS,
    PADDING,
    FoundMessages,
    scan,
)
from thrustmargin.gcs_plugin.logs.read import Beginning, LogFormat
from thrustmargin.gcs_plugin.mavlink.frame import Bytes
from thrustmargin.gcs_plugin.mavlink.scan import gather, read_bytes
from thrustmargin.gcs_plugin.telemetry.recording import NotThisFormat, Recording, without_leaps
from thrustmargin.models.errors import LogError
from thrustmargin.models.flight import Floats


def dataflash_boots(path: Path, *, vehicle: int | None = None) -> Iterator[Recording]:
    """Yield a recording of a binary DataFlash log for each run between restarts.

    `vehicle` is a system id, None for that of the log. Raise LogError if no message is found, or
    `vehicle` is not the one in the log.
    """
    yield from boots_of(path, "DataFlash", **_scanned_messages(path), vehicle=vehicle)


def _scanned_messages(path: Path) -> dict[str, Any]:
    """Return messages, times, size, kept and skipped, keyword arguments of `boots_of`, for a file.

    The file's bytes are freed before tables are made. Raise LogError if there is no message, or the
    log is an old one of PX4.
    """
    data, size = read_bytes(path, PADDING)
    scanned = scan(data, size)
    if scanned.start.size == 0 or len(scanned.formats) < 2:
        raise NotThisFormat(
            f"{path.name}: no DataFlash message in {size} bytes; is its start missing?"
        )
    if any(f.name == "TIME" and f.columns == ("StartTime",) for f in scanned.formats.values()):
        raise LogError(
            f"{path.name}: a log of PX4 from before 2016 (sdlog2, .px4log), whose messages are not "
            "known here; PX4 since version 1.4 writes .ulg, which is read: fly again with it"
        )
    clock = _clock(scanned)
    messages: dict[str, Messages] = {}
    for name in (*MESSAGES, *UNITS_OF):
        rows, form = scanned.rows_of(name)
        if form is not None and rows.size:
            table = scanned.table(rows, form)
            messages[name] = Messages(form, table, clock[rows], scanned.start[rows])
    start, skipped, timed = scanned.start, scanned.skipped, np.isfinite(clock)
    del data, scanned  # before their memory is needed
    return {
        "messages": messages,
        "times": Times(clock[timed], start[timed]),
        "size": size,
        "kept": int(start.size),
        "skipped": skipped,
    }


def _clock(messages: FoundMessages) -> Floats:
    """Return the time (n,), s since boot, of each message, NaN if it has none or a damaged one.

    In logs from before 2015, most of whose messages have none, it is interpolated.
    """
    clock = np.full(messages.start.size, np.nan)
    # Where in a message of each type its clock is, by what it is written as; 0 in all others.
    offsets: dict[tuple[str, float], Bytes] = {}
    for number, form in messages.formats.items():
        if (own := own_clock(form.columns)) is not None:
            column = form.columns.index(own[0])
            *before, kind = (LETTERS[letter][0] for letter in form.letters[: column + 1])
            if kind in ("<u8", "<i8", "<u4"):
                offset = offsets.setdefault((kind, own[1]), np.zeros(256, dtype=np.uint8))
                offset[number] = 3 + sum(np.dtype(one).itemsize for one in before)
    for (kind, unit), offset in offsets.items():
        place = offset[messages.type]
        timed = place > 0
        start = messages.start[timed]
        start += place[timed]
        own_s = gather(messages.data, start, np.dtype(kind).itemsize).view(kind).ravel() * unit
        del start
        clock[timed] = without_leaps(own_s)
    old = not any(form.columns[:1] == ("TimeUS",) for form in messages.formats.values())
    return filled_clock(clock) if old else clock


def _likeness(begins: Beginning) -> float:
    if begins.text is not None:
        return 0.0
    # In a quarter of the time that `count` takes of a megabyte.
    heads = re.findall(re.escape(FMT_HEAD), begins.head)
    described = len(heads) >= 3 or begins.suffix in FORMAT.suffixes
    return 0.8 if described else 0.2


FORMAT = LogFormat(
    name="DataFlash",
    known_by="an ArduPilot log (.BIN, it begins with descriptions FMT)",
    suffixes=(".bin", ".log"),
    likeness=_likeness,
    read=partial(sorties_by, dataflash_boots),
)
