"""A flight as few coloured line segments, without losing a corner or a worst moment.

A row is left out of the drawn line when that moves the line by less than a tolerance, in plan, in
height and in each coloured value (Douglas-Peucker by shapely, with the tolerance raised until the
line is short enough). Every row that is left out still counts: a segment's value is the worst of
all the rows that it covers, so the worst of the flight is always the worst of some segment.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from thrustmargin.models.errors import TrackError
from thrustmargin.models.flight import Bools, Floats

Rows = NDArray[np.intp]
Worst = Literal["max", "min", "abs"]

#: Share of a value's own range that counts as much as the tolerance in metres.
VALUE_TOLERANCE = 0.02
BISECTIONS = 8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Route:
    """S straight segments in flight order; neighbours share the row at which they meet."""

    start_ned: Floats  # (S, 3) m
    end_ned: Floats  # (S, 3) m
    first_row: Rows  # (S,) row of the track at which the segment starts
    last_row: Rows  # (S,) row at which it ends, included
    tolerance: float  # m by which the drawn line may differ from the flown one

    @property
    def count(self) -> int:
        return self.first_row.size

    def covers(self, rows: int) -> Bools:
        """(rows,) which rows of the track lie on some segment."""
        change = np.zeros(rows + 1, dtype=np.intp)
        np.add.at(change, self.first_row, 1)
        np.add.at(change, self.last_row + 1, -1)
        return np.cumsum(change[:-1]) > 0

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

    def worst_row(self, values: Floats, worst: Worst) -> int | None:
        """Row of the track with the worst of `values` (T,) on the route; None without any."""
        score = {"max": values, "min": -values, "abs": np.abs(values)}[worst]
        score = np.where(self.covers(values.size) & np.isfinite(values), score, -np.inf)
        return int(np.argmax(score)) if score.size and np.isfinite(score.max()) else None


def route_segments(
    position_ned: Floats,
    values: Sequence[Floats] = (),
    *,
    shown: Bools | None = None,
    limit: int = 1500,
    tolerance: float = 0.1,
) -> Route:
    """Segments of the line through `position_ned` (T, 3) m, at most `limit` of them.

    `values` are (T,) arrays that will colour the line: rows at which a colour turns are kept.
    `shown` (T,) picks the rows to draw; the line breaks where it is False or a position is NaN
    (when that makes more pieces than `limit` allows, at the longest breaks only).
    `tolerance` m is what the drawn line may differ by; it grows when `limit` asks for it.
    Raises TrackError when a shape disagrees or `limit` is below 1.
    """
    rows = position_ned.shape[0]
    if position_ned.shape != (rows, 3) or any(v.shape != (rows,) for v in values):
        raise TrackError("a route needs position_ned (T, 3) and values of (T,) each")
    if limit < 1:
        raise TrackError(f"a route of at most {limit} segments cannot be drawn; ask for 1 or more")
    wanted = np.ones(rows, dtype=np.bool_) if shown is None else shown
    placed = np.flatnonzero(wanted & np.all(np.isfinite(position_ned), axis=1))
    pieces = _pieces(placed, limit)
    planes = _planes(position_ned[placed], [v[placed] for v in values], tolerance)
    offsets = np.cumsum([0, *(p.size for p in pieces)])

    def kept(stretch: float) -> list[Rows]:
        return [
            piece[_kept(planes[:, a:b], stretch)]
            for piece, a, b in zip(pieces, offsets[:-1], offsets[1:], strict=True)
        ]

    stretch = 1.0
    chosen = kept(stretch)
    if _segment_count(chosen) > limit:
        stretch, chosen = _shorten(kept, limit)
    first = np.concatenate([_starts(c) for c in chosen] or [np.empty(0, dtype=np.intp)])
    last = np.concatenate([_ends(c) for c in chosen] or [np.empty(0, dtype=np.intp)])
    return Route(
        start_ned=position_ned[first],
        end_ned=position_ned[last],
        first_row=first,
        last_row=last,
        tolerance=tolerance * stretch,
    )


def _pieces(placed: Rows, limit: int) -> list[Rows]:
    """Rows of each unbroken piece of the line; at most `limit` pieces."""
    if placed.size == 0:
        return []
    gaps = np.diff(placed)
    breaks = np.flatnonzero(gaps > 1)
    if breaks.size > limit - 1:
        longest = np.argsort(gaps[breaks], kind="stable")[::-1][: limit - 1]
        breaks = np.sort(breaks[longest])
    return np.split(placed, breaks + 1)


def _planes(position_ned: Floats, values: Sequence[Floats], tolerance: float) -> Floats:
    """(P, T, 3) polylines to simplify, in units of their tolerance; the third number is the row.

    Plan (north, east), then height and each value over the distance flown. A missing value is
    drawn one range below the others, so that the ends of a stretch without data are corners.
    """
    rows = np.arange(position_ned.shape[0], dtype=np.float64)
    steps = np.linalg.norm(np.diff(position_ned, axis=0, prepend=position_ned[:1]), axis=1)
    distance = np.cumsum(steps) / tolerance
    plan = position_ned[:, :2] / tolerance
    planes = [
        np.column_stack([plan, rows]),
        np.column_stack([distance, position_ned[:, 2] / tolerance, rows]),
    ]
    for value in values:
        known = value[np.isfinite(value)]
        span = float(np.ptp(known)) if known.size and np.ptp(known) > 0 else 1.0
        low = float(known.min()) if known.size else 0.0
        filled = np.where(np.isfinite(value), value, low - span)
        planes.append(np.column_stack([distance, filled / (VALUE_TOLERANCE * span), rows]))
    return np.stack(planes)


def _kept(planes: Floats, stretch: float) -> Rows:
    """Indices of one piece's rows that some plane needs at `stretch` times its tolerance."""
    size = planes.shape[1]
    if size <= 2:
        return np.arange(size)
    lines = shapely.linestrings(planes)
    # Half, because a row kept for another plane may bend this one by as much again.
    short = shapely.simplify(lines, 0.5 * stretch, preserve_topology=False)
    needed = shapely.get_coordinates(short, include_z=True)[:, 2]
    first_row = planes[0, 0, 2]
    return np.union1d(needed - first_row, [0, size - 1]).astype(np.intp)


def _shorten(kept, limit: int) -> tuple[float, list[Rows]]:
    """The smallest stretch of the tolerance, to a few per cent, that fits `limit` segments."""
    low, high = 1.0, 2.0
    while _segment_count(chosen := kept(high)) > limit:
        if high > 1e12:  # ends and breaks alone fill the limit
            chosen = [c[[0, -1]] for c in chosen]
            return high, chosen
        low, high = high, high * 2
    for _ in range(BISECTIONS):
        middle = (low * high) ** 0.5
        tried = kept(middle)
        if _segment_count(tried) > limit:
            low = middle
        else:
            high, chosen = middle, tried
    return high, chosen


def _segment_count(chosen: Sequence[Rows]) -> int:
    return sum(max(c.size - 1, 1) for c in chosen)


def _starts(piece: Rows) -> Rows:
    return piece[:-1] if piece.size > 1 else piece


def _ends(piece: Rows) -> Rows:
    return piece[1:] if piece.size > 1 else piece
