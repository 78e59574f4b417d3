"""Compute how well predicted rotor speeds agree with measured ones, with intervals.

    e = y - y_hat     RMSE = sqrt(mean e²)     bias = mean e     R² = 1 - sum e² / sum (y - mean y)²

Every figure follows from sums over rows, so resampling only needs other sums. R² is relative to the
mean of the same rows: flights with similar tank levels get a lower R² for the same error in rpm.

Rows of one flight are correlated, so their number does not determine the uncertainty. There are
three resampling schemes, by the intended generalisation: to other flights (`by_flight`), other days
of the same flights (`by_block`, cluster bootstrap), and the rest of one flight (`by_moving_block`,
Kuensch 1989).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.flight import Bools, Floats

CONFIDENCE = 0.95
DRAWS = 2000
#: Fewest blocks of a flight from which its spread can be estimated.
FEWEST_BLOCKS = 5
#: Number of flights that a prior scatter between the flights of an aircraft counts as.
PRIOR_FLIGHTS = 3.0
#: Columns of the sums: rows, errors, squares, measured about its mean, its squares, rows inside
#: the interval of the prediction, rows that have one.
N, E, EE, Y, YY, INSIDE, BOUNDED = range(7)

Sums = Floats  # (..., 7)


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """Agreement on one set of rows; NaN where undefined."""

    rows: int
    flights: int
    r2_per_rotor: tuple[float, ...]
    rmse_per_rotor_rpm: tuple[float, ...]
    bias_per_rotor_rpm: tuple[float, ...]  # measured minus predicted
    r2_ci95: tuple[float, float] = (float("nan"), float("nan"))  # of the overall R2, by flights

    @property
    def r2(self) -> float:
        """Return the overall R²: the mean over rotors."""
        return float(np.mean(self.r2_per_rotor))

    @property
    def rmse_rpm(self) -> float:
        """Return the root mean square error over all rotors, rpm."""
        return float(np.sqrt(np.mean(np.square(self.rmse_per_rotor_rpm))))


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A figure with its 95 % interval; the ends are NaN where there is too little data for one."""

    value: float
    low: float
    high: float

    @property
    def bounded(self) -> bool:
        """Return True if the interval is known; without one no difference can be significant."""
        return math.isfinite(self.low) and math.isfinite(self.high)


def error_terms(
    measured: Floats,
    predicted: Floats,
    *,
    lower: Floats | None = None,
    upper: Floats | None = None,
    rows: Bools | None = None,
) -> Sums:
    """Return terms (T, R, 7) of speeds (T, R), rpm, from whose sums RMSE, R² and others follow.

    In order: row counts (0 or 1), error, its square, measured speed, its square, inside the
    interval, has an interval. Error is measured minus predicted; measured speed is relative to each
    rotor's mean, so that squares do not cancel digits. All are 0 where a speed is unknown or a row
    is not flagged in `rows` (T,). `lower` and `upper` (T, R) are the ends of the intervals.
    """
    good = np.isfinite(measured) & np.isfinite(predicted)
    if rows is not None:
        good &= rows[:, None]
    error = np.where(good, measured - predicted, 0.0)
    count = np.maximum(good.sum(axis=0), 1)
    about = np.where(good, measured - np.where(good, measured, 0.0).sum(axis=0) / count, 0.0)
    bounded = inside = np.zeros_like(good)
    if lower is not None and upper is not None:
        bounded = good & np.isfinite(lower) & np.isfinite(upper)
        inside = bounded & (measured >= lower) & (measured <= upper)
    columns = [good, error, error**2, about, about**2, inside, bounded]
    return np.stack(columns, axis=-1).astype(np.float64)


def rmse(s: Sums) -> Floats:
    """Return the root mean square error (...), rpm, from sums (..., 7); NaN without rows."""
    return np.sqrt(_over(s[..., EE], s[..., N]))


def bias(s: Sums) -> Floats:
    """Return the mean of measured minus predicted (...), rpm, from sums (..., 7)."""
    return _over(s[..., E], s[..., N])


def r2(s: Sums) -> Floats:
    """Return the coefficient of determination R² (...) from sums (..., 7).

    NaN for a measured speed that does not vary.
    """
    return 1.0 - _over(s[..., EE], s[..., YY] - _over(s[..., Y] ** 2, s[..., N]))


def mean_r2(s: Sums) -> Floats:
    """Return the mean R² over the rotors (last but one axis) that have one."""
    each = r2(s)
    known = np.isfinite(each)
    return _over(np.where(known, each, 0.0).sum(axis=-1), known.sum(axis=-1))


def coverage(s: Sums) -> Floats:
    """Return, from sums (..., 7), the share (...) of rows with an interval that are inside it."""
    return _over(s[..., INSIDE], s[..., BOUNDED])


def _over(top: Floats, bottom: Floats) -> Floats:
    """Divide; NaN where the denominator is not positive."""
    return np.divide(top, bottom, out=np.full(np.shape(top), np.nan), where=np.asarray(bottom) > 0)


def score(
    measured_rpm: Floats, predicted_rpm: Floats, flight: NDArray, *, seed: int | None = None
) -> Score:
    """Score predictions (N, R) against measurements (N, R), rpm; `flight` (N,) is each row's
    flight.

    With a `seed` of the bootstrap, and 3 flights or more, the overall R² has its 95 % interval;
    else the interval is NaN.
    """
    terms = error_terms(measured_rpm, predicted_rpm)
    whole = terms.sum(axis=0)
    flights = int(np.unique(flight).size)
    ends = (float("nan"), float("nan"))
    if seed is not None and flights > 2:
        ends = percentiles(mean_r2(by_flight(terms, flight, seed=seed)))
    return Score(
        rows=measured_rpm.shape[0],
        flights=flights,
        r2_per_rotor=tuple(r2(whole).tolist()),
        rmse_per_rotor_rpm=tuple(rmse(whole).tolist()),
        bias_per_rotor_rpm=tuple(bias(whole).tolist()),
        r2_ci95=ends,
    )


def by_flight(terms: Floats, flight: NDArray, *, seed: int = 0, draws: int = DRAWS) -> Sums:
    """Return bootstrap sums (draws, ...) of `terms` (T, ...): flights resampled with replacement.

    `flight` (T,) is each row's flight.
    """
    labels, which = np.unique(flight, return_inverse=True)
    sums = _group_sums(terms, which, labels.size)
    equal = np.full(labels.size, 1.0 / labels.size)
    drawn = np.random.default_rng(seed).multinomial(labels.size, equal, size=draws)
    return np.tensordot(drawn.astype(np.float64), sums, axes=1)


def by_block(
    terms: Floats, block: NDArray, block_flight: NDArray, *, seed: int = 0, draws: int = 400
) -> Sums:
    """Return bootstrap sums (draws, ...) of `terms` (T, ...) by blocks resampled within their
    flights.

    `block` (T,) numbers the rows' blocks, `block_flight` (B,) is the flight of each. Flights with
    only one block are resampled among themselves.
    """
    sums = _group_sums(terms, block, block_flight.size)
    of_flight = [np.flatnonzero(block_flight == f) for f in np.unique(block_flight)]
    groups = [mine for mine in of_flight if mine.size > 1]
    short = [mine for mine in of_flight if mine.size == 1]
    if short:
        groups.append(np.concatenate(short))
    generator = np.random.default_rng(seed)
    return np.stack(
        [
            sums[np.concatenate([generator.choice(mine, mine.size) for mine in groups])].sum(axis=0)
            for _ in range(draws)
        ]
    )


def by_moving_block(
    terms: Floats, time_s: Floats, *, block_s: float, seed: int = 0, draws: int = DRAWS
) -> tuple[Sums, int]:
    """Return bootstrap sums (draws, ...) of `terms` (T, ...) of one flight, by blocks of `block_s`
    s.

    `time_s` (T,) are the rows' times. A block starts at any row that leaves room for it. Also
    return the number of blocks in the flight; with fewer than FEWEST_BLOCKS the sums are NaN.
    """
    blocks = int((time_s[-1] - time_s[0]) // block_s)
    if blocks < FEWEST_BLOCKS:
        return np.full((1, *terms.shape[1:]), np.nan), blocks
    running = np.concatenate([np.zeros((1, *terms.shape[1:])), np.cumsum(terms, axis=0)])
    starts = np.flatnonzero(time_s <= time_s[-1] - block_s)
    of_block = running[np.searchsorted(time_s, time_s[starts] + block_s)] - running[starts]
    picks = np.random.default_rng(seed).integers(0, starts.size, (draws, blocks))
    drawn = np.zeros((draws, *terms.shape[1:]))
    for k in range(blocks):
        drawn += of_block[picks[:, k]]
    return drawn, blocks


def jackknife(figure: Callable[[Bools], Floats], block: NDArray) -> list[Estimate]:
    """Return the figures of all rows with their 95 % intervals, by omitting each block in turn.

    `figure` computes them from the rows (n,) in its mask, `block` (n,) numbers the rows' blocks.
    The scatter within blocks may be of any kind. Tukey 1958, Student's t. NaN ends for fewer than
    two blocks.
    """
    names = np.unique(block)
    values = figure(np.ones(block.size, dtype=np.bool_))
    reach = np.full_like(values, np.nan)
    if names.size > 1:
        without = np.stack([figure(block != name) for name in names])
        spread = np.sum((without - without.mean(axis=0)) ** 2, axis=0) * (1.0 - 1.0 / names.size)
        reach = t_quantile(names.size - 1, 0.5 + CONFIDENCE / 2) * np.sqrt(spread)
    found = zip(values.tolist(), reach.tolist(), strict=True)
    return [Estimate(value=value, low=value - off, high=value + off) for value, off in found]


def _group_sums(terms: Floats, which: NDArray, groups: int) -> Floats:
    """Sum the terms (T, ...) of each group (groups, ...)."""
    sums = np.zeros((groups, *terms.shape[1:]))
    np.add.at(sums, which, terms)
    return sums


def percentiles(drawn: Floats) -> tuple[float, float]:
    """Return the 95 % interval of a figure from its resampled values (D,)."""
    low, high = np.quantile(drawn, [0.5 - CONFIDENCE / 2, 0.5 + CONFIDENCE / 2])
    return float(low), float(high)


def estimate(figure: Callable[[Sums], Floats], whole: Sums, drawn: Sums, blocks: int) -> Estimate:
    """Return a figure of the sums `whole` with its interval by the resampled sums `drawn`.

    With few blocks percentiles are too narrow (about 80 % of nominal 95 % intervals cover), so the
    interval is the figure +- Student's t with one degree of freedom less than blocks: RMSE on a log
    scale, R² by log(1 - R²), coverage clipped to 0..1.
    """
    there, back = _SCALES.get(figure, _PLAIN)
    value, values = float(figure(whole)), figure(drawn)
    values = values[np.isfinite(values)]
    if blocks < FEWEST_BLOCKS or not np.isfinite(value) or values.size < 2:
        return Estimate(value=value, low=float("nan"), high=float("nan"))
    # A bootstrap of few blocks is too narrow by the factor of a biased variance.
    error = float(np.std(there(values))) * np.sqrt(blocks / (blocks - 1.0))
    reach = t_quantile(blocks - 1, 0.5 + CONFIDENCE / 2) * error
    ends = sorted(float(back(there(value) + side * reach)) for side in (-1.0, 1.0))
    return Estimate(value=value, low=ends[0], high=ends[1])


_Scale = tuple[Callable[[Any], Any], Callable[[Any], Any]]
_PLAIN: _Scale = (lambda v: v, lambda v: v)
_EXPLAINED = (lambda v: np.log(np.maximum(1.0 - v, 1e-12)), lambda v: 1.0 - np.exp(v))
_SCALES: dict[Callable[[Sums], Floats], _Scale] = {
    rmse: (lambda v: np.log(np.maximum(v, 1e-12)), np.exp),
    r2: _EXPLAINED,
    mean_r2: _EXPLAINED,
    coverage: (lambda v: v, lambda v: np.clip(v, 0.0, 1.0)),
}


@lru_cache(maxsize=256)
def t_quantile(degrees: int, level: float) -> float:
    """Return the quantile of Student's t with `degrees` of freedom at probability `level`.

    NaN without a degree of freedom; `level` is at least a half and below 1. `scipy.special` takes
    longer to import than a flight takes to read and analyse.
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
    """Return the probability that Student's t is within -t and t: Abramowitz, Stegun 26.7.3-4."""
    square = degrees / (degrees + t * t)  # of the cosine of atan(t / sqrt(degrees))
    odd = degrees % 2
    total, term = 0.0, math.sqrt(square) if odd else 1.0
    for k in range(1 + odd, degrees, 2):
        total += term
        term *= square * k / (k + 1)
    total *= t / math.sqrt(degrees + t * t)
    return (math.atan(t / math.sqrt(degrees)) + total) * 2.0 / math.pi if odd else total


def error_of_further(
    values: Sequence[float], middle: float, *, prior: float, independent: int | None = None
) -> float:
    """Return the standard error of one further value about `middle`, the mean of the F `values`.

    Flights of one aircraft differ by more than each is uncertain, and a few of them do not show by
    how much: their scatter is drawn towards `prior`, which counts as PRIOR_FLIGHTS flights.

    `prior` is the standard deviation between flights before any is seen. `independent` is the
    number of values that the mean counts as, F without it: flights of one day are not independent.
    """
    squares = PRIOR_FLIGHTS * prior**2 + sum((value - middle) ** 2 for value in values)
    scatter = squares / (PRIOR_FLIGHTS + len(values) - 1)
    return math.sqrt(scatter * (1.0 + 1.0 / (independent or len(values))))
