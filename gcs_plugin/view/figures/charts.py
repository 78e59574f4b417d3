"""What a flight looks like over time: rotor speeds around now, and the timeline of all of it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from thrustmargin.gcs_plugin.wording import palette as colours
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.model.analysis import FlightAnalysis, worst_rotor
from thrustmargin.models.physics.airframe import Airframe

#: s of a chart's window in a replay, the share of it that lies ahead of now, and s of a live one.
WINDOW_S, AHEAD, LIVE_WINDOW_S = 40.0, 0.25, 120.0
POINTS = 240
STRETCHES = 160  # of the timeline: two pixels each on a phone
WIDE, HIGH = 400, 100  # units of a drawing, which the page stretches


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


def chart_images(
    airframe: Airframe, speeds: Speeds, now_s: float, *, window_s: float, ahead: float
) -> list[dict[str, Any]]:
    """One drawing a rotor, R in all: its number, place, and an SVG of numbers alone.

    `ahead` of the window of `window_s` s is after `now_s`; ink is left to the page's style.
    """
    start_s = now_s - (1 - ahead) * window_s
    limits = speed_range(speeds)
    data = chart_data(speeds, start_s, start_s + window_s, now_s, limits)
    return [
        {"number": i + 1, "place": airframe.rotor_names[i], "svg": _svg(lines, limits)}
        for i, lines in enumerate(data)
    ]


def _svg(lines: tuple[Floats, ...], limits: tuple[float, float]) -> str:
    """One rotor's interval, prediction, measurement and line of now."""
    times, lower, upper, predicted, measured, now = lines
    low, high = limits
    across = (times - times[0]) / max(times[-1] - times[0], 1e-9) * WIDE

    def path(values: Floats, back: Floats | None = None) -> str:
        """Lines with gaps where a value is unknown; with `back` the areas between the two."""
        drawn = np.isfinite(values) if back is None else np.isfinite(values) & np.isfinite(back)
        parts = []
        for run in np.split(np.arange(times.size), np.flatnonzero(np.diff(drawn)) + 1):
            if not drawn[run[0]]:
                continue
            there = _points(across[run], values[run], low, high)
            if back is None:
                parts.append(f"M{' '.join(there)}")
            else:
                again = _points(across[run][::-1], back[run][::-1], low, high)
                parts.append(f"M{' '.join(there + again)}Z")
        return "".join(parts)

    return (
        f'<svg viewBox="0 0 {WIDE} {HIGH}" preserveAspectRatio="none" aria-hidden="true">'
        f'<path class="band" d="{path(lower, upper)}"/><path class="now" d="{path(now)}"/>'
        f'<path class="predicted" d="{path(predicted)}"/>'
        f'<path class="measured" d="{path(measured)}"/></svg>'
        f"<span>{high:.0f}</span><span>{low:.0f}</span>"
    )


def _points(across: Floats, values: Floats, low: float, high: float) -> list[str]:
    up = HIGH * (1.0 - (values - low) / (high - low))
    return [f"{x:.1f},{y:.1f}" for x, y in zip(across, up, strict=True)]


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
    speeds: Speeds, start_s: float, end_s: float, now_s: float, limits: tuple[float, float]
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


def timeline_colours(analysis: FlightAnalysis) -> list[str]:
    """One colour a stretch of time, by the least thrust left in it.

    In order of time, all of one length; grey on the ground and where nothing is known.
    """
    time_s = analysis.track.time_s
    use, _ = worst_rotor(analysis.known_utilisation)
    left = np.where(analysis.track.flying, 1.0 - use, np.nan)
    if time_s.size < 2:
        return [colours.css(colours.MARGIN.screen(np.nan))]
    count = min(STRETCHES, time_s.size)
    ends = np.linspace(time_s[0], time_s[-1], count + 1)[1:-1]
    parts = np.split(left, np.searchsorted(time_s, ends))
    least = [np.nanmin(part) if np.isfinite(part).any() else np.nan for part in parts]
    return [colours.css(colour) for colour in colours.MARGIN.screen(least)]
