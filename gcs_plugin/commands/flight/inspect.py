"""`thrustmargin inspect`: what is in a log, and can it be believed."""

from __future__ import annotations

import json as json_module
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text
from tyro.conf import Positional

from thrustmargin.gcs_plugin.commands.shared.inputs import (
    AS_HEARD,
    Inputs,
    Reading,
    reading_keywords,
    with_recorded,
)
from thrustmargin.gcs_plugin.commands.shared.log_flights import with_engineer_notes
from thrustmargin.gcs_plugin.commands.shared.options import (
    STDOUT,
    OutputFile,
    UsageError,
    check_outputs,
    require_logs,
)
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.gcs_plugin.reports.shared.page_shell import grid
from thrustmargin.gcs_plugin.telemetry.recording import channel_source
from thrustmargin.gcs_plugin.wording.flight_words import several_words, sortie_words
from thrustmargin.gcs_plugin.wording.language import Verbatim, clock, known, say
from thrustmargin.models.errors import LogError, ThrustMarginError
from thrustmargin.models.whole_file import whole_file

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.logs import FlightLog
    from thrustmargin.gcs_plugin.logs.inspection import Inspection

MARK = {
    "grave": ("LOOK", "bold red"),
    "ok": ("ok", "green"),
    "warning": ("look", "yellow"),
    "unknown": ("?", "cyan"),
}
NO_COPY = (
    "{name}: only a telemetry log (.tlog) can be copied without who and where; of this one share "
    "rows.csv of: thrustmargin report {name} --anonymise --out rows.html"
)
_WIDE = 110  # columns of the terminal from which the whole table fits


def inspect(
    logs: Positional[
        Annotated[tuple[Path, ...], tyro.conf.arg(metavar="LOG...", help_behavior_hint="")]
    ],
    *,
    airframe: str | None = None,
    reading: Reading = AS_HEARD,
    json: Path | None = None,
    notes: Path | None = None,
    anonymise: Path | None = None,
) -> int:
    """Show what a log holds: every channel, the message it came from, its rate, gaps and range.

    Says whether the file is damaged, whether each motor is where the airframe file has it (by how
    the aircraft turned when its motors changed), and whether the rotor speeds are of the rotor or
    electrical. Look at this first when a flight looks odd.

    Example: thrustmargin inspect demo --airframe topxgun-f16-sitl

    Args:
        logs: Recorded flights: .tlog, DataFlash .BIN or .log, PX4 .ulg, or .csv; or folders of
            them.
        airframe: Name of a shipped airframe, or your airframe file (.toml); without it
            topxgun-f16-sitl is taken when the flight is recognised as one of it.
        reading: How the logs are read.
        json: Write the same as JSON to this file (.json); - is standard output, and nothing else.
        notes: Your notes of the flight (.csv, with the columns time and text); without it notes.csv
            in the log's folder.
        anonymise: Write a copy of the telemetry log without names, ids, texts and place to this
            file (.tlog), to be shared; margins and verdict stay.
    """
    from thrustmargin.gcs_plugin.logs.inspection import as_json

    console, errors = Terminal(quiet=json == STDOUT), Terminal(stderr=True)
    logs = require_logs(logs)
    inputs = Inputs(logs=logs, airframe=airframe, reading=reading)
    outputs = (
        OutputFile("--json", json, endings=(".json",)),
        OutputFile("--anonymise", anonymise, endings=(".tlog",)),
    )
    check_outputs(outputs, inputs=[*inputs.files, notes])
    if notes is not None and len(logs) > 1:
        raise UsageError("--notes are of one log; name one")
    if anonymise is not None and len(logs) > 1:
        raise UsageError("--anonymise makes a copy of one log; name one")
    done, failed = [], 0
    for path in logs:
        try:
            with errors.status(escape(f"reading {path.name}")):
                found = _inspect(replace(inputs, logs=(path,)), errors)
                noted = with_engineer_notes([one.log for one in found], notes, errors)
                found = [replace(one, log=log) for one, log in zip(found, noted, strict=True)]
        except ThrustMarginError as error:
            # One bad log must not hide the others.
            if len(logs) == 1:
                raise
            errors.print(f"thrustmargin: {error}", soft_wrap=True)
            failed += 1
            continue
        if anonymise is not None and found[0].log.format != "tlog":
            raise LogError(NO_COPY.format(name=path.name))
        if len(found) > 1:
            several = several_words(len(found), load_stated=reading.states_load)
            console.print(escape(f"{path.name}: {several}"), soft_wrap=True)
            for inspection in found:
                log = inspection.log
                console.print(f"  {sortie_words(log.sortie, log.track)}", soft_wrap=True)
        for inspection in found:
            _print(console, inspection)
            done.append(as_json(inspection))
    if anonymise is not None:
        from thrustmargin.gcs_plugin.logs.anonymous_tlog import anonymous_copy

        copy = anonymous_copy(path)
        with whole_file(anonymise) as draft:
            draft.write_bytes(copy)
        console.print(say("wrote {file}", file=anonymise), soft_wrap=True)
    text = json_module.dumps(done, indent=2) + "\n"
    if json == STDOUT:
        sys.stdout.write(text)
    elif json is not None:
        try:
            with whole_file(json) as draft:
                draft.write_text(text, encoding="utf-8")
        except OSError as error:
            raise LogError(f"cannot write {json}: {error.strerror or error}") from error
        console.print(say("wrote {file}", file=json), soft_wrap=True)
    return 1 if failed else 0


def _inspect(inputs: Inputs, console: Console) -> list[Inspection]:
    """Inspect every sortie of the single log in `inputs`, and return the inspections.

    Where the sortie's airframe is known, they include the findings of its analysis.
    """
    from thrustmargin.gcs_plugin.logs.findings import gravest_first
    from thrustmargin.gcs_plugin.logs.inspection import inspect_log
    from thrustmargin.gcs_plugin.logs.log_answer import (
        answer_log,
        matched_flights,
        verdict_findings,
        with_statements,
    )
    from thrustmargin.gcs_plugin.logs.vehicle_statements import vehicle_statements
    from thrustmargin.models.checks.loss_of_control import loss_of_control
    from thrustmargin.models.model.analysis import analyse, analysis_for_verdict
    from thrustmargin.models.model.rotor_model import physics_model

    (path,) = inputs.logs
    inputs = with_recorded(inputs, console)
    model = inputs.rotor_model()
    craft = model.airframe
    options = {"given": inputs.given, **reading_keywords(inputs.reading)}
    read = matched_flights(path, physics_model(craft), **options, any_vehicle=True)
    made = []
    for log, airframe_match in read:
        inspection = inspect_log(log, craft, airframe_match)
        if not airframe_match.no_verdict:
            flown = analysis_for_verdict(analyse(log.track, model, airframe_match=airframe_match))
            answer = answer_log(log, flown, inputs.limit)
            found = verdict_findings(answer.advice)
            findings = gravest_first([*found, *answer.findings])
        else:
            said = vehicle_statements(log.events, log.track, losses=loss_of_control(log.track))
            findings = with_statements(inspection.findings, said, None)
        inspection = replace(inspection, findings=findings)
        made.append(inspection)
    return made


def _print(console: Console, inspection: Inspection) -> None:
    from thrustmargin.gcs_plugin.wording.check_words import (
        airframe_match_words,
        note_words,
        source_words,
        statement_words,
    )
    from thrustmargin.gcs_plugin.wording.flight_words import not_flown

    log, track = inspection.log, inspection.log.track
    others = [str(v) for v in log.vehicles if v != log.vehicle]
    also = say(" (also in the log: {vehicles})", vehicles=", ".join(others)) if others else ""
    first = say(
        "{log}: {format}, {autopilot}, vehicle {vehicle}{also}, {long} s of which {flown} s in "
        "flight, {count} rows",
        log=Verbatim(log.name),
        format=log.format,
        autopilot=log.autopilot,
        vehicle=log.vehicle,
        also=also,
        long=f"{track.duration:.1f}",
        flown=f"{track.flying_s:.1f}",
        count=track.time_s.size,
    )
    console.print(f"{first}; {airframe_match_words(inspection.airframe_match)}", soft_wrap=True)
    console.print(
        say("vehicle: {words}", words=Verbatim(statement_words(log.facts.statement))),
        soft_wrap=True,
    )
    source = Verbatim(source_words(track.source("flying")))
    by = not_flown(track) or say("in flight by: {source}", source=source)
    console.print(by, soft_wrap=True)
    wide = console.width >= _WIDE
    console.print(_channels(log, wide=wide))
    if not wide:
        console.print(_sources(log))
    findings = Table(show_header=False, box=None, pad_edge=False)
    for finding in inspection.findings:
        mark, colour = MARK[finding.level]
        findings.add_row(
            Text(say(mark), style=colour), Text(say(finding.check)), Text(finding.words)
        )
    console.print(findings)
    for noted in log.engineer_notes:
        when = clock(max(noted.time_s, 0.0))
        words = say("noted at {clock}: {text}", clock=when, text=Verbatim(noted.text))
        console.print(Text(words), soft_wrap=True)
    for note in note_words(track):
        console.print(Text(say("note: {note}", note=Verbatim(note))), soft_wrap=True)
    unknown = log.quality.unknown_ids
    if unknown:
        listed = ", ".join(f"{number} ({count})" for number, count in sorted(unknown.items()))
        console.print(say("message ids not known, skipped: {ids}", ids=listed), soft_wrap=True)


def _channels(log: FlightLog, *, wide: bool) -> Table:
    """Return the table of the log's channels: rate, gaps, range and unit.

    `wide`: with a column of their sources. Cells of a channel without samples are empty.
    """
    headings = ("Hz", "gaps", "pause s", "min", "median", "max")

    words = ("channel", "from") if wide else ("channel",)
    heads = tuple(map(say, (*words, *headings, "unit")))
    table = grid(heads, left=(*range(len(words)), len(heads) - 1))
    for c in log.channels:
        cells = [""] * len(headings)
        if c.samples:
            cells = [f"{c.rate_hz:.3g}", str(c.gaps), f"{c.longest_gap_s:.2f}"]
            cells += [
                f"{value:.4g}" if known(value) else "" for value in (c.minimum, c.median, c.maximum)
            ]
        source = [Text(channel_source(c))] if wide else []
        table.add_row(c.name, *source, *cells, c.unit, style="" if c.samples else "dim")
    return table


def _sources(log: FlightLog) -> Table:

    table = Table(show_header=False, box=None, pad_edge=False)
    for c in log.channels:
        table.add_row(c.name, Text(channel_source(c)), style="" if c.samples else "dim")
    return table
