"""Errors of a fit on rows that it has not seen.

Shared values come from other flights. Values of one flight (its wind, its onset) cannot: they are
found on every other block of the flight and used on the blocks between. Held-out flights are used
where there are some; else every row is predicted with values found without its flight (of one
flight, without its fifth).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models import scores
from thrustmargin.models.effects.compose import filled
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.identification.cross_validation import left_out_values
from thrustmargin.models.identification.fit import (
    Evaluator,
    Fit,
    linearise,
    mode_scales,
    term_values,
    whiten,
)
from thrustmargin.models.identification.problem import Problem
from thrustmargin.models.identification.terms import layout_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """Errors of measured minus predicted rotor speed; the interval is from blocks of time."""

    rmse_rpm: float
    bias_rpm: float
    r2: float  # of all rotors together, each about its own mean
    per_rotor_rmse_rpm: tuple[float, ...]  # (R,)
    rmse_ci95_rpm: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Unseen:
    """Residuals (T, R) rpm on the rows of `problem`, measured minus predicted."""

    problem: Problem
    before_rpm: Floats
    after_rpm: Floats
    role: str  # "fit" or "held_out"


@dataclass(frozen=True, slots=True, kw_only=True)
class RotorErrors:
    """Errors before and after of one rotor, or of all together (`rotor` None)."""

    rotor: int | None  # 0-based
    before: Errors
    after: Errors


def errors_of(problem: Problem, residual_rpm: Floats, rotor: int | None = None) -> Errors:
    """Errors of a residual (T, R), of one rotor or of all; see `scores.by_block`."""
    columns = slice(None) if rotor is None else slice(rotor, rotor + 1)
    measured, residual = problem.measured_rpm[:, columns], residual_rpm[:, columns]
    terms = scores.error_terms(measured, measured - residual)
    whole = terms.sum(axis=0)
    drawn = scores.by_block(terms.sum(axis=1), problem.block, problem.block_flight)
    together = whole.sum(axis=0)
    return Errors(
        rmse_rpm=float(scores.rmse(together)),
        bias_rpm=float(scores.bias(together)),
        r2=float(scores.r2(together)),
        per_rotor_rmse_rpm=tuple(scores.rmse(whole).tolist()),
        rmse_ci95_rpm=scores.percentiles(scores.rmse(drawn)),
    )


def rotor_errors(unseen: Unseen) -> tuple[RotorErrors, ...]:
    """All rotors together, then each; the intervals are from blocks of time within flights."""
    return tuple(
        RotorErrors(
            rotor=rotor,
            before=errors_of(unseen.problem, unseen.before_rpm, rotor),
            after=errors_of(unseen.problem, unseen.after_rpm, rotor),
        )
        for rotor in (None, *range(unseen.before_rpm.shape[1]))
    )


def across_flights(evaluator: Evaluator, fit: Fit) -> Floats:
    """Cross-validated residual (T, R) rpm: every row with values found without its flight."""
    problem = evaluator.problem
    if not fit.terms:
        return fit.residual_rpm
    out = np.empty_like(fit.residual_rpm)
    for blocks, moved in left_out_values(fit.statistics):
        values = np.clip(fit.values + moved, *_bounds(fit))
        prediction = evaluator.predict(fit.terms, fit.layout, values)
        rows = np.isin(problem.block, blocks)
        out[rows] = (problem.measured_rpm - prediction)[rows]
    return out


def nearly_across_flights(problem: Problem, fit: Fit) -> Floats:
    """`across_flights` with the fit taken as straight near its values: no new prediction, for
    ranking."""
    if not fit.terms:
        return fit.residual_rpm
    _, root = whiten(problem, fit.residual_rpm, fit.scales)
    out = fit.whitened.copy()
    for blocks, moved in left_out_values(fit.statistics):
        rows = np.flatnonzero(np.isin(problem.block, blocks))
        here = moved[fit.layout.places[problem.flight[rows]]]
        out[rows] -= np.einsum("trk,tk->tr", fit.jacobian[rows], here)
    return (out / root * fit.scales) @ problem.modes.directions.T


def on_new_flights(unused: Problem, evaluator: Evaluator, fit: Fit) -> Floats:
    """Residual (T, R) rpm of flights that no step has used."""
    x = unused.channels
    for term in fit.terms:
        middle = np.median(term_values(fit, term), axis=0)
        names = (p.name for p in term.effect.parameters)
        x = filled(term.effect, dict(zip(names, middle, strict=True)), x)
    unused = replace(unused, channels=x)
    new = Evaluator(unused)
    layout = layout_of(fit.terms, unused.flights)
    values = np.zeros(layout.size)
    own = np.zeros(layout.size, dtype=np.bool_)
    for k, parameter in enumerate(layout.parameters):
        where = layout.places[:, k]
        values[where] = np.median(fit.values[fit.layout.places[:, k]])
        own[where] = parameter.per_flight
    if not own.any():
        return unused.measured_rpm - new.predict(fit.terms, layout, values)
    scales = mode_scales(evaluator.problem, fit.residual_rpm)
    out = np.empty_like(unused.measured_rpm)
    parity = _parity(unused)
    for half in (0, 1):
        found = _own_values(new, fit, values, own, scales, parity != half)
        residual = unused.measured_rpm - new.predict(fit.terms, layout, found)
        rows = parity[unused.block] == half
        out[rows] = residual[rows]
    return out


def _own_values(
    evaluator: Evaluator, fit: Fit, start: Floats, own: Bools, scales: Floats, chosen: Bools
) -> Floats:
    """Values with those of each flight found on the chosen blocks, the shared ones kept."""
    problem = evaluator.problem
    layout = layout_of(fit.terms, problem.flights)
    values, free = start.copy(), np.flatnonzero(own)
    for _ in range(8):
        near = linearise(evaluator, fit.terms, layout, values, scales)
        hessian, gradient = near.statistics.normal(chosen)
        prior = np.diag(near.statistics.prior[free])
        step = np.linalg.solve(hessian[np.ix_(free, free)] + prior, gradient[free])
        values[free] += step
    return values


def _parity(problem: Problem) -> NDArray[np.intp]:
    """(B,) 0 or 1, alternating along each flight."""
    parity = np.zeros(problem.block_flight.size, dtype=np.intp)
    for f in range(problem.flights):
        mine = np.flatnonzero(problem.block_flight == f)
        parity[mine] = np.arange(mine.size) % 2
    return parity


def _bounds(fit: Fit) -> tuple[Floats, Floats]:
    lower, upper = np.full(fit.layout.size, -np.inf), np.full(fit.layout.size, np.inf)
    for k, p in enumerate(fit.layout.parameters):
        lower[fit.layout.places[:, k]], upper[fit.layout.places[:, k]] = p.lower, p.upper
    return lower, upper
