"""An identification as one HTML page that asks nothing of any network."""

from __future__ import annotations

import json

from thrustmargin.gcs_plugin.reports.identify.channel_figures import channels_figure, shares_figure
from thrustmargin.gcs_plugin.reports.identify.content import Content, content_of
from thrustmargin.gcs_plugin.reports.identify.identify_result import Result
from thrustmargin.gcs_plugin.reports.identify.residual_figures import (
    curve_figure,
    modes_figure,
    per_flight,
)
from thrustmargin.gcs_plugin.reports.shared.page_shell import (
    page_text,
    script_safe,
    software_version,
)
from thrustmargin.gcs_plugin.reports.shared.plot_style import PlotJson
from thrustmargin.gcs_plugin.wording import numbers as words


def html_text(result: Result) -> str:
    """The page; figures are drawn when they come into view."""
    content = content_of(result)
    context = {
        "c": content,
        "figures": {n: script_safe(json.dumps(f)) for n, f in _figures(result, content).items()},
        "version": software_version(),
    }
    functions = {"number": words.number, "percent": words.percent}
    return page_text(
        "thrustmargin.gcs_plugin.reports.identify", context, functions=functions, own_style=True
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
