"""Quantiles of Student's t for a whole number of degrees of freedom.

`scipy.special` has them too; loading it takes as long as the rest of a report does.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

#: Each halves what is left of a quarter turn: below what a float tells apart.
HALVINGS = 60


@lru_cache(maxsize=256)
def t_quantile(freedom: int, level: float) -> float:
    """What t stays below with probability `level`, 0 to 1, by `freedom` degrees, from 1.

    Abramowitz and Stegun 26.7.3 and 26.7.4: with t = tan(a) sqrt(freedom) the probability within
    +-t is a finite sum of powers of cos a; a is found by halving. NaN for other arguments.
    """
    if freedom < 1 or not 0.0 < level < 1.0:
        return math.nan
    odd = freedom % 2
    # (1/2)(3/4)(5/6)... of an even number, (2/3)(4/5)... of an odd one
    top = np.arange(1 + odd, freedom - 2 + odd, 2.0)
    factors = np.concatenate([[1.0], np.cumprod(top / (top + 1.0))])[: (freedom - odd + 1) // 2]
    powers = odd + 2.0 * np.arange(factors.size)

    def within(angle: float) -> float:
        total = math.sin(angle) * float(factors @ np.cos(angle) ** powers)
        return 2.0 / math.pi * (angle + total * (freedom > 1)) if odd else total

    wanted, low, high = abs(2.0 * level - 1.0), 0.0, math.pi / 2
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        low, high = (middle, high) if within(middle) < wanted else (low, middle)
    return math.copysign(math.tan(low) * math.sqrt(freedom), level - 0.5)
