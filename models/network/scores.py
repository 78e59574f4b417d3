"""How well predicted rotor speeds agree with measured ones, with the flight as the unit.

    R2_i = 1 - sum (N_i - N_hat_i)^2 / sum (N_i - mean N_i)^2        overall R2 = mean over rotors

R2 is against the mean of the same rows, so flights with like tank levels get a lower R2 for the
same error in rpm: look at both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from thrustmargin.models.flight import Floats
from thrustmargin.models.network.training_rows import Rows

BOOTSTRAPS = 2000


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """Agreement on one set of rows; NaN where it has none."""

    rows: int
    flights: int
    r2_per_rotor: tuple[float, ...]
    rmse_per_rotor_rpm: tuple[float, ...]
    bias_per_rotor_rpm: tuple[float, ...]  # measured minus predicted
    r2_ci95: tuple[float, float] = (float("nan"), float("nan"))  # of the overall R2, by flights

    @property
    def r2(self) -> float:
        """Overall R²: the mean over rotors."""
        return float(np.mean(self.r2_per_rotor))

    @property
    def rmse_rpm(self) -> float:
        """Root mean square error over all rotors, rpm."""
        return float(np.sqrt(np.mean(np.square(self.rmse_per_rotor_rpm))))


def score(measured_rpm: Floats, predicted_rpm: Floats, flight: Rows) -> Score:
    """Score of predictions (N, R) against measurements (N, R) of rows of `flight` (N,)."""
    rows, rotors = measured_rpm.shape
    if rows == 0:
        nothing = (float("nan"),) * rotors
        return Score(
            rows=0,
            flights=0,
            r2_per_rotor=nothing,
            rmse_per_rotor_rpm=nothing,
            bias_per_rotor_rpm=nothing,
        )
    error = measured_rpm - predicted_rpm
    return Score(
        rows=rows,
        flights=int(np.unique(flight).size),
        r2_per_rotor=tuple(r2_per_rotor(measured_rpm, predicted_rpm).tolist()),
        rmse_per_rotor_rpm=tuple(np.sqrt(np.mean(error**2, axis=0)).tolist()),
        bias_per_rotor_rpm=tuple(error.mean(axis=0).tolist()),
    )


def r2_per_rotor(measured_rpm: Floats, predicted_rpm: Floats) -> Floats:
    """(R,) coefficient of determination; NaN for a rotor whose speed does not vary."""
    total = np.sum((measured_rpm - measured_rpm.mean(axis=0)) ** 2, axis=0)
    left = np.sum((measured_rpm - predicted_rpm) ** 2, axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(total > 0.0, 1.0 - left / total, np.nan)


def r2_interval(
    measured_rpm: Floats, predicted_rpm: Floats, flight: Rows, *, seed: int
) -> tuple[float, float]:
    """95 % interval of the overall R² by drawing whole flights anew, with replacement.

    Percentiles of 2000 draws; NaN for fewer than 3 flights.
    """
    labels, which = np.unique(flight, return_inverse=True)
    if labels.size < 3:
        return (float("nan"), float("nan"))
    centre = measured_rpm - measured_rpm.mean(axis=0)  # large offsets cost digits
    sums = [
        np.stack([np.bincount(which, weights=column, minlength=labels.size) for column in part.T])
        for part in (centre, centre**2, (measured_rpm - predicted_rpm) ** 2)
    ]
    count = np.bincount(which, minlength=labels.size).astype(np.float64)
    rng = np.random.default_rng(seed)
    drawn = rng.multinomial(labels.size, np.full(labels.size, 1.0 / labels.size), size=BOOTSTRAPS)
    first, second, left = (drawn @ part.T for part in sums)
    total = second - first**2 / (drawn @ count)[:, None]
    low, high = np.percentile(np.mean(1.0 - left / total, axis=1), [2.5, 97.5])
    return (float(low), float(high))
