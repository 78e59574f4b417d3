"""Logs read and analysed as `report` does it, with the options that a recording was made with.

`monitor` writes its options into options.json in the folder of the .tlog that it records. Commands
that read the .tlog take from there the aircraft, the reading options and the limit that the user
does not give. `with_engineer_notes` adds the notes of an engineer to the logs. `TracksOnDisk` keeps
the flights of a search on disk, of which one is in memory at a time.
"""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from rich.console import Console

from thrustmargin.gcs_plugin.commands.shared.inputs import (
    AS_HEARD,
    Inputs,
    ReadingOptions,
    reading_keywords,
)
from thrustmargin.gcs_plugin.commands.shared.known import known_flights
from thrustmargin.gcs_plugin.commands.shared.options import UsageError, check_utilisation
from thrustmargin.models.errors import DataError, LogError, ThrustMarginError
from thrustmargin.models.json_values import from_json_values
from thrustmargin.models.whole_file import regular

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.logs import FlightLog
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog
    from thrustmargin.models.flight import FlightTrack
    from thrustmargin.models.model.analysis import FlightAnalysis


def analysed_flights(
    inputs: Inputs, console: Console
) -> tuple[list[tuple[FlightAnalysis, FlightLog]], float, list[UnusedLog]]:
    """Return the analysis and log of every sortie, the utilisation limit, and the logs not read.

    For the logs of a recording, options that the user did not give are those it was recorded with.
    Raises DataError if no log can be read, UsageError if the limit is no share.
    """
    inputs = with_recorded(inputs, console)
    check_utilisation(inputs.limit)
    flights, unread = flights_of(inputs, console)
    return flights, inputs.limit, unread


def flights_of(
    inputs: Inputs, console: Console
) -> tuple[list[tuple[FlightAnalysis, FlightLog]], list[UnusedLog]]:
    """Return the analysis and log of every sortie in the order of the inputs, and the logs not
    read.

    Flights of known aircraft are analysed with their aircraft's model, the others with that of the
    options. The analysis is the one that the verdict is based on. Raises DataError if no log can be
    read.
    """
    from thrustmargin.gcs_plugin.commands.shared.inputs import listed, read_logs
    from thrustmargin.models.model.analysis import analyse, analysis_for_verdict

    unread: list[UnusedLog] = []
    learnt = [] if inputs.by_file else known_flights(inputs, unread, console)
    of_known = {log.path for _, log in learnt}
    rest = tuple(path for path in inputs.logs if path not in of_known)
    if rest or not learnt:
        model = inputs.rotor_model()
        others = replace(inputs, logs=rest)
        read = read_logs(others, unread, console, model=model, skipped=ThrustMarginError)
        learnt += [
            (analysis_for_verdict(analyse(log.track, model, airframe_match=airframe_match)), log)
            for log, airframe_match in read
        ]
    if not learnt:
        raise DataError(listed(unread))
    order = {path: place for place, path in reversed(list(enumerate(inputs.logs)))}
    return sorted(learnt, key=lambda one: (order[one[1].path], one[1].sortie)), unread


OPTIONS = "options.json"


def with_engineer_notes(
    logs: Sequence[FlightLog], notes: Path | None, console: Console
) -> list[FlightLog]:
    """Return the logs, in their order, with the notes of the file `notes`.

    If `notes` is None, the notes.csv next to each log is read; if that cannot be read, print so and
    leave the log without notes. Raises LogError if `notes` cannot be read, UsageError if it is
    given for several logs.
    """
    from thrustmargin.gcs_plugin.logs.notes_file import notes_file_of, with_notes

    paths = list(dict.fromkeys(log.path for log in logs))
    if notes is not None and len(paths) > 1:
        raise UsageError("--notes are of one log; name one")
    noted: dict[int, FlightLog] = {}
    for path in paths:
        numbers = [k for k, log in enumerate(logs) if log.path == path]
        file = notes or notes_file_of(path)
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


@dataclass(frozen=True, slots=True, kw_only=True)
class _Table:
    """The content of options.json, with value types."""

    model: str | None
    airframe: str | None
    max_utilisation: float | None
    reading: ReadingOptions


def with_recorded(user: Inputs, console: Console) -> Inputs:
    """Return the inputs with the options of the recording where the user gave none; print those
    used.

    A recording of `monitor` has a file of its options next to it. Raises DataError if that file
    cannot be read, or if the options of several logs differ.
    """
    logs = user.logs
    recorded = [_options_of(log) for log in logs]
    taken = Inputs()
    if not user.given:
        model, airframe = _common(recorded, logs, lambda one: (one.model, one.airframe))
        taken = replace(taken, model=model, airframe=airframe)
    if user.max_utilisation is None:
        taken = replace(taken, max_utilisation=_common(recorded, logs, lambda o: o.max_utilisation))
    if user.reading == AS_HEARD:
        taken = replace(taken, reading=_common(recorded, logs, lambda one: one.reading))
    if taken == Inputs():
        return user
    console.print(f"as recorded ({logs[0].parent / OPTIONS}): {taken.words}", soft_wrap=True)
    return Inputs(
        logs=logs,
        model=taken.model or user.model,
        airframe=taken.airframe or user.airframe,
        max_utilisation=user.max_utilisation or taken.max_utilisation,
        reading=taken.reading if user.reading == AS_HEARD else user.reading,
        known=user.known,
    )


def _common(recorded: Sequence[Inputs], logs: Sequence[Path], part: Callable[[Inputs], Any]) -> Any:
    for one, log in zip(recorded, logs, strict=True):
        if part(one) != part(recorded[0]):
            differing = [
                f"{o.words or 'nothing'} ({p})" for o, p in ((recorded[0], logs[0]), (one, log))
            ]
            raise DataError(
                f"recorded with other options: {' and '.join(differing)}; name the options, or "
                "give one of these recordings at a time"
            )
    return part(recorded[0]) if recorded else part(Inputs())


def _options_of(log: Path) -> Inputs:
    """Return the options in the options.json next to a .tlog; the defaults if there is none.

    Raises DataError if the file is damaged or has an impossible value.
    """
    path = log.parent / OPTIONS
    if log.suffix.lower() != ".tlog" or not path.exists():
        return Inputs()
    try:
        content = json.loads(regular(path).read_text("utf-8"))
        table: _Table = from_json_values(_Table, content, "options")
        if table.max_utilisation is not None and not 0.0 < table.max_utilisation <= 1.0:
            raise ValueError(f"a limit of {table.max_utilisation:g}")
        reading_keywords(table.reading)
        made = Inputs(
            model=None if table.model is None else Path(table.model),
            airframe=table.airframe,
            max_utilisation=table.max_utilisation,
            reading=table.reading,
        )
    except (OSError, ValueError, RecursionError, UsageError) as error:
        raise DataError(
            f"{path} does not hold the options of a recording ({error!s:.80}); rename it, and give "
            "the options yourself"
        ) from error
    return made


class TracksOnDisk(Sequence["FlightTrack"]):
    """Tracks in pickle files of a folder, each read again whenever it is indexed.

    The folder must be private: reading a pickle runs code of whoever wrote it.
    """

    def __init__(self, folder: Path, files: Sequence[Path] = ()) -> None:
        self.folder, self.files = folder, list(files)

    def append(self, track: FlightTrack) -> None:
        """Write one more track to a file, so that its memory can be freed."""
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
