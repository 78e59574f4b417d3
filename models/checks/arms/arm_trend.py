"""Find arms that need more and more power, by all flights of an aircraft.

Each flight gives each arm's power over N³ against the median of the arms, so that air and battery
do not count. Its mean over each day's flights is fitted by a line in the number of the flight. The
days, not the flights, are independent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from thrustmargin.models.checks.arms.arm_figures import ArmFigures, ArmQuantity

FEWEST_DAYS = 6
#: Expected false entries of one aircraft, over all its arms, as in a season's changes.
FALSE_ENTRIES = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerTrend:
    """An arm, counted from 0, whose power at equal speed changed over the flights, as a share."""

    arm: int
    change: float  # from the first flight to the last; above 0: more power
    lower: float  # 95 % interval
    upper: float
    flights: int


def power_trends(flights: Sequence[ArmFigures]) -> tuple[PowerTrend, ...]:
    """Return the arms whose power rose significantly over `flights`, relative to the median arm.

    `flights` are ordered by time. Each trend has the change from first to last flight as a share,
    with its 95 % interval; `arm` is from 0. Empty with fewer than FEWEST_DAYS days with every arm's
    power.
    """
    from scipy.special import stdtrit

    seen = [(one.day, found) for one in flights if (found := one.of(ArmQuantity.POWER))]
    if not seen:
        return ()
    power = np.array([found.value for _, found in seen])
    known = np.isfinite(power).all(axis=1)
    day = np.array([day for day, _ in seen], dtype=np.int64)[known]
    power, number = power[known], np.flatnonzero(known).astype(np.float64)
    numbers, which = np.unique(day, return_inverse=True)
    if numbers.size < FEWEST_DAYS:
        return ()
    power = power - np.median(power, axis=1, keepdims=True)
    count = np.bincount(which)
    at = np.bincount(which, weights=number) / count
    means = np.stack([np.bincount(which, weights=arm) / count for arm in power.T], axis=1)
    at = at - at.mean()
    slope = at @ means / (at @ at)
    left = means - means.mean(axis=0) - np.outer(at, slope)
    freedom = numbers.size - 2
    error = np.sqrt(np.sum(left**2, axis=0) / freedom / (at @ at))
    span = number[-1] - number[0]
    sure = float(stdtrit(freedom, 1.0 - 0.5 * FALSE_ENTRIES / power.shape[1]))
    reach = float(stdtrit(freedom, 0.975))
    return tuple(
        PowerTrend(
            arm=arm,
            change=float(np.expm1(slope[arm] * span)),
            lower=float(np.expm1((slope[arm] - reach * error[arm]) * span)),
            upper=float(np.expm1((slope[arm] + reach * error[arm]) * span)),
            flights=len(number),
        )
        for arm in range(power.shape[1])
        if slope[arm] > sure * error[arm]
    )
