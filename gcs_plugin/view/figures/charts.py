"""Predicted and measured rotor speed, one chart a rotor, over a window around now.

uPlot draws them in the browser without any network. The line of now is one more series of each
chart, so that a tick is one assignment of arrays.
"""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from thrustmargin.gcs_plugin.wording import view_words as words
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.physics.airframe import Airframe

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


class Speeds(NamedTuple):
    """Rotor speeds of T moments of R rotors, rpm; NaN where unknown."""

    time_s: Floats  # (T,)
    lower: Floats  # (T, R) of the prediction's interval
    upper: Floats
    predicted: Floats
    measured: Floats
    flying: Bools  # (T,)

    @classmethod
    def of(cls, analysis: FlightAnalysis) -> Speeds:
        track, made = analysis.track, analysis.prediction
        bounds = made.lower_rpm, made.upper_rpm
        return cls(track.time_s, *bounds, made.rotor_speed_rpm, track.rotor_speed_rpm, track.flying)

    def rows(self, chosen: slice, clock_s: Floats) -> Speeds:
        """Those rows, with their times (T,) by another clock."""
        bounds = self.lower[chosen], self.upper[chosen]
        speeds = self.predicted[chosen], self.measured[chosen]
        return Speeds(clock_s[chosen], *bounds, *speeds, self.flying[chosen])


class RotorCharts:
    """R small charts in the current GUI container, with `ahead` of `window_s` s after now."""

    def __init__(
        self,
        gui: GuiApi,
        airframe: Airframe,
        speeds: Speeds,
        *,
        window_s: float = WINDOW_S,
        ahead: float = AHEAD,
    ) -> None:
        from viser import uplot

        series = (
            uplot.Series(label=words.TIME.lower()),
            uplot.Series(show=True, width=0),
            uplot.Series(show=True, width=0),
            uplot.Series(label="predicted", stroke=PREDICTED_INK, width=2),
            uplot.Series(label="measured", stroke=MEASURED_INK, width=1.6),
            uplot.Series(label="now", stroke=NOW_INK, width=3),
        )
        low, high = speed_range(speeds)
        self._range = (low, high)
        self._window_s, self._ahead = window_s, ahead
        self._shown = float(speeds.time_s[0])
        self._charts = []
        if not airframe.rotor_count:
            return
        gui.add_html(
            '<div style="font:600 13px system-ui;color:#111;margin:0 10px">'
            f'<b style="color:{MEASURED_INK}">&#9644;</b> measured &nbsp; '
            f'<b style="color:{PREDICTED_INK}">&#9644;</b> {words.PREDICTED_WITHIN}</div>'
        )
        data = self._data(self._shown, speeds)
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

    def show(self, time_s: float, speeds: Speeds) -> None:
        """Move the window so that `time_s` is at the line of now; the range only grows."""
        if time_s == self._shown:
            return
        self._shown = time_s
        low, high = speed_range(speeds)
        grown = (min(low, self._range[0]), max(high, self._range[1]))
        from viser import uplot

        scales = {"x": uplot.Scale(time=False), "y": uplot.Scale(range=grown)}
        for chart, data in zip(self._charts, self._data(time_s, speeds), strict=True):
            chart.data = data
            if grown != self._range:
                chart.scales = scales
        self._range = grown

    def _data(self, time_s: float, speeds: Speeds) -> list[tuple[Floats, ...]]:
        start = time_s - (1 - self._ahead) * self._window_s
        end = time_s + self._ahead * self._window_s
        return chart_data(speeds, start, end, time_s, self._range)


def speed_range(given: Speeds) -> tuple[float, float]:
    """Limits of the charts in rpm, whole hundreds around all flying rows."""
    both = (given.measured, given.predicted)
    speeds = np.concatenate([speeds[given.flying].ravel() for speeds in both])
    speeds = speeds[np.isfinite(speeds)]
    if speeds.size == 0:
        return 0.0, 3000.0
    low, high = np.floor(speeds.min() / 100) * 100, np.ceil(speeds.max() / 100) * 100
    return float(low), float(max(high, low + 100))


def chart_data(
    speeds: Speeds,
    start_s: float,
    end_s: float,
    now_s: float,
    limits: tuple[float, float],
) -> list[tuple[Floats, ...]]:
    """For each rotor: times, lower, upper, predicted, measured, line of now. All (K,).

    Rows are thinned by a fixed stride of the flight, so that points stay put as the window moves.
    """
    time_s = speeds.time_s
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
    lines = speeds.lower, speeds.upper, speeds.predicted, speeds.measured
    return [
        (times, *(column(values[:, i]) for values in lines), now)
        for i in range(speeds.measured.shape[1])
    ]
