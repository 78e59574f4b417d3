"""Read an engineer's own notes of a flight: a CSV file with a time and a text in each line.

    time,text
    0:42,gust from the left
    2026-05-04T09:12:30Z,swapped the battery

A time is in s or as m:ss from the first row of the log, or a date and time with its zone, which is
Z for UTC. The file is `notes.csv` in the log's folder, or any that the user names.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

from thrustmargin.gcs_plugin.telemetry.recording import EngineerNote, FlightLog
from thrustmargin.gcs_plugin.wording.language import clean
from thrustmargin.models.errors import LogError

NOTES_NAME = "notes.csv"  # name of the notes file in a log's folder
#: Letters of a text and lines of a file that are read: notes of a day are far fewer.
MOST_LETTERS, MOST_LINES = 300, 5000
#: s before the first and after the last row that still belong to a flight.
AROUND_S = 60.0
_CLOCK = re.compile(r"(?:(\d+):)?(\d{1,3}):(\d{1,2}(?:\.\d+)?)")


@dataclass(frozen=True, slots=True)
class _Line:
    """A note of the file: s from the first row, or Unix time in s; the other is NaN."""

    seconds: float
    unix_s: float
    text: str


def notes_file_of(log: Path) -> Path | None:
    """Return the notes.csv in the folder of a log; None without one."""
    path = log.parent / NOTES_NAME
    return path if path.is_file() and path != log else None


def with_notes(logs: Sequence[FlightLog], path: Path) -> list[FlightLog]:
    """Return the sorties of one log, each with the notes of the file `path` in its time span.

    Times without a date count from the first row of the first sortie. Raises LogError for a file
    that is no table of notes, and for dates where a log has none.
    """
    lines = _read(path)
    start_s = min((log.clock_start_s for log in logs), default=0.0)
    made = []
    for log in logs:
        if log.track.start_unix_s is None and any(math.isfinite(one.unix_s) for one in lines):
            raise LogError(f"{path.name}: its times are dates, and {log.path.name} has no date")
        notes = [_of_sortie(one, log, start_s) for one in lines]
        last_s = float(log.track.time_s[-1]) + AROUND_S
        inside = (note for note in notes if -AROUND_S <= note.time_s <= last_s)
        made.append(replace(log, engineer_notes=tuple(sorted(inside, key=lambda n: n.time_s))))
    return made


def _of_sortie(line: _Line, log: FlightLog, start_s: float) -> EngineerNote:
    """Convert a line to a note, at s from the first row of the sortie `log`.

    `start_s` is the vehicle's clock at the first row of the first sortie. NaN for a date, if `log`
    has none.
    """
    if math.isfinite(line.unix_s):
        return EngineerNote(line.unix_s - (log.track.start_unix_s or math.nan), line.text)
    return EngineerNote(line.seconds + start_s - log.clock_start_s, line.text)


def _read(path: Path) -> list[_Line]:
    """Return the notes in a file; raise LogError without UTF-8 text and the header time,text."""
    try:
        text = path.read_text("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(f"{path.name}: cannot be read as UTF-8 text") from error
    rows = csv.reader(text.splitlines())
    head = [cell.strip().lower() for cell in next(rows, [])]
    if head[:2] != ["time", "text"]:
        raise LogError(f"{path.name}: its first line must be time,text")
    return list(_lines(rows, path.name))


def _lines(rows: Iterable[Sequence[str]], name: str) -> Iterable[_Line]:
    """Yield the notes of the rows below the header, each a time and a text; skip empty rows.

    Raise LogError for a row without a valid time, and for more than MOST_LINES rows.
    """
    for number, row in enumerate(rows, 2):
        if number > MOST_LINES:
            raise LogError(f"{name}: more than {MOST_LINES} lines")
        if not any(cell.strip() for cell in row):
            continue
        when = row[0].strip()
        text = clean(",".join(row[1:]).strip())[:MOST_LETTERS]
        seconds, unix_s = _time(when)
        if math.isnan(seconds) and math.isnan(unix_s):
            raise LogError(
                f"{name} line {number}: {clean(when)[:30]!r} is no time; give s, m:ss or "
                "2026-05-04T09:12:30Z"
            )
        yield _Line(seconds, unix_s, text)


def _time(text: str) -> tuple[float, float]:
    """Parse a time; return s from the first row, and Unix time in s: one of them is NaN.

    Both are NaN if the text is no time.
    """
    if found := _CLOCK.fullmatch(text):
        hours, minutes, seconds = (float(part or 0) for part in found.groups())
        return 3600.0 * hours + 60.0 * minutes + seconds, math.nan
    try:
        value = float(text)
    except ValueError:
        pass
    else:
        return (value if math.isfinite(value) else math.nan), math.nan
    try:
        date = datetime.fromisoformat(text)
    except ValueError:
        return math.nan, math.nan
    return math.nan, date.timestamp() if date.tzinfo is not None else math.nan
