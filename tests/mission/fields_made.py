"""Fields made for tests, of sizes that are reckoned by hand."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from thrustmargin.mission.outline import FieldOutline, LocalPlane, field_outline

PLANE = LocalPlane(latitude_deg=48.0, longitude_deg=11.0)


def degrees(area: Any) -> Any:
    """A shape of (east, north) m as longitude, latitude."""
    return shapely.transform(area, lambda points: PLANE.to_degrees(points)[:, ::-1])


def outline(*areas: Any) -> FieldOutline:
    return field_outline("made", [degrees(area) for area in areas], PLANE)


def rectangle(width: float = 300.0, height: float = 200.0, *, at: tuple[float, float] = (0, 0)):
    return shapely.box(at[0], at[1], at[0] + width, at[1] + height)


#: Shape by name and its area in m², reckoned by hand.
SHAPES = {
    "square": ([rectangle()], 60_000.0),
    "L": ([rectangle() - rectangle(150, 100, at=(150, 100))], 45_000.0),
    "U": ([rectangle() - rectangle(100, 120, at=(100, 80))], 48_000.0),
    "hole": ([rectangle(400, 300) - rectangle(70, 80, at=(150, 100))], 114_400.0),
    "split": ([rectangle(200, 150), rectangle(160, 200, at=(260, 20))], 62_000.0),
    "circle": ([shapely.Point(0, 0).buffer(150, quad_segs=64)], math.pi * 150**2),
    "triangle": ([shapely.Polygon([(0, 0), (400, 0), (100, 300)])], 60_000.0),
}


def geojson(area: Any, folder: Path, name: str = "field.geojson") -> Path:
    path = folder / name
    path.write_text(json.dumps(shapely.geometry.mapping(degrees(area))))
    return path


def comb(teeth: int, deep: float = 60.0) -> Any:
    """A field whose edge goes in and out `teeth` times on the way round."""
    turn = np.linspace(0.0, 2.0 * math.pi, 2 * teeth, endpoint=False)
    far = np.where(np.arange(2 * teeth) % 2 == 0, 700.0, 700.0 + deep)
    return shapely.Polygon(np.column_stack([far * np.cos(turn), far * np.sin(turn)]))
