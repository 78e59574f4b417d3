"""Put an engineer's notes beside the logs of a command: the file that is named, or notes.csv."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from thrustmargin.gcs_plugin.commands.shared.options import UsageError
from thrustmargin.models.errors import LogError

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.logs import FlightLog


def with_engineer_notes(
    logs: Sequence[FlightLog], notes: Path | None, console: Console
) -> list[FlightLog]:
    """Return the logs, in their order, with the notes of `notes`, else of a notes.csv beside each.

    A notes.csv that cannot be read is named and left out. Raises LogError for such a file that the
    user named, UsageError where it is named for several logs.
    """
    from thrustmargin.gcs_plugin.logs.notes_file import notes_beside, with_notes

    paths = list(dict.fromkeys(log.path for log in logs))
    if notes is not None and len(paths) > 1:
        raise UsageError("--notes are of one log; name one")
    noted: dict[int, FlightLog] = {}
    for path in paths:
        numbers = [k for k, log in enumerate(logs) if log.path == path]
        file = notes or notes_beside(path)
        if file is None:
            continue
        try:
            made = with_notes([logs[k] for k in numbers], file)
        except LogError as error:
            if notes is not None:
                raise
            console.print(f"not read: {error}", markup=False, soft_wrap=True)
            continue
        noted.update(zip(numbers, made, strict=True))
    return [noted.get(k, log) for k, log in enumerate(logs)]
