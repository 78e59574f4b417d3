"""The way that an aircraft has flown so far, as line segments that never become too many.

A segment closes when the aircraft has moved on or some time has passed; it keeps the worst value of
all its rows. When there are more than `limit`, neighbours are joined two by two and from then on
segments are twice as long, so that an hour is drawn as fast as a minute.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from thrustmargin.mission.route import Worst
from thrustmargin.models.flight import Floats

FIRST_LENGTH, FIRST_SECONDS = 0.5, 2.0  # m and s after which a segment closes at first


class Trail:
    """Segments of one aircraft with K values each; `kinds` say which end of a value is the worst.

    Mutable: `add` rows in the order of time.
    """

    def __init__(self, kinds: Sequence[Worst], limit: int = 1500) -> None:
        self._kinds = tuple(kinds)
        self._limit = max(limit, 2)
        self._stretch = 1.0
        self._starts: list[Floats] = []
        self._ends: list[Floats] = []
        self._values: list[Floats] = []
        self._last: Floats | None = None
        self._last_s = float("nan")
        self._open_s = 0.0  # s that the running segment has lasted

    @property
    def count(self) -> int:
        """Segments so far, the running one included."""
        return len(self._starts)

    def points(self) -> Floats:
        """(S, 2, 3) m: where each segment starts and ends."""
        if not self._starts:
            return np.empty((0, 2, 3))
        return np.stack([np.array(self._starts), np.array(self._ends)], axis=1)

    def values(self, which: int) -> Floats:
        """(S,) worst of value number `which` on each segment; NaN where it was never known."""
        return np.array([v[which] for v in self._values])

    def add(self, time_s: float, position: Floats, values: Floats) -> None:
        """One row: s, (3,) m and (K,) values. A pause or a missing position breaks the line."""
        if not np.all(np.isfinite(position)):
            self._last = None
            return
        gap = time_s - self._last_s
        before, self._last, self._last_s = self._last, position, time_s
        if before is None or not 0.0 <= gap <= 2.0:
            self._open_s = np.inf
            return
        length = float(np.linalg.norm(position - self._starts[-1])) if self._starts else np.inf
        full = length > FIRST_LENGTH * self._stretch or self._open_s > FIRST_SECONDS * self._stretch
        if full or not self._starts:
            self._starts.append(before)
            self._ends.append(position)
            self._values.append(np.array(values, dtype=np.float64))
            self._open_s = gap
            if len(self._starts) > self._limit:
                self._halve()
        else:
            self._ends[-1] = position
            self._values[-1] = self._worst(self._values[-1], values)
            self._open_s += gap

    def _worst(self, one: Floats, other: Floats) -> Floats:
        both = np.stack([one, other])
        result = np.empty(len(self._kinds))
        for k, kind in enumerate(self._kinds):
            a, b = both[:, k]
            if kind == "abs":
                result[k] = b if np.isnan(a) or abs(b) > abs(a) else a
            else:
                result[k] = np.fmax(a, b) if kind == "max" else np.fmin(a, b)
        return result

    def _halve(self) -> None:
        starts, ends, values = [], [], []
        at = 0
        while at < len(self._starts):
            joined = at + 1 < len(self._starts) and np.array_equal(
                self._ends[at], self._starts[at + 1]
            )
            starts.append(self._starts[at])
            ends.append(self._ends[at + 1] if joined else self._ends[at])
            value = self._values[at]
            values.append(self._worst(value, self._values[at + 1]) if joined else value)
            at += 2 if joined else 1
        self._starts, self._ends, self._values = starts, ends, values
        self._stretch *= 2.0
