"""Heights of the ground made for tests, in the two formats that are read."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

METRES_PER_DEGREE = 111_320.0


def ascii_grid(
    path: Path,
    height: Callable[[float], float],
    *,
    south: float = 47.998,
    west: float = 10.998,
    size: tuple[int, int] = (60, 40),
    step: float = 0.0001,
    head: str = "xllcenter {west}\nyllcenter {south}\n",
) -> Path:
    """Write an ESRI ASCII grid of `height`, m, by latitude, degrees."""
    rows, columns = size
    lines = [
        " ".join([f"{height(south + (rows - 1 - row) * step):.3f}"] * columns)
        for row in range(rows)
    ]
    corner = head.format(west=west, south=south)
    top = f"ncols {columns}\nnrows {rows}\n{corner}cellsize {step}\nNODATA_value -9999\n"
    path.write_text(top + "\n".join(lines) + "\n", encoding="ascii")
    return path


def north_slope(latitude: float) -> float:
    """Return a slope of 30 % to the north, from 500 m at latitude 48 on."""
    return 500.0 + 0.3 * max(latitude - 48.0, 0.0) * METRES_PER_DEGREE


def tile(folder: Path, name: str, heights: np.ndarray) -> Path:
    """Write an SRTM tile of heights, m, rows from north to south."""
    path = folder / name
    path.write_bytes(heights.astype(">i2").tobytes())
    return path
