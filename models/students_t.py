"""Student's t for a whole number of degrees of freedom, whose distribution has a closed form.

`scipy.special` takes longer to import than a flight takes to read and analyse.
"""

from __future__ import annotations

import math
from functools import lru_cache


@lru_cache(maxsize=256)
def t_quantile(degrees: int, level: float) -> float:
    """What Student's t with so many degrees of freedom stays below with probability `level`.

    NaN without a degree of freedom; `level` is below 1 and at least a half.
    """
    if degrees < 1:
        return math.nan
    low, high = 0.0, 1.0
    while _within(high, degrees) < 2.0 * level - 1.0:
        low, high = high, 2.0 * high
    while low < (middle := (low + high) / 2.0) < high:
        below = _within(middle, degrees) < 2.0 * level - 1.0
        low, high = (middle, high) if below else (low, middle)
    return high


def _within(t: float, degrees: int) -> float:
    """Probability of at most t on either side: Abramowitz and Stegun 26.7.3 and 26.7.4."""
    square = degrees / (degrees + t * t)  # of the cosine of atan(t / sqrt(degrees))
    odd = degrees % 2
    total, term = 0.0, math.sqrt(square) if odd else 1.0
    for k in range(1 + odd, degrees, 2):
        total += term
        term *= square * k / (k + 1)
    total *= t / math.sqrt(degrees + t * t)
    return (math.atan(t / math.sqrt(degrees)) + total) * 2.0 / math.pi if odd else total
