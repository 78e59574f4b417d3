"""Logs read and analysed as `report` does it, for commands that write something else."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from thrustmargin.gcs_plugin.commands.shared.options import check_utilisation
from thrustmargin.gcs_plugin.commands.shared.recorded import Chosen, with_recorded
from thrustmargin.models.errors import DataError, ThrustMarginError

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.logs import FlightLog
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog
    from thrustmargin.models.model.analysis import FlightAnalysis


def analysed_flights(
    logs: Sequence[Path], asked: Chosen, console: Console
) -> tuple[list[tuple[FlightAnalysis, FlightLog]], float, list[UnusedLog]]:
    """Every sortie of the logs, the largest share of thrust that may be in use, the logs not read.

    What a recording was made with is taken where nothing is asked for. Raises DataError when no
    log can be read, UsageError when the share is none.
    """
    chosen = with_recorded(logs, asked, console)
    check_utilisation(chosen.limit)
    flights, unread = flights_of(logs, chosen, console)
    return flights, chosen.limit, unread


def flights_of(
    logs: Sequence[Path], chosen: Chosen, console: Console
) -> tuple[list[tuple[FlightAnalysis, FlightLog]], list[UnusedLog]]:
    """Every sortie of the logs with the load that its verdict rests on, and the logs not read.

    Raises DataError when no log can be read.
    """
    from thrustmargin.gcs_plugin.commands.shared.inputs import chosen_model, listed, read_logs
    from thrustmargin.models.model.analysis import analyse, for_verdict

    model = chosen_model(chosen.model, chosen.airframe)
    unread: list[UnusedLog] = []
    read = read_logs(
        logs,
        unread,
        console,
        model=model,
        given=chosen.given,
        reading=chosen.reading,
        skipped=ThrustMarginError,
    )
    flights = [(for_verdict(analyse(log.track, model, claim=claim)), log) for log, claim in read]
    if not flights:
        raise DataError(listed(unread))
    return flights, unread
