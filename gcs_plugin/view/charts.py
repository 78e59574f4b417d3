"""Predicted and measured rotor speed, one chart a rotor, over a window around now.

uPlot draws them in the browser without any network. The line of now is one more series of each
chart, so that a tick is one assignment of arrays.
"""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

import numpy as np

from thrustmargin.gcs_plugin.wording import view_words as words
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.analysis import FlightAnalysis

if TYPE_CHECKING:
    from viser import GuiApi

WINDOW_S = 40.0
#: Share of the window that lies ahead of now in a replay.
AHEAD = 0.25
POINTS = 240
PIXELS, AXIS_PIXELS = 74, 22
#: With more than four rotors, so that more of the charts fit on a screen.
SMALL_PIXELS = 46
FONT = "600 12px system-ui"
MEASURED_INK, PREDICTED_INK, NOW_INK = "#111111", "#d05a00", "#c8146e"
BAND = "rgba(236,150,35,0.35)"


class RotorCharts:
    """R small charts in the current GUI container."""

    def __init__(self, gui: GuiApi, analysis: FlightAnalysis) -> None:
        from viser import uplot

        airframe = analysis.model.airframe
        series = (
            uplot.Series(label=words.TIME.lower()),
            uplot.Series(show=True, width=0),
            uplot.Series(show=True, width=0),
            uplot.Series(label="predicted", stroke=PREDICTED_INK, width=2),
            uplot.Series(label="measured", stroke=MEASURED_INK, width=1.6),
            uplot.Series(label="now", stroke=NOW_INK, width=3),
        )
        low, high = speed_range(analysis)
        self._range = (low, high)
        self._analysis = analysis
        self._shown = float(analysis.track.time_s[0])
        self._charts = []
        if not airframe.rotor_count:
            return
        gui.add_html(
            '<div style="font:600 13px system-ui;color:#111;margin:0 10px">'
            f'<b style="color:{MEASURED_INK}">&#9644;</b> measured &nbsp; '
            f'<b style="color:{PREDICTED_INK}">&#9644;</b> {words.PREDICTED_WITHIN}</div>'
        )
        data = self._data(self._shown)
        last = airframe.rotor_count - 1
        height = PIXELS if airframe.rotor_count <= 4 else SMALL_PIXELS
        for i in range(airframe.rotor_count):
            gui.add_html(
                '<div style="font:700 13px system-ui;color:#111;margin:0 10px -8px">'
                f"{i + 1} {escape(airframe.rotor_names[i])}</div>"
            )
            chart = gui.add_uplot(
                data[i],
                series,
                bands=(uplot.Band(series=(2, 1), fill=BAND),),
                scales={"x": uplot.Scale(time=False), "y": uplot.Scale(range=(low, high))},
                axes=(
                    uplot.Axis(show=i == last, stroke="#111", size=AXIS_PIXELS, font=FONT, gap=2),
                    uplot.Axis(stroke="#111", size=56, font=FONT, space=18, gap=2),
                ),
                legend=uplot.Legend(show=False),
                cursor=uplot.Cursor(show=False),
                height=height + (AXIS_PIXELS if i == last else 0),
                padding=(6, 10, 4, 0),
            )
            self._charts.append(chart)

    def show(self, time_s: float) -> None:
        """Move the window so that `time_s` is at the line of now."""
        if time_s == self._shown:
            return
        self._shown = time_s
        for chart, data in zip(self._charts, self._data(time_s), strict=True):
            chart.data = data

    def _data(self, time_s: float) -> list[tuple[Floats, ...]]:
        start, end = time_s - (1 - AHEAD) * WINDOW_S, time_s + AHEAD * WINDOW_S
        return chart_data(self._analysis, start, end, time_s, self._range)


def speed_range(analysis: FlightAnalysis) -> tuple[float, float]:
    """Limits of the charts in rpm, whole hundreds around all flying rows."""
    both = (analysis.track.rotor_speed_rpm, analysis.prediction.rotor_speed_rpm)
    speeds = np.concatenate([speeds[analysis.track.flying].ravel() for speeds in both])
    speeds = speeds[np.isfinite(speeds)]
    if speeds.size == 0:
        return 0.0, 3000.0
    low, high = np.floor(speeds.min() / 100) * 100, np.ceil(speeds.max() / 100) * 100
    return float(low), float(max(high, low + 100))


def chart_data(
    analysis: FlightAnalysis,
    start_s: float,
    end_s: float,
    now_s: float,
    limits: tuple[float, float],
) -> list[tuple[Floats, ...]]:
    """For each rotor: times, lower, upper, predicted, measured, line of now. All (K,).

    Rows are thinned by a fixed stride of the flight, so that points stay put as the window moves.
    """
    time_s, prediction = analysis.track.time_s, analysis.prediction
    first = int(np.searchsorted(time_s, start_s, side="left"))
    end = int(np.searchsorted(time_s, end_s, side="right"))
    step = max(1, (end - first) // POINTS)
    which = np.arange(first + -first % step, end, step)
    after = int(np.searchsorted(time_s[which], now_s, side="right"))
    ends = np.array([start_s, end_s])

    def column(values: Floats) -> Floats:
        inside = np.insert(values[which], after, [np.nan, np.nan, np.nan])
        return np.concatenate([[np.nan], inside, [np.nan]])

    times = np.insert(time_s[which], after, [now_s, now_s, now_s])
    times = np.clip(np.concatenate([ends[:1], times, ends[1:]]), start_s, end_s)
    now = np.full(times.size, np.nan)
    now[after + 1 : after + 3] = limits
    lines = (
        prediction.lower_rpm,
        prediction.upper_rpm,
        prediction.rotor_speed_rpm,
        analysis.track.rotor_speed_rpm,
    )
    return [
        (times, *(column(values[:, i]) for values in lines), now)
        for i in range(analysis.track.rotor_count)
    ]
