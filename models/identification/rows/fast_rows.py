"""Estimate how late rotor speeds are, from variation that the means of a search average out.

A delay shorter than a bin hardly moves its mean. Within a bin, rows show that turns and gusts
arrive late. So the deviations of measured and predicted rows from their bin means are compared with
the changes that a delay would cause. Lasting effects are in the means and not in these deviations,
so no information is used twice.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.effects.base import Placed
from thrustmargin.models.effects.channels import LAG_STEP
from thrustmargin.models.effects.instrument_effects import ROTOR_SPEED_LAG
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.rows.noise import whitening_of
from thrustmargin.models.identification.rows.problem import Problem
from thrustmargin.models.network.records import GoodFlights, scatter_between

ENOUGH = 1_500  # rows: they determine a delay to 2 ms; telemetry itself repeats to 10 ms at best
STEPS = 3  # Gauss-Newton steps
UNKNOWN = np.array([0.0, np.inf])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reading:
    """Estimates of a candidate's only value from F flights, independent of the flights' means."""

    values: Floats  # (F,)
    errors: Floats  # (F,) standard deviations, infinite where a flight does not determine the value
    shared: float  # standard deviation of the error that all flights share

    @property
    def pooled(self) -> tuple[float, float]:
        """Return the weighted mean of all flights' values and its standard error."""
        weight = self.errors**-2.0
        value = float(np.average(self.values, weights=weight))
        return value, float(np.hypot(weight.sum() ** -0.5, self.shared))

    def without(self, flights: Collection[int]) -> Reading | None:
        """Return the reading with infinite errors in `flights`; None if no finite one remains."""
        errors = self.errors.copy()
        errors[list(flights)] = np.inf
        return replace(self, errors=errors) if np.isfinite(errors).any() else None


def delay_reading(delay_s: Floats, good: GoodFlights | None, resolution: float) -> Reading | None:
    """Return each flight's delay less that of the training flights, s, as a reading with errors.

    `delay_s` (F, 2) is delay and error, s; an error includes the larger scatter of both groups.
    `resolution`, s, is an error all flights share. None without `good`, its scatter or a delay.
    """
    values, errors = delay_s.T
    shown = np.isfinite(errors)
    if good is None or np.isnan(good.delay_scatter_s) or not shown.any():
        return None
    own = scatter_between(values[shown], errors[shown])
    return Reading(
        values=values - good.delay_s,
        errors=np.hypot(errors, np.fmax(own, good.delay_scatter_s)),
        shared=float(np.hypot(resolution, good.delay_scatter_s / good.flights**0.5)),
    )


def delay_of_rows(flight: Problem, bins: NDArray[np.intp]) -> Floats:
    """Estimate the delay of one flight's rotor speeds and its standard error (2,), s.

    `bins` (T,) is each row's bin, whose mean is removed. The error is infinite for motor outputs
    and without quick motion. It is at least the delay over the square root of twice its log
    likelihood ratio against no delay.
    """
    if flight.of_outputs or flight.lacks(ROTOR_SPEED_LAG):
        return UNKNOWN
    flight, bins = flight.rows(np.arange(min(ENOUGH, bins.size))), bins[:ENOUGH]
    measured = flight.mode_amplitudes(flight.measured_rpm)

    def remaining(delay: float) -> Floats:
        """Return the residual (T, R), rpm in modes, less its bin means, with a delay in s."""
        return _subtract_bin_means(measured - _predict_delayed(flight, delay), bins)

    (lag,) = ROTOR_SPEED_LAG.parameters
    # from zero, steps may end at another maximum
    tried = np.arange(lag.lower, lag.upper, lag.scale)
    best, shown = float(max(tried, key=lambda delay: _log_likelihood(remaining(delay)))), 0.0
    for _ in range(STEPS):
        residual = remaining(best)
        slope = (residual - remaining(best + LAG_STEP / 2)) / (LAG_STEP / 2)
        still = np.zeros(bins.size, dtype=np.bool_)
        filter_ = whitening_of(
            residual, flight.flight, flight.follows, still, float(flight.measured_rpm.mean())
        )
        if filter_.unfiltered.any():  # rows that rarely follow each other do not show quick motion
            return UNKNOWN
        z, d = filter_.apply(residual), filter_.apply(slope)
        shown = float(np.sum(d * d))
        if shown <= 0.0:
            return UNKNOWN
        best += float(np.sum(d * z)) / shown
    over_none = _log_likelihood(remaining(best)) - _log_likelihood(remaining(0.0))
    return np.array([best, max(shown**-0.5, abs(best) / np.sqrt(max(2.0 * over_none, 1.0)))])


def _log_likelihood(residual: Floats) -> float:
    """Return the log likelihood of a residual (T, R) in modes, each mode's noise at its
    best size."""
    return -0.5 * len(residual) * float(np.log(np.sum(residual**2, axis=0)).sum())


def _predict_delayed(flight: Problem, delay: float) -> Floats:
    """Return predicted mode amplitudes (T, R), rpm, with a delay in s."""
    placed = Placed(effect=ROTOR_SPEED_LAG, rotor=None, values={"lag": delay})
    return flight.mode_amplitudes(flight.speeds([placed]))


def _subtract_bin_means(values: Floats, bins: NDArray[np.intp]) -> Floats:
    """Return values (T, R) less the mean over each bin."""
    _, start, bin_of = np.unique(bins, return_index=True, return_inverse=True)
    mean = np.add.reduceat(values, start, axis=0) / np.bincount(bin_of)[:, None]
    return values - mean[bin_of]
