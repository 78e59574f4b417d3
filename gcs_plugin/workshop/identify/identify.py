"""The command `thrustmargin identify`: find the physical effects that a rotor speed model lacks."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, fields, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, overload

import numpy as np
import tyro
from rich.console import Console
from tyro.conf import Positional

from thrustmargin.gcs_plugin.commands.shared.inputs import (
    ANY_KNOWN,
    AS_HEARD,
    Inputs,
    Known,
    Reading,
)
from thrustmargin.gcs_plugin.commands.shared.log_flights import with_recognised
from thrustmargin.gcs_plugin.commands.shared.options import (
    STDOUT,
    OutputFile,
    check_outputs,
    require_logs,
)
from thrustmargin.models.errors import DataError, ModelError, require

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog
    from thrustmargin.gcs_plugin.workshop.identify.identify_result import Result
    from thrustmargin.models.flight import FlightTrack
    from thrustmargin.models.model.rotor_model import RotorModel


def identify(
    logs: Positional[
        Annotated[tuple[Path, ...], tyro.conf.arg(metavar="LOG...", help_behavior_hint="")]
    ],
    *,
    model: Path | None = None,
    airframe: str | None = None,
    held_out: tuple[Path, ...] = (),
    reading: Reading = AS_HEARD,
    known: Known = ANY_KNOWN,
    out_model: Path | None = None,
    json: Path | None = None,
    out: Path | None = None,
    next_flight: Path | None = None,
    surrogates: int | None = None,
    seed: int | None = None,
    force: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> int:
    """Find what a rotor speed model lacks: the missing effect, its size, and the error after it.

    Compares measured rotor speeds with the model, tries every effect of its table (a worn rotor,
    hidden mass, thin air, an off-centre load, ...), and takes in those that make flights left out
    better by more than chance. Give two flights or more, at different tank levels.

    Example: thrustmargin identify demo --out demo.html

    Args:
        logs: Recorded flights to learn from: .tlog, DataFlash .BIN or .log, PX4 .ulg, or .csv.
        model: Rotor speed model file of this aircraft; without it, and without an airframe, the one
            that ships is used for a flight that is recognised as one of topxgun-f16-sitl.
        airframe: Name of a shipped airframe, or an airframe file (.toml), to start from its weight
            and thrust curve alone, without a model file.
        held_out: Flights that are not learnt from, on which the error is stated.
        reading: How the logs are read.
        known: The known aircraft that flew, whose own model the search starts from.
        out_model: New model file to write, with the effects added; the old one stays (--out with
            .safetensors is an older name of it).
        json: Write the result as JSON to this file (.json); - is standard output, and nothing else.
        out: Write a page with the residual before and after to this file (.html).
        next_flight: Write the flight that would distinguish what these flights cannot as a mission,
            a QGroundControl .plan file about the place where they were flown.
        surrogates: Not needed any more: chance is worked out, not drawn.
        seed: Not needed any more: the same flights give the same answer.
        force: Replace the new model file and the mission if they are there.
    """
    require("identify", "scipy")
    from datetime import UTC, datetime

    from thrustmargin.gcs_plugin.commands.shared.inputs import starting_model
    from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal, steps
    from thrustmargin.gcs_plugin.wording.language import say
    from thrustmargin.gcs_plugin.workshop.identify.identify_result import make_result
    from thrustmargin.models.identification.loop import identify_checked
    from thrustmargin.models.identification.rows.usable_flights import require_distinct

    errors = Terminal(stderr=True, soft_wrap=True)
    to_fit = Inputs(
        logs=require_logs(logs), model=model, airframe=airframe, reading=reading, known=known
    )
    to_fit = with_recognised(to_fit, errors)
    to_check = replace(to_fit, logs=require_logs(held_out) if held_out else ())
    check_outputs(
        (
            OutputFile("--out-model", out_model, endings=(".safetensors",), keep=not force),
            OutputFile("--json", json, endings=(".json",)),
            OutputFile("--out", out, endings=(".html", ".htm")),
            OutputFile("--next-flight", next_flight, endings=(".plan",), keep=not force),
        ),
        inputs=[*to_fit.files, *to_check.logs],
    )
    for option, given in (("--surrogates", surrogates), ("--seed", seed)):
        if given is not None:
            words = "{option} is not needed any more: chance is worked out, not drawn"
            errors.print(say(words, option=option))
    start, model_name = starting_model(to_fit)
    not_used: list[UnusedLog] = []
    with TemporaryDirectory(prefix="thrustmargin-") as folder:
        fit, new = (
            logs_to_fit(inputs, start, not_used, errors, Path(folder), option=option)
            for inputs, option in ((to_fit, ""), (to_check, "--held-out "))
        )
        require_distinct(fit + new)
        with steps(errors, total=1.0) as progress:
            found = identify_checked(fit, start, held_out=new, progress=progress)
            progress("what it means for the margin", 0.0)
            result = make_result(
                found,
                tracks=fit + new,
                not_used=not_used,
                model_in=model_name,
                model_out="" if out_model is None else str(out_model),
                mission="" if next_flight is None else str(next_flight),
                date=datetime.now(UTC).date().isoformat(),
            )
            progress("writing", 0.0)
            written = write_result(result, out=out_model, json=json, html=out, mission=next_flight)
    if json != STDOUT:
        show(result, written)
    if next_flight is not None and next_flight not in written:
        errors.print(say("no {file}: no flight would tell more", file=next_flight))
    return 1 if result.not_used else 0


def logs_to_fit(
    inputs: Inputs,
    model: RotorModel,
    not_used: list[UnusedLog],
    console: Console,
    folder: Path,
    *,
    option: str,
) -> TracksOnDisk:
    """Read the logs in `inputs` in order, and store the usable flights in files of `folder`.

    Unusable logs, also those of another airframe, are appended to `not_used`. Print offsets of the
    logs' instruments. `option` is put into errors to name the kind of logs. Raise DataError if
    rotor speeds belong to other rotors or times, or if no log is usable.
    """
    from thrustmargin.gcs_plugin.commands.shared.log_flights import listed, matching_logs, read_logs
    from thrustmargin.gcs_plugin.logs.inspection import instrument_offsets
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog
    from thrustmargin.gcs_plugin.wording.check_words import statement_words
    from thrustmargin.models.identification.rows.usable_flights import too_little, wrong_speeds

    tracks = TracksOnDisk(folder)
    unusable: list[UnusedLog] = []
    misordered: list[UnusedLog] = []
    read = read_logs(inputs, unusable, console, model=model)
    offsets: dict[str, list[str]] = {}
    for log in matching_logs(read, unusable, console):
        for words in instrument_offsets(log):
            offsets.setdefault(words, []).append(log.name)
        wrong = wrong_speeds(log.track, model.airframe)
        lacking = statement_words(wrong) if wrong else too_little(log.track, model)
        if lacking is None:
            tracks.append(log.track)
        else:
            group = unusable if wrong is None else misordered
            group.append(UnusedLog(name=log.name, reason=lacking))
    for words, names in offsets.items():
        console.print(f"{', '.join(names)}: {words}")
    if misordered:
        raise DataError(listed(misordered))
    if unusable and not tracks:
        raise DataError(f"no {option}flight can be used; {listed(unusable)}")
    not_used += unusable
    return tracks


def write_result(
    result: Result,
    *,
    out: Path | None,
    json: Path | None,
    html: Path | None,
    mission: Path | None = None,
) -> list[Path]:
    """Write the result to the files that are not None, and return their paths.

    They are `out` (the new model), `json`, `html` (a page) and `mission` (the next flight, if there
    is one). `json` "-" is standard output. No file is replaced before all are complete. Raise
    ModelError if one cannot be written.
    """
    from thrustmargin.gcs_plugin.workshop.identify.identify_result import json_text
    from thrustmargin.gcs_plugin.workshop.identify.manoeuvre_plan import manoeuvre_plan
    from thrustmargin.mission.plan import plan_text
    from thrustmargin.models.identification.next_flight.manoeuvres import FlownLimits
    from thrustmargin.models.model.model_file import save_model
    from thrustmargin.models.whole_file import whole_file

    following = result.following
    mission = None if following is None else mission
    if json == STDOUT:
        sys.stdout.write(json_text(result))
        json = None
    wanted = [path for path in (out, json, html, mission) if path is not None]
    try:
        with ExitStack() as files:
            drafts = {path: files.enter_context(whole_file(path)) for path in wanted}
            if html is not None:
                from thrustmargin.gcs_plugin.workshop.identify.identify_page import html_text

                drafts[html].write_bytes(html_text(result).encode("utf-8", "replace"))
            if json is not None:
                drafts[json].write_bytes(json_text(result).encode("utf-8", "replace"))
            if mission is not None and following is not None:
                limits = FlownLimits.from_tracks(result.tracks)
                plan = manoeuvre_plan(following.manoeuvre, limits, repeats=following.repeats)
                drafts[mission].write_text(plan_text(plan), encoding="utf-8")
            if out is not None:
                save_model(result.update.model, drafts[out])
    except OSError as error:
        raise ModelError(f"cannot write {error.filename}: {error.strerror or error}") from error
    return wanted


def show(result: Result, written: Sequence[Path]) -> None:
    """Print the result: sentences, tables, unused logs, notes on the new model, and the files
    `written`.
    """
    from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
    from thrustmargin.gcs_plugin.wording.language import Verbatim, say
    from thrustmargin.gcs_plugin.workshop.identify.identify_result import printed_tables

    console = Terminal()
    for sentence in result.answer:
        console.print(sentence, soft_wrap=True)
    for table in printed_tables(result):
        console.print(table)
    for one in result.not_used:
        words = say("not used: {log}: {reason}", log=Verbatim(one.name), reason=say(one.reason))
        console.print(words, soft_wrap=True)
    if result.model_out:
        for note in result.update.notes:
            console.print(say("new model: {note}", note=Verbatim(note)), soft_wrap=True)
    for path in written:
        console.print(say("wrote {file}", file=path), soft_wrap=True)


@dataclass(frozen=True, slots=True)
class _StoredTrack:
    """A track with its arrays in a safetensors file."""

    file: Path
    track: FlightTrack  # without rows

    def read(self) -> FlightTrack:
        """Return the track as it was stored."""
        from safetensors.numpy import load_file

        arrays = load_file(self.file)
        errors = {n: arrays.pop(f"{ERROR_OF}{n}") for n in self.track.standard_errors}
        return replace(self.track, **arrays, standard_errors=errors)


#: before a channel's name: its standard errors, in the file of a track
ERROR_OF = "standard error of "


class TracksOnDisk(Sequence["FlightTrack"]):
    """Tracks with their arrays in files of a folder, each read again whenever it is indexed."""

    def __init__(self, folder: Path, stored: Sequence[_StoredTrack] = ()) -> None:
        self.folder, self.stored = folder, list(stored)

    def append(self, track: FlightTrack) -> None:
        """Write the arrays of one more track to a file, so that their memory can be freed."""
        from safetensors.numpy import save_file

        of_channels = {f.name: getattr(track, f.name) for f in fields(track)}
        arrays = {name: v for name, v in of_channels.items() if isinstance(v, np.ndarray)}
        errors = {f"{ERROR_OF}{name}": v for name, v in track.standard_errors.items()}
        file = self.folder / f"{len(list(self.folder.iterdir()))}.safetensors"
        save_file({n: np.ascontiguousarray(v) for n, v in {**arrays, **errors}.items()}, file)
        empty = {name: v[:0].copy() for name, v in arrays.items()}
        without = {name: v[:0].copy() for name, v in track.standard_errors.items()}
        self.stored.append(_StoredTrack(file, replace(track, **empty, standard_errors=without)))

    def __add__(self, other: TracksOnDisk) -> TracksOnDisk:
        return TracksOnDisk(self.folder, [*self.stored, *other.stored])

    def __len__(self) -> int:
        return len(self.stored)

    @overload
    def __getitem__(self, which: int) -> FlightTrack: ...
    @overload
    def __getitem__(self, which: slice) -> TracksOnDisk: ...
    def __getitem__(self, which: int | slice) -> FlightTrack | TracksOnDisk:
        if isinstance(which, slice):
            return TracksOnDisk(self.folder, self.stored[which])
        return self.stored[which].read()
