"""A report to one HTML page, a JSON and a CSV, written whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from markupsafe import Markup

from thrustmargin.gcs_plugin.reports.margin.csv_rows import COLUMNS, csv_columns
from thrustmargin.gcs_plugin.reports.margin.data import SCHEMA, Report, ReportedFlight
from thrustmargin.gcs_plugin.reports.margin.figures import airborne, figures
from thrustmargin.gcs_plugin.reports.margin.summary import worst_first
from thrustmargin.gcs_plugin.reports.shared import page_shell
from thrustmargin.gcs_plugin.reports.shared.page_shell import packed, page_text
from thrustmargin.gcs_plugin.reports.shared.plot_style import Figure
from thrustmargin.gcs_plugin.wording import alarm_words as faults
from thrustmargin.gcs_plugin.wording import palette
from thrustmargin.gcs_plugin.wording.actions import shown_level
from thrustmargin.gcs_plugin.wording.advice_words import SEVERAL
from thrustmargin.gcs_plugin.wording.fill_words import amount
from thrustmargin.gcs_plugin.wording.flight_words import doing_words
from thrustmargin.gcs_plugin.wording.glance_words import glance
from thrustmargin.gcs_plugin.wording.margin_verdict import (
    estimate,
    peak_left,
    peak_words,
    worst_words,
)
from thrustmargin.gcs_plugin.wording.report_words import CONDITIONS, SHOWN_AS_LEFT, TO_COPY
from thrustmargin.gcs_plugin.wording.thrust_left import least_words, left_words
from thrustmargin.models.model.analysis import worst_rotor
from thrustmargin.models.whole_file import whole_file


@dataclass(frozen=True, slots=True, kw_only=True)
class Written:
    """The files of one report."""

    html: Path
    json: Path
    csv: Path


def write_report(report: Report, out: Path) -> Written:
    """Write the report to `out` (.html), and JSON and CSV files with the same stem next to it.

    Return the three paths. All three are complete before any is replaced: after a failure or Ctrl-C
    the old files are unchanged. Raises OSError when the folder is missing or cannot be written.
    """
    files_of = Written(html=out, json=out.with_suffix(".json"), csv=out.with_suffix(".csv"))
    with ExitStack() as files:
        drafts = {p: files.enter_context(whole_file(p)) for p in (files_of.csv, files_of.json, out)}
        drafts[files_of.csv].write_bytes(csv_bytes(report))
        # Names of files may hold what is no character.
        drafts[files_of.json].write_bytes(
            json_text(report, files_of.csv.name).encode("utf-8", "replace")
        )
        drafts[out].write_bytes(html_text(report, files_of).encode("utf-8", "replace"))
    return files_of


def json_text(report: Report, csv_name: str) -> str:
    """Return the report's numbers as JSON, schema "thrustmargin.report/3".

    Unknown numbers are null. `csv_name` is the name of the report's CSV file, which the JSON states
    with its columns.
    """
    whole = {
        "schema": SCHEMA,
        "made_utc": report.made_utc,
        "version": report.version,
        "limit": report.max_utilisation,
        "overview": report.overview,
        "csv": {
            "file": csv_name,
            "columns": ["flight_number", *(f"{name} [{unit}]" for name, unit, _ in COLUMNS)],
        },
        "flights": [flight.json for flight in report.flights],
        "unread": report.unread,
    }
    return page_shell.json_text(whole)


def csv_bytes(report: Report) -> bytes:
    """Return all flights as one CSV in UTF-8: a header with units, then a row for each time step.

    Unknown values are empty cells. The first column is the flight's number in the JSON's list, from
    1. Texts of a log are excluded, so that no spreadsheet runs one as a formula. Empty without a
    flight.
    """
    rotors = max((len(f.json["rotors"]) for f in report.flights), default=0)
    heading, lines = "", []
    for k, flight in enumerate(report.flights):
        columns = dict(csv_columns(flight.rows, rotors))
        if not heading:
            heading = ",".join(f'"{name}"' for name in ("flight_number", *columns))
        rows = zip(*(values.tolist() for values in columns.values()), strict=True)
        # The tuple's own text is written several times as fast as cell by cell.
        lines += (f"{k + 1}, {str(row)[1:-1]}, \n" for row in rows)
    text = "".join(lines).replace("nan", "").replace(".0, ", ", ")
    text = text.replace(", \n", "\n").replace(", ", ",")
    return f"{heading}\n{text}".encode() if heading else b""


def pdf_bytes(report: Report, written: Written | None) -> bytes:
    """Return the report's HTML page, with its words and figures, as a PDF on A4.

    `written` are the paths of the report's files, to be named on the page; None if none are
    written. One flight takes three to four pages; of several, each has its verdict and one figure,
    two flights to a page.
    """
    from thrustmargin.gcs_plugin.reports.paper import pdf_page

    brief = len(report.flights) > 1
    drawn = {n: made for n, made in _drawn(report).items() if not brief or n.startswith("use_")}
    html = _page(report, written, dict.fromkeys(drawn, Markup()))
    return pdf_page.pdf_bytes(html, drawn, brief=brief)


def html_text(report: Report, written: Written) -> str:
    """Return the report as an HTML page; the browser draws a figure when it scrolls into view.

    `written` are the paths of the report's files, which the page names.
    """
    drawn = {name: packed(made.to_json()) for name, made in _drawn(report).items()}
    return _page(report, written, drawn)


def _drawn(report: Report) -> dict[str, Figure]:
    return {
        f"{name}_{index}": made
        for index, flight in enumerate(report.flights)
        for name, made in figures(flight).items()
    }


BINS = 120  # of the strip


@dataclass(frozen=True, slots=True)
class Strip:
    """A flight as a strip of colours: parts (share of its length in %, CSS colour) in order.

    `worst_at` is where the worst row is, in %.
    """

    parts: tuple[tuple[float, str], ...]
    worst_at: float | None


def strip_of(flight: ReportedFlight) -> Strip | None:
    """Return a coloured bar of thrust left from take-off to landing; None if it is unknown
    throughout.

    The flight is divided into BINS equal time bins. Each has the colour of its least thrust left of
    any rotor, or the colour of no data. Neighbours of equal colour are one part, its length in % of
    the time. The worst peak is marked at its time, in % too.
    """
    rows = airborne(flight.rows)
    time_s, use = rows["time_s"], worst_rotor(rows["known_utilisation"])[0]
    if not np.isfinite(use).any():
        return None
    whole_s = max(float(time_s[-1] - time_s[0]), 1e-9)
    place = np.minimum((BINS * (time_s - time_s[0]) / whole_s).astype(int), BINS - 1)
    most = np.full(BINS, -np.inf)
    np.maximum.at(most, place, np.nan_to_num(use, nan=-np.inf))
    scale = palette.thrust_left(1.0 - flight.advice.limit)
    colours = [palette.css(c) for c in scale.screen(np.where(most > -np.inf, 1.0 - most, np.nan))]
    parts: list[tuple[float, str]] = []
    for colour in colours:
        share = 100.0 / BINS + (parts.pop()[0] if parts and parts[-1][1] == colour else 0.0)
        parts.append((share, colour))
    worst = flight.worst
    at = None if worst is None else 100.0 * (worst.time_s - float(time_s[0])) / whole_s
    return Strip(tuple(parts), None if at is None else min(max(at, 0.0), 100.0))


def left_of_use(use: float) -> str:
    """Return the thrust left as text, `45 %`, of the utilisation `use`, a share (0.55)."""
    return left_words(1.0 - use)


def _page(report: Report, written: Written | None, drawn: Mapping[str, Markup]) -> str:
    context = {
        "report": report,
        "order": worst_first(report.flights),
        "overall_level": shown_level(
            report.overview["level"], left_open=any(one.advice.caveats for one in report.flights)
        ),
        "schema": SCHEMA,
        "figures": drawn,
        "files": {"json": written.json.name, "csv": written.csv.name} if written else None,
        "to_copy": TO_COPY,
        "conditions": CONDITIONS,
        "strip_of": strip_of,
        "worst_words": worst_words,
        "spins": faults.SPINS,
        "held": faults.HELD,
        "descended": faults.DESCENDED,
        "maximum_fill": faults.MAXIMUM_FILL,
        "fill": amount,
        "glance": glance,
        "left": left_of_use,
        "least_left": least_words,
        "peak_left": peak_left,
        "shown_as_left": SHOWN_AS_LEFT,
        "several": SEVERAL,
        "estimate": estimate,
        "doing": doing_words,
        "peak_words": peak_words,
        "place_words": faults.place_words,
    }
    return page_text(__name__.rpartition(".")[0], context)
