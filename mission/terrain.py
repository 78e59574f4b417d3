"""Read heights of the ground from a file, and the ground below a way.

Two formats are read, both documented and without a library: ESRI ASCII grid (`.asc`: six lines of
header, then rows from north to south) in degrees of WGS 84, and SRTM tiles (`.hgt`: one degree,
named by its south-west corner, big-endian 16 bit, rows from north to south). A GeoTIFF becomes the
first of them by gdalwarp.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from thrustmargin.models.errors import PlanError
from thrustmargin.models.flight import Floats
from thrustmargin.models.whole_file import regular

LARGEST_FILE = 256 * 2**20
ENDINGS = (".asc", ".hgt")
CONVERT = "gdalwarp -t_srs EPSG:4326 -of AAIGrid IN.tif OUT.asc"
#: Words of an ASCII grid's header; the corner or the centre of the south-west cell is given.
_HEADER = re.compile(r"\s*([A-Za-z_]+)\s+([-+.\dEe]+)\s*")
_SIZES = ("ncols", "nrows")
_TILE = re.compile(r"([NS])(\d{2})([EW])(\d{3})", re.IGNORECASE)
_VOID = -32768  # of a tile
_METRES_PER_DEGREE = 111_320.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Terrain:
    """Heights of the ground at the points of a grid in degrees, rows from north to south."""

    name: str  # of its file
    heights: Floats  # (M, N) m above the sea; NaN where the file has none
    north_deg: float  # latitude of the first row
    west_deg: float  # longitude of the first column
    step_deg: tuple[float, float]  # between rows, between columns

    @property
    def spacing(self) -> float:
        """Return the smaller distance between neighbouring points, m."""
        narrow = math.cos(math.radians(self.north_deg))
        return _METRES_PER_DEGREE * min(self.step_deg[0], self.step_deg[1] * max(narrow, 0.01))

    def height(self, latitude_deg: Floats, longitude_deg: Floats) -> Floats:
        """Interpolate the height (N,), m above the sea, at places (N,), degrees.

        NaN outside the grid, and next to a grid point without a height.
        """
        row = (self.north_deg - np.asarray(latitude_deg, np.float64)) / self.step_deg[0]
        column = (np.asarray(longitude_deg, np.float64) - self.west_deg) / self.step_deg[1]
        rows, columns = self.heights.shape
        inside = (row >= 0.0) & (row <= rows - 1) & (column >= 0.0) & (column <= columns - 1)
        top = np.clip(np.nan_to_num(row), 0, rows - 2).astype(int)
        left = np.clip(np.nan_to_num(column), 0, columns - 2).astype(int)
        down, right = row - top, column - left
        upper = self.heights[top, left] * (1.0 - right) + self.heights[top, left + 1] * right
        lower = (
            self.heights[top + 1, left] * (1.0 - right) + self.heights[top + 1, left + 1] * right
        )
        return np.where(inside, upper * (1.0 - down) + lower * down, np.nan)


def read_terrain(path: Path) -> Terrain:
    """Read an ESRI ASCII grid in degrees or an SRTM tile, by the ending of its name.

    Raise PlanError, with the remedy, for another file, a damaged one, or a grid in metres.
    """
    if path.suffix.lower() not in ENDINGS:
        raise PlanError(
            f"{path.name} is no heights of the ground that are read ({' or '.join(ENDINGS)}); "
            f"convert it: {CONVERT}"
        )
    try:
        if regular(path).stat().st_size > LARGEST_FILE:
            raise PlanError(
                f"{path.name} has more than {LARGEST_FILE >> 20} MiB; cut it to the field: "
                "gdalwarp -te WEST SOUTH EAST NORTH"
            )
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise PlanError(f"no file {path}; check its name and folder") from error
    except OSError as error:
        raise PlanError(f"{path} cannot be read: {error.strerror}") from error
    terrain = _tile(data, path) if path.suffix.lower() == ".hgt" else _grid(data, path)
    if min(terrain.heights.shape) < 2 or not np.isfinite(terrain.heights).any():
        raise PlanError(f"{path.name} has no heights; save it again")
    return terrain


def _tile(data: bytes, path: Path) -> Terrain:
    """Return the terrain in the bytes of an SRTM tile (.hgt): heights in m AMSL, NaN in voids.

    The stem of `path` states the tile's south-west corner (N48E011). Raise PlanError for another
    name, or if the bytes are no square of 16-bit heights.
    """
    corner = _TILE.match(path.stem)
    side = math.isqrt(len(data) // 2)
    if corner is None:
        raise PlanError(f"{path.name} does not name its corner; name it as N48E011.hgt")
    if 2 * side**2 != len(data) or side < 2:
        raise PlanError(
            f"{path.name} has {len(data)} bytes, which is no square of heights; copy it again"
        )
    heights = np.frombuffer(data, dtype=">i2").reshape(side, side).astype(np.float64)
    south = float(corner[2]) * (1.0 if corner[1].upper() == "N" else -1.0)
    west = float(corner[4]) * (1.0 if corner[3].upper() == "E" else -1.0)
    return Terrain(
        name=path.name,
        heights=np.where(heights == _VOID, np.nan, heights),
        north_deg=south + 1.0,
        west_deg=west,
        step_deg=(1.0 / (side - 1), 1.0 / (side - 1)),
    )


def _grid(data: bytes, path: Path) -> Terrain:
    """Return the terrain in the bytes of an ESRI ASCII grid in degrees: heights in m, NaN where it
    has no data.

    `path` serves for messages only. The value of no data is -9999 if the header states none. Raise
    PlanError for a damaged grid or one in metres.
    """
    lines = data.decode("ascii", errors="replace").splitlines()
    header: dict[str, float] = {}
    for line in lines:
        match = _HEADER.fullmatch(line)
        if match is None:
            break
        try:
            header[match[1].lower()] = float(match[2])
        except ValueError as error:
            raise PlanError(f"{path.name}: {line!r:.40} is no number; save it again") from error
    columns, rows = (int(header.get(name, 0)) for name in _SIZES)
    steps = header.get("dy", header.get("cellsize", 0.0)), header.get("cellsize", 0.0)
    steps = (steps[0], header.get("dx", steps[1]))
    lowest = [
        header.get(f"{axis}llcenter", header.get(f"{axis}llcorner", math.nan) + 0.5 * step)
        for axis, step in (("y", steps[0]), ("x", steps[1]))
    ]
    if columns < 1 or rows < 1 or not min(steps) > 0.0 or not np.isfinite(lowest).all():
        raise PlanError(
            f"{path.name} is no ESRI ASCII grid: its header needs ncols, nrows, xllcorner, "
            f"yllcorner and cellsize; convert it: {CONVERT}"
        )
    south, west = lowest
    if not (abs(south) <= 90.0 and abs(west) <= 180.0 and max(steps) < 1.0):
        raise PlanError(
            f"{path.name} is in metres of a map, with its corner at {west:.0f}, {south:.0f}; "
            f"degrees are needed: {CONVERT}"
        )
    try:
        values = np.array(" ".join(lines[len(header) :]).split(), dtype=np.float64)
    except ValueError as error:
        raise PlanError(f"{path.name} has a word where a height belongs; save it again") from error
    if values.size != rows * columns:
        raise PlanError(
            f"{path.name} has {values.size} heights where {rows} x {columns} are due; save it again"
        )
    values[values == header.get("nodata_value", -9999.0)] = np.nan
    return Terrain(
        name=path.name,
        heights=values.reshape(rows, columns),
        north_deg=south + (rows - 1) * steps[0],
        west_deg=west,
        step_deg=steps,
    )
