"""Chance: the same search on residuals that cannot hold an effect.

A surrogate takes the residual of one flight, moves it around in time, lays it under the channels of
another flight, and turns the sign of whole blocks. What is left is noise of the same size and
memory that goes with no channel. The best score that the whole list of candidates reaches on it is
what trying many candidates is worth by chance. Sources: wild cluster bootstrap (Cameron, Gelbach
and Miller 2008), cyclic-shift surrogates (Schreiber and Schmitz 2000).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.cross_validation import held_out_cost
from thrustmargin.models.identification.fit import Statistics
from thrustmargin.models.identification.problem import Background, Problem


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Linear:
    """A candidate near its start: whitened residual there is `e - offset - jacobian d`."""

    statistics: Statistics
    jacobian: Floats  # (T, R, K)
    offset: Floats | None = None  # (T, R), None for zero


def surrogate_residuals(
    problem: Problem,
    whitened: Floats,
    count: int,
    generator: np.random.Generator,
    background: Background,
) -> NDArray[np.float32]:
    """`count` surrogates (T, R, count) of a whitened residual (T, R), float32.

    `background` adds what the base model may be off by: a constant of each flight, and one random
    sum of its directions over all flights.
    """
    rows = [np.flatnonzero(problem.flight == f) for f in range(problem.flights)]
    shape = (*whitened.shape, count)
    out = np.empty(shape, dtype=np.float32)
    blocks, rotors = problem.block_flight.size, background.constant.size
    for s in range(count):
        donors = generator.permutation(problem.flights)
        signs = generator.choice([-1.0, 1.0], size=blocks)
        for mine, donor in zip(rows, donors, strict=True):
            theirs = rows[donor]
            start = int(generator.integers(theirs.size))
            source = theirs[(start + np.arange(mine.size)) % theirs.size]
            out[mine, :, s] = whitened[source] * signs[problem.block[mine], None]
            if np.isfinite(background.degrees):
                own = generator.standard_t(background.degrees, size=rotors)
            else:
                own = generator.standard_normal(rotors)
            out[mine, :, s] += background.constant * own
    if background.directions.size:
        draws = generator.standard_normal((background.directions.shape[0], count))
        flat = background.directions.reshape(background.directions.shape[0], -1)
        out += (flat.T.astype(np.float32) @ draws.astype(np.float32)).reshape(shape)
    return out


def best_gains(
    problem: Problem, base: Linear, candidates: Sequence[Linear], surrogates: NDArray[np.float32]
) -> Floats:
    """(S,) the largest gain over all candidates on each surrogate: the search by chance."""
    reference = _cost(problem, base, surrogates)
    best = np.zeros(surrogates.shape[2])
    for candidate in candidates:
        best = np.maximum(best, reference - _cost(problem, candidate, surrogates))
    return best


def p_value(observed: float, by_chance: Floats) -> float:
    """Share of surrogates that do as well, counting the observation itself, and NaN as well."""
    return float((1 + np.sum(~(by_chance < observed))) / (1 + by_chance.size))


def _cost(problem: Problem, linear: Linear, surrogates: NDArray[np.float32]) -> Floats:
    starts = np.flatnonzero(np.diff(problem.block, prepend=-1))
    ends = np.append(starts[1:], problem.block.size)
    count = linear.jacobian.shape[2]
    gradient = np.empty((starts.size, count, surrogates.shape[2]))
    cost = np.empty((starts.size, surrogates.shape[2]))
    for b, (i, j) in enumerate(zip(starts, ends, strict=True)):
        e = surrogates[i:j].reshape(-1, surrogates.shape[2])
        if linear.offset is not None:
            e = e - linear.offset[i:j].reshape(-1, 1).astype(np.float32)
        if count:
            gradient[b] = linear.jacobian[i:j].reshape(-1, count).astype(np.float32).T @ e
        cost[b] = np.einsum("ns,ns->s", e, e)
    return held_out_cost(linear.statistics, gradient, cost).sum(axis=0)
