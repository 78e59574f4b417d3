"""A report to one HTML page, a JSON and a CSV, written whole or not at all.

The page asks nothing of any network: plotly.js is in it once, figures are JSON in inert <script>
elements, and its content security policy lets only the two scripts run whose hash it names. Text
from a log reaches the page through jinja2's autoescape or through JSON with < > & as \\u escapes.
"""

from __future__ import annotations

import base64
import hashlib
import io
import json
from contextlib import ExitStack
from dataclasses import dataclass, fields
from importlib import resources
from pathlib import Path

import jinja2
import numpy as np
import pyarrow as pa
import pyarrow.csv
from markupsafe import Markup

from gcs_plugin.report import words
from gcs_plugin.report.build import worst_first
from gcs_plugin.report.data import SCHEMA, Report
from gcs_plugin.report.figures import figures
from gcs_plugin.report.series import COLUMNS, csv_columns
from mission.whole_file import whole_file
from models.plain import to_plain

_ESCAPES = {
    "<": "\\u003c",
    ">": "\\u003e",
    "&": "\\u0026",
    "\u2028": "\\u2028",
    "\u2029": "\\u2029",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Written:
    """The files of one report."""

    html: Path
    json: Path
    csv: Path


def write_report(report: Report, out: Path) -> Written:
    """Write `out` (.html) and beside it, with the same stem, the JSON and the CSV.

    All three are made before any is replaced: a failure or Ctrl-C on the way leaves what was there.
    Raises OSError when the folder is missing or cannot be written.
    """
    written = Written(html=out, json=out.with_suffix(".json"), csv=out.with_suffix(".csv"))
    with ExitStack() as files:
        drafts = {p: files.enter_context(whole_file(p)) for p in (written.csv, written.json, out)}
        drafts[written.csv].write_bytes(csv_bytes(report))
        drafts[written.json].write_text(json_text(report, written.csv.name), encoding="utf-8")
        drafts[out].write_text(html_text(report, written), encoding="utf-8")
    return written


def json_text(report: Report, csv_name: str) -> str:
    """The report's numbers as JSON, schema "thrustmargin.report/1"; unknown numbers are null."""
    whole = {
        "schema": SCHEMA,
        "made_utc": report.made_utc,
        "version": report.version,
        "limit": report.limit,
        "overview": to_plain(report.overview),
        "csv": {
            "file": csv_name,
            "columns": ["flight", *(f"{name} [{unit}]" for _, name, unit, _ in COLUMNS)],
        },
        "flights": [
            {
                f.name: to_plain(getattr(flight, f.name))
                for f in fields(flight)
                if f.name != "series"
            }
            for flight in report.flights
        ],
        "unread": to_plain(report.unread),
    }
    return json.dumps(whole, ensure_ascii=False, allow_nan=False, indent=1) + "\n"


def csv_bytes(report: Report) -> bytes:
    """A row a time of every flight, units in the header, empty cells where unknown.

    The first column is the number of the flight in the JSON's list, from 1. No text of a log is in
    the file, so that no spreadsheet can take it for a formula.
    """
    rotors = max((f.series.rotor_count for f in report.flights), default=0)
    buffer = io.BytesIO()
    tables = []
    for k, flight in enumerate(report.flights):
        rows = flight.series.time_s.size
        columns = {"flight": pa.array(np.full(rows, k + 1))}
        for header, values in csv_columns(flight.series, rotors):
            columns[header] = pa.array(values, from_pandas=True)
        tables.append(pa.table(columns))
    if tables:
        pyarrow.csv.write_csv(pa.concat_tables(tables), buffer)
    return buffer.getvalue()


def html_text(report: Report, written: Written) -> str:
    """The page; the figures of every flight are drawn when they come into view."""
    from plotly.offline import get_plotlyjs

    library = get_plotlyjs().replace("\r\n", "\n")
    draw = _template_text("draw.js")
    drawn = [
        {
            name: script_safe(json.dumps(made, allow_nan=False))
            for name, made in figures(flight).items()
        }
        for flight in report.flights
    ]
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_template_text),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals |= {
        name: getattr(words, name)
        for name in (
            "number",
            "percent",
            "significant",
            "more",
            "clock",
            "duration",
            "area",
            "estimate",
            "place",
            "from_direction",
            "moment_words",
        )
    }
    environment.filters["unbroken"] = words.unbroken
    return environment.get_template("page.html").render(
        report=report,
        order=worst_first(report.flights),
        schema=SCHEMA,
        figures=drawn,
        files={"json": written.json.name, "csv": written.csv.name},
        policy=content_policy(library, draw),
        style=Markup(_template_text("page.css")),
        library=Markup(library),
        draw=Markup(draw),
    )


def script_safe(text: str) -> Markup:
    """JSON text with every character escaped that could end or open an HTML element."""
    for character, escape in _ESCAPES.items():
        text = text.replace(character, escape)
    return Markup(text)


def content_policy(*scripts: str) -> str:
    """The page's policy: nothing from anywhere, and only the scripts given, known by their hash."""
    hashes = " ".join(
        f"'sha256-{base64.b64encode(hashlib.sha256(s.encode()).digest()).decode()}'"
        for s in scripts
    )
    # plotly.js places style rules and draws its download through data and blob addresses.
    return (
        f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; "
        "img-src data: blob:; base-uri 'none'; form-action 'none'"
    )


def _template_text(name: str) -> str:
    return (resources.files("gcs_plugin.report") / name).read_text(encoding="utf-8")
