"""Cross-validate an answer: predict each flight with effects that were fitted without it.

Each flight is held out in turn; many flights are held out in MOST_FOLDS groups, a single flight in
FIFTHS. The sums over the other flights form a smaller problem, on which every set that the search
has fitted is scored again; effects are selected and values estimated from these sums alone. Values
that belong to one flight (its wind, the time of a step) cannot come from other flights. They are
fitted on every other block of time of that flight and used on the blocks between.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.models.effects.compose import fill_neutral
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.identification.answer.posterior import EffectEstimate, Posterior
from thrustmargin.models.identification.rows.candidates import (
    Term,
    TrialEffect,
    candidate,
    placed_effects,
)
from thrustmargin.models.identification.rows.problem import Problem
from thrustmargin.models.identification.rows.row_fit import fit_rows
from thrustmargin.models.identification.sets.linear_sets import (
    EffectSet,
    LinearisedSets,
    SetColumns,
)
from thrustmargin.models.identification.sets.nuisance import Nuisance, ReducedNuisance
from thrustmargin.models.identification.sets.set_search import Search

MOST_FOLDS = 20  # folds of many flights: a twentieth is held out
FIFTHS = 5  # folds of a single flight

Values = dict[int, Floats]  # candidate -> (F, K)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeldOutFold:
    """One fold: the search's problem without some flights, or without a fifth of a single
    flight."""

    flights: tuple[int, ...]  # held-out flights; none for a fifth of a single flight
    rows: Bools  # (T,) held-out rows of the problem
    linear: LinearisedSets

    def named_candidates(self, search: Search) -> list[int]:
        """Return the candidates that would be reported if this fold's data were missing."""
        return self._posterior(search, search.possible_sets).named_candidates()

    def unnamed_members(self, search: Search) -> list[int]:
        """Return the candidates that may enter a model as unnamed causes, without this
        fold's data."""
        return self._posterior(search, search.possible_sets).unnamed_members()

    def excludes(self, search: Search, candidate: int) -> bool:
        """Return True if a candidate, variants included, is improbable without this fold's data."""
        return not self._posterior(search, search.possible_sets).is_possible(candidate)

    def values(self, search: Search, members: Collection[int]) -> Values:
        """Return the values (F, K) of each candidate in `members`, fitted without this fold."""
        answer = self._posterior(search, [frozenset(members)])
        return {c: answer.estimate(c).value for c in members}

    def _posterior(self, search: Search, keys: Iterable[frozenset[int]]) -> Posterior:
        """Return the posterior over the effect sets `keys`, each scored on the flights outside this
        fold.
        """
        linear, sets = self.linear, []
        for key in keys:
            sets.append(
                EffectSet(
                    key=key,
                    trials=tuple(linear.trials[c] for c in sorted(key)),
                    set_score=linear.score(key),
                    residual=linear.about.residual,
                )
            )
        return Posterior.from_sets(search, sets)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoldSums:
    """Nuisance sums of every fold, shared by all sets that are cross-validated."""

    flights: tuple[tuple[int, ...], ...]
    nuisances: tuple[Nuisance, ...]  # nuisances of the held-out flights alone
    solved: tuple[ReducedNuisance, ...]  # nuisances of all other flights

    @classmethod
    def from_nuisance(cls, nuisance: Nuisance) -> FoldSums:
        """Prepare the nuisances of each fold: one flight each, or MOST_FOLDS groups of flights.

        No folds for a single flight.
        """
        every = len(nuisance.flights)
        count = min(every, MOST_FOLDS) if every > 1 else 0
        flights = [tuple(range(k, every, count)) for k in range(count)]
        less = [nuisance.select_means(np.isin(nuisance.whitening.flight, out)) for out in flights]
        solved = [nuisance.marginalise(less=one) for one in less]
        return cls(flights=tuple(flights), nuisances=tuple(less), solved=tuple(solved))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CrossValidation:
    """The rows that errors are reported on, and the search's problem without each fold."""

    problem: Problem
    search: Search
    folds: tuple[HeldOutFold, ...]

    @classmethod
    def about_set(
        cls,
        problem: Problem,
        search: Search,
        start: EffectSet,
        *,
        alone: bool = False,
        out: FoldSums | None = None,
    ) -> CrossValidation:
        """Linearise about the set `start`, fitted to all flights, and subtract each fold from the
        sums.

        With `alone`, only the values of that set can be refitted: enough to cross-validate this set
        and no other. `out` are the folds' sums if already computed. A single flight is split into
        fifths.
        """
        columns, nuisance = search.set_columns(start, alone=alone), search.nuisance
        if problem.flights == 1:
            return cls(
                problem=problem, search=search, folds=_folds_of_one_flight(search, columns, problem)
            )
        out = out or FoldSums.from_nuisance(nuisance)
        members = frozenset().union(*search.fitted)
        shared, own = nuisance.sums(columns.whole)
        folds = []
        for flights, less, solved in zip(out.flights, out.nuisances, out.solved, strict=True):
            less_shared, less_own = less.sums(columns.whole)
            rest = shared - less_shared, own - less_own
            linear = columns.linear(solved, rest).restrict(members, flights)
            rows = np.isin(problem.flight, flights)
            folds.append(HeldOutFold(flights=flights, rows=rows, linear=linear))
        return cls(problem=problem, search=search, folds=tuple(folds))

    def residual(self, values: Values) -> Floats:
        """Return the residual (T, R), rpm, measured minus predicted, with `values` on all rows."""
        placed_ = placed_effects(self.problem, self.trial_effects(values))
        return self.problem.measured_rpm - self.problem.speeds(placed_)

    def with_effects(self, members: Collection[int]) -> Floats:
        """Return the residual (T, R), rpm, with the effects `members` (candidates).

        Each row uses values fitted without its fold.
        """
        return self._assemble_residual([fold.values(self.search, members) for fold in self.folds])

    def fold_squares(self, residual_rpm: Floats) -> Floats:
        """Return the mean square (folds,) of a residual (T, R) over the rows of each fold."""
        square = np.mean(residual_rpm**2, axis=1)
        return np.array([square[fold.rows].mean() for fold in self.folds])

    def with_persistent_effects(self, members: Collection[int]) -> Floats:
        """Return the residual (T, R), rpm, measured minus predicted, by those of the effects
        `members` that also apply to later flights.

        `members` are candidate indices. For each row all of them are fitted to the other folds,
        without the row's own. Effects of the fitted flights alone (a wind, a step) are then left
        out of the prediction.
        """
        lasting = {c for c in members if not self._term(c).effect.of_its_flights}
        values = [fold.values(self.search, members) for fold in self.folds]
        return self._assemble_residual(
            [{c: v for c, v in of_fold.items() if c in lasting} for of_fold in values]
        )

    def with_selected_effects(
        self, members: Collection[int], dropped: Collection[int], *, open_: bool = False
    ) -> Floats:
        """Return the residual (T, R), rpm, with effects selected and fitted anew without each row's
        fold.

        Each fold selects from all candidates by itself, except those in `dropped` and effects that
        begin at a time. `members` adds to every fold's selection, even if in `dropped`, those of
        its effects that begin at a time or have a value of the held-out flight itself, because
        other flights cannot show them. With `open_`, folds select unnamed causes too. `members`
        and `dropped` are candidate indices.
        """
        values = []
        for fold in self.folds:
            selected = fold.named_candidates(self.search)
            selected += fold.unnamed_members(self.search) if open_ else []
            own = [c for c in members if self._only_shown_by(fold, c)]
            chosen = {c for c in selected if c not in dropped and not self._term(c).effect.begins}
            values.append(fold.values(self.search, chosen | set(own)))
        return self._assemble_residual(values)

    def excludes_any(self, members: Collection[int]) -> bool:
        """Return True if one of the candidates is improbable without some fold's data.

        Effects that only the held-out flight can show do not count.
        """
        return any(
            fold.excludes(self.search, c)
            for fold in self.folds
            for c in members
            if not self._only_shown_by(fold, c)
        )

    def _only_shown_by(self, fold: HeldOutFold, c: int) -> bool:
        """Return True if candidate `c` begins at a time or has values of the fold's own flights."""
        own = any(f in fold.flights for _, f in self.search.candidates[c].free)
        return own or self._term(c).effect.begins

    def _term(self, c: int) -> Term:
        """Return the term of candidate `c`."""
        return self.search.candidates[c].term

    def trial_effects(self, values: Values) -> list[TrialEffect]:
        """Return the effects with values (F, K) for all flights, in the order of candidates."""
        return [_trial_effect(self._term(c), v) for c, v in sorted(values.items())]

    def _assemble_residual(self, values: Sequence[Values]) -> Floats:
        """Return the residual (T, R), rpm, where each row uses the values fitted without its
        fold."""
        out = np.empty_like(self.problem.measured_rpm)
        for fold, fold_values in zip(self.folds, values, strict=True):
            if not fold.flights:
                out[fold.rows] = self.residual(fold_values)[fold.rows]
            for f in fold.flights:
                mine = np.flatnonzero(self.problem.flight == f)
                trials = self.trial_effects({c: v[[f]] for c, v in fold_values.items()})
                out[mine] = residual_on_other_flights(self.problem.rows(mine), trials)
        return out


def _folds_of_one_flight(
    search: Search, columns: SetColumns, problem: Problem
) -> tuple[HeldOutFold, ...]:
    """Return folds of a single flight: contiguous fifths, cut at borders of blocks."""
    blocks = problem.block_flight.size
    part = np.arange(blocks) * min(FIFTHS, blocks) // blocks
    begins = problem.channels.time_s[np.searchsorted(problem.block, np.arange(blocks))]
    means_s = search.reduced.channels.time_s[search.nuisance.whitening.rows]
    of_mean = part[np.maximum(np.searchsorted(begins, means_s, side="right") - 1, 0)]
    folds = []
    for k in np.unique(part):
        rest = search.nuisance.select_means(of_mean != k)
        linear = columns.linear(rest.marginalise(), rest.sums(columns.whole))
        folds.append(HeldOutFold(flights=(), rows=part[problem.block] == k, linear=linear))
    return tuple(folds)


def held_out_residual(unused: Problem, estimates: Sequence[EffectEstimate]) -> Floats:
    """Return the residual (T, R), rpm, of the flights in `unused`, predicted with reported effects.

    Shared values are the median over the fitted flights, and so are the start values of values that
    each flight has for itself; these are refitted on every other block
    (`residual_on_other_flights`). An effect has no influence where its channels are NaN.
    """
    trials = []
    for one in estimates:
        middle = np.median(one.value, axis=0)
        names = (p.name for p in one.term.effect.parameters)
        x = fill_neutral(one.term.effect, dict(zip(names, middle, strict=True)), unused.channels)
        unused = replace(unused, channels=x)
        trials.append(_trial_effect(one.term, np.repeat(middle[None], unused.flights, axis=0)))
    return residual_on_other_flights(unused, trials)


def _trial_effect(term: Term, values: Floats) -> TrialEffect:
    """Return a trial effect of `term` with `values` (F, K): F flights, K parameters."""
    return TrialEffect(candidate=candidate(term, values.shape[0]), values=values)


def residual_on_other_flights(problem: Problem, trials: Sequence[TrialEffect]) -> Floats:
    """Return the residual (T, R), rpm, of flights that the effects `trials` were not fitted on.

    Shared values stay as given. Values that each flight has for itself are fitted on every other
    block of the flight, to predict the blocks between.
    """
    measured = problem.measured_rpm
    if not any(flight is not None for h in trials for _, flight in h.candidate.free):
        return measured - problem.speeds(placed_effects(problem, trials))
    out = np.empty_like(measured)
    starts = np.searchsorted(problem.block_flight, problem.block_flight)
    parity = (np.arange(problem.block_flight.size) - starts) % 2
    for half in (0, 1):
        refitted = refit_flight_values(problem, trials, parity != half)
        rows = parity[problem.block] == half
        out[rows] = (measured - problem.speeds(placed_effects(problem, refitted)))[rows]
    return out


def refit_flight_values(
    problem: Problem, trials: Sequence[TrialEffect], chosen: Bools
) -> list[TrialEffect]:
    """Refit the values that each flight has for itself, on the blocks flagged in `chosen` (B,).

    Values that flights share stay as they are.
    """
    own = [
        replace(h.candidate, free=tuple(f for f in h.candidate.free if f[1] is not None))
        for h in trials
    ]
    free = [replace(h, candidate=c) for h, c in zip(trials, own, strict=True)]
    return list(fit_rows(problem, free, chosen).trials)
