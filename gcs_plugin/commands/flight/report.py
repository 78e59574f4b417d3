"""`thrustmargin report`: a margin report of recorded flights as one HTML page, JSON and CSV."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.console import Console
from tyro.conf import Positional

from thrustmargin.gcs_plugin.commands.shared.inputs import (
    ANY_KNOWN,
    AS_HEARD,
    Inputs,
    Known,
    Reading,
    Share,
    with_recorded,
)
from thrustmargin.gcs_plugin.commands.shared.log_flights import flights_of, with_engineer_notes
from thrustmargin.gcs_plugin.commands.shared.options import (
    STDOUT,
    OutputFile,
    check_outputs,
    check_utilisation,
    json_apart,
    require_logs,
)
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.gcs_plugin.wording.language import say
from thrustmargin.models.errors import DataError

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.reports.margin.data import Report


def report(
    logs: Positional[
        Annotated[tuple[Path, ...], tyro.conf.arg(metavar="LOG...", help_behavior_hint="")]
    ],
    *,
    model: Path | None = None,
    airframe: str | None = None,
    reading: Reading = AS_HEARD,
    known: Known = ANY_KNOWN,
    out: Path | None = None,
    json: Path | None = None,
    pdf: Path | None = None,
    plan: Path | None = None,
    assumed: Path | None = None,
    max_utilisation: Share | None = None,
    notes: Path | None = None,
    anonymise: bool = False,
) -> int:
    """Write a margin report of one or more flights: how close it was, where, and with which rotor.

    Of a recording of `monitor`, what you do not state is taken as it was stated there.
    The page opens in any browser without a network. With the same name come a .json
    with its numbers and a .csv with a line for each moment of the flight.

    Example: thrustmargin report demo --out north-field.html

    Args:
        logs: Recorded flights: .tlog, DataFlash .BIN or .log, PX4 .ulg, or .csv; or folders of
            them.
        model: Rotor speed model file of this aircraft; without it, and without an airframe, the one
            that ships is used for a flight that is recognised as one of topxgun-f16-sitl.
        airframe: Name of a shipped airframe, or an airframe file (.toml); without it the
            model's, else that of topxgun-f16-sitl for a flight that is recognised as one of it.
        reading: How the logs are read.
        known: The known aircraft that flew; see `thrustmargin learn`.
        out: Page to write, to look at (.html) or to print (.pdf); without it report.html, unless
            --json or --pdf is given.
        json: Write the numbers as JSON to this file (.json); - is standard output, and nothing
            else.
        pdf: Write the page to this file (.pdf) too, on A4 to print; needs no browser.
        plan: Plan that was flown (.plan, .waypoints, or the log itself): its forecast is compared
        with
            the flight, with which assumption was off.
        assumed: With --plan, what it was forecast with: the JSON that `forecast --json` wrote;
            without it still, standard air, a full battery, and the fill at take-off.
        max_utilisation: Largest share of a rotor's maximum thrust that may be in use; without it
            50%, or what a recording was made with.
        notes: Your notes of the flight (.csv, with the columns time and text), shown in its
            timeline; without it notes.csv in the log's folder.
        anonymise: Strip who and where: names, serial numbers, ids, texts, the place on the globe.
    """
    planned = beforehand = None
    if plan is not None or assumed is not None:
        from thrustmargin.gcs_plugin.commands.shared.plan_source import read_assumed, read_plan

        # A plan that is none is refused before the rest is loaded.
        planned = None if plan is None else read_plan(plan)
        beforehand = None if assumed is None else read_assumed(assumed, plan=plan)
    from thrustmargin.gcs_plugin.reports.margin import build_report
    from thrustmargin.gcs_plugin.reports.margin.render import json_text, pdf_bytes, write_report
    from thrustmargin.models.whole_file import whole_file

    console = Terminal(stderr=True, soft_wrap=True)
    inputs = Inputs(
        logs=require_logs(logs),
        model=model,
        airframe=airframe,
        max_utilisation=max_utilisation,
        reading=reading,
        known=known,
    )
    inputs = with_recorded(inputs, console)
    check_utilisation(inputs.limit)
    out, json = json_apart(out, json)
    if out is not None and pdf is None and out.suffix.lower() == ".pdf":
        out, pdf = None, out
    if out is None and json is None and pdf is None:
        out = Path("report.html")
    outputs = [
        OutputFile("--json", json, endings=(".json",), content="numbers"),
        OutputFile("--pdf", pdf, endings=(".pdf",)),
    ]
    if out is not None:
        outputs += [
            OutputFile("--out", out, endings=(".html", ".htm")),
            OutputFile("--out", out.with_suffix(".json"), content="numbers"),
            OutputFile("--out", out.with_suffix(".csv")),
        ]
    check_outputs(outputs, inputs=[*inputs.files, plan, assumed, notes])
    flights, unread = flights_of(inputs, console)
    noted = with_engineer_notes([log for _, log in flights], notes, console)
    flights = [(analysis, log) for (analysis, _), log in zip(flights, noted, strict=True)]
    shown = unread
    if anonymise:
        from thrustmargin.gcs_plugin.commands.shared.anonymous import anonymous
        from thrustmargin.gcs_plugin.reports.shared import UnusedLog

        flights = [anonymous(*flight, f"flight {n}") for n, flight in enumerate(flights, 1)]
        shown = [UnusedLog(name="a log", reason="not read") for _ in unread]
    with console.status("writing the report"):
        made = build_report(
            flights, max_utilisation=inputs.limit, unread=shown, plan=planned, assumed=beforehand
        )
        written = None
        try:
            if out is not None:
                written = write_report(made, out)
            text = json_text(made, "" if written is None else written.csv.name)
            if pdf is not None:
                with whole_file(pdf) as draft:
                    draft.write_bytes(pdf_bytes(made, written))
            if json == STDOUT:
                sys.stdout.write(text)
            elif json is not None:
                with whole_file(json) as draft:
                    draft.write_bytes(text.encode("utf-8", "replace"))
        except OSError as error:
            where = error.filename or out or "standard output"
            raise DataError(f"cannot write {where}: {error.strerror or error}") from error
    summary = Terminal(soft_wrap=True, quiet=json == STDOUT)
    print_verdicts(summary, made)
    for log in unread:
        console.print(f"not read: {log.name}: {log.reason}")
    if written is not None:
        summary.print(f"wrote {written.html}, {written.json.name} and {written.csv.name}")
    for also in (json, pdf):
        if also is not None:
            summary.print(f"wrote {also}")
    # A flight that is not of the airframe that was given has no verdict either.
    unfit = any(
        one.airframe_match.basis == "given" and one.airframe_match.no_verdict for one, _ in flights
    )
    return 1 if unread or unfit else 0


def print_verdicts(console: Console, made: Report) -> None:
    """Print headline and (label, text) lines of each flight, the worst flight first.

    For several flights, a headline on all of them comes before.
    """
    from thrustmargin.gcs_plugin.reports.margin.summary import worst_first

    if len(made.flights) > 1:
        console.print(made.overview["headline"], style="bold", soft_wrap=True)
    for _, flight in worst_first(made.flights):
        verdict = flight.json["verdict"]
        console.print(f"{flight.name}: {verdict['headline']}", style="bold", soft_wrap=True)
        for fact in verdict["facts"]:
            console.print(f"  {say(fact['label'])}: {fact['text']}", soft_wrap=True)
