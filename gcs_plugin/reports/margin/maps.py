"""The maps of the margin report: thrust in use, and what one lost rotor would leave."""

from __future__ import annotations

import numpy as np

from thrustmargin.gcs_plugin.reports.margin.data import Moment
from thrustmargin.gcs_plugin.reports.margin.series import Series
from thrustmargin.gcs_plugin.reports.shared.plot_style import INK, PlotJson
from thrustmargin.gcs_plugin.reports.shared.route_map import route_map
from thrustmargin.gcs_plugin.wording.palette import REDUNDANCY, ColourScale
from thrustmargin.models.flight import Floats


def map_figure(
    series: Series,
    values: Floats,
    scale: ColourScale,
    worst: Moment | None = None,
    *,
    low_is_bad: bool = False,
) -> PlotJson:
    """The route coloured by `values` (T,); of each stretch the worst row is drawn.

    `worst` is ringed. `low_is_bad` turns round what counts as worst.
    """
    figure = route_map(
        (series.north, series.east),
        series.time_s,
        values,
        -values if low_is_bad else values,
        scale,
        form=".2f",
        height=560,
        margin={"l": 70, "r": 20, "t": 90, "b": 60},
    )
    if worst is not None and np.isfinite(worst.north) and np.isfinite(worst.east):
        figure["data"].append(_ring(worst))
    return figure


def redundancy_map(series: Series) -> PlotJson:
    """The map of redundancy, with buttons for heading given up and kept."""
    figure = map_figure(series, series.redundancy_yaw_free, REDUNDANCY, low_is_bad=True)
    if not np.any(np.isfinite(series.redundancy_yaw_kept)):
        return figure
    kept = map_figure(series, series.redundancy_yaw_kept, REDUNDANCY, low_is_bad=True)

    def button(label: str, trace: PlotJson) -> PlotJson:
        change = {
            "x": [trace["x"]],
            "y": [trace["y"]],
            "marker.color": [trace["marker"]["color"]],
            "customdata": [trace["customdata"]],
        }
        return {"label": label, "method": "restyle", "args": [change, [1]]}

    menu = {
        "type": "buttons",
        "direction": "right",
        "x": 0.0,
        "xanchor": "left",
        "y": -0.16,
        "yanchor": "top",
        "showactive": True,
        "font": {"size": 16},
        "buttons": [
            button("heading given up", figure["data"][1]),
            button("heading kept", kept["data"][1]),
        ],
    }
    layout = {
        **figure["layout"],
        "updatemenus": [menu],
        "height": 620,
        "margin": {**figure["layout"]["margin"], "b": 120},
    }
    return {**figure, "layout": layout}


def _ring(worst: Moment) -> PlotJson:
    return {
        "type": "scatter",
        "mode": "markers+text",
        "x": [worst.east],
        "y": [worst.north],
        "marker": {"size": 22, "symbol": "circle-open", "color": INK, "line": {"width": 4}},
        "text": ["<b>worst</b>"],
        "textposition": "top center",
        "textfont": {"size": 17, "color": INK},
        "hoverinfo": "skip",
        "showlegend": False,
    }
