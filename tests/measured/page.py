"""The page of measured data: one HTML file that asks nothing of any network."""

from __future__ import annotations

import json

from markupsafe import Markup

from tests.measured.findings import Finding, Number
from tests.measured.study import SCHEMA, Study
from thrustmargin.gcs_plugin.reports.shared.page_shell import (
    page_text,
    script_safe,
    software_version,
)


def html_text(study: Study) -> str:
    """The page; figures are drawn when they come into view."""
    context = {
        "study": study,
        "schema": SCHEMA,
        "figures": [_figures(finding) for finding in study.findings],
        "version": software_version(),
    }
    functions = {"shown": shown, "named": named, "verdict": verdict}
    return page_text("tests.measured", context, functions=functions)


def shown(number: Number, *, quoted: bool = False) -> str:
    """The number, or what is quoted for it, with four digits; a dash where there is none."""
    value = number.quoted if quoted else number.value
    if value is None or value != value:
        return "-"
    unit = "" if number.unit == "1" else f" {number.unit}"
    return f"{value:.4g}{unit}"


def named(number: Number) -> str:
    """What the number is, in words."""
    return number.label or number.name.replace("_", " ")


def verdict(number: Number) -> str:
    """Whether the number reaches what is quoted, in a word; empty where nothing is asked."""
    return {None: "", True: "reached", False: "NOT reached"}[number.met]


def _figures(finding: Finding) -> list[tuple[str, Markup]]:
    return [
        (caption, script_safe(json.dumps(figure)))
        for caption, figure in finding.figures.items()
        if figure["data"]
    ]
