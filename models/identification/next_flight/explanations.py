"""Explanations of the same flights: sets of effects, each fitted to the flown rows.

Works in mode amplitudes, weighed by the noise of a row.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.models.effects import effects_for
from thrustmargin.models.effects.base import Parameter
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.rows.candidates import (
    Term,
    TrialEffect,
    candidate,
    predicted,
    slopes,
    unnamed_candidates,
)
from thrustmargin.models.identification.rows.problem import (
    BLOCK_SECONDS,
    Problem,
    RowsToFit,
    thinned,
)
from thrustmargin.models.identification.rows.row_fit import fit_rows, moved_by


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Explanation:
    """Effects with values that all flights share, and the covariance of all values in their
    order."""

    held: tuple[TrialEffect, ...]
    covariance: Floats  # (P, P)

    @property
    def terms(self) -> tuple[Term, ...]:
        return tuple(one.candidate.term for one in self.held)


def fitted_explanation(problem: Problem, terms: Sequence[Term], noise_rpm: Floats) -> Explanation:
    """The terms with their likeliest values given the flown rows, alike in all flights; a step
    within a flight counts as it is afterwards.

    `noise_rpm` (R,) is that of a mean over one second. Values have their usual sizes as prior,
    their covariance the scatter of a sound aircraft in it.
    """
    rows = thinned(problem, problem.stride)
    fit = fit_rows(rows, [_shared(term, rows) for term in terms])
    noise = noise_rpm / np.sqrt(float(np.sum(problem.durations)) / rows.measured_rpm.shape[0])
    every = [p for one in fit.held for p in one.candidate.parameters]
    size = np.array([p.scale for p in every])
    values = np.concatenate([np.zeros(0), *(one.free_values for one in fit.held)])
    own = over_noise(fit.columns * size, noise)
    left = np.nan_to_num(rows.in_modes(rows.measured_rpm) - predicted(rows, fit.held))
    pull = own.T @ over_noise(left[:, :, None], noise)[:, 0]
    pull += (np.array([_absent(p) for p in every]) - values) / size
    step = np.asarray(np.linalg.solve(own.T @ own + np.eye(size.size), pull), dtype=np.float64)
    likeliest = moved_by(fit.held, size * step)
    whole = np.hstack([own, over_noise(scatter(rows, problem.background_rpm), noise)])
    inverse = np.linalg.inv(whole.T @ whole + np.eye(whole.shape[1]))[: size.size, : size.size]
    of_values: Floats = np.asarray(inverse, dtype=np.float64) * np.outer(size, size)
    return Explanation(
        held=tuple(replace(one, values=one.values[:1]) for one in likeliest),
        covariance=of_values,
    )


def over_noise(columns: Floats, noise_rpm: Floats) -> Floats:
    """(T R, K) of columns (T, R, K) rpm in modes, in units of the noise (R,) of a row."""
    rows, modes, count = columns.shape
    return (columns / noise_rpm[:, None]).reshape(rows * modes, count)


def scatter(rows: RowsToFit, background_rpm: Floats | float) -> Floats:
    """(T, R, N) rpm in modes by which a sound aircraft's flight may be off: one deviation a column.

    Each mode's mean by `background_rpm` (R,), and every effect by its scatter from flight to
    flight, as the model file has it from good flights, else the usual one.
    """
    shape = rows.measured_rpm.shape
    means = np.diag(np.broadcast_to(background_rpm, shape[1:]))
    made = [np.broadcast_to(means, (*shape, shape[1]))]
    good = rows.model.good_flights
    shown = good.scatter if good is not None else {}
    for effect in effects_for(rows.model.airframe):
        if effect.begins:
            continue
        own = [shown.get(f"{effect.key}.{p.name}", p.smallest) for p in effect.parameters]
        moving = [k for k, size in enumerate(own) if size > 0.0]
        absent = np.array([[_absent(p) for p in effect.parameters]] * rows.flights)
        for rotor in range(shape[1]) if effect.of_one_rotor else (None,):
            one = candidate(Term(effect=effect, rotor=rotor), rows.flights)
            by_value = slopes(rows, [TrialEffect(candidate=one, values=absent)], 0, moving)
            made.append(by_value * np.array(own)[moving])
    return np.nan_to_num(np.concatenate(made, axis=2))


def second_noise_rpm(problem: Problem, residual_rpm: Floats) -> Floats:
    """(R,) rpm: noise of a mean over one second in each mode, from means over blocks of time.

    `residual_rpm` (T, R) is what the effects found leave on the rows of the problem. Means over
    BLOCK_SECONDS about that of their flight have what lasts for seconds in them.
    """
    amplitudes = problem.in_modes(residual_rpm)
    count = np.bincount(problem.block).astype(float)[:, None]
    blocks = np.stack([np.bincount(problem.block, a) for a in amplitudes.T], axis=1) / count
    flights = np.bincount(problem.block_flight).astype(float)[:, None]
    means = np.stack([np.bincount(problem.block_flight, b) for b in blocks.T], axis=1) / flights
    about = blocks - means[problem.block_flight]
    free = max(1, blocks.shape[0] - means.shape[0])
    return np.sqrt(np.sum(about**2, axis=0) / free * BLOCK_SECONDS) + 1e-3


def _shared(term: Term, rows: RowsToFit) -> TrialEffect:
    """A term, of a step what it is afterwards, all of whose values flights share."""
    lasting = Term(effect=term.effect.afterwards or term.effect, rotor=term.rotor)
    free = tuple((k, None) for k in range(len(lasting.effect.parameters)))
    one = replace(candidate(lasting, rows.flights), free=free)
    if one.unnamed:  # its curve lies where these flights have its channel
        one = next(known for known in unnamed_candidates(rows) if known.key == term.key)
    return one.at_start


def _absent(parameter: Parameter) -> float:
    return parameter.start if parameter.absent is None else parameter.absent
