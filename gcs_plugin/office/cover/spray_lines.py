"""Lay parallel lines over an area and order them, and find ways between them inside the area.

Lines are flown back and forth in one cell after another. A cell is a run of neighbouring lines that
nothing divides (boustrophedon cellular decomposition, Choset 2000); a hole or a notch begins new
cells. Lines are evenly spaced over each part of the area.

The way between two points is the shortest that stays inside the area, around its holes and corners.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from thrustmargin.models.errors import PlanError
from thrustmargin.models.flight import Floats

#: Share by which lines may be wider apart than a swath, to avoid one more line.
LOOSE = 0.02
#: m below which a piece of a line is not worth flying to.
SHORTEST = 0.5
#: Lines, at most: a mission has no room for more.
MOST_LINES = 16_000
#: Cells of a field with a hundred trees are some hundreds.
MOST_CELLS = 1000
#: Headings are tried every so many degrees, and along the edges; with so many lines at most.
TRIED_DEG, TRIED_LINES, TRIED_EDGES = 5.0, 60, 40


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinesInOrder:
    """The L straight lines in the order and direction of flight."""

    lines: Floats  # (L, 2, 2) start and end, each (east, north) in m
    heading_deg: tuple[float, ...]  # of the lines of each part, 0 to 180
    spacing: tuple[float, ...]  # m, of each part
    cells: int


def lines_in_order(
    area: shapely.MultiPolygon, swath: float, heading_deg: float | None, start: Floats
) -> LinesInOrder:
    """Return spray lines about `swath` m apart over each part of `area`, ordered into one route.

    Coordinates are m east and north; `start` (2,) is where the route begins. `heading_deg` is of
    the lines, clockwise from north; with None each part gets the heading with the fewest lines.
    Raise PlanError if no area is left or the lines are too many for a mission.
    """
    cells: list[list[Floats]] = []
    headings: list[float] = []
    spacings: list[float] = []
    for part in area.geoms:
        if part.area <= 0.0:
            continue
        heading = fewest_turns(part, swath) if heading_deg is None else heading_deg % 180.0
        pieces, spacing = _cells(part, swath, heading)
        cells += pieces
        headings.append(heading)
        spacings.append(spacing)
    if not cells:
        raise PlanError("nothing is left of the field to fly; lower the headland or the clearance")
    return LinesInOrder(
        lines=_tour(cells, start),
        heading_deg=tuple(headings),
        spacing=tuple(spacings),
        cells=len(cells),
    )


def fewest_turns(part: shapely.Polygon, swath: float) -> float:
    """Return the heading, 0 to 180 degrees, at which lines `swath` m apart over `part` are fewest.

    Of headings with equally many lines it is the one at which the part is narrowest across the
    lines.
    """
    rough = shapely.simplify(part.exterior, swath / 4, preserve_topology=False)
    corners = shapely.get_coordinates(rough)
    edge = np.diff(corners, axis=0)
    longest = edge[np.argsort(-np.hypot(*edge.T), kind="stable")][:TRIED_EDGES]
    headings = np.degrees(np.arctan2(longest[:, 0], longest[:, 1])) % 180.0
    tried = np.unique(np.concatenate([headings, np.arange(0.0, 180.0, TRIED_DEG)]).round(6))
    widest = math.hypot(*np.ptp(corners, axis=0))
    coarse = max(swath, widest / TRIED_LINES)

    def turns(heading: float) -> tuple[float, float]:
        level = shapely.transform(part, lambda xy: _turned(xy, heading))
        _, low, _, high = level.bounds
        pieces, _ = _pieces(level, low, high, coarse)
        # What the coarse spacing rounds away decides between headings that are nearly as good.
        pieces_each = sum(map(len, pieces)) / len(pieces)
        return pieces_each * _count(high - low, swath), pieces_each * (high - low)

    return float(min(tried, key=turns))


def _turned(points: Floats, heading_deg: float, *, back: bool = False) -> Floats:
    """Rotate points (N, 2) from (east, north) to (along, across) of a heading, or `back`."""
    a = math.radians(heading_deg)
    matrix = np.array([[math.sin(a), math.cos(a)], [-math.cos(a), math.sin(a)]])
    return points @ (matrix if back else matrix.T)


def _count(width: float, swath: float) -> int:
    """Return the number of lines for a strip `width` m wide: width / swath rounded, at least 1.

    One more if the lines would be more than (1 + LOOSE) * `swath` m apart.
    """
    exact = width / swath
    near = max(round(min(exact, 1e9)), 1)
    return near if exact <= near * (1.0 + LOOSE) else near + 1


def _pieces(
    level: shapely.Polygon, low: float, high: float, swath: float
) -> tuple[list[list[Floats]], float]:
    """Return the pieces inside `level` of equally spaced horizontal lines, and the spacing, m.

    The lines cover the heights `low` to `high`, m, about `swath` m apart. For each line, from the
    lowest, there is a list of pieces (2, 2), m, left to right; pieces shorter than SHORTEST m are
    left out. Raise PlanError for more than MOST_LINES lines or pieces.
    """
    count = _count(high - low, swath)
    if count > MOST_LINES:
        raise PlanError(
            f"a swath of {swath:g} m makes {count} lines of the field, over {MOST_LINES}; "
            "take a wider one, or a part of the field"
        )
    spacing = (high - low) / count
    across = low + spacing * (np.arange(count) + 0.5)
    rings = [shapely.get_coordinates(ring) for ring in (level.exterior, *level.interiors)]
    a = np.concatenate([ring[:-1] for ring in rings])
    b = np.concatenate([ring[1:] for ring in rings])
    # Each edge meets the lines from number `first` on, `met` of them; at a corner one edge counts.
    ends = np.sort(np.searchsorted(across, np.column_stack([a[:, 1], b[:, 1]])), axis=1)
    first, met = ends[:, 0], ends[:, 1] - ends[:, 0]
    if met.sum() > 2 * MOST_LINES:
        raise PlanError(f"the outline cuts the lines into over {MOST_LINES} pieces; simplify it")
    edge = np.repeat(np.arange(met.size), met)
    line = np.arange(edge.size) - np.repeat(np.cumsum(met) - met, met) + first[edge]
    share = (across[line] - a[edge, 1]) / (b[edge, 1] - a[edge, 1])
    positions = a[edge, 0] + share * (b[edge, 0] - a[edge, 0])
    # From left to right a line goes in and out in turn.
    order = np.lexsort([positions, line])
    spans = np.column_stack([positions[order][::2], positions[order][1::2]])
    pieces: list[list[Floats]] = [[] for _ in range(count)]
    for k, (left, right) in zip(line[order][::2].tolist(), spans.tolist(), strict=True):
        if right - left >= SHORTEST:
            pieces[k].append(np.array([[left, across[k]], [right, across[k]]]))
    return pieces, spacing


def _cells(part: shapely.Polygon, swath: float, heading: float) -> tuple[list[list[Floats]], float]:
    """Divide `part` into cells that can be sprayed back and forth without a gap; return the spacing
    too.

    A cell is a list of its lines in order across, each (2, 2): both ends, m east and north.
    `heading` of the lines is in degrees from north, clockwise; the spacing of lines is in m. Raise
    PlanError for more than MOST_CELLS cells.
    """
    level = shapely.transform(part, lambda xy: _turned(xy, heading))
    _, low, _, high = level.bounds
    rows, spacing = _pieces(level, low, high, swath)
    cells: list[list[Floats]] = []
    open_cells: list[list[Floats]] = []  # those that the line before belongs to
    for row in rows:
        touching = [[_overlap(cell[-1], piece) for cell in open_cells] for piece in row]
        followers = [sum(t[k] for t in touching) for k in range(len(open_cells))]
        now: list[list[Floats]] = []
        for piece, touched in zip(row, touching, strict=True):
            own = [k for k, is_touched in enumerate(touched) if is_touched]
            if len(own) == 1 and followers[own[0]] == 1:
                cell = open_cells[own[0]]
            else:
                cells.append(cell := [])
                if len(cells) > MOST_CELLS:
                    raise PlanError(
                        f"the outline divides the lines into over {MOST_CELLS} cells; simplify it"
                    )
            cell.append(piece)
            now.append(cell)
        open_cells = now
    return [[_turned(p, heading, back=True) for p in cell] for cell in cells], spacing


def _overlap(a: Floats, b: Floats) -> bool:
    """Return True if two pieces (2, 2) of neighbouring lines overlap along the lines."""
    return bool(a[0, 0] < b[1, 0] and b[0, 0] < a[1, 0])


def _tour(cells: Sequence[Sequence[Floats]], start: Floats) -> Floats:
    """Order the lines of all cells into one route (L, 2, 2), m: L lines, each from its start to its
    end.

    From `start` (2,) go to the nearest corner of an unvisited cell, then back and forth along its
    lines.
    """
    # Corner k of a cell: from its first (0, 1) or last line (2, 3), at that line's start or end.
    corners = np.array([[c[0][0], c[0][1], c[-1][0], c[-1][1]] for c in cells])
    unvisited = np.ones(len(cells), dtype=np.bool_)
    place, lines = np.asarray(start, dtype=np.float64), []
    for _ in cells:
        far = np.hypot(*np.moveaxis(corners - place, -1, 0))
        far[~unvisited] = np.inf
        cell, corner = map(int, np.unravel_index(int(np.argmin(far)), far.shape))
        unvisited[cell] = False
        ordered = list(cells[cell]) if corner < 2 else list(cells[cell])[::-1]
        for k, line in enumerate(ordered):
            lines.append(line if (corner + k) % 2 == 0 else line[::-1])
        place = lines[-1][1]
    return np.array(lines)


#: m by which a way may leave the area, to allow for rounding.
CLOSE = 0.02
#: Corners of an area, at most; one with more is simplified towards its inside.
MOST_CORNERS = 150


class Detours:
    """Shortest paths inside one area (m east, north)."""

    def __init__(self, area: shapely.Geometry) -> None:
        self._wide = shapely.buffer(area, CLOSE, join_style="mitre")
        shapely.prepare(self._wide)
        self._area = area
        self._corners: Floats | None = None
        self._between = np.empty((0, 0))

    def way(self, start: Floats, end: Floats) -> Floats | None:
        """Return the turning points (K, 2) of the shortest path from `start` (2,) to `end` (2,).

        Points are m east and north, and the path stays inside the area. K is 0 if the straight line
        does. None if no path stays inside.
        """
        if shapely.covers(self._wide, shapely.LineString([start, end])):
            return np.empty((0, 2))
        if self._corners is None:
            self._corners = _inner_corners(self._area)
            self._between = self._lengths(self._corners, self._corners)
        corners = self._corners
        count = len(corners)
        ends = self._lengths(np.array([start, end]), corners)
        graph = np.zeros((count + 2, count + 2))
        graph[:count, :count] = self._between
        graph[count:, :count] = ends
        graph[:count, count:] = ends.T
        far, before = dijkstra(
            csr_array(graph), directed=False, indices=count, return_predecessors=True
        )
        if not np.isfinite(far[count + 1]):
            return None
        route, place = [], int(before[count + 1])
        while place != count:
            route.append(corners[place])
            place = int(before[place])
        return np.array(route[::-1])

    def _lengths(self, a: Floats, b: Floats) -> Floats:
        """Return the distances (A, B), m, between points `a` (A, 2) and `b` (B, 2), m.

        A distance is 0, which the path search takes as no connection, where the straight line
        leaves the area.
        """
        if not len(a) or not len(b):
            return np.zeros((len(a), len(b)))
        ends = np.stack(np.broadcast_arrays(a[:, None], b[None, :]), axis=2)
        free = shapely.covers(self._wide, shapely.linestrings(ends))
        return np.where(free, np.hypot(*np.moveaxis(ends[:, :, 1] - ends[:, :, 0], -1, 0)), 0.0)


def _inner_corners(area: shapely.Geometry) -> Floats:
    """Return the corners (C, 2) that point into the area, at which a shortest path may turn."""
    simple, step = shapely.simplify(area, CLOSE), 0.25
    while len(corners := _reflex(simple)) > MOST_CORNERS:
        simple = shapely.simplify(shapely.buffer(area, -step, join_style="mitre"), step)
        step *= 2.0
    return corners


def _reflex(area: shapely.Geometry) -> Floats:
    """Return the corners (C, 2) of an area at which its inner angle exceeds 180°, also those of
    holes.

    A shortest path inside the area turns only there.
    """
    found_corners = [np.empty((0, 2))]
    for part in shapely.get_parts(area):
        if part.geom_type != "Polygon" or part.is_empty:
            continue
        whole = shapely.orient_polygons(part)  # the area is on the left of every ring
        for ring in (whole.exterior, *whole.interiors):
            corners = shapely.get_coordinates(ring)[:-1]
            into, out = (
                corners - np.roll(corners, 1, axis=0),
                np.roll(corners, -1, axis=0) - corners,
            )
            found_corners.append(corners[into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0] < 0.0])
    return np.concatenate(found_corners)
