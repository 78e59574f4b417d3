"""What sound flights show: how large the scatter and the discrepancy are when nothing is missing.

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
    FlightScatter,
    Nuisance,
    root_of,
    root_of_shared,
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
    numbers: NDArray[np.intp],
    factor: float = 1.0,
) -> Learnt:
    """Variance components of a residual (N, R) rpm in modes.

    `groups` (H,) is each hat's channel; `numbers` (K,) has the component of each column that a
    flight draws for itself, -1 for those that keep their size.
    """
    names = list(dict.fromkeys(groups))
    of = np.array([names.index(g) for g in groups])
    modes = nuisance.free.shape[0]
    scatter = np.ones(nuisance.scatter.shape[2])
    free = np.ones((modes, len(names)))
    sums = _Sums.of(nuisance, residual)
    if factor != 1.0 and len(sums.flights) == 1:
        sums = _of_draws_alone(sums, factor)
    known, hats = sums.known, sums.hats
    of = of[:hats]
    acts = np.concatenate([one.acts for one in sums.flights])
    for _ in range(STEPS):
        size = np.concatenate([np.ones(known), free[:, of].ravel()])
        taken, moved, spread = [], [], []
        for one, seen in zip(sums.flights, sums.seen, strict=True):
            own = scatter[one.acts, None]
            root = root_of(np.eye(one.acts.size) + own * one.gram * own.T)
            taken.append(root @ (own * np.concatenate([one.crossed * size, seen], axis=1)))
            moved.append(root.T @ taken[-1])
            spread.append(np.sum(root**2, axis=0))
        crossed, drawn = np.split(np.concatenate(taken), [size.size], axis=1)
        left = size[:, None] * sums.shared * size - crossed.T @ crossed
        root = root_of_shared(left, known, hats, factor)
        mean = root.T @ (root @ (size[:, None] * sums.along - crossed.T @ drawn))
        square = (mean[:, 0] ** 2 + np.sum(root**2, axis=0))[known:].reshape(modes, hats)
        for g in range(len(names)):
            free[:, g] *= np.sqrt(square[:, of == g].mean(axis=1)) if factor == 1.0 else 1.0
        shift, at = np.split(np.concatenate(moved), [size.size], axis=1)
        draws = (at - shift @ mean)[:, 0] ** 2 + np.concatenate(spread)
        draws += np.sum((shift @ root.T) ** 2, axis=1)
        # Where a draw shows nowhere, it is as large as it was taken to be.
        drawn = 1.0 + np.bincount(acts, draws - 1.0, scatter.size) / len(sums.flights)
        for g in range(numbers.max() + 1):
            scatter[numbers == g] *= np.sqrt(drawn[numbers == g].mean())
        scatter, free = np.maximum(scatter, LEAST), np.maximum(free, LEAST)
    return Learnt(scatter=scatter, free=free)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Sums:
    """All that the steps need of a nuisance and a residual."""

    flights: tuple[FlightScatter, ...]
    seen: tuple[Floats, ...]  # of each (K, 1): S'r
    shared: Floats  # (X, X) X'X
    along: Floats  # (X, 1) X'r
    known: int  # of X, those before the hats
    hats: int  # of each mode

    @classmethod
    def of(cls, nuisance: Nuisance, residual: Floats) -> _Sums:
        z = nuisance.filtered(residual[:, :, None])
        pairs = zip(nuisance.by_flight, nuisance.flights, strict=True)
        return cls(
            flights=nuisance.by_flight,
            seen=tuple(
                (one.columns @ z.values[rows].swapaxes(0, 1)).sum(axis=0) for one, rows in pairs
            ),
            shared=nuisance.shared_gram,
            along=nuisance.products(z)[0],
            known=nuisance.uncertainty.shape[2],
            hats=nuisance.free.shape[2],
        )


def _of_draws_alone(sums: _Sums, factor: float) -> _Sums:
    """A single flight, what flights share marginalised once, for it keeps its size: the steps then
    solve for the draws alone, a fifth of all."""
    (one,), (seen,) = sums.flights, sums.seen
    root = root_of_shared(sums.shared, sums.known, sums.hats, factor)
    moved = one.crossed @ root.T
    alone = replace(one, gram=one.gram - moved @ moved.T, crossed=one.crossed[:, :0])
    return _Sums(
        flights=(alone,),
        seen=(seen - moved @ (root @ sums.along),),
        shared=sums.shared[:0, :0],
        along=sums.along[:0],
        known=0,
        hats=0,
    )
