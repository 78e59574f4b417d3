"""The one rule of all screens for thrust left: how it is rounded, and when it is too little.

Words, gauges, colours, alarms and the discs of the 3D scene use it, so that none contradicts
another. Thrust left is a share of a rotor's maximum thrust, and `least` the share that must be
left: one minus the option --max-utilisation.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thrustmargin.gcs_plugin.wording.language import known, number, say
from thrustmargin.models.flight import Bools, Floats

#: Share above `least` up to which thrust that was too little still counts as too little: a rotor
#: that works at the limit would change its colour with every gust.
HYSTERESIS = 0.03
#: Of a share; 1e-6 %, by which a number that is whole but for its last bits is not rounded down.
ROUNDING = 1e-8


def percent_down(share: float) -> int:
    """Return a share of thrust left in whole per cent, rounded down, so that too little reads
    so."""
    return math.floor(100.0 * (share + ROUNDING))


def percent_up(share: float) -> int:
    """Return the upper end of an interval of thrust left, a share, in whole per cent, rounded
    up."""
    return math.ceil(100.0 * (share - ROUNDING))


def left_words(share: float | None, low: float = math.nan, high: float = math.nan) -> str:
    """Return thrust left as `45 %`, with its interval as `45 % (40 to 50)`.

    `share`, `low` and `high` are shares; only the high end is rounded up. `none` for a negative
    share, of a rotor that worked harder than its airframe allows; `unknown` for NaN and None.
    """
    if not known(share):
        return number(None)
    words = say("none") if percent_down(share) < 0 else number(percent_down(share), "%", 0)
    if not (known(low) and known(high)) or high - low < 1e-9:
        return words
    ends = (max(percent_down(low), 0), max(percent_up(high), 0))
    return f"{words} ({number(ends[0], '', 0)} {say('to')} {number(ends[1], '', 0)})"


def least_words(max_utilisation: float) -> str:
    """Return the least thrust that must be left, `50 %`, from the largest share that may be in
    use."""
    return left_words(1.0 - max_utilisation)


def below(left: ArrayLike, least: float) -> Bools:
    """Flag where thrust left, a share of any shape, is below `least`; False for NaN.

    For a `least` of whole per cent these are exactly the values that are displayed as less.
    """
    return np.asarray(left, dtype=np.float64) + ROUNDING < least


def clear(left: ArrayLike, least: float) -> Bools:
    """Flag where thrust left, a share of any shape, exceeds `least` by more than HYSTERESIS.

    There "too little" ends. False for NaN.
    """
    return np.asarray(left, dtype=np.float64) > least + HYSTERESIS


def too_little(left: Floats, least: float, before: ArrayLike = False) -> Bools:
    """Flag (T, R) where the thrust left, a share (T, R), is too little, with a hysteresis in time.

    It is from a row below `least` on, until a row HYSTERESIS above it. Between the two, and where
    NaN, the flag of the row before is kept; `before`, (R,) or a single value, is the flag before
    the first row.
    """
    low = below(left, least)
    row = np.arange(len(low))[:, None]
    decided = np.maximum.accumulate(np.where(low | clear(left, least), row, -1), axis=0)
    since: NDArray[np.bool_] = np.take_along_axis(low, np.maximum(decided, 0), axis=0)
    return np.where(decided >= 0, since, np.asarray(before, dtype=np.bool_))


def value_of_colour(left: Floats, least: float, low: Bools) -> Floats:
    """Return the value of thrust left, a share, to colour a point by; NaN stays NaN.

    Where the flag `low` (too little) and the value are on different sides of `least`, the value is
    moved to the flag's side.
    """
    least_low = np.nextafter(least, 0.0)
    return np.where(low, np.minimum(left, least_low), np.maximum(left, least))
