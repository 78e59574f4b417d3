"""The stamps of a recording whose computer's clock was set meanwhile, without its leaps.

A listener stamps by a clock that nobody sets; other programs write the computer's own. There a
leap of an hour looks like an hour of silence, and one back like a recording out of order. The
vehicle's clock says how much time really went by.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.flight import Floats

LEAP_US = 2_000_000  # by which stamps may part from the vehicle's clock: a slow link, two links


def steadied(
    stamps_us: NDArray[np.int64], boot_ms: Floats, system: NDArray[np.uint8]
) -> NDArray[np.int64]:
    """(n,) stamps, µs, that go on where a clock was set; the same ones where none was.

    `boot_ms` (n,) is the clock since boot that a message of `system` (n,) carries, NaN where none.
    Without it only a step back is known for one, and takes no time.
    """
    steps = np.diff(stamps_us)
    clocked = np.flatnonzero(np.isfinite(boot_ms))
    for row in np.flatnonzero((steps < -LEAP_US) | (steps > LEAP_US)).tolist():
        went = _went_by(stamps_us, boot_ms, system, clocked, row)
        if went is None or went < 0:  # not known, or the vehicle was started again
            steps[row] = max(int(steps[row]), 0)
        elif abs(int(steps[row]) - went) > LEAP_US:
            steps[row] = went
    return stamps_us[:1] + np.concatenate([[0], np.cumsum(steps)])[: stamps_us.size]


def _went_by(
    stamps_us: NDArray[np.int64],
    boot_ms: Floats,
    system: NDArray[np.uint8],
    clocked: NDArray[np.intp],
    row: int,
) -> int | None:
    """µs from a row to the next by the clock of a vehicle that is heard before and after."""
    place = int(np.searchsorted(clocked, row, side="right"))
    if place == 0:
        return None
    before = int(clocked[place - 1])
    later = clocked[place:]
    again = later[system[later] == system[before]]
    if not again.size:
        return None
    after = int(again[0])
    around = (stamps_us[row] - stamps_us[before]) + (stamps_us[after] - stamps_us[row + 1])
    return round(1000.0 * (boot_ms[after] - boot_ms[before])) - int(around)
