"""Detect when a per-flight value changed over a season: by a step or by a ramp.

Flights are divided into segments; within a segment the value is constant or follows a line. Each
cut and each slope must reduce the sum of squares, weighted by the flights' variances, by more than
a penalty. The penalty follows from the wanted rate of false entries: without a change, each gain is
the largest of many squared normal numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.special import ndtri

from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.certainty import ERRORS

FALSE_ENTRIES = 0.01  # expected false entries of one aircraft in one season
LEAST_FLIGHTS, LEAST_LINE = 3, 5  # least flights of a segment, and of one with a slope
#: combined errors at which a flight is clipped; flights of the median
OUTLIER, NEIGHBOURS = 3.0, 5
QUARTILE = float(ndtri(0.75))  # median absolute deviation of a standard normal number


@dataclass(frozen=True, slots=True, kw_only=True)
class SeasonEntry:
    """A change of a value over a season. Flights are counted from 0."""

    ramp: bool  # a ramp from flight to flight, else a step
    flight: int  # first flight after the step, or on the ramp
    earliest: int  # first and last flight of its 95 % interval
    latest: int
    until: int  # first flight after the segment that begins here
    before: float  # value on the flight before the change
    after: float  # value after a step, or at the end of the ramp
    size_error: float  # standard error of after - before
    per_flight: float  # slope of a ramp, 0 for a step
    per_flight_error: float
    score: float  # size in standard errors

    @property
    def size(self) -> float:
        """Return the change of the value."""
        return self.after - self.before


def penalty_of(flights: int, series: int = 1, false_entries: float = FALSE_ENTRIES) -> float:
    """Return the least gain of an entry, in squared standard errors, for a rate of false entries.

    The rate holds for all `series` of one season together: steps and slopes from every flight are
    tried (Bonferroni).
    """
    tried = 2 * max(flights, 1) * max(series, 1)
    return float(ndtri(false_entries / tried / 2.0) ** 2)


def spread_beyond(values: Floats, errors: Floats) -> float:
    """Return the ratio of the scatter of `values` (F,) to their errors (F,), at least 1; 1 for
    fewer than 5 flights.

    Computed from the median of second differences, which neither a step nor a ramp changes much.
    """
    if values.size < 5:
        return 1.0
    second = values[2:] - 2.0 * values[1:-1] + values[:-2]
    variance = errors[2:] ** 2 + 4.0 * errors[1:-1] ** 2 + errors[:-2] ** 2
    return max(1.0, float(np.median(np.abs(second) / np.sqrt(variance)) / QUARTILE))


def scatter_of(values: Floats) -> Floats:
    """Return standard errors (F,) for values (F,) that have none: `spread_of(values)`, repeated."""
    return np.full(values.size, max(spread_of(values), 1e-12))


def spread_of(values: Floats) -> float:
    """Estimate the standard deviation between flights by the median of second differences; 0 for
    fewer than 3."""
    second = values[2:] - 2.0 * values[1:-1] + values[:-2]
    return float(np.median(np.abs(second)) / QUARTILE / np.sqrt(6.0)) if second.size else 0.0


def clip_outliers(values: Floats, errors: Floats) -> Floats:
    """Limit the distance of `values` (F,) from the median of neighbours to OUTLIER errors.

    The error is that of the value combined with the neighbours' median one.
    """
    middle = median_filter(values, NEIGHBOURS, mode="nearest")
    far = OUTLIER * np.hypot(errors, median_filter(errors, NEIGHBOURS, mode="nearest"))
    return middle + np.clip(values - middle, -far, far)


class _Piece(NamedTuple):
    """The fitted line of one segment, over the flight's number."""

    mean: float  # at the middle flight
    slope: float
    middle: float
    mean_error: float
    slope_error: float
    squares: float  # remaining squares over the variances
    cost: float  # squares plus the penalty of a slope

    def at(self, flight: Any) -> Any:
        """Return the line's value at a flight."""
        return self.mean + self.slope * (flight - self.middle)

    def error(self, flight: float) -> float:
        """Return the line's standard error at a flight."""
        return float(np.hypot(self.mean_error, self.slope_error * (flight - self.middle)))


class _ConstantOrLine:
    """Cumulative sums over flights, from which any segment is fitted at constant cost."""

    def __init__(self, values: Floats, errors: Floats, penalty: float) -> None:
        """Compute the sums of values (F,) with errors (F,); `penalty` is that of a slope."""
        w, t = errors**-2.0, np.arange(values.size, dtype=np.float64)
        rows = [w, w * t, w * t * t, w * values, w * t * values, w * values**2]
        self.sums = np.concatenate([np.zeros((6, 1)), np.cumsum(rows, axis=1)], axis=1)
        self.penalty = penalty

    def costs(self, start: Any, end: Any) -> Floats:
        """Return the cost (N,) of fitting N segments by a constant, or by a line where that gains
        enough.

        A segment has the flights from `start` up to, excluding, `end`, each (N,) or one for all.
        The cost is the remaining squares, plus the penalty for a line.
        """
        start, end = np.atleast_1d(start), np.atleast_1d(end)
        w, wt, wtt, wy, wty, wyy = self.sums[:, end] - self.sums[:, start]
        across, along = wty - wy * wt / w, wtt - wt * wt / w
        gained = np.maximum(across * across / along - self.penalty, 0.0)
        return wyy - wy * wy / w - np.where(end - start >= LEAST_LINE, gained, 0.0)

    def fitted(self, start: int, end: int) -> _Piece:
        """Fit the flights from `start` up to, excluding, `end` by a constant or, where it gains
        more, a line.

        A line must gain more than the penalty in squares and have LEAST_LINE flights.
        """
        w, wt, wtt, wy, wty, wyy = self.sums[:, end] - self.sums[:, start]
        mean, middle = wy / w, wt / w
        along, across, squares = wtt - wt * middle, wty - wy * middle, wyy - wy * mean
        if end - start >= LEAST_LINE and across**2 / along > self.penalty:
            slope = across / along
            squares -= across * slope
            of = (mean, slope, middle, w**-0.5, along**-0.5, squares, squares + self.penalty)
        else:
            of = (mean, 0.0, middle, w**-0.5, 0.0, squares, squares)
        return _Piece(*(float(value) for value in of))


def recount_flights(entry: SeasonEntry, where: NDArray[np.intp]) -> SeasonEntry:
    """Return an entry with its flight numbers converted to numbers among all flights of the season.

    The entry was searched for in some flights only: `where` (n,) has the number among all flights
    of each of them.
    """
    after = [*where.tolist(), int(where[-1]) + 1]
    counted = ("flight", "earliest", "latest", "until")
    return replace(entry, **{k: after[min(getattr(entry, k), where.size)] for k in counted})


def segments(values: Floats, errors: Floats, penalty: float) -> list[tuple[int, int]]:
    """Cut F flights into consecutive segments of least total cost; return (start, end) of each.

    Each segment has the flights from `start` up to, excluding, `end`, at least LEAST_FLIGHTS, and
    is fitted by a constant or a line; its cost is the remaining squares, in standard errors, plus
    `penalty`. `values` and `errors` are (F,). Source: Jackson et al. 2005, optimal partitioning.
    """
    flights = values.size
    start, end = np.triu_indices(flights + 1, LEAST_FLIGHTS)
    costs = np.full((flights + 1, flights + 1), np.inf)
    costs[end, start] = _ConstantOrLine(values, errors, penalty).costs(start, end) + penalty
    least, begins = np.zeros(flights + 1), np.zeros(flights + 1, dtype=np.intp)
    for stop in range(1, flights + 1):
        whole = least[:stop] + costs[stop, :stop]
        begins[stop] = np.argmin(whole)
        least[stop] = whole[begins[stop]]
    cuts = [flights]
    while cuts[-1]:
        cuts.append(int(begins[cuts[-1]]))
    return list(pairwise(cuts[::-1]))


def changes(values: Floats, errors: Floats, penalty: float) -> tuple[list[SeasonEntry], Floats]:
    """Return the changes of a value (F,) with standard errors (F,), and the fitted curve (F,).

    `penalty` is the gain in squares that a change must exceed. A single outlier is no change.
    Slopes are per flight. For fewer than 2 LEAST_FLIGHTS flights there is no change, and the curve
    is the mean.
    """
    if values.size < 2 * LEAST_FLIGHTS:
        return [], np.full(values.size, float(np.mean(values)) if values.size else np.nan)
    values = clip_outliers(values, errors)
    sums = _ConstantOrLine(values, errors, penalty)
    pieces = segments(values, errors, penalty)
    fits = [sums.fitted(*piece) for piece in pieces]
    curve = np.concatenate([f.at(np.arange(*p)) for p, f in zip(pieces, fits, strict=True)])
    found: list[SeasonEntry] = []
    for k, ((start, end), now) in enumerate(zip(pieces, fits, strict=True)):
        dates, before = (start, start, start), float(now.at(start))
        if k:
            began, old = pieces[k - 1][0], fits[k - 1]
            before = float(old.at(start - 1))
            bent = (
                fit_hinge(values, errors, began, end, line=bool(old.slope)) if now.slope else None
            )
            if bent is not None and bent[0] - now.squares - old.squares <= penalty:
                dates = bent[1]
            else:
                stays = float(now.at(start) if now.slope else now.mean)
                error = float(np.hypot(now.error(start), old.error(start - 1)))
                found.append(
                    SeasonEntry(
                        ramp=False,
                        flight=start,
                        earliest=min(
                            start, (tried := _step_interval(values, errors, began, end))[0]
                        ),
                        latest=max(start, tried[1]),
                        until=end,
                        before=before,
                        after=stays,
                        size_error=error,
                        per_flight=0.0,
                        per_flight_error=0.0,
                        score=abs(stays - before) / error,
                    )
                )
                before = stays
        if now.slope:
            found.append(
                SeasonEntry(
                    ramp=True,
                    flight=dates[0],
                    earliest=dates[1],
                    latest=dates[2],
                    until=end,
                    before=before,
                    after=float(now.at(end - 1)),
                    size_error=now.slope_error * (end - start),
                    per_flight=now.slope,
                    per_flight_error=now.slope_error,
                    score=abs(now.slope) / now.slope_error,
                )
            )
    return found, curve


def _date_interval(costs: Floats, first: int) -> tuple[int, int, int]:
    """Return the flight of the least cost, and the first and last flight of its 95 % interval.

    Costs within ERRORS² of the least are in the interval (chi-squared of one value).
    """
    good = np.flatnonzero(costs <= costs.min() + ERRORS**2)
    return int(np.argmin(costs)) + first, int(good[0]) + first, int(good[-1]) + first


def _step_interval(values: Floats, errors: Floats, began: int, end: int) -> tuple[int, int]:
    """Return the earliest and latest flight at which the step may be that is between `began` and
    `end`.

    `values` and their standard errors are (F,); before and after the step the values are constant
    or on a line, over LEAST_FLIGHTS flights or more. `end` is excluded.
    """
    sums = _ConstantOrLine(values, errors, 0.0)
    tried = np.arange(began + LEAST_FLIGHTS, end - LEAST_FLIGHTS + 1)
    costs = sums.costs(began, tried)
    costs += sums.costs(tried, end)
    return _date_interval(costs, int(tried[0]))[1:]


def fit_hinge(
    values: Floats, errors: Floats, began: int, end: int, line: bool
) -> tuple[float, tuple[int, int, int]]:
    """Fit a constant (a line if `line`) followed by a line that starts where the first one ends.

    `values` (F,) with `errors` (F,); flights `began` up to, excluding, `end` are fitted. Return the
    remaining squares, and the first flight on the second line: best, earliest, latest.
    """
    tried = np.arange(began + 1, end - 2)
    t, w, y = np.arange(0.0, end - began), errors[began:end] ** -2.0, values[began:end]
    rows = np.stack([w, w * t, w * t * t, w * y, w * t * y])
    # sums from each tried flight on
    w0, w1, w2, y0, y1 = np.cumsum(rows[:, ::-1], axis=1)[:, ::-1][:, tried - began]
    all0, all1, all2, all_y, all_ty = rows.sum(axis=1)[:, None] + np.zeros(tried.size)
    h = tried - began
    bent1, bent2, bent_t, bent_y = (
        w1 - h * w0,
        w2 - 2 * h * w1 + h * h * w0,
        w2 - h * w1,
        y1 - h * y0,
    )
    system = np.array([[all0, bent1, all1], [bent1, bent2, bent_t], [all1, bent_t, all2]])
    along, used = np.array([all_y, bent_y, all_ty]), 2 + line
    system, along = np.moveaxis(system[:used, :used], 2, 0), along[:used].T
    size = np.linalg.solve(system, along[:, :, None]).squeeze(2)
    costs = float(w @ y**2) - np.sum(along * size, axis=1)
    return float(np.min(costs)), _date_interval(costs, int(tried[0]) + 1)
