"""Least squares on rows at 10 Hz for a given set of effects, without a search or a discrepancy.

Lags of tenths of a second show in rows, not in means. Each mode's residual is divided by its robust
size and has Huber weights. Blocks of time keep sums z'z of derivatives and residual, so that
holding out flights, intervals and removing effects are algebra on these sums.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.identification.rows.candidates import (
    TrialEffect,
    derivatives,
    predicted_modes,
)
from thrustmargin.models.identification.rows.noise import Whitening, unfiltered_whitening
from thrustmargin.models.identification.rows.problem import Problem

ROUNDS = 2  # times that Huber weights are recomputed
STEPS = 10  # Gauss-Newton steps in each round
SHRINK = (1.0, 0.3, 0.1)  # factors tried on a step that does not reduce the cost
CONVERGED = 1e-6  # least relative gain of a step
FARTHEST = 4.0  # largest step of a value, in usual sizes
RIDGE = 1e-4  # prior weight per row, for a value in usual sizes


def block_sums(filter_: Whitening, columns: Floats, block: NDArray[np.intp]) -> Floats:
    """Return z'z (B, q, q) of whitened columns (T, R, q), rpm in modes, over the rows of each
    block."""
    z = filter_.apply(columns)
    ends = [*np.flatnonzero(np.diff(block, prepend=-1)), block.size]
    parts = [z[a:b].reshape(-1, z.shape[2]) for a, b in pairwise(ends)]
    return np.stack([part.T @ part for part in parts])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RowSums:
    """Sums by block, linearised about the values of a fit: P derivatives, then the residual."""

    sums: Floats  # (B, P + 1, P + 1) of [derivatives, residual]
    owner: NDArray[np.intp]  # (B,) flight of each block
    prior: Floats  # (P,) weight of the prior of each value
    pull: Floats  # (P,) negative gradient of the prior's cost at the values
    flights: int

    def by_flight(self) -> Floats:
        """Return the sums (F, P + 1, P + 1) of each flight."""
        out = np.zeros((self.flights, *self.sums.shape[1:]))
        np.add.at(out, self.owner, self.sums)
        return out

    def move(self, total: Floats) -> Floats:
        """Return the Gauss-Newton step (P,) from the fit's values by the sums `total` (P + 1, P +
        1)."""
        system = total[:-1, :-1] + np.diag(self.prior)
        return np.asarray(np.linalg.solve(system, total[:-1, -1] + self.pull), dtype=np.float64)

    def held_out_costs(self) -> Floats:
        """Return each flight's cost (F,), a sum of squares, with values fitted to the others."""
        each = self.by_flight()
        total, costs = each.sum(axis=0), []
        for own in each:
            weights = np.append(-self.move(total - own), 1.0)
            costs.append(float(weights @ own @ weights))
        return np.array(costs)

    def fix_values(self, free: Sequence[int], move: Floats) -> RowSums:
        """Return the sums after moving the P values by `move` (P,), then fixing all but some.

        `free` has the indices of the values that stay free, in the order of the result.
        """
        chosen = np.zeros((self.prior.size + 1, len(free) + 1))
        chosen[list(free), np.arange(len(free))] = 1.0
        chosen[:-1, -1], chosen[-1, -1] = -move, 1.0
        return replace(
            self,
            sums=chosen.T @ self.sums @ chosen,
            prior=self.prior[list(free)],
            pull=(self.pull - self.prior * move)[list(free)],
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RowFit:
    """A converged fit: effects with their values, whitening, derivatives and sums."""

    trials: tuple[TrialEffect, ...]
    filter: Whitening
    columns: Floats  # (T, R, P) rpm in modes
    sums: RowSums


def fit_rows(
    problem: Problem,
    trials: Sequence[TrialEffect],
    chosen: Bools | None = None,
    known_rpm: Floats | float = 0.0,
) -> RowFit:
    """Fit all free values of a set of effects together, starting from their present values.

    Only the blocks flagged in `chosen` (B,) are fitted; None: all. `known_rpm` (R,) is the base
    model's standard error in each mode, added to the noise in squares: a quiet sensor does not make
    the model more accurate.
    """
    trials = tuple(trials)
    measured = problem.mode_amplitudes(problem.measured_rpm)
    chosen = np.ones(problem.block_flight.size, dtype=bool) if chosen is None else chosen
    rows = chosen[problem.block]

    def residual(effects: Sequence[TrialEffect]) -> Floats:
        """Return the residual (T, R), rpm in modes, with the given effects; 0 where unknown."""
        return np.nan_to_num(measured - predicted_modes(problem, effects))

    remaining = residual(trials)
    for _ in range(ROUNDS if any(h.candidate.free for h in trials) else 1):
        filter_ = unfiltered_whitening(remaining, problem.flight, problem.of_outputs, known_rpm)
        for _ in range(STEPS):
            columns = _columns(problem, trials)
            sums = _row_sums(problem, trials, filter_, columns, remaining)
            step = bounded_step(sums, sums.sums[chosen].sum(axis=0), trials)
            size = np.array([p.scale for h in trials for p in h.candidate.parameters])
            step = np.clip(step, -FARTHEST * size, FARTHEST * size)
            merit = penalised_squares(trials, sums.prior, filter_.apply(remaining)[rows])
            gained = 0.0
            for shrink in SHRINK:
                moved = move_values(trials, shrink * step)
                new = residual(moved)
                value = penalised_squares(moved, sums.prior, filter_.apply(new)[rows])
                if value < merit:
                    gained, trials, remaining = merit - value, moved, new
                    break
            if gained <= CONVERGED * merit:
                break
    filter_ = unfiltered_whitening(remaining, problem.flight, problem.of_outputs, known_rpm)
    columns = _columns(problem, trials)
    sums = _row_sums(problem, trials, filter_, columns, remaining)
    return RowFit(trials=trials, filter=filter_, columns=columns, sums=sums)


def held_out_costs_with(problem: Problem, fit: RowFit, filter_: Whitening) -> Floats:
    """Return each flight's held-out cost (F,) of a fit, whitened by the filter of another fit.

    A fit's own filter is scaled by its own residual, so costs of two fits need a common filter.
    """
    remaining = np.nan_to_num(
        problem.mode_amplitudes(problem.measured_rpm) - predicted_modes(problem, fit.trials)
    )
    return _row_sums(problem, fit.trials, filter_, fit.columns, remaining).held_out_costs()


def bounded_step(sums: RowSums, total: Floats, trials: Sequence[TrialEffect]) -> Floats:
    """Return the step (P,) of least cost, with values fixed at a bound that they would leave.

    `total` (P + 1, P + 1) is the sum of `sums` over blocks. A value may overshoot a bound that it
    is not at yet. Fixing one value changes the step of the others, which is solved again.
    """
    value = np.concatenate([np.zeros(0), *(h.free_values for h in trials)])
    which = [h.candidate.parameters for h in trials]
    low = np.array([p.lower for parameters in which for p in parameters])
    high = np.array([p.upper for parameters in which for p in parameters])
    step, free = np.zeros(value.size), np.ones(value.size, dtype=bool)
    while True:
        some = np.flatnonzero(free)
        step[:] = 0.0
        kept = np.append(some, value.size)
        step[some] = sums.fix_values(some.tolist(), step).move(total[np.ix_(kept, kept)])
        out = ((value <= low) & (step < 0.0)) | ((value >= high) & (step > 0.0))
        if not np.any(out):
            return step
        free &= ~out


def _columns(problem: Problem, trials: Sequence[TrialEffect]) -> Floats:
    """Return the derivatives (T, R, P), rpm in modes, by all free values; 0 where unknown."""
    empty = np.zeros((*problem.measured_rpm.shape, 0))
    parts = [derivatives(problem, trials, k) for k in range(len(trials))]
    return np.nan_to_num(np.concatenate([empty, *parts], axis=2))


def _row_sums(
    problem: Problem,
    trials: Sequence[TrialEffect],
    filter_: Whitening,
    columns: Floats,
    residual: Floats,
) -> RowSums:
    """Return the products of `columns` and residual, summed by block of time, and the ridge prior.

    `columns` (T, R, P) are the derivatives by the P free values of `trials`, `residual` is (T, R);
    both modal, rpm. `filter_` divides them by the noise.
    """
    away, weight = (
        _distances_from_absent(trials),
        RIDGE * residual.shape[0] / _usual_sizes(trials) ** 2,
    )
    whole = np.concatenate([columns, residual[:, :, None]], axis=2)
    return RowSums(
        sums=block_sums(filter_, whole, problem.block),
        owner=problem.block_flight,
        prior=weight,
        pull=-weight * away,
        flights=problem.flights,
    )


def penalised_squares(trials: Sequence[TrialEffect], prior: Floats, z: Floats) -> float:
    """Return the sum of squares of the whitened residual plus the cost of the prior."""
    return float(np.sum(z**2) + np.sum(prior * _distances_from_absent(trials) ** 2))


def _usual_sizes(trials: Sequence[TrialEffect]) -> Floats:
    """Return the usual size (P,) of each free value."""
    return np.array([p.scale for h in trials for p in h.candidate.parameters])


def _distances_from_absent(trials: Sequence[TrialEffect]) -> Floats:
    """Return the distance (P,) of each value from its absent value; 0 where it has none."""
    pairs = [
        (p, v) for h in trials for p, v in zip(h.candidate.parameters, h.free_values, strict=True)
    ]
    return np.array([0.0 if p.absent is None else v - p.absent for p, v in pairs])


def move_values(trials: Sequence[TrialEffect], step: Floats) -> tuple[TrialEffect, ...]:
    """Return the effects with all free values moved by `step` (P,), each clipped to its bounds."""
    ends = np.cumsum([0, *(len(h.candidate.free) for h in trials)])
    return tuple(h.moved(step[a:b]) for h, (a, b) in zip(trials, pairwise(ends), strict=True))


def half_widths(
    sums: RowSums, uncertainty: Floats, confidence: float = 0.95
) -> tuple[Floats, Floats]:
    """Return half widths (P,) of the values' intervals at `confidence`, and their covariance (P,
    P).

    The variance is that of block sums; where flights differ by more than their blocks explain, that
    of flight sums (Liang and Zeger 1986). Student's t has half as many degrees of freedom as
    blocks, because neighbouring blocks are not quite independent, or flights minus one. The base
    model's error is added, as rows do not reduce it: `uncertainty` (P, D) are the products of the
    derivatives with its D directions.
    """
    gradient, blocks, flights = sums.sums[:, :-1, -1], sums.owner.size, sums.flights
    total = sums.sums.sum(axis=0)[:-1, :-1]
    bread = np.linalg.inv(total + np.diag(sums.prior + 1e-12))
    covariance = bread @ gradient.T @ gradient @ bread * blocks / max(1, blocks - 1)
    level = 0.5 + confidence / 2
    quantile = np.full(len(bread), stdtrit(max(2, blocks // 2), level))
    if flights > 2:
        own = sums.by_flight()[:, :-1, -1]
        wide = np.diag(bread @ own.T @ own @ bread) * flights / (flights - 1)
        narrow = np.diag(covariance)
        scale = np.sqrt(np.maximum(wide / np.maximum(narrow, 1e-300), 1.0))
        quantile[wide > narrow] = stdtrit(flights - 1, level)
        covariance = covariance * scale[:, None] * scale
    square = quantile**2 * np.diag(covariance)
    base = bread @ uncertainty @ uncertainty.T @ bread
    square = square + ndtri(level) ** 2 * np.diag(base)
    return np.sqrt(square), covariance + base
