"""From sets and their evidence to an answer: named, one of, not seen and excluded above.

An effect is named when nearly all the weight of all sets holds it. Where only together several do,
it is one of them. Values and intervals are averaged over the sets that have weight,
so that what cannot be distinguished is in them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from thrustmargin.models.effects.unnamed import KNOTS
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.answer.result import Excluded, Mentioned, OneOf, SetWeight
from thrustmargin.models.identification.certainty import CHOICE, DOUBT, ERRORS, SURE
from thrustmargin.models.identification.rows.candidates import (
    Candidate,
    Term,
    TrialEffect,
    derivatives,
    predicted_modes,
)
from thrustmargin.models.identification.sets.discrepancy import FORM
from thrustmargin.models.identification.sets.linear_sets import FittedSet, LinearisedSets
from thrustmargin.models.identification.sets.set_search import Search


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EffectEstimate:
    """One effect over all sets that hold it: (F, K) values and their standard errors."""

    candidate: int
    term: Term
    probability: float
    value: Floats
    error: Floats
    steepness: float = 0.0  # standard error of what sets the size of all values, as a share

    @property
    def half_width(self) -> Floats:
        """(F, K) of intervals of 95 %, with what no number of rows gets them below."""
        parameters = self.term.effect.parameters
        finest = np.array([p.resolution for p in parameters])
        share = np.array([p.accuracy for p in parameters])
        share = share + np.array([0.0 if p.detail else ERRORS * self.steepness for p in parameters])
        return ERRORS * self.error + finest + np.abs(self.value) * share


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Posterior:
    """All fitted sets with their weights, likeliest first."""

    search: Search
    sets: tuple[FittedSet, ...]
    weights: Floats  # (sets,)
    steepness: float  # of the thrust curve of motor outputs: a standard error, as a share

    @classmethod
    def from_sets(
        cls, search: Search, fitted: Iterable[FittedSet], steepness: float = 0.0
    ) -> Posterior:
        """Sets with their weights."""
        sets = sorted(fitted, key=lambda f: -f.total)
        totals = np.array([s.total for s in sets])
        weights = np.exp(totals - np.logaddexp.reduce(totals))
        return cls(search=search, sets=tuple(sets), weights=weights, steepness=steepness)

    def drop_sets(self, dropped: Collection[frozenset[int]]) -> Posterior:
        """The answer without some sets."""
        kept = [s for s in self.sets if s.key not in dropped]
        return Posterior.from_sets(self.search, kept, self.steepness)

    @property
    def best(self) -> FittedSet:
        return self.sets[0]

    def probability(self, members: Collection[int]) -> float:
        """That at least one of some candidates is there."""
        wanted = set(members)
        trials = [w for s, w in zip(self.sets, self.weights, strict=True) if s.key & wanted]
        return min(1.0, float(sum(trials)))

    def named_candidates(self) -> list[int]:
        """Candidates that nearly all the weight holds, with an interval that excludes zero.

        A rotor that is surely weak is named though it may be so from the start or from a moment on:
        by the likeliest of these.
        """
        seen = sorted({c for s in self.sets for c in s.key if not self._unnamed(c)})
        likely = [c for c in seen if self.probability([c]) >= SURE]
        for c in seen:
            alike = self._equivalent_candidates(c)
            names = [k for k in alike if not self._unnamed(k)]
            first = max(names, key=lambda c: self.probability([c]))
            if c == first and not {*likely} & alike and self.probability(alike) >= SURE:
                likely.append(c)
        return [c for c in sorted(likely) if _excludes_zero(self.estimate(c))]

    def _unnamed(self, candidate: int) -> bool:
        return self.search.candidates[candidate].unnamed

    def _equivalent_candidates(self, candidate: int) -> set[int]:
        """The candidate, of an effect on one rotor all that have it on that rotor."""
        term = self.search.candidates[candidate].term
        if term.rotor is None:
            return {candidate}
        return {
            c
            for s in self.sets
            for c in s.key
            if self.search.candidates[c].term.rotor == term.rotor
            and (self._unnamed(c) or self.search.candidates[c].term.effect.name == term.effect.name)
        }

    def estimate(self, candidate: int) -> EffectEstimate:
        """Mean and standard error over sets of the values of one candidate."""
        term = self.search.candidates[candidate].term
        total, mean, square = 0.0, 0.0, 0.0
        for one in self.sets:
            if candidate not in one.key:
                continue
            of = sorted(one.key).index(candidate)
            before = sum(len(h.candidate.free) for h in one.trials[:of])
            trial = one.trials[of]
            weight = float(np.exp(one.total - self.sets[0].total))
            values, errors = trial.values.copy(), np.zeros_like(trial.values)
            for k, (parameter, flight) in enumerate(trial.candidate.free):
                rows = slice(None) if flight is None else flight
                values[rows, parameter] += one.scored.step[before + k]
                errors[rows, parameter] = one.scored.variance[before + k]
            total += weight
            mean = mean + weight * values
            square = square + weight * (errors + values**2)
        mean, square = np.asarray(mean) / total, np.asarray(square) / total
        error = np.sqrt(np.maximum(square - mean**2, 0.0))
        if self._unnamed(candidate):
            mean = _interpolate_unknown_knots(self.search.candidates[candidate], mean, error)
        return EffectEstimate(
            candidate=candidate,
            term=term,
            probability=self.probability(self._equivalent_candidates(candidate)),
            value=mean,
            error=error,
            steepness=self.steepness,
        )

    def estimates(self, kept: Sequence[int], either: Collection[int] = ()) -> list[EffectEstimate]:
        """Of the kept names those whose own interval excludes zero. Values are those
        of them alone, since that is what they predict with, but beside the likeliest of each
        `either ... or`, and as uncertain as the absence of whatever else is likely moves them."""
        kept, found = sorted(kept), []
        while kept:
            alone = Posterior.from_sets(
                self.search, [self.fit_alone({*kept, *either})], self.steepness
            )
            found, still_clear = [], []
            for c in kept:
                among, own = self.estimate(c), alone.estimate(c)
                error = np.hypot(own.error, among.value - own.value)
                found.append(replace(among, value=own.value, error=np.maximum(error, among.error)))
                # Of one value that is by its interval; of several another may stand out each time.
                if _excludes_zero(own) and (
                    _excludes_zero(found[-1]) or len(_main_values(own.term)) > 1
                ):
                    still_clear.append(c)
            if still_clear == kept:
                break
            kept, found = still_clear, []
        return found

    def fit_alone(self, kept: Iterable[int]) -> FittedSet:
        """The set of these effects and no other, fitted from where likely sets have them."""
        key = frozenset(kept)
        near = {c: h for s in self.sets[::-1] for c, h in zip(sorted(s.key), s.trials, strict=True)}
        return self.search.fitted.get(key) or self.search.fit_near(key, near)

    def alternatives(self) -> tuple[SetWeight, ...]:
        """Sets that have weight."""
        return tuple(
            SetWeight(
                probability=float(w),
                terms=tuple(self.search.candidates[c].term for c in sorted(s.key)),
            )
            for s, w in zip(self.sets, self.weights, strict=True)
            if w >= DOUBT
        )

    def one_of(self, named: Sequence[int]) -> tuple[OneOf, ...]:
        """The smallest groups of effects without a name of which nearly surely one is there.

        An effect that is likely by itself, at a size that may be nothing, is no such group, nor are
        effects that mostly come together: one stands in for another, else it is no choice.
        """
        rest = {c for s in self.sets for c in s.key if not self._unnamed(c)} - set(named)
        by_weight = sorted(
            (c for c in rest if self.probability([c]) >= DOUBT),
            key=lambda c: -self.probability([c]),
        )
        found = []
        while by_weight and self.probability(by_weight) >= SURE:
            group = [by_weight[0]]
            while self.probability(group) < SURE:
                left = [c for c in by_weight if c not in group]
                group.append(max(left, key=lambda c: self.probability([*group, c])))
            alone = sum(
                w
                for s, w in zip(self.sets, self.weights, strict=True)
                if len(s.key & set(group)) == 1
            )
            if len(group) == 1 or alone < CHOICE:
                del by_weight[0]
                continue
            found.append(
                OneOf(
                    terms=tuple(self.search.candidates[c].term for c in group),
                    probabilities=tuple(self.probability([c]) for c in group),
                )
            )
            by_weight = [c for c in by_weight if c not in group]
        return tuple(found)

    def mentioned(self, named: Sequence[int]) -> tuple[tuple[Mentioned, int], ...]:
        """Rotors without a name that still have weight, each with its likeliest candidate."""
        candidates = self.search.candidates
        safe = {candidates[c].term.rotor for c in named}
        rotors: dict[int, list[int]] = {}
        for c in {c for s in self.sets for c in s.key}:
            rotor = candidates[c].term.rotor
            if rotor is not None and rotor not in safe:
                rotors.setdefault(rotor, []).append(c)
        found = []
        for rotor, members in sorted(rotors.items()):
            probability = self.probability(members)
            if probability <= DOUBT:
                continue
            named_ones = [c for c in members if not self._unnamed(c)]
            if not named_ones:
                continue
            likeliest = max(named_ones, key=lambda c: self.probability([c]))
            estimate = self.estimate(likeliest)
            largest = int(np.argmax(np.abs(estimate.value[:, 0])))
            loss, half = (float(v[largest, 0]) for v in (estimate.value, estimate.half_width))
            one = Mentioned(
                rotor=rotor, probability=probability, loss=loss, ci95=(loss - half, loss + half)
            )
            found.append((one, likeliest))
        return tuple(found)

    def excluded(self, linear: LinearisedSets, named: Sequence[int]) -> tuple[Excluded, ...]:
        """Sizes above which effects of one main value are excluded, beside the best set."""
        best, found = self.best, []
        for c, candidate in enumerate(self.search.candidates):
            main = [
                k
                for k, p in enumerate(candidate.parameters)
                if p.absent is not None and not p.detail
            ]
            if c in named or len(main) != 1 or candidate.term.effect.begins:
                continue
            if self.probability([c]) > DOUBT:
                continue
            key = best.key | {c}
            scored = linear.score(key)
            at = sum(len(self.search.candidates[k].free) for k in sorted(key) if k < c) + main[0]
            p = candidate.parameters[main[0]]
            value = linear.trials[c].free_values[main[0]] + scored.step[at] - (p.absent or 0.0)
            error = float(np.hypot(np.sqrt(scored.variance[at]), linear.law_error(c, main[0])))
            above = float(abs(value) + ndtri(SURE) * error)
            absent = p.absent or 0.0
            if above >= max(p.upper - absent, absent - p.lower):
                continue  # what cannot be is no size to exclude
            found.append(
                Excluded(
                    term=candidate.term,
                    parameter=p.name,
                    unit=p.unit,
                    above=above,
                )
            )
        return tuple(found)


def _interpolate_unknown_knots(one: Candidate, value: Floats, error: Floats) -> Floats:
    """The values (F, K) of a curve: a knot of which the flights say less than its prior, as one
    that they do not reach, lies between those beside it, and beyond the last is as that."""
    free = {k for k, _ in one.free}
    known = [
        k
        for k, p in enumerate(one.term.effect.parameters[:KNOTS])
        if k not in free or 2.0 * error[0, k] ** 2 < p.scale**2
    ]
    value = value.copy()
    value[:, :KNOTS] = np.interp(np.arange(KNOTS), known, value[0, known])
    return value


def _main_values(term: Term) -> list[tuple[int, float]]:
    """The values that make an effect, by their places, and where they are absent."""
    every = enumerate(term.effect.parameters)
    return [(k, p.absent) for k, p in every if p.absent is not None and not p.detail]


def _excludes_zero(estimate: EffectEstimate) -> bool:
    """True where the interval of a main value leaves out "absent"; effects without it are clear."""
    away = [
        np.abs(estimate.value[:, k] - absent) > ERRORS * estimate.error[:, k]
        for k, absent in _main_values(estimate.term)
    ]
    return not away or bool(np.any(away))


def posterior_of(search: Search, steepness: float = 0.0) -> Posterior:
    """The sets that a search has fitted, with their weights."""
    return Posterior.from_sets(search, search.fitted.values(), steepness)


def add_law_error(search: Search, estimate: EffectEstimate) -> EffectEstimate:
    """The estimate with the error of its law beside its own: a law is good to FORM of what it
    changes, so a value to what alone would have to differ for that."""
    reduced, one = search.reduced, search.candidates[estimate.candidate]
    trials = [TrialEffect(candidate=one, values=estimate.value)]
    change = np.nan_to_num(predicted_modes(reduced, trials) - predicted_modes(reduced, ()))
    by_value = np.nan_to_num(derivatives(reduced, trials, 0))
    size, whole = np.sqrt(np.mean(by_value**2, axis=(0, 1))), np.sqrt(np.mean(change**2))
    of_law = np.zeros(estimate.value.shape[1])
    for (k, flight), per_value, p in zip(one.free, size, one.parameters, strict=True):
        if flight is None and not p.detail and per_value > 0.0 and not one.unnamed:
            of_law[k] = FORM * whole / per_value
    return replace(estimate, error=np.hypot(estimate.error, of_law))
