"""Plotly figures of measured data, in the colours and type of the report."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from thrustmargin.gcs_plugin.reports.shared.plot_style import (
    AXIS,
    INK,
    LAYOUT,
    MEASURED,
    PREDICTED,
    PlotJson,
    packed,
)
from thrustmargin.models.flight import Floats

POINT_COLOURS = (MEASURED, "#6f6f6f", "#0077bb", "#00512d", "#7a3e9d")
LINE_COLOURS = (PREDICTED, "#b00000", INK, "#00512d")
BEFORE_AFTER = (PREDICTED, MEASURED, "#6f6f6f")
DASHES = ("solid", "dash", "dot", "dashdot")
MOST_POINTS = 3000

Named = tuple[str, Floats, Floats]


def scatter_figure(
    *,
    points: Sequence[Named] = (),
    lines: Sequence[Named] = (),
    x_title: str,
    y_title: str,
    height: int = 460,
    line_colours: Sequence[str] = LINE_COLOURS,
) -> PlotJson:
    """Points and lines, each (name, x, y), on one pair of axes."""
    data: list[PlotJson] = []
    for k, (name, x, y) in enumerate(points):
        every = max(1, -(-len(x) // MOST_POINTS))
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "name": escape(name),
                "x": packed(np.asarray(x)[::every]),
                "y": packed(np.asarray(y)[::every]),
                "marker": {"size": 6, "color": POINT_COLOURS[k % len(POINT_COLOURS)]},
            }
        )
    for k, (name, x, y) in enumerate(lines):
        style = {
            "color": line_colours[k % len(line_colours)],
            "width": 3,
            "dash": DASHES[k % len(DASHES)],
        }
        data.append(
            {
                "type": "scatter",
                "mode": "lines",
                "name": escape(name),
                "x": packed(np.asarray(x)),
                "y": packed(np.asarray(y)),
                "line": style,
            }
        )
    return {"data": data, "layout": _layout(x_title, y_title, height)}


def bar_figure(
    *,
    groups: Sequence[tuple[str, Sequence[float]]],
    labels: Sequence[str],
    y_title: str,
    digits: int = 2,
    intervals: Sequence[Sequence[tuple[float, float]]] = (),
) -> PlotJson:
    """Bars side by side: one group of bars a label (of one line or two), one bar a series in it.

    `intervals` has the ends of an interval for each bar, series by series. With several series the
    first is the colour of "before", the second of "after".
    """
    data: list[PlotJson] = []
    for k, (name, values) in enumerate(groups):
        bar: PlotJson = {
            "type": "bar",
            "name": escape(name),
            "x": [escape(label).replace("\n", "<br>") for label in labels],
            "y": [float(v) for v in values],
            "marker": {"color": BEFORE_AFTER[k % len(BEFORE_AFTER)]},
            "text": [f"{v:.{digits}f}" for v in values],
            "textposition": "inside",
            "insidetextanchor": "start",
            "textfont": {"color": "white", "size": 16},
            "textangle": 0,
        }
        if intervals:
            ends = np.asarray(intervals[k], dtype=np.float64)
            bar["error_y"] = {
                "type": "data",
                "symmetric": False,
                "array": (ends[:, 1] - values).tolist(),
                "arrayminus": (values - ends[:, 0]).tolist(),
                "thickness": 2,
                "color": "#8a8a8a",
                "width": 6,
            }
        else:
            bar |= {"textposition": "outside", "textfont": {"color": INK, "size": 16}}
        data.append(bar)
    layout = _layout("", y_title, 420)
    layout["barmode"] = "group"
    layout["showlegend"] = len(groups) > 1
    layout["xaxis"] = {**AXIS, "type": "category", "showgrid": False}
    return {"data": data, "layout": layout}


def binned(x: Floats, y: Floats, bins: int = 20) -> tuple[Floats, Floats]:
    """Centres and means of y in bins of x of equal count, (B,) each."""
    edges = np.quantile(x, np.linspace(0.0, 1.0, bins + 1))
    which = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, bins - 1)
    count = np.bincount(which, minlength=bins)
    full = count > 0
    with np.errstate(invalid="ignore"):
        centre = np.bincount(which, x, minlength=bins) / count
        mean = np.bincount(which, y, minlength=bins) / count
    return centre[full], mean[full]


def _layout(x_title: str, y_title: str, height: int) -> PlotJson:
    def titled(text: str) -> PlotJson:
        return {**AXIS, "title": {"text": escape(text), "standoff": 8}}

    return {
        **LAYOUT,
        "height": height,
        "margin": {"l": 80, "r": 20, "t": 30, "b": 64},
        "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
        "xaxis": titled(x_title),
        "yaxis": titled(y_title),
    }
