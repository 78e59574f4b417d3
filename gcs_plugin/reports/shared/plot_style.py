"""Plotly figures as JSON values: colours, axes, lines, and panels stacked over one time axis.

Black on white, thick lines, large type: they are looked at in the field. Blue is measured, dashed
orange predicted, red the limit; a print in black and white still shows which is which.
Arrays go into the page as base64 of single precision, which plotly.js reads as they are.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.reports.shared.thinning import keep_extremes
from thrustmargin.models.flight import Floats

PlotJson = dict[str, Any]

INK = "#000000"
GRID = "#d0d0d0"
MEASURED = "#00429d"
PREDICTED = "#d55e00"
MEAN = "#6f6f6f"
BEFORE, AFTER = PREDICTED, MEASURED
OVER = "#b00000"
SPRAYING = "#0077bb"
OVER_FILL = "rgba(176, 0, 0, 0.30)"
BAND = "rgba(213, 94, 0, 0.22)"
FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', Arial, sans-serif"

AXIS: PlotJson = {
    "gridcolor": GRID,
    "linecolor": INK,
    "linewidth": 2,
    "zeroline": False,
    "ticks": "outside",
    "tickfont": {"size": 15},
}
LAYOUT: PlotJson = {
    "paper_bgcolor": "white",
    "plot_bgcolor": "white",
    "font": {"family": FONT, "size": 16, "color": INK},
    "hovermode": "closest",
}

LEGEND: PlotJson = {
    "orientation": "h",
    "x": 0,
    "yref": "container",
    "y": 1.0,
    "yanchor": "top",
}

#: A line keeps at most four points for each of these; a screen has about 1500 columns.
LINE_BUCKETS = 400
#: Height of the gap between two panels, px; more when the lower one has a title.
GAP_PX, TITLED_GAP_PX = 26, 34
ROTOR_PX = 96  # height of the strip of one rotor
MARGIN: PlotJson = {"l": 80, "r": 84, "t": 60, "b": 50}


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
    """One strip of a figure over time: its traces, lines and vertical axis."""

    traces: Sequence[PlotJson | None]  # None: nothing to draw
    height_px: int
    unit: str  # title of the vertical axis
    low: float
    high: float
    suffix: str = ""  # after each number of the axis
    lines: Sequence[tuple[float, str]] = ()  # level, text: drawn across in red
    notes: Sequence[PlotJson] = ()  # plotly annotations, without their yref
    title: str = ""


def rotor_panels(
    names: Sequence[str],
    traces: Callable[[int, bool], Sequence[PlotJson | None]],
    *,
    unit: str,
    low: float,
    high: float,
    suffix: str = "",
    lines: Sequence[tuple[float, str]] = (),
) -> list[Panel]:
    """A strip a rotor; `traces(rotor, legend)` makes those of a 0-based rotor."""
    return [
        Panel(
            traces=traces(k, k == 0),
            height_px=ROTOR_PX,
            unit=unit,
            suffix=suffix,
            low=low,
            high=high,
            lines=lines,
            title=f"rotor {k + 1}, {name}",
        )
        for k, name in enumerate(names)
    ]


def packed(values: Floats) -> PlotJson:
    """Numbers as plotly.js reads them from base64; NaN stays NaN, which breaks a line."""
    array = np.ascontiguousarray(values, dtype="<f4")
    return {"dtype": "f4", "bdata": base64.b64encode(array.tobytes()).decode("ascii")}


def milliseconds(time_s: Floats) -> Floats:
    """Log time as what plotly's date axis shows as minutes and seconds."""
    return np.round(np.asarray(time_s) * 1000.0)


def line(
    time_s: Floats,
    values: Floats,
    *,
    color: str,
    name: str,
    width: float = 2.5,
    dash: str = "solid",
    legend: bool = True,
) -> PlotJson | None:
    """A line of (T,) `values`, thinned with its extremes kept; None when it has no number."""
    if not np.any(np.isfinite(values)):
        return None
    kept = keep_extremes(values, LINE_BUCKETS)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": packed(milliseconds(time_s[kept])),
        "y": packed(values[kept]),
        "line": {"color": color, "width": width, "dash": dash},
        "name": escape(name),
        "legendgroup": escape(name),
        "showlegend": legend,
        "hovertemplate": "%{x|%M:%S}  %{y:.1f}<extra>" + escape(name) + "</extra>",
    }


def band(
    time_s: Floats,
    lower: Floats,
    upper: Floats,
    *,
    color: str,
    name: str = "",
    legend: bool = False,
) -> PlotJson | None:
    """The area between two (T,) arrays, filled; None when nowhere both are known."""
    known = np.flatnonzero(np.isfinite(lower) & np.isfinite(upper))
    if not known.size:
        return None
    low, high = lower[known], upper[known]
    kept = np.union1d(keep_extremes(low, LINE_BUCKETS), keep_extremes(high, LINE_BUCKETS))
    x = milliseconds(time_s[known[kept]])
    return {
        **filled(x, low[kept], high[kept], color=color),
        "name": escape(name),
        "legendgroup": escape(name),
        "showlegend": legend,
    }


def filled(x: Floats, lower: Floats, upper: Floats, *, color: str) -> PlotJson:
    """The area between two known (N,) arrays over `x` (N,)."""
    return {
        "type": "scatter",
        "mode": "none",
        "x": packed(np.concatenate([x, x[::-1]])),
        "y": packed(np.concatenate([upper, lower[::-1]])),
        "fill": "toself",
        "fillcolor": color,
        "hoverinfo": "skip",
        "showlegend": False,
    }


def over_time(panels: Sequence[Panel], *, end_s: float) -> PlotJson:
    """Panels from top to bottom over one axis of log time; from an hour on it shows hours."""
    gaps = [0, *(TITLED_GAP_PX if p.title else GAP_PX for p in panels[1:])]
    whole = sum(p.height_px for p in panels) + sum(gaps)
    data, shapes, notes = [], [], []
    layout: PlotJson = {
        **LAYOUT,
        "height": whole + MARGIN["t"] + MARGIN["b"],
        "margin": MARGIN,
        "legend": LEGEND,
        "xaxis": {
            **AXIS,
            "type": "date",
            "tickformat": "%H:%M:%S" if end_s >= 3600.0 else "%M:%S",
            "anchor": _axis(len(panels) - 1),
        },
    }
    top = 1.0
    for k, (panel, gap) in enumerate(zip(panels, gaps, strict=True)):
        axis = _axis(k)
        top -= gap / whole
        bottom = max(0.0, top - panel.height_px / whole)
        layout[axis.replace("y", "yaxis")] = {
            **AXIS,
            "domain": [bottom, top],
            "range": [panel.low, panel.high],
            "title": {"text": escape(panel.unit), "font": {"size": 16}},
            "ticksuffix": panel.suffix,
            "nticks": max(5, panel.height_px // 38),
        }
        data += [{**t, "xaxis": "x", "yaxis": axis} for t in panel.traces if t is not None]
        notes += [{**note, "yref": axis} for note in panel.notes]
        for level, text in panel.lines:
            shapes.append(_across(axis, level))
            notes.append(_beside(axis, level, text))
        if panel.title:
            notes.append(heading(panel.title, x=1, y=top, xanchor="right"))
        top = bottom
    return {"data": data, "layout": {**layout, "shapes": shapes, "annotations": notes}}


def _axis(number: int) -> str:
    return "y" if number == 0 else f"y{number + 1}"


def _across(axis: str, level: float) -> PlotJson:
    return {
        "type": "line",
        "xref": "paper",
        "x0": 0,
        "x1": 1,
        "yref": axis,
        "y0": level,
        "y1": level,
        "line": {"color": OVER, "width": 3},
    }


def _beside(axis: str, level: float, text: str) -> PlotJson:
    return {
        "text": f"<b>{escape(text)}</b>".replace("\n", "<br>"),
        "xref": "paper",
        "x": 1,
        "xanchor": "left",
        "yref": axis,
        "y": level,
        "showarrow": False,
        "font": {"color": OVER, "size": 16},
    }


def heading(text: str, *, x: float, y: float = 1.0, xanchor: str = "left") -> PlotJson:
    """A title inside a figure, above the place (x, y) of its paper, each 0..1."""
    return {
        "text": f"<b>{escape(text)}</b>",
        "xref": "paper",
        "x": x,
        "xanchor": xanchor,
        "yref": "paper",
        "y": y,
        "yanchor": "bottom",
        "showarrow": False,
        "font": {"size": 16},
    }
