"""The way that an aircraft has flown so far, as a route that never has too many segments.

A segment ends when the aircraft has moved on or some time has passed, and keeps the worst value of
all its rows. Where that makes more than `LIMIT` segments, each becomes twice as long, again and
again; rows that no segment needs are then forgotten, so that an hour is drawn as fast as a minute.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from thrustmargin.mission.route import Route, Worst
from thrustmargin.models.flight import Floats

LENGTH, SECONDS, PAUSE = 0.5, 2.0, 2.0  # m and s of a segment at first; s that break the line
LIMIT = 1500  # segments
#: Rows a segment beyond which rows are forgotten.
ROWS_EACH = 10


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
            tolerance=LENGTH * stretch,
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
