"""What an airframe file just made says of the flight that it was made from."""

from __future__ import annotations

import shlex
from pathlib import Path

from rich.console import Console

from thrustmargin.gcs_plugin.commands.shared.reading import ReadingOptions
from thrustmargin.models.errors import ThrustMarginError


def print_answer(console: Console, log: Path, file: Path, reading: ReadingOptions) -> None:
    """Print the report's verdict of a log by an airframe file, and how to have it as a page.

    A log that the report refuses is no fault of the file: the reason is printed.
    """
    from thrustmargin.gcs_plugin.commands.flight.report import print_verdicts
    from thrustmargin.gcs_plugin.commands.shared.inputs import chosen_model, read_flights
    from thrustmargin.gcs_plugin.reports.margin import build_report
    from thrustmargin.models.model.analysis import analyse, for_verdict

    try:
        model = chosen_model(None, str(file))
        flights = read_flights(log, model, given=True, reading=reading)
        made = build_report(
            (for_verdict(analyse(flight.track, model, claim=claim)), flight)
            for flight, claim in flights
        )
    except ThrustMarginError as error:
        console.print(f"no verdict of {log.name}: {error}", soft_wrap=True)
        return
    print_verdicts(console, made)
    line = f"thrustmargin report {shlex.quote(str(log))} --airframe {shlex.quote(str(file))}"
    load = "" if reading.load is None else f" --load {reading.load:g}"
    console.print(f"as a page: {line}{load}", soft_wrap=True)
