"""The page of measured data: one HTML file that asks nothing of any network.

Plots, policy and escapes are those of the margin report; text from a file reaches the page through
jinja2's autoescape or through JSON with < > & as \\u escapes.
"""

from __future__ import annotations

import json
from importlib import resources

import jinja2
from markupsafe import Markup

from gcs_plugin.measured.findings import Finding, Number
from gcs_plugin.measured.study import SCHEMA, Study
from gcs_plugin.report.build import software_version
from gcs_plugin.report.render import content_policy, script_safe


def html_text(study: Study) -> str:
    """The page; figures are drawn when they come into view."""
    from plotly.offline import get_plotlyjs

    library = get_plotlyjs().replace("\r\n", "\n")
    draw = _text("gcs_plugin.report", "draw.js")
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(lambda name: _text("gcs_plugin.measured", name)),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals |= {"shown": shown, "named": named, "verdict": verdict}
    return environment.get_template("page.html").render(
        study=study,
        schema=SCHEMA,
        figures=[_figures(finding) for finding in study.findings],
        policy=content_policy(library, draw),
        version=software_version(),
        style=Markup(_text("gcs_plugin.report", "page.css")),
        library=Markup(library),
        draw=Markup(draw),
    )


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


def _text(package: str, name: str) -> str:
    return (resources.files(package) / name).read_text(encoding="utf-8")
