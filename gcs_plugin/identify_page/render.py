"""An identification as one HTML page that asks nothing of any network.

Plots, policy and escapes are those of the margin report; text from a log reaches the page through
jinja2's autoescape or through JSON with < > & as \\u escapes.
"""

from __future__ import annotations

import json
from importlib import resources

import jinja2
from markupsafe import Markup

from gcs_plugin.identify_page.channel_figures import channels_figure, shares_figure
from gcs_plugin.identify_page.content import Content, content_of
from gcs_plugin.identify_page.figures import curve_figure, modes_figure, per_flight
from gcs_plugin.identify_result import Result
from gcs_plugin.report import words
from gcs_plugin.report.build import software_version
from gcs_plugin.report.plot_style import PlotJson
from gcs_plugin.report.render import content_policy, script_safe


def html_text(result: Result) -> str:
    """The page; figures are drawn when they come into view."""
    from plotly.offline import get_plotlyjs

    library = get_plotlyjs().replace("\r\n", "\n")
    draw = _text("gcs_plugin.report", "draw.js")
    content = content_of(result)
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(lambda name: _text("gcs_plugin.identify_page", name)),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals |= {name: getattr(words, name) for name in ("number", "percent")}
    environment.filters["unbroken"] = words.unbroken
    style = _text("gcs_plugin.report", "page.css") + _text("gcs_plugin.identify_page", "page.css")
    return environment.get_template("page.html").render(
        c=content,
        figures={n: script_safe(json.dumps(f)) for n, f in _figures(result, content).items()},
        policy=content_policy(library, draw),
        version=software_version(),
        style=Markup(style),
        library=Markup(library),
        draw=Markup(draw),
    )


def _figures(result: Result, content: Content) -> dict[str, PlotJson]:
    rows, found = content.rows, result.found
    made = {
        "modes": modes_figure(rows),
        "shares": shares_figure(rows),
        **{f"channels_{m}": channels_figure(rows, m) for m in range(len(rows.mode_names))},
        **per_flight(rows, content.shown_flights),
    }
    if found.curve is not None:
        made["curve"] = curve_figure(found.curve, rows.mode_names[found.curve.mode])
    return made


def _text(package: str, name: str) -> str:
    return (resources.files(package) / name).read_text(encoding="utf-8")
