"""Read a file into one padded byte array, and name the largest damaged places."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.telemetry.recording import Damage

_WORST_PLACES = 20


def read_bytes(path: Path, padding: int) -> tuple[NDArray[np.uint8], int]:
    """The file and `padding` zeros after it, and the file's own size.

    Read, not mapped: a file that another program cuts short must not kill this one.
    """
    size = path.stat().st_size
    data = np.empty(size + padding, dtype=np.uint8)
    with path.open("rb") as file:
        got = file.readinto(data[:size].data)
    data[got:] = 0
    return data, got


def worst_places(
    skipped: Sequence[tuple[int, int]], time_before: Callable[[int], float]
) -> tuple[Damage, ...]:
    """The longest of the skipped stretches (offset, length), in file order."""
    worst = sorted(skipped, key=lambda place: -place[1])[:_WORST_PLACES]
    return tuple(Damage(byte, length, time_before(byte)) for byte, length in sorted(worst))
