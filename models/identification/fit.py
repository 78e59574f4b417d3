"""Joint robust fit of effects, and the sufficient statistics by block that all judging rests on.

The residual is in rpm, taken apart into modes and divided by each mode's robust scale. A
Gauss-Newton step with Huber weights and bounds uses derivatives by central differences. At the end,
each block keeps only H = J'WJ, g = J'We and c = e'We, so that leaving flights out, intervals and
surrogate searches are small linear algebra and never another pass over the rows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.effects.base import Kind
from thrustmargin.models.effects.compose import corrected, rotor_speed_rpm
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.base_uncertainty import base_uncertainty_rpm
from thrustmargin.models.identification.modes import robust_scale
from thrustmargin.models.identification.output_shares import scaled_to
from thrustmargin.models.identification.problem import Background, Problem
from thrustmargin.models.identification.terms import (
    FitLayout,
    Term,
    columns_of,
    layout_of,
    placed_terms,
    starts,
)

HUBER = 3.0  # scales of a mode beyond which a residual counts linearly
SPREAD = 3.0  # largest ratio of the scales of two modes
STEP = 1e-4  # of a parameter's usual size, of the central difference
STEPS = 12
TOLERANCE = 1e-3  # of a parameter's own scale
RIDGE = 1e-4  # weight of the prior, per row


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Statistics:
    """What the blocks keep of a linear problem e = J d, with a weak prior on d."""

    layout: FitLayout
    owner: NDArray[np.intp]  # (B,) flight of each block
    hessian: Floats  # (B, K, K)
    gradient: Floats  # (B, K)
    cost: Floats  # (B,)
    prior: Floats  # (P,) weight of the prior
    pull: Floats  # (P,) its gradient at d = 0

    def normal(self, chosen: NDArray[np.bool_], gradient: Floats | None = None) -> Any:
        """Normal matrix (P, P) and gradient (P, ...) over the chosen blocks, without the prior."""
        gradient = self.gradient if gradient is None else gradient
        hessian = np.zeros((self.layout.size, self.layout.size))
        total = np.zeros((self.layout.size, *gradient.shape[2:]))
        for f in range(self.layout.places.shape[0]):
            mine = chosen & (self.owner == f)
            where = self.layout.places[f]
            hessian[np.ix_(where, where)] += self.hessian[mine].sum(axis=0)
            total[where] += gradient[mine].sum(axis=0)
        return hessian, total


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit:
    """Values found, and statistics by block at those values."""

    terms: tuple[Term, ...]
    layout: FitLayout
    values: Floats  # (P,)
    residual_rpm: Floats  # (T, R) measured minus predicted
    whitened: Floats  # (T, R) weighted mode residuals
    jacobian: Floats  # (T, R, K) of the weighted mode predictions
    prediction_rpm: Floats  # (T, R)
    statistics: Statistics
    block: NDArray[np.intp]  # (T,)
    scales: Floats  # (R,) rpm of the modes
    converged: bool


def term_values(fit: Fit, term: Term, values: Floats | None = None) -> Floats:
    """Values of one term of a fit, (F, parameters of the term)."""
    given = fit.values if values is None else values
    return given[fit.layout.places[:, list(columns_of(fit.terms)[term.key].values())]]


def mode_scales(problem: Problem, residual_rpm: Floats) -> Floats:
    """(R,) rpm, robust size of each mode of a residual, none beyond SPREAD times the quietest.

    A mode in which much is missing is large for that reason; it must not lose its say for it. What
    the base model itself may be off by counts in full: quiet sensors do not make it any truer.
    """
    directions = problem.modes.directions
    amplitudes = residual_rpm @ directions
    scales = np.array([robust_scale(amplitudes[:, k]) for k in range(amplitudes.shape[1])])
    if problem.of_outputs:  # what all rotors have in common is as measured
        scales[0] = scales[1:].min()
    scales = np.clip(scales, 1e-6, SPREAD * max(float(scales.min()), 1e-6))
    return np.hypot(scales, np.sqrt(problem.known_square(directions)))


class Evaluator:
    """Predictions and derivatives of a problem."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem

    def predict(self, terms: Sequence[Term], layout: FitLayout, values: Floats) -> Floats:
        """(T, R) rpm."""
        return self._speeds(terms, self._rows(layout, values))

    def jacobian(
        self, terms: Sequence[Term], layout: FitLayout, values: Floats, wanted: Sequence[int]
    ) -> tuple[Floats, Callable[[], Floats]]:
        """Prediction (T, R), and what works out its derivatives by the row parameters wanted,
        (T, R, len(wanted)), by central differences: a step that is not taken never asks for them.
        """
        rows = self._rows(layout, values)
        prediction = self._speeds(terms, rows)

        def derivatives() -> Floats:
            columns = [self._derivative(terms, layout, rows, k) for k in wanted]
            return np.stack(columns, axis=2) if columns else np.zeros((*prediction.shape, 0))

        return prediction, derivatives

    def _derivative(
        self, terms: Sequence[Term], layout: FitLayout, rows: list[Any], k: int
    ) -> Floats:
        p, at = layout.parameters[k], rows[k]
        ends = [np.clip(at + side * STEP * p.scale, p.lower, p.upper) for side in (1.0, -1.0)]
        above, below = (self._speeds(terms, [*rows[:k], end, *rows[k + 1 :]]) for end in ends)
        width = np.broadcast_to(ends[0] - ends[1], above.shape[:1])
        return (above - below) / np.where(width == 0.0, np.inf, width)[:, None]

    def _rows(self, layout: FitLayout, values: Floats) -> list[Any]:
        by_flight = values[layout.places]
        return [
            by_flight[self.problem.flight, k] if parameter.per_flight else by_flight[0, k]
            for k, parameter in enumerate(layout.parameters)
        ]

    def _speeds(self, terms: Sequence[Term], rows: Sequence[Any]) -> Floats:
        placed = (*self.problem.placed, *placed_terms(terms, rows))
        speed = rotor_speed_rpm(self.problem.base, placed, self.problem.channels)
        if not self.problem.of_outputs:
            return speed
        return scaled_to(np.sum(self.problem.measured_rpm**2, axis=1), speed)


def fit_terms(
    evaluator: Evaluator,
    terms: Sequence[Term],
    *,
    scales: Floats,
    start: Floats | None = None,
    steps: int = STEPS,
) -> Fit:
    """Fit all terms together from `start` (or their own starts); `scales` (R,) rpm of the modes."""
    problem = evaluator.problem
    layout = layout_of(terms, problem.flights)
    values = starts(layout) if start is None else start.copy()
    lower, upper, size, _ = _bounds(layout, values)
    converged = not layout.size
    best: Fit | None = None
    reference = np.inf
    damping = 1e-6
    everything = range(len(layout.parameters))
    for _ in range(max(1, steps)):
        prediction, derivatives = evaluator.jacobian(terms, layout, values, everything)
        whitened, _ = whiten(problem, problem.measured_rpm - prediction, scales)
        _, _, size, centre = _bounds(layout, values)
        total = np.sum(whitened**2) + np.sum(_prior(problem, size) * (values - centre) ** 2)
        if best is None or total <= reference * (1 + 1e-9):
            gained = np.inf if best is None else reference - total
            best = _straight(problem, terms, layout, values, scales, prediction, derivatives())
            reference, damping = total, damping / 5
            if gained < 1e-6 * reference:
                converged = True
                break
        else:
            damping = max(10 * damping, 1e-3)
            if damping > 1e4:
                break
        if not layout.size:
            break
        statistics = best.statistics
        hessian, gradient = statistics.normal(np.ones(statistics.owner.size, dtype=np.bool_))
        hessian += np.diag(statistics.prior)
        gradient += statistics.pull
        step = np.linalg.solve(hessian + damping * np.diag(np.diag(hessian) + 1e-12), gradient)
        values = np.clip(best.values + np.clip(step, -4 * size, 4 * size), lower, upper)
        if np.all(np.abs(values - best.values) < TOLERANCE * size):
            converged = True
            break
    assert best is not None
    return replace(best, converged=converged)


def _bounds(layout: FitLayout, values: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Lower and upper bound, size, and centre of the prior of each value.

    A value that has no "absent" is held near where it stands; it is drawn to nothing.
    """
    lower, upper, size, centre = (np.zeros(layout.size) for _ in range(4))
    for k, p in enumerate(layout.parameters):
        where = layout.places[:, k]
        lower[where], upper[where], size[where] = p.lower, p.upper, p.scale
        centre[where] = values[where] if p.absent is None else p.absent
    return lower, upper, size, centre


def _prior(problem: Problem, size: Floats) -> Floats:
    """(P,) weight of the prior of values of these sizes."""
    return RIDGE * problem.measured_rpm.shape[0] / size**2


def linearise(
    evaluator: Evaluator,
    terms: Sequence[Term],
    layout: FitLayout,
    values: Floats,
    scales: Floats,
    known: Floats | None = None,
) -> Fit:
    """The problem at given values: residual, weighted derivatives and block statistics.

    `known` (T, R, k) are weighted derivatives of the first k parameters from a neighbouring fit,
    good enough for ranking candidates; they are not worked out again.
    """
    have = 0 if known is None else known.shape[2]
    wanted = range(have, len(layout.parameters))
    prediction, derivatives = evaluator.jacobian(terms, layout, values, wanted)
    return _straight(
        evaluator.problem, terms, layout, values, scales, prediction, derivatives(), known
    )


def _straight(
    problem: Problem,
    terms: Sequence[Term],
    layout: FitLayout,
    values: Floats,
    scales: Floats,
    prediction: Floats,
    derivative: Floats,
    known: Floats | None = None,
) -> Fit:
    """`linearise` with the prediction (T, R) and its derivatives (T, R, K) by what is not known."""
    residual = problem.measured_rpm - prediction
    whitened, root = whiten(problem, residual, scales)
    shape, count = whitened.shape, derivative.shape[2]
    turned = np.swapaxes(derivative, 1, 2).reshape(-1, shape[1])
    turned = turned @ (problem.modes.directions / scales)
    jacobian = np.swapaxes(turned.reshape(shape[0], count, shape[1]), 1, 2) * root[:, :, None]
    if known is not None:
        jacobian = np.concatenate([known, jacobian], axis=2)
    hessian, gradient, cost = block_statistics(problem, whitened, jacobian)
    _, _, size, centre = _bounds(layout, values)
    prior = _prior(problem, size)
    statistics = Statistics(
        layout=layout,
        owner=problem.block_flight,
        hessian=hessian,
        gradient=gradient,
        cost=cost,
        prior=prior,
        pull=-prior * (values - centre),
    )
    return Fit(
        terms=tuple(terms),
        layout=layout,
        values=values.copy(),
        residual_rpm=residual,
        prediction_rpm=prediction,
        whitened=whitened,
        jacobian=jacobian,
        statistics=statistics,
        block=problem.block,
        scales=scales,
        converged=False,
    )


def background_of(problem: Problem, fit: Fit) -> Background:
    """The base model's own error at the airspeed and tank mass that the fit corrects to."""
    values = fit.values[fit.layout.places]
    by_row = [
        values[problem.flight, k] if parameter.per_flight else float(values[0, k])
        for k, parameter in enumerate(fit.layout.parameters)
    ]
    inputs = [p for p in placed_terms(fit.terms, by_row) if p.effect.kind is Kind.INPUT]
    if not inputs:
        return problem.background(fit.scales)
    true = corrected(inputs, problem.channels)
    return problem.background(fit.scales, base_uncertainty_rpm(problem.model, problem.base, true))


def whiten(problem: Problem, residual_rpm: Floats, scales: Floats) -> tuple[Floats, Floats]:
    """Mode residuals over their scales with Huber weights in, and the root of the weights."""
    modes = residual_rpm @ (problem.modes.directions / scales)
    root = np.sqrt(HUBER / np.maximum(np.abs(modes), HUBER))
    return modes * root, root


def block_statistics(
    problem: Problem, whitened: Floats, jacobian: Floats
) -> tuple[Floats, Floats, Floats]:
    """H (B, K, K), g (B, K) and c (B,) of each block."""
    starts_ = np.flatnonzero(np.diff(problem.block, prepend=-1))
    count = jacobian.shape[2]
    hessian = np.zeros((starts_.size, count, count))
    gradient = np.zeros((starts_.size, count))
    ends = np.append(starts_[1:], problem.block.size)
    for b, (i, j) in enumerate(zip(starts_, ends, strict=True)):
        block = jacobian[i:j].reshape(-1 if count else 0, count)
        hessian[b] = block.T @ block
        gradient[b] = block.T @ whitened[i:j].ravel()[: block.shape[0]]
    cost = np.add.reduceat(np.sum(whitened**2, axis=1), starts_)
    return hessian, gradient, cost


def warm_start(terms: Sequence[Term], fit: Fit, flights: int) -> Floats:
    """Values of a fit carried over to a list of terms that may hold more, fewer or others."""
    layout = layout_of(terms, flights)
    values, known = starts(layout), columns_of(fit.terms)
    for key, columns in columns_of(terms).items():
        if key in known:
            before = fit.layout.places[:, list(known[key].values())]
            values[layout.places[:, list(columns.values())]] = fit.values[before]
    return values
