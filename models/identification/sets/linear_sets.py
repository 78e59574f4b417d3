"""Score sets of effects near a fitted set on one linear problem.

One Gram matrix contains the derivatives by the values of all candidates, each candidate's change by
entering or leaving the set, and the residual; a set then costs one small Cholesky factor. Nuisances
are marginalised in it. `FilteredColumns` keeps the products that do not depend on the residual,
because each step of a fit needs the same columns with another residual.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.rows.candidates import Term, TrialEffect
from thrustmargin.models.identification.rows.value_columns import ValueColumns
from thrustmargin.models.identification.sets.discrepancy import FORM
from thrustmargin.models.identification.sets.evidence import (
    SetScore,
    ValuePrior,
    is_shape,
    prior_of,
    score,
)
from thrustmargin.models.identification.sets.nuisance import Nuisance, ReducedNuisance, Sums


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FilteredColumns:
    """P columns, filtered by the noise, with their products with the nuisances."""

    nuisance: Nuisance
    solved: ReducedNuisance
    z: ValueColumns  # filtered columns of n means
    draws: Floats  # (draws of all flights, P) `Nuisance.flight_draws` of the columns
    absorbed: Floats  # (X, P) `ReducedNuisance.absorbed` of the columns
    products: Floats  # (P, P) products of the columns, nuisances marginalised

    @classmethod
    def from_columns(
        cls, nuisance: Nuisance, solved: ReducedNuisance, columns: ValueColumns
    ) -> FilteredColumns:
        """Filter modal columns, rpm, and marginalise the nuisances.

        `solved` are the products of the nuisance columns with the scatter marginalised.
        """
        z = nuisance.filter_columns(columns)
        drawn, (shared, own) = nuisance.flight_draws(z), nuisance.products(z)
        sums = shared - nuisance.cross_products.T @ drawn, own - drawn.T @ drawn
        return cls(
            nuisance=nuisance,
            solved=solved,
            z=z,
            draws=drawn,
            absorbed=solved.absorbed(sums[0]),
            products=solved.reduce(sums),
        )

    def gram(self, residual: Floats) -> Floats:
        """Return the Gram matrix (P + 1, P + 1) of the columns and a modal residual (N, R), rpm.

        Nuisances are marginalised.
        """
        n = self.nuisance
        r = n.filter_columns(residual[:, :, None])
        drawn, (shared, own) = n.flight_draws(r)[:, 0], n.products(r)
        absorbed = self.solved.absorbed(shared - n.cross_products.T @ drawn[:, None])[:, 0]
        cross = self.z.products(r.values[:, :, 0], n.flights) - self.draws.T @ drawn
        cross = cross - self.absorbed.T @ absorbed
        corner = np.array([[own[0, 0] - drawn @ drawn - absorbed @ absorbed]])
        return np.block([[self.products, cross[:, None]], [cross[None], corner]])


TINY = 1e-9  # keeps the matrix of a value without effect solvable

Key = frozenset[int]


@dataclass(frozen=True, kw_only=True, eq=False)
class EffectSet:
    """A set of effects with its values and its score, from the search to the report.

    The search fits the values with the nonlinear effects; a fold of cross-validation scores them.
    """

    key: Key  # candidate indices
    trials: tuple[TrialEffect, ...]  # in the order of the candidate indices
    set_score: SetScore
    residual: Floats  # (N, R) rpm in modes

    @cached_property
    def effects(self) -> Mapping[int, TrialEffect]:
        """Return the effects by candidate index, in ascending order."""
        return dict(zip(sorted(self.key), self.trials, strict=True))

    @property
    def terms(self) -> tuple[Term, ...]:
        """Return the terms in the order of the candidate indices."""
        return tuple(one.candidate.term for one in self.trials)

    @property
    def total(self) -> float:
        """Return the log evidence, with the log prior probability of the set."""
        return self.set_score.log_evidence

    @property
    def possible_key(self) -> Key:
        """Return the set without the effects that have a main value at its bound."""
        kept = []
        for c, trial in self.effects.items():
            values = zip(trial.candidate.parameters, trial.free_values, strict=True)
            if all(is_shape(p) or p.lower < value < p.upper for p, value in values):
                kept.append(c)
        return frozenset(kept)


@dataclass(frozen=True, kw_only=True, eq=False)
class _AboutSet:
    """All candidates about a fitted set, and the places of their values among the columns."""

    about: EffectSet
    trials: tuple[TrialEffect, ...]  # (C,) at their values in the set; at their starts outside it
    columns: tuple[slice, ...]  # (C,) columns of each candidate's free values
    temperature: float  # factor on the noise while sets are scored


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearisedSets(_AboutSet):
    """All candidates, linearised about a fitted set.

    `gram` (q, q) is of [derivatives, changes, residual]. A change is what a candidate adds to the
    prediction by entering the set at its start values, or by leaving it.
    """

    gram: Floats

    @cached_property
    def _priors(self) -> tuple[ValuePrior, ...]:
        """Return the prior of each candidate's values alone."""
        return tuple(prior_of([one]) for one in self.trials)

    @cached_property
    def _reading_ratios(self) -> Floats:
        """Return the log likelihood ratio (C,) of each candidate's reading."""
        return np.array([one.log_likelihood_ratio for one in self._priors])

    def score(self, key: Iterable[int]) -> SetScore:
        """Score a set of candidates on the linearised problem: log evidence, step and variance of
        its values.

        `key` has the candidates' indices.
        """
        members = sorted(key)
        where = self._value_places(members)
        residual = self._residual_weights(frozenset(members))
        gradient = self.gram @ residual
        whole = np.empty((where.size + 1, where.size + 1))
        whole[:-1, :-1] = self.gram[where[:, None], where]
        whole[:-1, -1] = whole[-1, :-1] = gradient[where]
        whole[-1, -1] = gradient @ residual
        return score(prior_of([self.trials[c] for c in members]), whole, self.temperature)

    def gains(self, key: Key, pool: Sequence[int]) -> Floats:
        """Estimate the gain (n,) in log likelihood of changing the set `key` by each candidate of
        `pool`.

        Both hold candidate indices. The values of the set are refitted to the linearised problem.
        """
        members = sorted(key)
        gram, where, residual = self.gram, self._value_places(members), self._residual_weights(key)
        prior = prior_of([self.trials[c] for c in members])
        system = gram[np.ix_(where, where)] + np.diag(prior.weight + TINY)
        remaining = gram - gram[:, where] @ np.linalg.solve(system, gram[where])
        gradient = remaining @ residual
        first = self.columns[-1].stop if self.columns else 0
        out = np.zeros(len(pool))
        sizes = np.array([self.columns[c].stop - self.columns[c].start for c in pool])
        for size in np.unique(sizes):
            of_size = np.flatnonzero(sizes == size)
            some = np.array(pool)[of_size]
            part = np.array([self.columns[c].start for c in some])[:, None] + np.arange(size)
            change, own = first + some, [self._priors[c] for c in some]
            sign = np.array([1.0 if c in self.about.key else -1.0 for c in some])
            pull = np.stack([one.pull for one in own])
            g = gradient[part] + sign[:, None] * remaining[part, change[:, None]] + pull
            h = remaining[part[:, :, None], part[:, None, :]].copy()
            place = np.arange(size)
            weight = np.stack([one.weight for one in own])
            h[:, place, place] += weight + TINY * (np.abs(h[:, place, place]) + TINY)
            gain = np.sum(g * np.linalg.solve(h, g[:, :, None])[:, :, 0], axis=1)
            out[of_size] = 0.5 * gain - sign * gradient[change] - 0.5 * remaining[change, change]
            out[of_size] += self._reading_ratios[some]
        return out

    def restrict(self, members: Collection[int], without: Collection[int]) -> LinearisedSets:
        """Return the problem in which only candidates in `members` have free values.

        `without` are flight numbers: values that belong to one of these flights, and the flights'
        readings, are dropped too.
        """
        trials, columns, kept = [], [], []
        for c, (one, places) in enumerate(zip(self.trials, self.columns, strict=True)):
            free = one.candidate.free if c in members else ()
            mine = [k for k, (_, flight) in enumerate(free) if flight not in without]
            candidate = replace(one.candidate, free=tuple(free[k] for k in mine))
            if candidate.reading is not None:
                candidate = replace(candidate, reading=candidate.reading.without(without))
            trials.append(replace(one, candidate=candidate))
            columns.append(slice(len(kept), len(kept) + len(mine)))
            kept += [places.start + k for k in mine]
        first = self.columns[-1].stop if self.columns else 0
        kept += range(first, self.gram.shape[0])
        gram = self.gram[np.ix_(kept, kept)]
        return replace(self, trials=tuple(trials), columns=tuple(columns), gram=gram)

    def law_error(self, c: int, k: int) -> float:
        """Return the standard error of value number `k` of candidate `c` due to inaccurate
        equations.

        Every effect in the set is accurate to the share FORM of the change that it predicts; the
        errors of all add up. The candidate itself is outside the set.
        """
        place = self.columns[c].start + k
        first = self.columns[-1].stop if self.columns else 0
        changes = [first + c for c in self.about.key]
        magnitude = float(np.abs(self.gram[place, changes]).sum())
        return FORM * magnitude / max(float(self.gram[place, place]), TINY)

    def _value_places(self, members: Sequence[int]) -> NDArray[np.intp]:
        """Return the row indices in `gram` of the values of some candidates."""
        places = [k for c in members for k in range(self.columns[c].start, self.columns[c].stop)]
        return np.array(places, dtype=np.intp)

    def _residual_weights(self, key: Key) -> Floats:
        """Return weights (q,) that combine the q columns of `gram` into the residual of the set
        `key`.

        The residual column has 1, the total change of each candidate that enters or leaves has -1.
        """
        weights = np.zeros(self.gram.shape[1])
        weights[-1] = 1.0
        first = self.columns[-1].stop if self.columns else 0
        weights[[first + c for c in self.about.key ^ key]] = -1.0
        return weights


@dataclass(frozen=True, kw_only=True, eq=False)
class SetColumns(_AboutSet):
    """The q columns, rpm in modes, from which `LinearisedSets` are made for any subset of the
    means."""

    whole: ValueColumns

    def linear(self, solved: ReducedNuisance, sums: Sums) -> LinearisedSets:
        """Return the linear problem of the rows from which `sums` were computed.

        `solved` are the nuisance columns' products over these rows, `sums` those of the columns.
        """
        return LinearisedSets(
            about=self.about,
            trials=self.trials,
            columns=self.columns,
            gram=solved.reduce(sums),
            temperature=self.temperature,
        )
