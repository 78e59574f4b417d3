"""Figures of the residual along the channels: which mode goes with which, and how.

Orange is before, blue is after, on one scale for all channels of a mode.
"""

from __future__ import annotations

from html import escape

import numpy as np
from numpy.typing import NDArray
from plotly.graph_objects import Figure, Scatter
from plotly.subplots import make_subplots

from thrustmargin.gcs_plugin.reports.identify.identify_sentences import channel_name, channel_title
from thrustmargin.gcs_plugin.reports.identify.residual_rows import Rows
from thrustmargin.gcs_plugin.reports.shared.plot_style import AFTER, BEFORE, STYLE, filled, single
from thrustmargin.models.flight import Floats

COLOURS = {"before": BEFORE, "after": AFTER}
BANDS = {"before": "rgba(213, 94, 0, 0.20)", "after": "rgba(0, 66, 157, 0.22)"}
BINS, FEWEST_IN_BIN = 24, 8
#: Part of the rows, at each end of a channel, that the bins leave out.
TAIL = 0.002
ACROSS = 5  # panels in a line of channel plots
PANEL_PX, UNDER_PX = 180, 66  # of a panel, and of its axis below


def channels_figure(rows: Rows, mode: int) -> Figure:
    """One mode against every channel: medians of bins, with the middle 80 % as a band."""
    lines = -(-len(rows.channels) // ACROSS)
    height = lines * (PANEL_PX + UNDER_PX) - UNDER_PX
    made = make_subplots(
        rows=lines,
        cols=ACROSS,
        shared_yaxes="all",
        horizontal_spacing=0.024,
        vertical_spacing=UNDER_PX / height if lines > 1 else 0.0,
    )
    reach = 0.0
    for k, (name, channel) in enumerate(rows.channels.items()):
        row, column = k // ACROSS + 1, k % ACROSS + 1
        for which, table in (("before", rows.before_modes), ("after", rows.after_modes)):
            traces, high = _binned(channel, table[:, mode], which, legend=k == 0)
            made.add_traces(traces, rows=row, cols=column)
            reach = max(reach, high)
        title = {"text": escape(channel_title(name)), "font": {"size": 14}, "standoff": 4}
        made.update_xaxes(title=title, nticks=5, tickangle=0, row=row, col=column)
    made.update_yaxes(range=[-1.06 * reach, 1.06 * reach], zeroline=True)
    made.update_yaxes(title={"text": "rpm", "font": {"size": 14}}, col=1)
    made.for_each_xaxis(lambda axis: axis.update(visible=axis.title.text is not None))
    margin = {"l": 70, "r": 10, "t": 40, "b": UNDER_PX}
    made.update_layout(template=STYLE, height=height + 40 + UNDER_PX, margin=margin)
    return made.update_xaxes(tickfont_size=13).update_yaxes(tickfont_size=13)


def _binned(
    channel: Floats, values: Floats, which: str, *, legend: bool
) -> tuple[list[Scatter], float]:
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
    band = filled(x, y[:, 0], y[:, 2], color=BANDS[which], legendgroup=which)
    median = Scatter(
        mode="lines+markers",
        x=single(x),
        y=single(y[:, 1]),
        line={"color": COLOURS[which], "width": 2.5},
        marker={"size": 5},
        name=which,
        legendgroup=which,
        showlegend=legend,
        hovertemplate="%{x:.3g}: %{y:.1f} rpm<extra>" + which + "</extra>",
    )
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


def shares_figure(rows: Rows) -> Figure:
    """Which mode goes with which channel, before and after, as shares of the square before."""
    tables = [shares(rows, rows.before_modes), shares(rows, rows.after_modes)]
    made = make_subplots(
        cols=2,
        shared_yaxes=True,
        horizontal_spacing=0.03,
        subplot_titles=("<b>before, %</b>", "<b>after, % of the same</b>"),
    )
    labels = ["constant", *(escape(channel_name(name).split(" (")[0]) for name in rows.channels)]
    for column, table in enumerate(tables, 1):
        made.add_heatmap(
            x=labels,
            y=rows.mode_names,
            z=(100.0 * table).tolist(),
            zmin=0.0,
            zmax=float(max(1.0, 100.0 * tables[0].max())),
            colorscale=[[0.0, "#ffffff"], [0.5, "#ec9623"], [1.0, "#700004"]],
            texttemplate="%{z:.1f}",
            hovertemplate="%{y} with %{x}: %{z:.2f} %<extra></extra>",
            showscale=False,
            xgap=2,
            ygap=2,
            row=1,
            col=column,
        )
    made.update_xaxes(gridcolor="white", tickangle=40, tickfont_size=13)
    made.update_yaxes(gridcolor="white", autorange="reversed", tickfont_size=14)
    height = 34 * len(rows.mode_names) + 190
    margin = {"l": 90, "r": 60, "t": 40, "b": 130}
    return made.update_layout(template=STYLE, height=height, margin=margin)
