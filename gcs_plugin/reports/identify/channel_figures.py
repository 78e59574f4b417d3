"""Figures of the residual along the channels: which mode goes with which, and how.

Orange is before, blue is after, on one scale for all channels of a mode.
"""

from __future__ import annotations

from html import escape

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.reports.identify.identify_sentences import channel_name, channel_title
from thrustmargin.gcs_plugin.reports.identify.residual_rows import Rows
from thrustmargin.gcs_plugin.reports.shared.plot_style import (
    AFTER,
    AXIS,
    BEFORE,
    INK,
    LAYOUT,
    LEGEND,
    PlotJson,
    filled,
    heading,
    packed,
)
from thrustmargin.models.flight import Floats

COLOURS = {"before": BEFORE, "after": AFTER}
BANDS = {"before": "rgba(213, 94, 0, 0.20)", "after": "rgba(0, 66, 157, 0.22)"}
BINS, FEWEST_IN_BIN = 24, 8
#: Part of the rows, at each end of a channel, that the bins leave out.
TAIL = 0.002
ACROSS = 5  # panels in a line of channel plots
PANEL_PX, UNDER_PX = 180, 66  # of a panel, and of its axis below


def channels_figure(rows: Rows, mode: int) -> PlotJson:
    """One mode against every channel: medians of bins, with the middle 80 % as a band."""
    lines = -(-len(rows.channels) // ACROSS)
    width, height = 1.0 / ACROSS, 1.0 / max(lines, 1)
    data: list[PlotJson] = []
    axes: PlotJson = {}
    reach = 0.0
    for k, (name, channel) in enumerate(rows.channels.items()):
        axis = "" if k == 0 else str(k + 1)
        for which, table in (("before", rows.before_modes), ("after", rows.after_modes)):
            traces, high = _binned(channel, table[:, mode], which, axis, legend=k == 0)
            data += traces
            reach = max(reach, high)
        row, column = divmod(k, ACROSS)
        top = 1.0 - row * height
        axes[f"xaxis{axis}"] = {
            **AXIS,
            "domain": [column * width + 0.012, (column + 1) * width - 0.012],
            "anchor": f"y{axis}",
            "title": {"text": escape(channel_title(name)), "font": {"size": 14}, "standoff": 4},
            "tickfont": {"size": 13},
            "nticks": 5,
            "tickangle": 0,
        }
        axes[f"yaxis{axis}"] = {
            **AXIS,
            "domain": [top - height * PANEL_PX / (PANEL_PX + UNDER_PX), top],
            "anchor": f"x{axis}",
            "showticklabels": column == 0,
            "zeroline": True,
            "zerolinecolor": INK,
            "tickfont": {"size": 13},
            "title": {"text": "rpm" if column == 0 else "", "font": {"size": 14}},
        }
    for name, axis in axes.items():
        if name.startswith("yaxis"):
            axis["range"] = [-1.06 * reach, 1.06 * reach]
    layout = {
        **LAYOUT,
        "height": lines * (PANEL_PX + UNDER_PX) + 40,
        "margin": {"l": 70, "r": 10, "t": 40, "b": 0},
        "legend": LEGEND,
    }
    return {"data": data, "layout": {**layout, **axes}}


def _binned(
    channel: Floats, values: Floats, which: str, axis: str, *, legend: bool
) -> tuple[list[PlotJson], float]:
    """Band and median of one mode in bins of a channel, and how far they reach."""
    index, low, width = _bins(channel)
    inside = (channel >= low) & (channel <= low + BINS * width)
    centre, ends = [], []
    for b in range(BINS):
        own = values[inside & (index == b)]
        if own.size >= FEWEST_IN_BIN:
            centre.append(low + (b + 0.5) * width)
            ends.append(np.quantile(own, [0.1, 0.5, 0.9]))
    if not centre:
        return [], 0.0
    x, y = np.array(centre), np.array(ends)
    common = {"xaxis": f"x{axis}", "yaxis": f"y{axis}", "legendgroup": which}
    band = {**filled(x, y[:, 0], y[:, 2], color=BANDS[which]), **common}
    median = {
        "type": "scatter",
        "mode": "lines+markers",
        "x": packed(x),
        "y": packed(y[:, 1]),
        "line": {"color": COLOURS[which], "width": 2.5},
        "marker": {"size": 5},
        "name": which,
        "showlegend": legend,
        "hovertemplate": "%{x:.3g}: %{y:.1f} rpm<extra>" + which + "</extra>",
        **common,
    }
    return [band, median], float(np.max(np.abs(y)))


def _bins(channel: Floats) -> tuple[NDArray[np.intp], float, float]:
    """Bin of each row in BINS of equal width but for the TAIL, their low end and their width."""
    low, high = np.quantile(channel, [TAIL, 1.0 - TAIL])
    width = max(float(high - low), 1e-12) / BINS
    index = np.clip(((channel - low) / width).astype(np.intp), 0, BINS - 1)
    return index, float(low), width


def shares(rows: Rows, modes: Floats) -> Floats:
    """(modes, 1 + channels) share of the mean square before, in all modes together.

    First what is constant, then what goes with each channel about that: by the means of bins of
    equal width, so that a straight and a bent line show alike.
    """
    total = float(np.sum(rows.before_modes**2))
    mean = modes.mean(axis=0)
    about = modes - mean
    columns = [mean**2 * modes.shape[0] / total]
    for channel in rows.channels.values():
        index, _, _ = _bins(channel)
        count = np.maximum(np.bincount(index, minlength=BINS), 1)
        sums = [np.bincount(index, about[:, m], minlength=BINS) for m in range(modes.shape[1])]
        columns.append(np.array([np.sum(own**2 / count) for own in sums]) / total)
    return np.stack(columns, axis=1)


def shares_figure(rows: Rows) -> PlotJson:
    """Which mode goes with which channel, before and after, as shares of the square before."""
    tables = [shares(rows, rows.before_modes), shares(rows, rows.after_modes)]
    labels = ["constant", *(escape(channel_name(name).split(" (")[0]) for name in rows.channels)]
    data: list[PlotJson] = [
        {
            "type": "heatmap",
            "x": labels,
            "y": list(rows.mode_names),
            "z": (100.0 * table).tolist(),
            "zmin": 0.0,
            "zmax": float(max(1.0, 100.0 * tables[0].max())),
            "colorscale": [[0.0, "#ffffff"], [0.5, "#ec9623"], [1.0, "#700004"]],
            "texttemplate": "%{z:.1f}",
            "hovertemplate": "%{y} with %{x}: %{z:.2f} %<extra></extra>",
            "xaxis": f"x{axis}",
            "yaxis": f"y{axis}",
            "showscale": False,
            "xgap": 2,
            "ygap": 2,
        }
        for table, axis in zip(tables, ("", "2"), strict=True)
    ]
    height = 34 * len(rows.mode_names) + 190
    side = {**AXIS, "gridcolor": "white", "tickangle": 40, "tickfont": {"size": 13}}
    up = {**AXIS, "gridcolor": "white", "autorange": "reversed", "tickfont": {"size": 14}}
    layout = {
        **LAYOUT,
        "height": height,
        "margin": {"l": 90, "r": 60, "t": 40, "b": 130},
        "xaxis": {**side, "domain": [0.0, 0.485]},
        "xaxis2": {**side, "domain": [0.515, 1.0], "anchor": "y2"},
        "yaxis": up,
        "yaxis2": {**up, "anchor": "x2", "showticklabels": False},
        "annotations": [
            heading(text, x=x) for text, x in (("before, %", 0.0), ("after, % of the same", 0.515))
        ],
    }
    return {"data": data, "layout": layout}
