"""Clocks that leap, fall back or pause: shared by the readers of every format."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import median_filter

from thrustmargin.models.errors import LogError
from thrustmargin.models.flight import Floats

BACKWARD = 1.0  # s; a clock that falls by more has been restarted
FORWARD = 5.0  # s; a larger step from message to message is looked at twice
GAP = 1.0  # s without any message
_MANY = 10  # falls in one log that no vehicle restarts


@dataclass(frozen=True, slots=True)
class Stretch:
    """The longest run of rows between two restarts: `first` to `last`, both kept."""

    first: int
    last: int
    size: int  # rows in all
    jumps: tuple[tuple[float, float], ...] = ()  # (before, after) s at every restart
    notes: tuple[str, ...] = ()


def longest_stretch(time_s: Floats, name: str) -> Stretch:
    """Where time (n,) in file order runs forward longest.

    Lone late messages are no restart. Raises LogError when two clocks run in turns, as two
    vehicles of one system id do.
    """
    last = time_s.size - 1
    if last < 1 or not np.any(np.diff(time_s) < -BACKWARD):
        return Stretch(0, last, time_s.size)
    smooth = median_filter(time_s, 5, mode="nearest") if time_s.size >= 5 else time_s
    falls = np.flatnonzero(np.diff(smooth) < -BACKWARD) + 1
    if falls.size == 0:
        return Stretch(0, last, time_s.size)
    edges = np.concatenate([[0], falls, [time_s.size]])
    spans = [float(smooth[b - 1] - smooth[a]) for a, b in pairwise(edges)]
    # By messages, not by seconds: a leap forward would make a stretch long.
    best = int(np.argmax(np.diff(edges)))
    if falls.size > _MANY and edges[best + 1] - edges[best] < 0.5 * time_s.size:
        raise LogError(
            f"{name}: the clock jumps back {falls.size} times, as when two vehicles share one "
            "system id; give each its own and record again"
        )
    jumps = tuple((float(time_s[f - 1]), float(time_s[f])) for f in falls)
    note = (
        f"time went backwards {falls.size} time(s) (restart): the longest stretch of "
        f"{spans[best]:.0f} s is kept, {sum(spans) - spans[best]:.0f} s in the others are dropped"
    )
    return Stretch(int(edges[best]), int(edges[best + 1]) - 1, time_s.size, jumps, (note,))


def without_leaps(time_s: Floats) -> Floats:
    """Times (n,) with lone leaps (a damaged time field) as NaN."""
    step = np.diff(time_s)
    odd = np.flatnonzero((step < -BACKWARD) | (step > FORWARD))
    if time_s.size < 5 or odd.size == 0:
        return time_s
    # Only rows next to an odd step can be leaps; each is held against the median of five.
    rows = np.unique(np.clip(odd[:, None] + np.arange(-1, 3), 0, time_s.size - 1))
    # The first and last row have neighbours on one side only: two of five are their own time.
    centre = np.clip(rows, 1, time_s.size - 2)
    around = np.clip(centre[:, None] + np.arange(-2, 3), 0, time_s.size - 1)
    middle = np.median(time_s[around], axis=1)
    repaired = time_s.copy()
    repaired[rows[np.abs(time_s[rows] - middle) > FORWARD]] = np.nan
    return repaired


def pauses(time_s: Floats) -> tuple[tuple[float, float], ...]:
    """(start, length) s of every pause longer than GAP."""
    if time_s.size < 2:
        return ()
    ordered = time_s if np.all(np.diff(time_s) >= 0) else np.sort(time_s, kind="stable")
    late = np.flatnonzero(np.diff(ordered) > GAP)
    return tuple((float(ordered[i]), float(ordered[i + 1] - ordered[i])) for i in late)
