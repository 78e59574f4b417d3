"""What sound flights show: how large the scatter and the free form are when nothing is missing.

Both are variance components of a linear model, found by expectation and maximisation (Dempster,
Laird and Rubin 1977; Laird and Ware 1982): the mean square of each draw given the flights takes the
place of its variance, until it stays.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.sets.nuisance import (
    LEVELS,
    FlightSums,
    Nuisance,
    NuisanceGram,
)

STEPS = 20
LEAST = 0.05  # of the size that a component began with, below which it is not let fall: few flights
# cannot show that something never varies


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Learnt:
    """Factors of the sizes that a nuisance began with."""

    scatter: Floats  # (K,)
    free: Floats  # (R, groups)


def learn(
    nuisance: Nuisance,
    residual: Floats,
    groups: tuple[str, ...],
    own: NDArray[np.intp],
    level: int = 0,
) -> Learnt:
    """Variance components of a residual (N, R) rpm in modes.

    `groups` (H,) is each hat's channel; `own` (K,) numbers the components of the columns that each
    flight draws for itself, -1 for those that keep their size.
    """
    names = list(dict.fromkeys(groups))
    of = np.array([names.index(g) for g in groups])
    modes = nuisance.free.shape[0]
    scatter = np.ones(nuisance.scatter.shape[2])
    free = np.ones((modes, len(names)))
    sums, grams = nuisance.sums(residual[:, :, None]), nuisance.grams()
    if level and len(grams) == 1:
        nuisance, sums, grams = _of_draws_alone(nuisance, sums[0], grams[0], level)
    known, hats = nuisance.uncertainty.shape[2], nuisance.free.shape[2]
    of = of[:hats]
    for _ in range(STEPS):
        size = np.concatenate([np.ones(known), free[:, of].ravel()])
        own_size = scatter[:, None]
        solved = nuisance.solved(
            grams=[
                (s * own_size * scatter, sx * own_size * size, x * size[:, None] * size)
                for s, sx, x in grams
            ],
            levels=LEVELS[level : level + 1],
        )
        now = [
            replace(one, scatter=one.scatter * own_size, shared=one.shared * size[:, None])
            for one in sums
        ]
        shared, _ = solved.without_scatter(now)
        covariance = solved.shared[0]
        mean = covariance @ shared[:, 0]
        square = (mean**2 + np.diag(covariance))[known:].reshape(modes, hats)
        for g in range(len(names)):
            free[:, g] *= np.sqrt(square[:, of == g].mean(axis=1)) if level == 0 else 1.0
        draws = []
        for f, spread, crossed in zip(solved.flights, solved.scatter, solved.crossed, strict=True):
            moved = spread @ crossed
            at = spread @ now[f].scatter[:, 0] - moved @ mean
            more = np.einsum("kx,xy,ky->k", moved, covariance, moved, optimize=True)
            draws.append(at**2 + np.diag(spread) + more)
        drawn = np.mean(draws, axis=0)
        for g in range(own.max() + 1):
            scatter[own == g] *= np.sqrt(drawn[own == g].mean())
        scatter, free = np.maximum(scatter, LEAST), np.maximum(free, LEAST)
    return Learnt(scatter=scatter, free=free)


def _of_draws_alone(
    nuisance: Nuisance, sums: FlightSums, grams: NuisanceGram, level: int
) -> tuple[Nuisance, list[FlightSums], list[NuisanceGram]]:
    """A single flight with what flights share taken out once, for it keeps its size: the steps then
    solve for the draws alone, a fifth of all."""
    own, crossed, shared = grams
    held = (own[:0, :0], crossed[:0], shared)
    spread = nuisance.solved(grams=[held], levels=LEVELS[level : level + 1]).shared[0]
    moved = crossed @ spread
    return (
        replace(nuisance, uncertainty=nuisance.uncertainty[:, :, :0], free=nuisance.free[:, :, :0]),
        [replace(sums, scatter=sums.scatter - moved @ sums.shared, shared=sums.shared[:0])],
        [(own - moved @ crossed.T, crossed[:, :0], shared[:0, :0])],
    )
