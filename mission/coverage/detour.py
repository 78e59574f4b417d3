"""The shortest way between two points that stays inside an area: around its holes and corners."""

from __future__ import annotations

import numpy as np
import shapely
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from thrustmargin.models.flight import Floats

#: m by which a way may be outside, which is rounding and no leaving.
CLOSE = 0.02
#: Corners to turn at, at most; an area with more is made simpler, on its inside.
MOST_CORNERS = 150


class Detours:
    """Ways inside one area (east, north) in m."""

    def __init__(self, area: shapely.Geometry) -> None:
        self._wide = shapely.buffer(area, CLOSE, join_style="mitre")
        shapely.prepare(self._wide)
        self._area = area
        self._corners: Floats | None = None
        self._between = np.empty((0, 0))

    def way(self, start: Floats, end: Floats) -> Floats | None:
        """(K, 2) points to turn at from `start` (2,) to `end` (2,), none where the way is free.

        None when no way stays inside.
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
        found, at = [], int(before[count + 1])
        while at != count:
            found.append(corners[at])
            at = int(before[at])
        return np.array(found[::-1])

    def _lengths(self, a: Floats, b: Floats) -> Floats:
        """(A, B) m from each point of `a` to each of `b`, 0 where that is not free."""
        if not len(a) or not len(b):
            return np.zeros((len(a), len(b)))
        ends = np.stack(np.broadcast_arrays(a[:, None], b[None, :]), axis=2)
        free = shapely.covers(self._wide, shapely.linestrings(ends))
        return np.where(free, np.hypot(*np.moveaxis(ends[:, :, 1] - ends[:, :, 0], -1, 0)), 0.0)


def _inner_corners(area: shapely.Geometry) -> Floats:
    """(C, 2) corners at which a shortest way may turn: those that point into the area."""
    simple, step = shapely.simplify(area, CLOSE), 0.25
    while len(found := _reflex(simple)) > MOST_CORNERS:
        simple = shapely.simplify(shapely.buffer(area, -step, join_style="mitre"), step)
        step *= 2.0
    return found


def _reflex(area: shapely.Geometry) -> Floats:
    found = [np.empty((0, 2))]
    for part in shapely.get_parts(area):
        if part.geom_type != "Polygon" or part.is_empty:
            continue
        whole = shapely.orient_polygons(part)  # the area is on the left of every ring
        for ring in (whole.exterior, *whole.interiors):
            at = shapely.get_coordinates(ring)[:-1]
            into, out = at - np.roll(at, 1, axis=0), np.roll(at, -1, axis=0) - at
            found.append(at[into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0] < 0.0])
    return np.concatenate(found)
