"""Cross-validation of a fit: error on what was left out, intervals, and chance.

All of it works on block statistics. A fit is linear near its values, so leaving a flight out moves
the values by one solve. Parameters of one flight are found on every other block of that flight and
scored on the blocks between.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.fit import Fit, Statistics
from thrustmargin.models.identification.problem import Background

FOLDS_OF_ONE_FLIGHT = 5


def held_out_cost(
    s: Statistics, gradient: Floats | None = None, cost: Floats | None = None
) -> Floats:
    """Cost (B,) or (B, S) of every block under values found without it.

    With several flights a flight is left out whole; with one, every fifth run of blocks.
    `gradient` (B, K, S) and `cost` (B, S) cross-validate S other residuals on the same derivatives.
    """
    single = gradient is None or cost is None
    g = s.gradient[:, :, None] if gradient is None else gradient
    c = s.cost[:, None] if cost is None else cost
    out = np.empty_like(c)
    for test, _, moved in _folds(s, g):
        out[test] = _cost(s, g, c, test, moved)
    return out[:, 0] if single else out


def left_out_values(s: Statistics) -> list[tuple[NDArray[np.intp], Floats]]:
    """Groups of blocks, each with the move (P,) of the values when found without the group."""
    groups = []
    for test, flight, values in _folds(s, s.gradient[:, :, None]):
        moved = np.zeros(s.layout.size)
        moved[s.layout.places[flight]] = values[:, 0]
        groups.append((test, moved))
    return groups


def _folds(s: Statistics, gradient: Floats) -> Iterator[tuple[NDArray[np.intp], int, Floats]]:
    """(test blocks, their flight, values (K, S) of its rows found without them) of every fold."""
    everything, flights = np.arange(s.owner.size), s.layout.places.shape[0]
    if flights > 1:
        for f in range(flights):
            values = _solve(s, gradient, s.owner != f)
            for test, own_training in _halves(everything[s.owner == f]):
                yield test, f, _of_flight(s, gradient, values, own_training, f)
    else:
        fold = everything * min(FOLDS_OF_ONE_FLIGHT, everything.size) // everything.size
        for k in np.unique(fold):
            yield everything[fold == k], 0, _solve(s, gradient, fold != k)[s.layout.places[0]]


def _halves(mine: NDArray[np.intp]) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    even, odd = mine[::2], mine[1::2]
    return [(even, odd), (odd, even)] if odd.size else [(even, even[:0])]


def _solve(s: Statistics, gradient: Floats, training: NDArray[np.bool_]) -> Floats:
    """Values (P, S) found on the blocks `training`."""
    if not s.layout.size:
        return np.zeros((0, gradient.shape[2]))
    hessian, total = s.normal(training, gradient)
    return np.linalg.solve(hessian + np.diag(s.prior), total + s.pull[:, None])


def _of_flight(
    s: Statistics, gradient: Floats, values: Floats, own_training: NDArray[np.intp], flight: int
) -> Floats:
    """Values (K, S) of one flight's rows: shared ones of `values`, its own from its blocks."""
    where = s.layout.places[flight]
    moved = values[where]
    own = ~s.layout.shared[where]
    if own.any() and own_training.size:
        h = s.hessian[own_training].sum(axis=0)
        rest = gradient[own_training].sum(axis=0) - h[:, ~own] @ moved[~own]
        prior = np.diag(s.prior[where[own]])
        moved[own] = np.linalg.solve(
            h[np.ix_(own, own)] + prior, rest[own] + s.pull[where[own], None]
        )
    return moved


def _cost(
    s: Statistics,
    g: Floats,
    c: Floats,
    test: NDArray[np.intp],
    moved: Floats,
) -> Floats:
    linear = np.einsum("bks,ks->bs", g[test], moved)
    square = np.einsum("ks,bkl,ls->bs", moved, s.hessian[test], moved)
    return c[test] - 2 * linear + square


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ParameterInterval:
    """95 % intervals of the P values of a fit, and their covariance."""

    lower: Floats
    upper: Floats
    covariance: Floats  # (P, P)


def intervals(
    fit: Fit,
    background: Background | None = None,
    confidence: float = 0.95,
    *,
    few: bool = True,
) -> ParameterInterval:
    """Intervals from blocks and flights (cluster sandwich), never from the number of rows.

    `background` is what the base model itself does not know: no number of rows can teach it.

    The variance is that of block sums, and where flights disagree by more than their blocks
    explain, that of flight sums. Source: Liang and Zeger 1986, with Student's t at half as many
    degrees of freedom as blocks, because neighbouring blocks are not quite independent. Where the
    flights' scatter counts and `few` is set, t has as many as there are flights, less one: an
    interval to be stated. Without it the interval is one to tell a value from nothing by.
    """
    s = fit.statistics
    size = fit.layout.size
    hessian, _ = s.normal(np.ones(s.owner.size, dtype=np.bool_))
    bread = np.linalg.inv(hessian + np.diag(s.prior + 1e-12)) if size else np.zeros((0, 0))
    by_block = _meat(s, np.arange(s.owner.size))
    blocks = s.owner.size
    covariance = bread @ by_block @ bread * blocks / max(1, blocks - 1)
    level = 0.5 + confidence / 2
    quantile = np.full(size, student.ppf(level, max(2, blocks // 2)))
    flights = fit.layout.places.shape[0]
    own_spread = background is not None and np.isfinite(background.degrees)  # of flights, in it
    if flights > 2 and not own_spread:
        by_flight = bread @ _meat(s, s.owner) @ bread * flights / (flights - 1)
        wider = (np.diag(by_flight) > np.diag(covariance)) & fit.layout.shared
        scale = np.ones(size)
        scale[wider] = np.sqrt(np.diag(by_flight)[wider] / np.diag(covariance)[wider])
        covariance = covariance * scale[:, None] * scale[None, :]
        if few:
            quantile[wider] = student.ppf(level, flights - 1)
    square = quantile**2 * np.diag(covariance)
    if background is not None and size:
        own = bread @ _background_meat(fit, background) @ bread
        square = square + student.ppf(level, background.degrees) ** 2 * np.diag(own)
        covariance = covariance + own
    finest = np.zeros(size)
    for k, parameter in enumerate(fit.layout.parameters):
        where = fit.layout.places[:, k]
        finest[where] = parameter.resolution + parameter.accuracy * np.abs(fit.values[where])
    half = np.sqrt(square) + finest
    return ParameterInterval(
        lower=fit.values - half, upper=fit.values + half, covariance=covariance
    )


def _background_meat(fit: Fit, background: Background) -> Floats:
    """Scatter of the gradient when the base is off by its background."""
    s = fit.statistics
    size = s.layout.size
    meat = np.zeros((size, size))
    starts = np.flatnonzero(np.diff(fit.block, prepend=-1))
    sums = np.add.reduceat(fit.jacobian, starts, axis=0)  # (B, R, K)
    pulls = np.einsum("dtr,trk->dtk", background.directions, fit.jacobian)
    pulls = np.add.reduceat(pulls, starts, axis=1)  # (D, B, K)
    shared = np.zeros((background.directions.shape[0], size))
    for f in range(s.layout.places.shape[0]):
        mine, where = s.owner == f, s.layout.places[f]
        total = sums[mine].sum(axis=0) * background.constant[:, None]
        meat[np.ix_(where, where)] += total.T @ total
        shared[:, where] += pulls[:, mine].sum(axis=1)
    return meat + shared.T @ shared


def _meat(s: Statistics, cluster: NDArray[np.intp]) -> Floats:
    meat = np.zeros((s.layout.size, s.layout.size))
    for k in np.unique(cluster):
        total = np.zeros(s.layout.size)
        for b in np.flatnonzero(cluster == k):
            np.add.at(total, s.layout.places[s.owner[b]], s.gradient[b])
        meat += np.outer(total, total)
    return meat


def difference_is_uncertain(first: Floats, second: Floats, owner: NDArray[np.intp]) -> bool:
    """True when two held-out costs (B,) differ by less than their blocks' scatter allows (95 %)."""
    gap = second - first
    flights = np.unique(owner)
    error = float(np.std(gap, ddof=1) * np.sqrt(gap.size)) if gap.size > 1 else np.inf
    if flights.size > 2:
        by_flight = np.array([gap[owner == f].sum() for f in flights])
        error = max(error, float(np.std(by_flight, ddof=1) * np.sqrt(flights.size)) / 2)
    return bool(abs(gap.sum()) < 2.0 * error)
