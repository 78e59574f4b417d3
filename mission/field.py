"""Compute the sprayed field from the places where the pump was on: swath lines, outline and area.

The swath width is not in the telemetry. It is estimated as the spacing of neighbouring spray lines,
as missions are planned. With fewer than two lines it is unknown, and nothing that depends on it is
drawn or counted. Where the place is unknown, the log pauses or the state of the pump is unknown,
the area is incomplete; `lost_s` is the duration of that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from thrustmargin.models.errors import TrackError
from thrustmargin.models.flight import Bools, Floats

#: A spray line is a straight piece at least this long, m.
SHORTEST_LINE = 5.0
#: Lines closer than this are the same line flown again, m: the usual accuracy of a GPS position.
SAME_LINE = 1.0
#: Bends smaller than this are steering, not a new line, m.
STRAIGHTNESS = 0.5
#: s between two rows beyond which the path from one to the other is not known.
LONGEST_PAUSE = 2.0
#: Share of the time with the pump on that may have no place before the area is a part alone.
LOST_SHARE = 0.01


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Field:
    """The sprayed ground in plan (north, east), and the swath lines at their height."""

    rows: tuple[NDArray[np.intp], ...]  # of each stretch with the pump on and a known way
    swaths_ned: tuple[Floats, ...]  # each (K, 3) m: the same stretches
    ground: shapely.MultiPolygon  # (north, east) m; empty without a swath width
    swath_width: float  # m, spacing of neighbouring lines; NaN unknown
    area: float  # m² under the swaths, overlaps counted once; NaN without a width
    sprayed_s: float  # with the pump on, or unknown
    lost_s: float  # of these, without a place, or in a pause of the log

    @property
    def whole(self) -> bool:
        """Return True if at most LOST_SHARE of the spraying time is without a position."""
        return self.lost_s <= LOST_SHARE * self.sprayed_s


def sprayed_field(
    time_s: Floats, position_ned: Floats, spraying: Floats, *, swath_width: float | None = None
) -> Field | None:
    """Compute the field under the rows of `position_ned` (T, 3), m, where `spraying` (T,) is 1.

    `spraying` is 0 with the pump off or on the ground, NaN where unknown. Rows where it is NaN,
    and rows without a position, add no ground. `swath_width`, m, replaces the spacing measured
    between the lines. Return None if `spraying` is never 1; a field with an empty ground and a
    NaN area if no line or no spacing is known. Raise TrackError if shapes disagree.
    """
    rows = spraying.size
    if position_ned.shape != (rows, 3) or time_s.shape != (rows,):
        raise TrackError("a field needs time_s (T,), position_ned (T, 3) and spraying (T,)")
    if not np.any(spraying > 0.5):
        return None
    known = np.all(np.isfinite(position_ned), axis=1)
    on = np.flatnonzero((spraying > 0.5) & known)
    ends = (np.diff(on) > 1) | (np.diff(time_s[on]) > LONGEST_PAUSE)
    runs = [run for run in np.split(on, np.flatnonzero(ends) + 1) if run.size > 1]
    sprayed_s, lost_s = _spans(time_s, spraying, known)
    lines = shapely.simplify(
        [shapely.LineString(position_ned[run]) for run in runs], 0.1, preserve_topology=False
    )
    swaths = tuple(shapely.get_coordinates(line, include_z=True) for line in lines)
    width = line_spacing(swaths) if swath_width is None else swath_width
    ground, area = shapely.MultiPolygon(), float("nan")
    if runs and np.isfinite(width):
        ground, area = _ground(lines, width)
    return Field(
        rows=tuple(runs),
        swaths_ned=swaths,
        ground=ground,
        swath_width=float(width) if runs else float("nan"),
        area=area,
        sprayed_s=sprayed_s,
        lost_s=lost_s,
    )


def _spans(time_s: Floats, spraying: Floats, known: Bools) -> tuple[float, float]:
    """Return two times, s: with the pump on or unknown, and the part of it that cannot be mapped.

    `spraying` (T,) is 1 on, 0 off, NaN unknown; `known` (T,) flags rows with a position. That part
    is where the pump is unknown, where a row with the pump on has no position, and in a pause of
    the log with the pump on at either end.
    """
    steps = np.diff(time_s)
    on, unsaid = spraying > 0.5, np.isnan(spraying)
    paused = (steps > LONGEST_PAUSE) & (on[:-1] | on[1:])
    lost = paused | unsaid[:-1] | (on[:-1] & ~(known[:-1] & known[1:]))
    return float(steps[on[:-1] | lost].sum()), float(steps[lost].sum())


def _ground(lines: NDArray[np.object_], width: float) -> tuple[shapely.MultiPolygon, float]:
    """Return the outline of the ground within half of `width` of the lines, and its area, m².

    The outline also covers narrow gaps between the lines; the area does not.
    """
    # Half the spacing on both sides covers the ground; what then still gapes by less than half a
    # swath is steering, so the outline closes over it. The area counts the strips alone. The union
    # is made on a 1 mm grid: in floating point GEOS may drop a strip that just touches another.
    strips = shapely.union_all(
        shapely.buffer(shapely.force_2d(lines), width / 2, cap_style="flat", join_style="mitre"),
        grid_size=1e-3,
    )
    closed = shapely.buffer(shapely.buffer(strips, width / 4), -width / 4)
    parts = [p for p in shapely.get_parts(closed) if p.geom_type == "Polygon" and not p.is_empty]
    return shapely.MultiPolygon(parts), float(strips.area)


def line_spacing(swaths_ned: tuple[Floats, ...]) -> float:
    """Return the median distance, m, between neighbouring parallel spray lines; NaN for fewer
    than two.
    """
    pieces = _straight_pieces(swaths_ned)
    if len(pieces) < 2:
        return np.nan
    direction = pieces[:, 1] - pieces[:, 0]
    length = np.hypot(*direction.T)
    # Axial mean: there and back are one direction, so angles are doubled before averaging.
    doubled = 2 * np.arctan2(direction[:, 1], direction[:, 0])
    heading = np.arctan2(length @ np.sin(doubled), length @ np.cos(doubled)) / 2
    parallel = np.abs(np.cos(np.arctan2(direction[:, 1], direction[:, 0]) - heading)) > np.cos(
        np.radians(10.0)
    )
    middle = pieces[parallel].mean(axis=1)
    across: Floats = middle @ np.array([-np.sin(heading), np.cos(heading)])
    gaps: Floats = np.diff(np.sort(across))
    gaps = gaps[gaps > SAME_LINE]
    return float(np.median(gaps)) if gaps.size else np.nan


def _straight_pieces(swaths_ned: tuple[Floats, ...]) -> Floats:
    """Return start and end (P, 2, 2), m north and east, of straight pieces of SHORTEST_LINE m or
    more; P may be 0."""
    pieces = [np.empty((0, 2, 2))]
    for swath in swaths_ned:
        line = shapely.simplify(shapely.LineString(swath[:, :2]), STRAIGHTNESS)
        corners = shapely.get_coordinates(line)
        pieces.append(np.stack([corners[:-1], corners[1:]], axis=1))
    segments = np.concatenate(pieces)
    return segments[np.hypot(*(segments[:, 1] - segments[:, 0]).T) >= SHORTEST_LINE]
