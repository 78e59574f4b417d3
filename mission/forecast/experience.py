"""Correct the forecast of a plan by how earlier missions of the aircraft differed from theirs.

Each mission that a known aircraft flew is compared with the forecast made by what was known before
it. From FEWEST_MISSIONS on, the mean difference corrects the next forecast, and the scatter of the
differences widens its interval.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean

from thrustmargin.models.physics.electric_power import NORMAL
from thrustmargin.models.scores import error_of_further

FEWEST_MISSIONS = 3
#: Standard deviations between missions before any is seen: of ln time and ln energy, and of
#: utilisation. Source: four missions of a heavy quad, Quiver PT1 (time 3 to 16 %, peak 14 points).
TIME_SCATTER, ENERGY_SCATTER, USE_SCATTER = 0.08, 0.12, 0.06


@dataclass(frozen=True, slots=True)
class SaidFlown:
    """A value of a mission as it was forecast and as it was flown; NaN where unknown."""

    said: float = math.nan
    flown: float = math.nan

    @property
    def difference(self) -> float:
        """Return flown minus forecast."""
        return self.flown - self.said

    @property
    def log_ratio(self) -> float:
        """Return ln of flown over forecast; NaN where one is not above 0."""
        known = self.said > 0.0 and self.flown > 0.0
        return math.log(self.flown / self.said) if known else math.nan


@dataclass(frozen=True, slots=True, kw_only=True)
class FlownMission:
    """Forecast and flown values of one mission, over the stretches that were flown as planned."""

    stretches: int
    complete: bool  # all of the plan was flown
    seconds: SaidFlown
    energy_wh: SaidFlown
    leg_use: SaidFlown  # mean utilisation of the most used rotor on level legs
    peak_use: SaidFlown  # largest utilisation in any stretch


@dataclass(frozen=True, slots=True)
class Correction:
    """A mean difference of flown from forecast, and its standard error for one mission more."""

    mean: float
    error: float


NO_CORRECTION = Correction(0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Experience:
    """The corrections that the earlier missions of an aircraft show; a value that fewer than
    FEWEST_MISSIONS of them know is not corrected.
    """

    missions: int
    seconds: Correction = NO_CORRECTION  # of ln
    energy: Correction = NO_CORRECTION  # of ln
    leg_use: Correction = NO_CORRECTION
    peak_use: Correction = NO_CORRECTION


def experience(missions: Sequence[FlownMission]) -> Experience | None:
    """Return corrections of a forecast by the differences that earlier missions had from theirs.

    None with fewer than FEWEST_MISSIONS.
    """
    if len(missions) < FEWEST_MISSIONS:
        return None
    return Experience(
        missions=len(missions),
        seconds=_correction([one.seconds.log_ratio for one in missions], TIME_SCATTER),
        energy=_correction([one.energy_wh.log_ratio for one in missions], ENERGY_SCATTER),
        leg_use=_correction([one.leg_use.difference for one in missions], USE_SCATTER),
        peak_use=_correction([one.peak_use.difference for one in missions], USE_SCATTER),
    )


def _correction(differences: Sequence[float], prior: float) -> Correction:
    """Return the mean of the finite differences, and the standard error of a further mission's.

    `prior` is the prior standard deviation between missions. NO_CORRECTION with fewer than
    FEWEST_MISSIONS finite differences.
    """
    known = [value for value in differences if math.isfinite(value)]
    if len(known) < FEWEST_MISSIONS:
        return NO_CORRECTION
    middle = fmean(known)
    return Correction(middle, error_of_further(known, middle, prior=prior))


Interval = tuple[float, float, float]  # value, lower end, upper end


@dataclass(frozen=True, slots=True, kw_only=True)
class AsFlown:
    """A forecast corrected by earlier missions, each value with its widened 90 % interval."""

    missions: int
    seconds: Interval
    typical: Interval  # utilisation that lasts
    peak: Interval  # utilisation


def corrected_factor(value: float, correction: Correction, error: float = 0.0) -> Interval:
    """Return a positive value with its 90 % interval after a correction of its ln.

    `error` is the standard error of ln of the value itself.
    """
    middle, reach = value * math.exp(correction.mean), NORMAL * math.hypot(error, correction.error)
    return middle, middle * math.exp(-reach), middle * math.exp(reach)


def corrected_use(value: float, low: float, high: float, correction: Correction) -> Interval:
    """Return a utilisation plus a mean correction, and the ends of its 90 % interval.

    `low` and `high` are the 90 % interval of `value`, to which the correction's error is added in
    squares.
    """
    middle, spread = value + correction.mean, NORMAL * correction.error
    return (
        middle,
        middle - math.hypot(value - low, spread),
        middle + math.hypot(high - value, spread),
    )
