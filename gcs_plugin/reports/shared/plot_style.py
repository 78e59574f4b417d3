"""Figures in one style: colours, lines, and panels stacked over one time axis.

A figure is plain tables as plotly.js reads them (plotly.com/javascript/reference), which
`drawn_figure` draws on paper. Black on white, thick lines, large type: they are looked at in the
field. Blue is measured, dashed orange predicted, red the limit; a print in black and white still
shows which is which.
Arrays of single precision go into the page as base64, which plotly.js reads as they are.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.wording.alarm_words import place_words
from thrustmargin.gcs_plugin.wording.language import say
from thrustmargin.gcs_plugin.wording.report_words import TANK_SPRAYING
from thrustmargin.gcs_plugin.wording.thrust_left import percent_down
from thrustmargin.models.flight import Floats
from thrustmargin.models.json_values import to_json_values

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

_AXIS = {
    "gridcolor": GRID,
    "showgrid": True,
    "showline": True,
    "linecolor": INK,
    "linewidth": 2,
    "zeroline": False,
    "zerolinecolor": INK,
    "ticks": "outside",
    "tickfont": {"size": 15},
    "title": {"font": {"size": 16}},
}
STYLE = {
    "layout": {
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
        "font": {"family": FONT, "size": 16, "color": INK},
        "hovermode": "closest",
        "legend": {"orientation": "h", "x": 0, "yref": "container", "y": 1.0, "yanchor": "top"},
        "xaxis": _AXIS,
        "yaxis": _AXIS,
    }
}

#: A line keeps at most four points for each of these; a screen has about 1500 columns.
LINE_BUCKETS = 400
GAP_PX = 34  # height of the gap between two panels, which holds the title of the lower one
ROTOR_PX = 96  # height of the strip of one rotor

Trace = dict[str, Any]


@dataclass(slots=True)
class Figure:
    """Traces and their layout; built step by step, and unchanged once displayed."""

    layout: dict[str, Any]
    data: list[Trace] = field(default_factory=list)

    def add(self, traces: Iterable[Trace | None], axes: str = "") -> None:
        """Add traces to the axes of number `axes` ("" for the first), skipping None."""
        on = {"xaxis": f"x{axes}", "yaxis": f"y{axes}"} if axes else {}
        self.data += [trace | on for trace in traces if trace is not None]

    def note(self, text: str, **properties: Any) -> None:
        """Add an annotation; it has an arrow only if the properties ask for one."""
        one = {"text": text, "showarrow": False, **properties}
        self.layout.setdefault("annotations", []).append(one)

    def to_json(self) -> str:
        """Return the JSON that plotly.js draws, with arrays as base64, which it can read."""
        made = to_json_values({"data": self.data, "layout": self.layout})
        return json.dumps(made, default=_packed, ensure_ascii=False, allow_nan=False)


def scatter(x: Any, y: Any, **properties: Any) -> Trace:
    """Return a trace of lines, marks or an area through x and y (N,)."""
    return {"type": "scatter", "mode": "lines", "x": x, "y": y, **properties}


def titled(text: str, **properties: Any) -> dict[str, Any]:
    """Return the properties of a plotly axis with this title."""
    return {"title": {"text": say(text)}, **properties}


def _packed(array: np.ndarray) -> dict[str, str]:
    data = base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()
    return {"dtype": array.dtype.str[1:], "bdata": data}


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
    """A panel of a figure over time: its traces, vertical axis and limit."""

    traces: Sequence[Trace | None]  # None: nothing to draw
    axis: dict[str, Any]  # plotly's properties of the vertical axis
    height_px: int = ROTOR_PX
    limit: tuple[float, str] | None = None  # level, text: drawn across in red
    title: str = ""


def rotor_panels(
    names: Sequence[str], traces: Callable[[int, bool], Sequence[Trace | None]], **panel: Any
) -> list[Panel]:
    """Return a panel for each rotor, titled with its number and its place in `names`.

    `traces(rotor, legend)` returns the lines of a rotor, counted from 0; `legend` is True for the
    first rotor only. `panel` are properties that all panels share.
    """
    titles = [f"{say('rotor')} {k + 1}, {place_words(name)}" for k, name in enumerate(names)]
    return [
        Panel(traces=traces(k, k == 0), title=title.removesuffix(", "), **panel)
        for k, title in enumerate(titles)
    ]


def single(values: Floats) -> NDArray[np.float32]:
    """Round numbers to one part in 16 000, so that they compress to half the size in the page.

    That is finer than a pixel. The result is in single precision with the last ten bits zero; NaN,
    which breaks a line, stays NaN.
    """
    exact = np.array(values, dtype=np.float32)
    bits = exact.view(np.uint32)
    return np.where(np.isnan(exact), exact, ((bits + 0x200) & 0xFFFFFC00).view(np.float32))


def milliseconds(time_s: Floats) -> NDArray[np.float32]:
    """Convert log time, s, to ms, which plotly's date axis displays as minutes and seconds.

    Half a millisecond is added, because that axis reads a whole number of four digits as a year.
    """
    return np.asarray(np.round(np.asarray(time_s) * 1000.0) + 0.5, dtype=np.float32)


def keep_extremes(values: Floats, buckets: int) -> NDArray[np.intp]:
    """Return the indices of the rows of `values` (T,) to draw, so that peaks and gaps survive
    thinning.

    The rows are divided into `buckets` equal runs, of which the first, least, greatest and last row
    and one with NaN, if any, are kept. Return all indices if T is at most 4 * `buckets`.
    """
    rows = values.size
    if rows <= 4 * buckets:
        return np.arange(rows)
    edges = np.linspace(0, rows, buckets + 1).astype(np.intp)
    starts = edges[:-1]
    which = np.repeat(np.arange(buckets), np.diff(edges))
    known = np.isfinite(values)
    # Sorting by bucket and then by value puts each bucket's extremes at its ends.
    low = np.lexsort((np.where(known, values, np.inf), which))[starts]
    high = np.lexsort((np.where(known, -values, np.inf), which))[starts]
    gap = np.flatnonzero(~known)
    gap = gap[np.diff(which[gap], prepend=-1) > 0]
    return np.unique(np.concatenate([starts, low, high, gap, edges[1:] - 1]))


def keep_worst(score: Floats, buckets: int) -> NDArray[np.intp]:
    """Return the index of the largest `score` (T,) in each of `buckets` runs of nearly equal
    length.

    A run that is NaN throughout has none.
    """
    rows = score.size
    edges = np.linspace(0, rows, min(buckets, rows) + 1).astype(np.intp)
    which = np.repeat(np.arange(edges.size - 1), np.diff(edges))
    first = np.lexsort((np.where(np.isfinite(score), -score, np.inf), which))[edges[:-1]]
    return first[np.isfinite(score[first])]


def line(
    time_s: Floats,
    values: Floats,
    *,
    color: str,
    name: str,
    width: float = 2.5,
    dash: str = "solid",
    legend: bool = True,
) -> Trace | None:
    """Return a plotly line of `values` (T,) over `time_s` (T,), s, thinned with its extremes kept.

    `name` is translated and labels the line; `legend`: list it in the legend. None without a finite
    value.
    """
    name = say(name)
    if not np.any(np.isfinite(values)):
        return None
    kept = keep_extremes(values, LINE_BUCKETS)
    return scatter(
        milliseconds(time_s[kept]),
        single(values[kept]),
        line={"color": color, "width": width, "dash": dash},
        name=escape(name),
        legendgroup=escape(name),
        showlegend=legend,
        hovertemplate="%{x|%M:%S}  %{y:.1f}<extra>" + escape(name) + "</extra>",
    )


def band(
    time_s: Floats,
    lower: Floats,
    upper: Floats,
    *,
    color: str,
    name: str = "",
    legend: bool = False,
) -> Trace | None:
    """Return the filled area between `lower` and `upper` (T,) over `time_s` (T,), s, thinned.

    Extremes are kept. Rows where either is NaN are left out, so the area bridges them; None if no
    row has both. `legend`: list `name` in the legend.
    """
    known = np.flatnonzero(np.isfinite(lower) & np.isfinite(upper))
    if not known.size:
        return None
    low, high = lower[known], upper[known]
    kept = np.union1d(keep_extremes(low, LINE_BUCKETS), keep_extremes(high, LINE_BUCKETS))
    x = milliseconds(time_s[known[kept]])
    name = say(name) if name else ""
    shown = {"name": escape(name), "legendgroup": escape(name), "showlegend": legend}
    return filled(x, low[kept], high[kept], color=color, **shown)


def filled(x: NDArray[Any], lower: Floats, upper: Floats, *, color: str, **shown: Any) -> Trace:
    """Return the filled area between `lower` and `upper` (N,), both finite, over `x` (N,).

    `x` is used without rounding. `shown` are further properties of plotly's trace.
    """
    return scatter(
        np.concatenate([x, x[::-1]]),
        single(np.concatenate([upper, lower[::-1]])),
        **{"mode": "none", "fill": "toself", "fillcolor": color, "hoverinfo": "skip"},
        **{"showlegend": False, **shown},
    )


def below_limit(time_s: Floats, left: Floats, least: float) -> Trace | None:
    """Return the filled band between `left` (T,), % of thrust left, and the limit, where it is
    below.

    `least` is the limit, a share. None if `left` is NaN throughout.
    """
    return band(
        time_s, np.fmin(left, 100 * least), np.full(left.size, 100 * least), color=OVER_FILL
    )


def limit_across(least: float) -> tuple[float, str]:
    """Return the share of thrust that must be left, in %, and its label, as `Panel` draws them."""
    words = say("{value} limit", value=f"{percent_down(least)} %")
    return least * 100, "\n".join(words.rsplit(" ", 1))


def left_axis(title: str, left: Floats, least: float) -> dict[str, Any]:
    """Return the properties of a vertical axis of thrust left, %.

    It reaches from 0, or from negative values of `left`, to above the limit and all of `left`.
    """
    low, high = float(np.nanmin(left, initial=0.0)), float(np.nanmax(left, initial=130.0 * least))
    return titled(title, ticksuffix=" %", range=[1.08 * low, min(1.08 * high, 100.0)])


def in_tank(time_s: Floats, tank_kg: Floats, spraying: Floats, name: str) -> list[Trace | None]:
    """Return the lines of the tank level, kg, over time, s: one of all rows, one of rows while
    spraying.
    """
    sprayed = np.where(spraying > 0.5, tank_kg, np.nan)
    return [
        line(time_s, tank_kg, color=INK, name=name, width=2),
        line(time_s, sprayed, color=SPRAYING, name=TANK_SPRAYING, width=5),
    ]


def over_time(panels: Sequence[Panel], *, end_s: float) -> Figure:
    """Draw panels from top to bottom over one time axis, minutes and seconds since the log's start.

    If `end_s`, the last time, s, is an hour or more, the axis shows hours too. A panel's limit is a
    line across it, with its text at the right.
    """
    whole = sum(panel.height_px for panel in panels) + GAP_PX * (len(panels) - 1)
    # Above a title of the first panel there is room for two lines of legend, as on a phone.
    margin = {"l": 80, "r": 84, "t": 92 if panels[0].title else 60, "b": 50}
    height = whole + margin["t"] + margin["b"]
    made = Figure({"template": STYLE, "margin": margin, "height": height, "shapes": []})
    shown = {"type": "date", "tickformat": "%H:%M:%S" if end_s >= 3600.0 else "%M:%S"}
    last, top = str(len(panels)) if len(panels) > 1 else "", 1.0
    for number, panel in enumerate(panels, 1):
        this = "" if number == 1 else str(number)
        low = max(top - panel.height_px / whole, 0.0)
        ticks = {"nticks": max(5, panel.height_px // 38)}
        place = {"anchor": f"x{this}", "domain": [low, top]}
        made.layout[f"yaxis{this}"] = {**ticks, **place, **panel.axis}
        alike = {} if this == last else {"matches": f"x{last}", "showticklabels": False}
        made.layout[f"xaxis{this}"] = {"anchor": f"y{this}", **shown, **alike}
        made.add(panel.traces, this)
        if panel.title:
            corner = {"x": 1, "y": top, "xanchor": "right", "yanchor": "bottom"}
            paper = {"xref": "paper", "yref": "paper"}
            made.note(f"<b>{escape(panel.title)}</b>", **corner, **paper)
        if panel.limit is not None:
            level, text = panel.limit
            across = {"xref": f"x{this} domain", "yref": f"y{this}"}
            line = {"type": "line", "x0": 0, "x1": 1, "y0": level, "y1": level}
            look = {"color": OVER, "width": 3}
            made.layout["shapes"].append({**line, **across, "line": look})
            placed = {"x": 1, "y": level, "xanchor": "left", "yanchor": "middle", **across}
            words = f"<b>{escape(text)}</b>".replace("\n", "<br>")
            made.note(words, font={"color": OVER}, **placed)
        top = low - GAP_PX / whole
    return made
