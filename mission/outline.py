"""Check the outline of a field in degrees, and project it to the plane where lines are laid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pymap3d
import shapely

from thrustmargin.models.errors import PlanError
from thrustmargin.models.flight import Floats

#: m across beyond which something is no field, and a plane no map of it.
WIDEST = 50_000.0
#: m² below which an outline is no field.
SMALLEST = 1.0
#: Corners at most, of all its parts.
MOST_CORNERS = 10_000


class TooWide(PlanError):
    """Raised when polygons lie too far apart for one field."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalPlane:
    """The plane (east, north) in m about a place in degrees; exact to a millimetre over a field."""

    latitude_deg: float
    longitude_deg: float

    def to_plane(self, geometry: Any) -> Any:
        """Convert a shapely geometry from longitude, latitude, degrees, to (east, north), m."""
        return shapely.transform(geometry, self._east_north)

    def _east_north(self, degrees: Floats) -> Floats:
        east, north, _ = pymap3d.geodetic2enu(
            degrees[:, 1], degrees[:, 0], 0.0, self.latitude_deg, self.longitude_deg, 0.0
        )
        return np.column_stack([east, north])

    def point(self, latitude_deg: float, longitude_deg: float) -> Floats:
        """Return east, north and up (3,), m, of a place on the ellipsoid."""
        here = (self.latitude_deg, self.longitude_deg, 0.0)
        return np.array(pymap3d.geodetic2enu(latitude_deg, longitude_deg, 0.0, *here))

    def to_degrees(self, points: Floats) -> Floats:
        """Return latitude and longitude (N, 2), degrees rounded to 1e-7, of east and north (N,
        2), m."""
        latitude, longitude, _ = pymap3d.enu2geodetic(
            points[:, 0],
            points[:, 1],
            np.zeros(len(points)),
            self.latitude_deg,
            self.longitude_deg,
            0.0,
        )
        degrees = np.column_stack([latitude, longitude]).round(7)
        degrees[degrees[:, 1] > 180.0, 1] -= 360.0
        return degrees


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FieldOutline:
    """A field, which may have several parts and holes."""

    name: str
    plane: LocalPlane
    area: shapely.MultiPolygon  # (east, north) in m of `plane`


def field_outline(
    name: str, polygons: Sequence[shapely.Polygon], plane: LocalPlane | None = None
) -> FieldOutline:
    """Return the field called `name` of polygons in longitude, latitude, degrees, as an area in
    `plane`, m; None makes a plane at the field.

    Raise PlanError if there is no polygon or too many corners, if the polygons are not on Earth or
    cross themselves, or if the field is wider than WIDEST m (TooWide) or smaller than SMALLEST m².
    """
    corners = sum(int(shapely.get_num_coordinates(p)) for p in polygons)
    if not polygons or corners == 0:
        raise PlanError(f"{name} has no polygon; draw the field's outline and save it again")
    if corners > MOST_CORNERS:
        raise PlanError(f"{name} has {corners} corners, over {MOST_CORNERS}; simplify its outline")
    every = shapely.get_coordinates(list(polygons))
    if not np.isfinite(every).all():
        raise PlanError(f"{name} has a corner that is no number; draw it again")
    if np.abs(every[:, 1]).max() > 90.0 or np.abs(every[:, 0]).max() > 360.0:
        raise PlanError(
            f"{name} has a corner at latitude {every[0, 1]:.7g}, longitude {every[0, 0]:.7g}; "
            "degrees are needed: save it in WGS 84"
        )
    plane = plane or _plane_of(every)
    shapes = [plane.to_plane(p) for p in polygons]
    low, high = np.array(shapely.total_bounds(shapes)).reshape(2, 2)
    if not np.max(high - low) <= WIDEST:
        raise TooWide(f"{name} is {np.max(high - low) / 1e3:.0f} km across, which is no field")
    for shape in shapes:
        if not shape.is_valid:
            raise PlanError(f"{name} {_fault(shape, plane)}; draw it again")
    whole = shapely.union_all(shapes)
    parts = [p for p in shapely.get_parts(whole) if p.geom_type == "Polygon" and p.area > 0.0]
    if sum(p.area for p in parts) < SMALLEST:
        raise PlanError(f"{name} has an area below {SMALLEST:g} m², which is no field")
    return FieldOutline(name=name, plane=plane, area=shapely.MultiPolygon(parts))


def _plane_of(degrees: Floats) -> LocalPlane:
    """Return the local plane about the middle of the corners (N, 2), longitude and latitude,
    degrees.

    The longitudes may cross the date line.
    """
    first = degrees[0, 0]
    longitude = first + (degrees[:, 0] - first + 180.0) % 360.0 - 180.0
    middle = (longitude.min() + longitude.max()) / 2
    return LocalPlane(
        latitude_deg=float((degrees[:, 1].min() + degrees[:, 1].max()) / 2),
        longitude_deg=float((middle + 180.0) % 360.0 - 180.0),
    )


def _fault(shape: shapely.Polygon, plane: LocalPlane) -> str:
    """Return the fault of a polygon and its place: `crosses itself near latitude 1, longitude
    2`.
    """
    reason = shapely.is_valid_reason(shape)
    words, _, place = reason.rstrip("]").partition("[")
    if words.strip() != "Self-intersection" or not place:
        return f"is no outline ({words.strip().lower() or 'no reason given'})"
    location = np.array([[float(x) for x in place.split()[:2]]])
    latitude, longitude = plane.to_degrees(location)[0]
    return f"crosses itself near latitude {latitude:.6f}, longitude {longitude:.6f}"
