"""The maps of the margin report: thrust in use, and what one lost rotor would leave."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from thrustmargin.gcs_plugin.reports.margin.data import Moment
from thrustmargin.gcs_plugin.reports.shared.plot_style import INK, PlotJson
from thrustmargin.gcs_plugin.reports.shared.route_map import moved, route_map
from thrustmargin.gcs_plugin.wording.palette import LOAD, REDUNDANCY, ColourScale
from thrustmargin.models.flight import Floats

Rows = Mapping[str, Floats]


def use_map(rows: Rows, use: Floats, limit: float, worst: Moment | None) -> PlotJson:
    """The route coloured by `use` (T,) of the worst rotor; the worst moment is ringed."""
    figure = _map(rows, use, use, moved(LOAD, limit))
    if worst is not None and np.isfinite(worst.north) and np.isfinite(worst.east):
        figure["data"].append(_ring(worst))
    return figure


def redundancy_map(rows: Rows) -> PlotJson:
    """The map of redundancy, with buttons for yaw uncontrolled and controlled."""
    free, kept = (
        _map(rows, values, -values, REDUNDANCY)
        for values in (rows["redundancy_yaw_free"], rows["redundancy_yaw_kept"])
    )
    if not np.any(np.isfinite(rows["redundancy_yaw_kept"])):
        return free
    buttons = [_button("yaw uncontrolled", free), _button("yaw controlled", kept)]
    layout = {
        **free["layout"],
        "updatemenus": [{**MENU, "buttons": buttons}],
        "height": 620,
        "margin": {**free["layout"]["margin"], "b": 120},
    }
    return {**free, "layout": layout}


def _map(rows: Rows, values: Floats, badness: Floats, scale: ColourScale) -> PlotJson:
    return route_map(
        (rows["north"], rows["east"]),
        rows["time_s"],
        values,
        badness,
        scale,
        form=".2f",
        height=560,
        margin={"l": 70, "r": 20, "t": 90, "b": 60},
    )


MENU: PlotJson = {
    "type": "buttons",
    "direction": "right",
    "x": 0.0,
    "xanchor": "left",
    "y": -0.16,
    "yanchor": "top",
    "showactive": True,
    "font": {"size": 16},
}


def _button(label: str, figure: PlotJson) -> PlotJson:
    trace = figure["data"][1]
    change = {key: [trace[key]] for key in ("x", "y", "customdata")}
    change["marker.color"] = [trace["marker"]["color"]]
    return {"label": label, "method": "restyle", "args": [change, [1]]}


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
