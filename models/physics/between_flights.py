"""Estimate a value of a further flight from its values in earlier flights of the same aircraft.

Flights of one aircraft differ by more than each is unsure, and a few of them do not show by how
much. Their scatter is therefore drawn towards a prior one, which counts as PRIOR_FLIGHTS flights.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

PRIOR_FLIGHTS = 3.0


def error_of_further(
    values: Sequence[float], middle: float, *, prior: float, independent: int | None = None
) -> float:
    """Return the standard error of one further value about `middle`, the mean of the F `values`.

    `prior` is the standard deviation between flights before any is seen. `independent` is the
    number of values that the mean counts as, F without it: flights of one day are not independent.
    """
    squares = PRIOR_FLIGHTS * prior**2 + sum((value - middle) ** 2 for value in values)
    scatter = squares / (PRIOR_FLIGHTS + len(values) - 1)
    return math.sqrt(scatter * (1.0 + 1.0 / (independent or len(values))))
