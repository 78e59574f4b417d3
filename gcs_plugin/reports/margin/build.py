"""A report over several analysed flights."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from typing import get_args

from thrustmargin.gcs_plugin.logs import FlightLog
from thrustmargin.gcs_plugin.reports.margin.data import (
    FlightReport,
    Level,
    Overview,
    Report,
)
from thrustmargin.gcs_plugin.reports.margin.headline import several_headline
from thrustmargin.gcs_plugin.reports.margin.summary import report_flight
from thrustmargin.gcs_plugin.reports.shared import UnusedLog
from thrustmargin.gcs_plugin.reports.shared.page_shell import software_version
from thrustmargin.models.errors import DataError
from thrustmargin.models.model.analysis import FlightAnalysis


def build_report(
    flights: Iterable[tuple[FlightAnalysis, FlightLog]],
    *,
    max_utilisation: float = 0.5,
    unread: Iterable[UnusedLog] = (),
) -> Report:
    """The numbers of a report over flights, in their order, checked against `max_utilisation`.

    That is the largest share of a rotor's maximum thrust that may be in use.

    `unread` are logs that could not be read, to be named in it. Raises DataError when the
    share is not between 0 and 1, or there is no flight.
    """
    if not 0.0 < max_utilisation < 1.0:
        raise DataError(f"max_utilisation {max_utilisation:g} is no share; give one such as 0.5")
    reports = tuple(
        report_flight(analysis, log, max_utilisation=max_utilisation) for analysis, log in flights
    )
    if not reports:
        raise DataError("no flight to report on; give at least one log that can be read")
    return Report(
        made_utc=datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z"),
        version=software_version(),
        max_utilisation=max_utilisation,
        overview=overview_of(reports, max_utilisation),
        flights=reports,
        unread=tuple(unread),
    )


def overview_of(reports: Sequence[FlightReport], limit: float) -> Overview:
    """How many flights have which verdict, and which is the worst."""
    levels: list[Level] = [report.verdict.level for report in reports]
    level, headline = several_headline(levels, limit)
    first, report = worst_first(reports)[0]
    return Overview(
        level=level,
        headline=headline,
        worst_flight=first + 1 if report.verdict.worst else None,
        **{level: levels.count(level) for level in get_args(Level)},
    )


def worst_first(reports: Sequence[FlightReport]) -> list[tuple[int, FlightReport]]:
    """(index in the list, report), the highest thrust in use first, unknown ones last."""

    def use(item: tuple[int, FlightReport]) -> float:
        worst = item[1].verdict.worst
        return -worst.capacity_use if worst else 1.0

    return sorted(enumerate(reports), key=use)
