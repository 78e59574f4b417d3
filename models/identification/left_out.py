"""Residuals of a fit on rows that it has not seen.

Shared values come from other flights. Values of one flight (its wind, its onset) cannot: they are
found on every other block of the flight and used on the blocks between.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.identification.cross_validation import left_out_values
from thrustmargin.models.identification.fit import (
    Evaluator,
    Fit,
    layout_of,
    linearise,
    mode_scales,
    whiten,
)
from thrustmargin.models.identification.problem import Problem


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
