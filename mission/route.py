"""Where an aircraft has flown, as a route of coloured segments that are never too many.

A segment ends when the aircraft has moved on or some time has passed, and keeps the worst value of
all its rows. Where that makes more than the limit, each becomes twice as long, again and again;
rows that no segment needs are then forgotten, so that an hour is drawn as fast as a minute.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.flight import Floats

Rows = NDArray[np.intp]
Worst = Literal["max", "min", "abs"]

LENGTH, SECONDS, PAUSE = 0.5, 2.0, 2.0  # m and s of a segment at first; s that break the line
LIMIT = 1500  # segments; with four times as many a browser draws 1.6 times as long
#: Rows a segment beyond which rows are forgotten.
ROWS_EACH = 10


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Route:
    """S straight segments in flight order; neighbours share the row at which they meet."""

    start_ned: Floats  # (S, 3) m
    end_ned: Floats  # (S, 3) m
    first_row: Rows  # (S,) row of the track at which the segment starts
    last_row: Rows  # (S,) row at which it ends, included

    @property
    def count(self) -> int:
        return self.first_row.size

    def worst(self, values: Floats, worst: Worst) -> Floats:
        """(S,) worst of `values` (T,) over each segment's rows; NaN where none has a number.

        `max` and `min` keep the largest and smallest; `abs` the one furthest from zero, signed.
        """
        if worst == "abs":
            high, low = self.worst(values, "max"), self.worst(values, "min")
            return np.where(np.abs(high) >= np.abs(low), high, low)
        reduce = (np.fmax if worst == "max" else np.fmin).reduceat
        if self.count == 0:
            return np.empty(0)
        padded = np.append(np.asarray(values, dtype=np.float64), np.nan)
        bounds = np.column_stack([self.first_row, self.last_row + 1]).ravel()
        return reduce(padded, bounds)[::2]


class Trail:
    """Rows of one aircraft with K values each; `kinds` say which end of a value is the worst."""

    def __init__(self, kinds: Sequence[Worst], limit: int = LIMIT) -> None:
        self._kinds, self._limit = tuple(kinds), limit
        self._rows = np.empty((0, 5 + len(self._kinds)))  # time, piece, north, east, down, values
        self._last_s = np.nan
        self._piece = 0

    def add(self, time_s: Floats, position_ned: Floats, values: Floats) -> None:
        """Rows in order: (N,) s, (N, 3) m and (N, K). A pause or an unknown place is a break."""
        gap = np.diff(time_s, prepend=self._last_s)
        placed = np.all(np.isfinite(position_ned), axis=1)
        piece = self._piece + np.cumsum(~((gap >= 0.0) & (gap <= PAUSE)) | ~placed)
        if time_s.size:
            self._last_s, self._piece = time_s[-1], piece[-1]
        rows = np.column_stack([time_s, piece, position_ned, values])[placed]
        self._rows = np.concatenate([self._rows, rows])
        if len(self._rows) > ROWS_EACH * self._limit:
            self._forget()

    @property
    def route(self) -> Route:
        """Segments over the rows that `values` has."""
        time_s, piece, position = self._rows[:, 0], self._rows[:, 1], self._rows[:, 2:5]
        moved = np.linalg.norm(np.diff(position, axis=0), axis=1) / LENGTH
        share = np.maximum(moved, np.diff(time_s) / SECONDS) * (np.diff(piece) == 0)
        travelled = np.cumsum(np.append(np.zeros(min(time_s.size, 1)), share))
        total = travelled[-1] if travelled.size else 0.0
        stretch = 2.0 ** np.ceil(np.log2(max(total / self._limit, 1.0)))
        part = np.column_stack([piece, np.floor(travelled / stretch)])
        begins = np.flatnonzero(np.any(np.diff(part, axis=0, prepend=np.nan) != 0.0, axis=1))
        ends = np.append(begins[1:], time_s.size - 1)[: begins.size]
        ends -= piece[ends] != piece[begins]  # not on into the next piece
        first, last = begins[ends > begins], ends[ends > begins]
        return Route(
            start_ned=position[first],
            end_ned=position[last],
            first_row=first,
            last_row=last,
        )

    def values(self, which: int) -> Floats:
        """(T,) value number `which` of the rows."""
        return self._rows[:, 5 + which]

    def _forget(self) -> None:
        """Keep the rows at which segments meet and the worst of each value on each of them."""
        route = self.route
        segment = np.searchsorted(route.first_row, np.arange(len(self._rows)), side="right") - 1
        kept = [route.first_row, route.last_row]
        for which, kind in enumerate(self._kinds):
            worst = np.append(route.worst(self.values(which), kind), np.nan)
            found = np.flatnonzero(self.values(which) == worst[segment])
            kept.append(found[np.unique(segment[found], return_index=True)[1]])
        self._rows = self._rows[np.unique(np.concatenate(kept))]
