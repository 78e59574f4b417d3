"""Search for the most probable sets of effects.

About a fitted set everything is linear: one Gram matrix contains the derivatives by the values of
all candidates, each candidate's change by entering or leaving, and the residual. On it a beam
search grows sets, and neighbours of the best set are tried, thousands a second. The highest-ranked
sets are refitted with the nonlinear effects. The search then restarts around the best of them, and
stops when the best set no longer changes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import combinations

import numpy as np

from thrustmargin.models.effects.thrust_effects import ROTOR_DEGRADATION
from thrustmargin.models.effects.unnamed import place_of
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.rows.candidates import (
    Candidate,
    TrialEffect,
    predicted_modes,
    value_columns,
)
from thrustmargin.models.identification.rows.reduced import Reduced
from thrustmargin.models.identification.rows.value_columns import ValueColumns, concatenate_columns
from thrustmargin.models.identification.sets.evidence import (
    IMPOSSIBLE,
    TEMPERATURE,
    prior_of,
    score,
)
from thrustmargin.models.identification.sets.linear_sets import (
    EffectSet,
    FilteredColumns,
    Key,
    LinearisedSets,
    SetColumns,
)
from thrustmargin.models.identification.sets.nuisance import Nuisance

BEAM = 12  # sets that are grown further at each size
FITTED = 6  # sets that are fitted with nonlinear effects in each round
#: sets one effect away that are fitted whatever their linear score, which may be inaccurate
NEXT = 4
PAIRED = 5  # single effects of which all pairs are fitted
ROUNDS = 6  # restarts around the best sets at most
MOST_EFFECTS = 10  # effects of one set
#: below the best log evidence, at which the fit of a set ends: a lag alone may gain 200
HOPELESS = 500.0
NEAR = 9.0  # of log evidence below the best: less than one in 8,000 as likely
FAR = 3 * NEAR  # below the best, at which the fit of a set ends if its steps cannot make up for it

STALE = 2.0  # gain in -2 log likelihood below which derivatives are recomputed
CONVERGED = 0.02  # gain in -2 log likelihood below which a fit has converged

Progress = Callable[[str, float], None]


class Search:
    """A search in progress: candidates, and the sets fitted so far."""

    def __init__(
        self,
        reduced: Reduced,
        nuisance: Nuisance,
        candidates: Sequence[Candidate],
    ) -> None:
        """Prepare a search over `candidates`, with the noise raised by TEMPERATURE.

        For motor outputs it is not raised.
        """
        filter_ = nuisance.whitening
        # For outputs, between-flight variation has been widened by Student's t already.
        self.temperature = 1.0 if reduced.of_outputs else TEMPERATURE
        tempered = replace(filter_, scale=self.temperature * filter_.scale)
        self.reduced, self.nuisance = reduced, replace(nuisance, whitening=tempered)
        self.candidates = list(candidates)
        self.solved = self.nuisance.marginalise()
        self.fitted: dict[Key, EffectSet] = {}
        self.start = [
            TrialEffect(candidate=c, values=self._start_values(c)) for c in self.candidates
        ]

    def _start_values(self, one: Candidate) -> Floats:
        """Return the start values (F, K) of a candidate.

        A delay starts at the median of the flights' readings: its likelihood has several maxima,
        and steps from zero may end at a small wrong one.
        """
        if not one.term.effect.delays:
            return one.start
        return np.full_like(one.start, np.median(self.reduced.delay_s[:, 0]))

    def run(self, progress: Progress | None = None) -> None:
        """Search for the most probable set of effects, until a round finds none more probable, in
        at most ROUNDS rounds.

        The result is in `best`, the best of all sets in `fitted`. If a fit raises the log evidence
        by more than FAR, the round ends and the next one starts from that set. `progress` is called
        at the begin of each round with its name and the share of ROUNDS done.
        """
        if not self.fitted:
            self.fit(frozenset(), ())
        best = self.best
        for number in range(ROUNDS):
            if progress:
                progress(f"round {number + 1}", number / ROUNDS)
            linear = self.linearise(best)
            for key in self.promising_sets(linear):
                self.fit(key, linear.trials)
                if self.best.total > best.total + FAR:
                    break
            if self.best.key == best.key:
                self._refit_from_best(linear)
            if self.best.key == best.key:
                self._fit_pairs()
            if self.best.key == best.key:
                break
            best = self.best

    def _fit_pairs(self) -> None:
        """Fit each catalogue effect alone, and the pairs of the PAIRED most probable of them.

        The linear problem around another set misjudges a large effect: the speed of a rotor that
        lost a third of its thrust is far from linear in the loss.
        """
        alone = [frozenset({c}) for c, one in enumerate(self.candidates) if not one.unnamed]
        fits = sorted((self.fit(key, ()) for key in alone), key=lambda one: -one.total)[:PAIRED]
        for one, other in combinations(fits, 2):
            key = one.key | other.key
            if not any(self._is_duplicate(key - {c}, c) for c in key):
                near = {**one.effects, **other.effects}
                self.fit(key, [near.get(c, self.start[c]) for c in range(len(self.candidates))])

    def _refit_from_best(self, linear: LinearisedSets) -> None:
        """Refit sets whose linearised score around the best set exceeds the score they converged
        to.

        Gauss-Newton can stop early for exponents and lags.
        """
        best = self.fitted[linear.about.key]
        for key in self.possible_sets:
            fitted = self.fitted[key]
            promised = linear.score(key).log_evidence
            if promised > max(fitted.total + STALE, best.total - NEAR):
                other = self._fit(key, [linear.trials[c] for c in sorted(key)], 8, best.total)
                self.fitted[key] = max(fitted, other, key=lambda one: one.total)

    def add(self, further: Sequence[Candidate], members: Key) -> bool:
        """Add candidates `further` to the search, and fit each alone and together with the set
        `members`.

        Return True if one of these sets comes within FAR of the best, so that the search should
        continue.
        """
        near = {c: h for f in self.fitted.values() for c, h in f.effects.items()}
        added = []
        for one in further:
            self.candidates.append(one)
            self.start.append(one.initial_effect)
            new = len(self.candidates) - 1
            values = [near.get(c, self.start[c]) for c in range(new + 1)]
            added += [self.fit(key, values) for key in (frozenset({new}), members | {new})]
        return any(one.total > self.best.total - FAR for one in added)

    def fit_near(self, key: Key, near: Mapping[int, TrialEffect]) -> EffectSet:
        """Fit a set from the values `near` of a similar set, without storing it among the fitted
        sets."""
        return self._fit(key, [near[c] for c in sorted(key)], 8)

    def unnamed_members(self, key: Key) -> list[int]:
        """List the candidates, by index, that may enter a model as unnamed causes if `key` is the
        set.

        They are: unnamed causes in `key`; the steady degradation of each rotor with an unnamed
        cause in `key`, itself in `key` or not; and members of `key` that act on no rotor, are no
        step in time and apply to later flights.
        """
        every = self.candidates
        uneven = {every[c].term.rotor for c in key if every[c].unnamed} - {None}
        members = []
        for c, one in enumerate(every):
            effect, rotor = one.term.effect, one.term.degraded_rotor
            steady = effect.key == ROTOR_DEGRADATION.key and rotor in uneven
            lasts = rotor is None and not (effect.begins or effect.of_its_flights)
            if steady or (c in key and (one.unnamed or lasts)):
                members.append(c)
        return members

    def interchangeable(self, c: int) -> list[int]:
        """List the candidates that may replace candidate `c`, including itself.

        For an unnamed cause they are all in the same mode and on the same rotor, else only itself.
        """
        if not self.candidates[c].unnamed:
            return [c]
        term = self.candidates[c].term
        return [
            k
            for k, one in enumerate(self.candidates)
            if one.unnamed
            and one.term.rotor == term.rotor
            and place_of(one.term.effect)[0] == place_of(term.effect)[0]
        ]

    @property
    def possible_sets(self) -> list[Key]:
        """Return the keys of the fitted sets with all main values inside their bounds."""
        return [key for key, fitted in self.fitted.items() if fitted.total > IMPOSSIBLE / 2]

    @property
    def best(self) -> EffectSet:
        """Return the fitted set with the highest log evidence."""
        return max(self.fitted.values(), key=lambda f: f.total)

    def linearise(self, effect_set: EffectSet) -> LinearisedSets:
        """Linearise all candidates about a fitted set."""
        columns = self.set_columns(effect_set)
        return columns.linear(self.solved, self.nuisance.sums(columns.whole))

    def set_columns(self, effect_set: EffectSet, *, alone: bool = False) -> SetColumns:
        """Return the derivatives of all candidates, linearised about a fitted set, and their total
        changes.

        A member's change is that of removing it, another candidate's that of adding it at its start
        values. With `alone`, candidates outside the set have no columns and no change.
        """
        inside = effect_set.effects
        base = predicted_modes(self.reduced, effect_set.trials)
        trials, columns, changes, places = [], [], [], []
        first = 0
        for c, at_start in enumerate(self.start):
            if c in inside:
                members = list(effect_set.trials)
                place = list(inside).index(c)
                rest = [h for k, h in enumerate(members) if k != place]
                changes.append(predicted_modes(self.reduced, rest) - base)
            elif alone:
                trials.append(replace(at_start, candidate=replace(at_start.candidate, free=())))
                changes.append(np.zeros_like(base))
                places.append(slice(first, first))
                continue
            else:
                members, place = [*effect_set.trials, at_start], len(effect_set.trials)
                changes.append(predicted_modes(self.reduced, members) - base)
            columns.append(value_columns(self.reduced, members, place))
            trials.append(members[place])
            places.append(slice(first, first + columns[-1].count))
            first = places[-1].stop
        residual = self.reduced.mode_amplitudes(self.reduced.measured_rpm) - base
        both = np.stack([*changes, residual], axis=2)
        whole = concatenate_columns([*columns, ValueColumns.from_values(both)])
        return SetColumns(
            about=effect_set,
            trials=tuple(trials),
            columns=tuple(places),
            whole=whole.replace_nan(),
            temperature=self.temperature,
        )

    def promising_sets(self, linear: LinearisedSets) -> list[Key]:
        """Return unfitted sets to fit next, by score on the linearised problem `linear`.

        First up to FITTED sets within NEAR of the best score, then up to NEXT that differ from the
        best fitted set in one candidate.
        """
        scores: dict[Key, float] = {}
        best = self.fitted[linear.about.key]

        @cache
        def look(key: Key) -> float:
            """Score a set on the linear problem and keep the result."""
            scores[key] = linear.score(key).log_evidence
            return scores[key]

        centre = linear.about.key
        if centre:
            fewer = (centre - {*removed} for n in range(3) for removed in combinations(centre, n))
            self._grow(linear, list(fewer), look)
        # Grow from single effects too: other sets may replace all, pairs may gain only together.
        self._grow(linear, [frozenset({c}) for c in range(len(self.candidates))], look)
        ranked = sorted(scores, key=lambda k: -scores[k])
        top = max([best.total, *scores.values()])  # `scores` is empty without candidates
        near = [k for k in ranked if scores[k] > top - NEAR and k not in self.fitted]
        further = [k for k in ranked if len(k ^ best.key) == 1 and k not in self.fitted]
        return list(dict.fromkeys([*near[:FITTED], *further[:NEXT]]))

    def _grow(
        self, linear: LinearisedSets, starts: Sequence[Key], look: Callable[[Key], float]
    ) -> None:
        """Score sets by a beam search: add one candidate at a time to `starts`, then to the BEAM
        best sets.

        `look` scores a set and stores the score. Stop when the best set of a size is NEAR below the
        best of the size before.
        """
        everything = range(len(self.candidates))
        beam = {key: look(key) for key in starts}
        grown_from = len(beam)
        while True:
            grown: dict[Key, float] = {}
            for key in sorted(beam, key=lambda k: -beam[k])[:grown_from]:
                pool = [c for c in everything if c not in key and not self._is_duplicate(key, c)]
                if len(key) >= MOST_EFFECTS or not pool:
                    continue
                gains = linear.gains(key, pool)
                for i in np.argsort(-gains)[:BEAM]:
                    new = key | {pool[i]}
                    if new not in grown:
                        grown[new] = look(new)
            if not grown or max(grown.values()) < max(beam.values()) - NEAR:
                break
            beam, grown_from = grown, BEAM

    def _is_duplicate(self, key: Key, c: int) -> bool:
        """Return True if candidate `c` may not join the set `key`, which contains another variant
        of it.

        An effect occurs once for a rotor; one marked as of one variant occurs once in a set.
        """
        term = self.candidates[c].term
        return (term.effect.of_one_rotor or term.effect.one_variant) and any(
            (term.effect.one_variant or self.candidates[k].term.rotor == term.rotor)
            and self.candidates[k].term.effect.name == term.effect.name
            for k in key
        )

    def fit(self, key: Key, near: Sequence[TrialEffect], steps: int = 8) -> EffectSet:
        """Fit a set of candidates, with the nonlinear effects, unless it is fitted already.

        `near` holds start values of all candidates, by index; if empty their usual starts are used.
        The fit of a set far below the best ends early. If a main value ends at its bound, the set
        without that effect is fitted as well.
        """
        if key in self.fitted:
            return self.fitted[key]
        best = self.best.total if self.fitted else -np.inf
        fitted = self._fit(
            key, [near[c] if near else self.start[c] for c in sorted(key)], steps, best
        )
        self.fitted[key] = fitted
        if fitted.possible_key != key:
            self.fit(fitted.possible_key, near)  # an impossible effect may hide the others
        return fitted

    def _fit(
        self, key: Key, trials: Sequence[TrialEffect], steps: int, best: float = -np.inf
    ) -> EffectSet:
        """Fit the set `key` from the values `trials` by up to `steps` Gauss-Newton steps.

        A step that does not lower the cost is shortened to 0.3 and 0.1. Derivatives are recomputed
        once steps gain less than STALE. Stop early if even the linearised score stays far below
        `best`, a log evidence.
        """
        measured = self.reduced.mode_amplitudes(self.reduced.measured_rpm)
        columns, fresh = self._filtered_columns(trials), True
        residual = np.nan_to_num(measured - predicted_modes(self.reduced, trials))
        gram, merit = self._normal_equations(columns, trials, residual)
        promised = np.inf
        for number in range(steps if trials else 0):
            if fresh:
                fitted = self._fitted_set(key, columns, trials, residual)
                change, promised = abs(fitted.total - promised), fitted.total
                if (number and promised < best - HOPELESS) or promised + 2 * change < best - FAR:
                    return fitted
            prior = prior_of(trials)
            step = score(prior, gram).step
            gained = 0.0
            for shrink in (1.0, 0.3, 0.1):
                parts = zip(trials, prior.groups, strict=True)
                moved = [h.moved(shrink * step[group]) for h, group in parts]
                new = np.nan_to_num(measured - predicted_modes(self.reduced, moved))
                trial, value = self._normal_equations(columns, moved, new)
                if value < merit:
                    gained = merit - value
                    trials, residual, gram, merit = moved, new, trial, value
                    break
            if gained < CONVERGED and fresh:
                break
            if gained < STALE:
                columns = self._filtered_columns(trials)
                gram, merit = self._normal_equations(columns, trials, residual)
            fresh = gained < STALE
        if trials and not fresh:
            columns = self._filtered_columns(trials)
        return self._fitted_set(key, columns, trials, residual)

    def _normal_equations(
        self, columns: FilteredColumns, trials: Sequence[TrialEffect], residual: Floats
    ) -> tuple[Floats, float]:
        """Return the Gram matrix (P + 1, P + 1) of P columns and the residual (last), and the cost.

        `residual` (N, R) is modal, rpm, at the values of `trials`. The cost is its sum of squares,
        filtered and with nuisances marginalised, plus the squared distance of the values from their
        prior.
        """
        gram, prior = columns.gram(residual), prior_of(trials)
        away = prior.values - prior.centre
        return gram, float(gram[-1, -1]) + float(np.sum(prior.weight * away**2))

    def _fitted_set(
        self, key: Key, columns: FilteredColumns, trials: Sequence[TrialEffect], residual: Floats
    ) -> EffectSet:
        """Return a set at its present values, scored with the linear step to the optimum."""
        scored = score(prior_of(trials), columns.gram(residual), self.temperature)
        return EffectSet(key=key, trials=tuple(trials), set_score=scored, residual=residual)

    def final_step_change(self, best: EffectSet) -> Floats:
        """Return the change of the prediction (N, R), modal, rpm, by the last linear step that
        `best` has left.
        """
        moved, first = np.zeros_like(best.residual), 0
        step = best.set_score.step
        for k in range(len(best.trials)):
            columns = value_columns(self.reduced, best.trials, k).replace_nan()
            last = first + columns.count
            moved += columns.dense(self.reduced.flight) @ step[first:last]
            first = last
        return moved

    def _filtered_columns(self, trials: Sequence[TrialEffect]) -> FilteredColumns:
        """Return the filtered derivatives by a set's free values."""
        nothing = ValueColumns.from_values(np.zeros((*self.reduced.measured_rpm.shape, 0)))
        parts = [value_columns(self.reduced, trials, k) for k in range(len(trials))]
        whole = concatenate_columns([nothing, *parts]).replace_nan()
        return FilteredColumns.from_columns(self.nuisance, self.solved, whole)
