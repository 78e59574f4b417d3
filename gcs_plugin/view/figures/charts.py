"""Charts of a flight over time, for the page: rotor speeds around a moment, and the timeline.

`ReplayClock` turns the wall clock into a time of the flight.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.wording import palette as colours
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.model.analysis import FlightAnalysis, worst_rotor

#: s of a chart's window in a replay, the share of it that lies after now, and s of a live one.
WINDOW_S, FUTURE_SHARE, LIVE_WINDOW_S = 40.0, 0.25, 120.0
POINTS = 240
STRETCHES = 160  # of the timeline: two pixels each on a phone
WIDE, HIGH = 400, 100  # units of a drawing, which the page stretches


class Speeds(NamedTuple):
    """Rotor speeds of R rotors in T rows, rpm; NaN where unknown."""

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
        """Return the chosen rows, with times (T,) of another clock."""
        bounds = self.lower[chosen], self.upper[chosen]
        speeds = self.predicted[chosen], self.measured[chosen]
        return Speeds(clock_s[chosen], *bounds, *speeds, self.flying[chosen])


def chart_images(
    places: Sequence[str], speeds: Speeds, now_s: float, *, window_s: float, future_share: float
) -> list[dict[str, Any]]:
    """Return a chart for each rotor of `places`, their names, as a dict of `number` (from 1),
    `place` and `svg`.

    The window is `window_s` s long; the share `future_share` of it is after `now_s`, on the clock
    of `speeds`. The page sets the line colours.
    """
    start_s = now_s - (1 - future_share) * window_s
    rows = shown_rows(speeds.time_s, start_s, start_s + window_s)
    across = (speeds.time_s[rows] - start_s) / window_s * WIDE
    limits, now = speed_range(speeds), (1 - future_share) * WIDE
    lines = (speeds.lower, speeds.upper, speeds.predicted, speeds.measured)
    return [
        {
            "number": i + 1,
            "place": name,
            "svg": _svg(across, now, *(values[rows, i] for values in lines), limits=limits),
        }
        for i, name in enumerate(places)
    ]


def shown_rows(time_s: Floats, start_s: float, end_s: float) -> NDArray[np.intp]:
    """Return the rows at `time_s` (T,) from `start_s` to `end_s`, thinned to about POINTS.

    The stride is counted from the flight's first row, so that points do not change while the window
    moves.
    """
    first = int(np.searchsorted(time_s, start_s, side="left"))
    end = int(np.searchsorted(time_s, end_s, side="right"))
    step = max(1, (end - first) // POINTS)
    return np.arange(first + -first % step, end, step)


def _svg(
    across: Floats,
    now: float,
    lower: Floats,
    upper: Floats,
    predicted: Floats,
    measured: Floats,
    *,
    limits: tuple[float, float],
) -> str:
    """Draw one rotor's interval, prediction and measurement (K,), rpm, as SVG; NaN makes gaps.

    `across` (K,) are their x positions, `now` that of the vertical line at the present time;
    `limits` are the lowest and highest rpm drawn.
    """
    low, high = limits

    def points(rows: NDArray[np.intp], values: Floats) -> list[str]:
        up = HIGH * (1.0 - (values[rows] - low) / (high - low))
        return [f"{x:.1f},{y:.1f}" for x, y in zip(across[rows], up, strict=True)]

    def path(values: Floats, back: Floats | None = None) -> str:
        """Return an SVG path of a line; with `back`, of the area between both. Unknown values
        are gaps."""
        drawn = np.isfinite(values) if back is None else np.isfinite(values) & np.isfinite(back)
        parts = []
        for run in np.split(np.arange(values.size), np.flatnonzero(np.diff(drawn)) + 1):
            if run.size and drawn[run[0]]:
                again = [] if back is None else points(run[::-1], back)
                end = "" if back is None else "Z"
                parts.append(f"M{' '.join(points(run, values) + again)}{end}")
        return "".join(parts)

    return (
        f'<svg viewBox="0 0 {WIDE} {HIGH}" preserveAspectRatio="none" aria-hidden="true">'
        f'<path class="band" d="{path(lower, upper)}"/><path class="now" d="M{now:.1f},0V{HIGH}"/>'
        f'<path class="predicted" d="{path(predicted)}"/>'
        f'<path class="measured" d="{path(measured)}"/></svg>'
        f"<span>{high:.0f}</span><span>{low:.0f}</span>"
    )


def speed_range(given: Speeds) -> tuple[float, float]:
    """Return the lowest and highest rpm of the charts: whole hundreds around all speeds in flight.

    0 to 3000 if none is known.
    """
    both = (given.measured, given.predicted)
    speeds = np.concatenate([speeds[given.flying].ravel() for speeds in both])
    speeds = speeds[np.isfinite(speeds)]
    if speeds.size == 0:
        return 0.0, 3000.0
    low, high = np.floor(speeds.min() / 100) * 100, np.ceil(speeds.max() / 100) * 100
    return float(low), float(max(high, low + 100))


def timeline_colours(analysis: FlightAnalysis, least: float = 0.5) -> list[str]:
    """Return CSS colours of equally long parts of the flight, by the least margin in each.

    The colour scale turns at `least`, the share of thrust that must be left. Grey is a part on the
    ground, or one without a known margin. There are at most STRETCHES parts; one grey for fewer
    than two rows.
    """
    time_s = analysis.track.time_s
    use, _ = worst_rotor(analysis.known_utilisation)
    left = np.where(analysis.track.flying, 1.0 - use, np.nan)
    if time_s.size < 2:
        return [colours.css(colours.NO_DATA)]
    count = min(STRETCHES, time_s.size)
    ends = np.linspace(time_s[0], time_s[-1], count + 1)[1:-1]
    parts = np.split(left, np.searchsorted(time_s, ends))
    lowest = [np.nanmin(part) if np.isfinite(part).any() else np.nan for part in parts]
    return [colours.css(colour) for colour in colours.thrust_left(least).screen(lowest)]


SPEEDS = (1, 2, 5, 10, 30, 60)


class ReplayClock:
    """A clock that runs from 0 to `duration` s at `speed` times real time and stops at `rest`.

    `ended` is True from the end on until `play` or `seek` is called.
    """

    def __init__(
        self,
        duration: float,
        *,
        speed: float = 1.0,
        paused: bool = False,
        rest: float | None = None,
        wall: Callable[[], float] = time.monotonic,
    ) -> None:
        self.duration = duration
        self._wall = wall
        self._lock = threading.Lock()
        self._time_s = 0.0
        self._since = wall()
        self._speed = speed
        self._playing = not paused
        self._rest = duration if rest is None else rest
        self._ended = False

    @property
    def speed(self) -> float:
        return self._speed

    @property
    def playing(self) -> bool:
        """Return True while time passes; False when paused and at the end."""
        with self._at_now():
            return self._playing

    @property
    def ended(self) -> bool:
        with self._at_now():
            return self._ended

    def now(self) -> float:
        """Return the time in the flight, s."""
        with self._at_now():
            return self._time_s

    def play(self) -> None:
        """Continue; at the end, restart from 0."""
        with self._at_now():
            if self._ended or self._time_s >= self.duration:
                self._time_s = 0.0
            self._playing, self._ended = True, False

    def pause(self) -> None:
        with self._at_now():
            self._playing = False

    def seek(self, time_s: float) -> None:
        """Set the time, s, limited to the flight; ignore NaN."""
        if math.isnan(time_s):
            return
        with self._at_now():
            self._time_s, self._ended = min(max(time_s, 0.0), self.duration), False

    def set_speed(self, speed: float) -> None:
        with self._at_now():
            self._speed = speed

    @contextmanager
    def _at_now(self) -> Iterator[None]:
        """Lock the clock while the block runs, with its time advanced to now; at the end of the
        flight stop the playback."""
        with self._lock:
            wall = self._wall()
            if self._playing:
                self._time_s += (wall - self._since) * self._speed
                if self._time_s >= self.duration:
                    self._time_s, self._playing, self._ended = self._rest, False, True
            self._since = wall
            yield
