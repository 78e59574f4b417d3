"""The logs that a vehicle holds, and one of them as a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from queue import Queue
from typing import TYPE_CHECKING, Any

from thrustmargin.gcs_plugin.vehicle.connection import Progress, VehicleLink
from thrustmargin.models.errors import LinkError
from thrustmargin.models.whole_file import whole_file

if TYPE_CHECKING:
    from mavsdk import System


@dataclass(frozen=True, slots=True, kw_only=True)
class LogEntry:
    """One log on the vehicle."""

    number: int
    date: str | None  # ISO 8601 UTC; None when the vehicle had no clock
    size_bytes: int


class VehicleLogs:
    """The logs of one vehicle, listed once. Raises LinkError when it does not answer."""

    def __init__(self, link: VehicleLink, vehicle: System) -> None:
        from mavsdk.plugins.log_files import LogFiles, LogFilesResult

        self._link = link
        self._files = LogFiles(vehicle)  # one object: it downloads only what it has listed
        events: Queue[tuple[Any, list[Any]]] = Queue()
        self._files.get_entries_async(lambda result, found, _: events.put((result, found)))
        result, found = link.next_event(events, "its list of logs")
        if result not in (LogFilesResult.SUCCESS, LogFilesResult.NO_LOGFILES):
            raise link.refused("its list of logs", result.name)
        self._found = {entry.id: entry for entry in found}
        self.entries = tuple(
            LogEntry(
                number=entry.id,
                date=None if entry.date.startswith("1970") else entry.date or None,
                size_bytes=entry.size_bytes,
            )
            for entry in found
        )

    def choose(self, number: int | None = None) -> LogEntry:
        """Log `number`, or the latest that is not empty. Raises LinkError when there is none."""
        return choose_log(self.entries, number, self._link.name)

    def download(self, entry: LogEntry, path: Path, progress: Progress | None = None) -> None:
        """Save `entry` at `path`, whole or not at all; `progress` counts bytes.

        Raises LinkError when the vehicle falls silent or `path` cannot be written.
        """
        from mavsdk.plugins.log_files import LogFilesResult

        what = f"log {entry.number}"
        events: Queue[tuple[Any, float]] = Queue()
        try:
            with whole_file(path) as draft:
                draft.touch()  # says why it cannot be written, which MAVSDK does not
                draft.unlink()
                self._files.download_log_file_async(
                    self._found[entry.number],
                    str(draft),
                    lambda result, data, _: events.put((result, data.progress)),
                )
                result = LogFilesResult.NEXT
                try:
                    while result == LogFilesResult.NEXT:
                        result, share = self._link.next_event(events, what)
                        if progress is not None and 0.0 <= share <= 1.0:
                            progress(round(share * entry.size_bytes), entry.size_bytes)
                finally:
                    if result == LogFilesResult.NEXT:
                        self._files.cancel_download_log_file()
                if result != LogFilesResult.SUCCESS:
                    raise self._link.refused(what, result.name)
        except OSError as error:
            raise LinkError(f"{path} cannot be written: {error.strerror}") from error


def choose_log(entries: tuple[LogEntry, ...], number: int | None, name: str) -> LogEntry:
    """Log `number` of `entries`, or the latest that is not empty; `name` is the link's, for words.

    Raises LinkError when none fits.
    """
    if not entries:
        raise LinkError(f"{name}: the vehicle holds no logs; check its SD card and log settings")
    if number is None:
        filled = [e for e in entries if e.size_bytes > 0]
        if not filled:
            raise LinkError(f"{name}: all {len(entries)} logs on the vehicle are empty")
        return max(filled, key=lambda e: (e.date or "", e.number))
    for entry in entries:
        if entry.number == number and entry.size_bytes == 0:
            raise LinkError(f"{name}: log {number} is empty; choose another, see --list")
        if entry.number == number:
            return entry
    numbers = [e.number for e in entries]
    raise LinkError(
        f"{name}: there is no log {number}; the vehicle has {min(numbers)} to {max(numbers)}"
    )
