"""Flights of a season set aside on disk: a search looks at one of them at a time."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from pathlib import Path
from typing import overload

from thrustmargin.models.flight import FlightTrack


class TracksOnDisk(Sequence[FlightTrack]):
    """Tracks in files of a folder, each read again whenever it is looked at.

    The folder is the caller's, and private to it: files are pickles of what this process wrote.
    """

    def __init__(self, folder: Path, files: Sequence[Path] = ()) -> None:
        self.folder, self.files = folder, list(files)

    def append(self, track: FlightTrack) -> None:
        """One more track, which need not be held any longer."""
        file = self.folder / f"{len(list(self.folder.iterdir()))}.track"
        file.write_bytes(pickle.dumps(track, protocol=pickle.HIGHEST_PROTOCOL))
        self.files.append(file)

    def __add__(self, other: TracksOnDisk) -> TracksOnDisk:
        return TracksOnDisk(self.folder, [*self.files, *other.files])

    def __len__(self) -> int:
        return len(self.files)

    @overload
    def __getitem__(self, which: int) -> FlightTrack: ...
    @overload
    def __getitem__(self, which: slice) -> TracksOnDisk: ...
    def __getitem__(self, which: int | slice) -> FlightTrack | TracksOnDisk:
        if isinstance(which, slice):
            return TracksOnDisk(self.folder, self.files[which])
        return pickle.loads(self.files[which].read_bytes())
