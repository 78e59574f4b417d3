"""The route from above, coloured with the view's own scales."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from html import escape

import numpy as np

from thrustmargin.gcs_plugin.reports.shared.plot_style import (
    AXIS,
    GRID,
    LAYOUT,
    PlotJson,
    milliseconds,
    packed,
)
from thrustmargin.gcs_plugin.reports.shared.thinning import keep_worst
from thrustmargin.gcs_plugin.wording.palette import ColourScale, css
from thrustmargin.models.flight import Floats

MAP_POINTS = 900


def route_map(
    place: tuple[Floats, Floats],
    time_s: Floats,
    values: Floats,
    badness: Floats,
    scale: ColourScale,
    *,
    form: str,
    height: int,
    margin: Mapping[str, int],
) -> PlotJson:
    """The route through `place` (north and east (T,), m), coloured by `values` (T,).

    Of each stretch the row of the most `badness` (T,) is drawn; `form` is that of the number shown
    under the mouse, `height` and `margin` are in pixels.
    """
    north, east = place
    placed = np.isfinite(north) & np.isfinite(east)
    kept = keep_worst(np.where(placed, badness, np.nan), MAP_POINTS)
    # Worst last, so that a later pass over the same place does not hide it.
    kept = kept[np.argsort(badness[kept], kind="stable")]
    number = "%{marker.color:" + form + "}" + scale.unit
    data: list[PlotJson] = [
        {
            "type": "scatter",
            "mode": "lines",
            "x": packed(east[placed]),
            "y": packed(north[placed]),
            "line": {"color": GRID, "width": 2},
            "hoverinfo": "skip",
            "showlegend": False,
        },
        {
            "type": "scatter",
            "mode": "markers",
            "x": packed(east[kept]),
            "y": packed(north[kept]),
            "marker": _marker(values[kept], scale),
            "customdata": packed(milliseconds(time_s[kept])),
            "hovertemplate": "%{customdata|%M:%S}  " + number + "<extra></extra>",
            "showlegend": False,
        },
    ]
    layout = {
        **LAYOUT,
        "height": height,
        "margin": dict(margin),
        "xaxis": {**AXIS, "title": {"text": "east, m", "font": {"size": 16}}},
        "yaxis": {**AXIS, "title": {"text": "north, m", "font": {"size": 16}}, "scaleanchor": "x"},
    }
    return {"data": data, "layout": layout}


def moved(scale: ColourScale, limit: float) -> ColourScale:
    """The scale of thrust in use with its jump at `limit` instead of 50 %."""
    if limit == 0.5:
        return scale

    def at(value: float) -> float:
        return value / 0.5 * limit if value <= 0.5 else 1.0 - (1.0 - value) / 0.5 * (1.0 - limit)

    return replace(
        scale,
        stops=tuple((at(value), colour) for value, colour in scale.stops),
        marks=((0.0, "0"), (limit, f"{limit * 100:.0f} % limit"), (1.0, "100 %")),
    )


def plotly_scale(scale: ColourScale) -> list[list[float | str]]:
    """The scale as plotly's pairs of 0..1 and colour; a jump is two pairs at one place."""
    span = scale.high - scale.low
    return [[(value - scale.low) / span, css(colour)] for value, colour in scale.stops]


def _marker(values: Floats, scale: ColourScale) -> PlotJson:
    return {
        "size": 9,
        "color": packed(values * scale.factor),
        "cmin": scale.low * scale.factor,
        "cmax": scale.high * scale.factor,
        "colorscale": plotly_scale(scale),
        "colorbar": {
            "orientation": "h",
            "thickness": 16,
            "y": 1.0,
            "yanchor": "bottom",
            "tickvals": [value * scale.factor for value, _ in scale.marks],
            "ticktext": [escape(text) for _, text in scale.marks],
            "tickfont": {"size": 15},
        },
    }
