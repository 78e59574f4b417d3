"""Figures of the residual: over time, by mode, on the route, and what is unexplained.

Orange is before, blue is after, on every figure; before and after share their axes and colours.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
from plotly.graph_objects import Figure

from thrustmargin.gcs_plugin.reports.identify.identify_sentences import (
    channel_factor,
    channel_title,
)
from thrustmargin.gcs_plugin.reports.identify.residual_rows import Rows
from thrustmargin.gcs_plugin.reports.shared.plot_style import (
    AFTER,
    BEFORE,
    STYLE,
    line,
    over_time,
    rotor_panels,
    single,
)
from thrustmargin.gcs_plugin.reports.shared.route_map import route_map
from thrustmargin.gcs_plugin.wording.palette import residual_scale
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.unexplained import Curve

LONGEST_STEP_S = 1.0  # beyond which a line is broken


def time_figure(rows: Rows, flight: int) -> Figure:
    """Residual of each rotor of one flight over time, before and after."""
    mine = rows.of(flight)
    time_s, before, after = _broken(rows.time_s[mine], rows.before_rpm[mine], rows.after_rpm[mine])
    reach = float(np.nanmax(np.abs(rows.before_rpm[mine]))) * 1.08
    panels = rotor_panels(
        rows.rotor_names,
        lambda k, legend: [
            line(time_s, table[:, k], color=color, name=name, width=1.5, legend=legend)
            for name, color, table in (("before", BEFORE, before), ("after", AFTER, after))
        ],
        axis={"title_text": "rpm", "range": [-reach, reach]},
    )
    return over_time(panels, end_s=float(time_s[-1]))


def _broken(time_s: Floats, *tables: Floats) -> tuple[Floats, ...]:
    """With a row of NaN in each pause, so that no line is drawn across it."""
    gaps = np.flatnonzero(np.diff(time_s) > LONGEST_STEP_S) + 1
    middle = (time_s[gaps - 1] + time_s[gaps]) / 2 if gaps.size else np.empty(0)
    return (
        np.insert(time_s, gaps, middle),
        *(np.insert(t, gaps, np.nan, axis=0) for t in tables),
    )


def modes_figure(rows: Rows) -> Figure:
    """RMS of each mode before and after."""
    margin = {"l": 80, "r": 20, "t": 40, "b": 40}
    made = Figure(layout={"template": STYLE, "height": 340, "margin": margin})
    for which, table, colour in (
        ("before", rows.before_modes, BEFORE),
        ("after", rows.after_modes, AFTER),
    ):
        made.add_bar(
            name=which,
            x=rows.mode_names,
            y=np.sqrt(np.mean(table**2, axis=0)).tolist(),
            marker_color=colour,
            texttemplate="%{y:.0f}",
            textposition="outside",
            cliponaxis=False,
            hovertemplate="%{x}: %{y:.1f} rpm<extra>" + which + "</extra>",
        )
    return made.update_yaxes(title_text="RMS, rpm", rangemode="tozero")


def map_limit(rows: Rows) -> float:
    """rpm at which the colours of the maps end: all but 2 % of the rows before are within."""
    worst = np.abs(rows.before_rpm).max(axis=1)
    return float(max(1.0, np.quantile(worst, 0.98)))


def map_figure(rows: Rows, flight: int, residual_rpm: Floats, limit_rpm: float) -> Figure | None:
    """The route of a flight from above, coloured by the residual of the rotor that is furthest off.

    None when the log has no positions.
    """
    mine = rows.of(flight)
    north, east, time_s = rows.north[mine], rows.east[mine], rows.time_s[mine]
    if not np.any(np.isfinite(north) & np.isfinite(east)):
        return None
    own = residual_rpm[mine]
    worst = own[np.arange(own.shape[0]), np.argmax(np.abs(own), axis=1)]
    return route_map(
        (north, east),
        time_s,
        {"residual": (worst, np.abs(worst))},
        residual_scale(limit_rpm),
        form="+.0f",
        height=480,
        margin={"l": 70, "r": 50, "t": 80, "b": 60},
    )


def curve_figure(curve: Curve, mode: str) -> Figure:
    """The smooth curve of what no effect explains."""
    margin = {"l": 80, "r": 20, "t": 20, "b": 60}
    made = Figure(layout={"template": STYLE, "height": 320, "margin": margin})
    made.add_scatter(
        x=single(curve.grid * channel_factor(curve.channel)),
        y=single(curve.value_rpm),
        line={"color": AFTER, "width": 3},
        hovertemplate="%{x:.3g}: %{y:.1f} rpm<extra></extra>",
    )
    made.update_xaxes(title_text=escape(channel_title(curve.channel)))
    return made.update_yaxes(title_text=escape(f"{mode}, rpm"), zeroline=True)


def per_flight(rows: Rows, chosen: Sequence[int]) -> dict[str, Figure]:
    """Name -> figure over time and maps before and after, of the chosen flights."""
    limit = map_limit(rows)
    made: dict[str, Figure] = {}
    for f in chosen:
        made[f"time_{f}"] = time_figure(rows, f)
        for which, table in (("before", rows.before_rpm), ("after", rows.after_rpm)):
            drawn = map_figure(rows, f, table, limit)
            if drawn is not None:
                made[f"map_{which}_{f}"] = drawn
    return made
