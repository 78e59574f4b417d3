"""Summarise the posterior over sets of effects: what to report, to list as confounded, to exclude.

An effect is reported if its inclusion probability is at least SURE and its interval excludes zero.
If only several effects together reach SURE, they are listed as "one of". Values and intervals are
averaged over all sets by their posterior probabilities, so they contain what cannot be
distinguished.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from thrustmargin.models.effects.unnamed import KNOTS
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.answer.result import Excluded, Mentioned, OneOf, SetWeight
from thrustmargin.models.identification.certainty import CHOICE, ERRORS, OPEN_PROBABILITY, SURE
from thrustmargin.models.identification.rows.candidates import (
    Candidate,
    Term,
    TrialEffect,
    derivatives,
    predicted_modes,
)
from thrustmargin.models.identification.sets.discrepancy import FORM
from thrustmargin.models.identification.sets.linear_sets import EffectSet, LinearisedSets
from thrustmargin.models.identification.sets.set_search import Search


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EffectEstimate:
    """Values (F, K) of one effect and their standard errors, averaged over the sets that contain
    it."""

    candidate: int
    term: Term
    probability: float
    value: Floats
    error: Floats
    steepness: float = 0.0  # relative standard error of the scale of all values

    @property
    def half_width(self) -> Floats:
        """Return the half widths (F, K) of the 95 % intervals of K values in F flights.

        To the statistical error are added what more rows do not reduce: the parameters' resolution,
        their relative accuracy, and the relative error of the rotor speed law's slope
        (`steepness`).
        """
        parameters = self.term.effect.parameters
        finest = np.array([p.resolution for p in parameters])
        share = np.array([p.accuracy for p in parameters])
        share = share + np.array([0.0 if p.detail else ERRORS * self.steepness for p in parameters])
        return ERRORS * self.error + finest + np.abs(self.value) * share


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Posterior:
    """All fitted sets with their posterior probabilities, most probable first."""

    search: Search
    sets: tuple[EffectSet, ...]
    weights: Floats  # (sets,)
    steepness: float  # relative standard error of the slope of thrust over motor output

    @classmethod
    def from_sets(
        cls, search: Search, fitted: Iterable[EffectSet], steepness: float = 0.0
    ) -> Posterior:
        """Build the posterior: sort `fitted` by log evidence, and normalise the probabilities."""
        sets = sorted(fitted, key=lambda f: -f.total)
        totals = np.array([s.total for s in sets])
        weights = np.exp(totals - np.logaddexp.reduce(totals))
        return cls(search=search, sets=tuple(sets), weights=weights, steepness=steepness)

    def drop_sets(self, dropped: Collection[frozenset[int]]) -> Posterior:
        """Return the posterior without the sets whose keys are in `dropped`, normalised again."""
        kept = [s for s in self.sets if s.key not in dropped]
        return Posterior.from_sets(self.search, kept, self.steepness)

    @property
    def best(self) -> EffectSet:
        """Return the most probable set."""
        return self.sets[0]

    def probability(self, members: Collection[int]) -> float:
        """Return the posterior probability that at least one of the candidates `members` is in the
        set."""
        required = set(members)
        trials = [w for s, w in zip(self.sets, self.weights, strict=True) if s.key & required]
        return min(1.0, float(sum(trials)))

    def named_candidates(self) -> list[int]:
        """List the candidates to report, ascending: inclusion probability at least SURE and an
        interval that excludes zero.

        Several candidates can be variants of one degradation (since the start, since a step). If
        only their joint probability reaches SURE, the most probable named variant is listed. A
        variant without a rotor is listed only with a probability above OPEN_PROBABILITY.
        """
        seen = sorted({c for s in self.sets for c in s.key if not self._unnamed(c)})
        likely = [c for c in seen if self.probability([c]) >= SURE]
        for c in seen:
            equivalent = self._equivalent_candidates(c)
            names = [k for k in equivalent if not self._unnamed(k)]
            first = max(names, key=lambda c: self.probability([c]))
            if self.search.candidates[c].term.degraded_rotor is None:
                # It names no arm: it is certain where it is possible and the arm is not certain.
                first = c if self.probability([c]) > OPEN_PROBABILITY else None
            if c == first and not {*likely} & equivalent and self.probability(equivalent) >= SURE:
                likely.append(c)
        return [c for c in sorted(likely) if _excludes_zero(self.estimate(c))]

    def is_possible(self, candidate: int) -> bool:
        """Return True if a candidate, or another variant of its effect, has over
        OPEN_PROBABILITY."""
        return self.probability(self._equivalent_candidates(candidate)) > OPEN_PROBABILITY

    def unnamed_members(self) -> list[int]:
        """List the candidates of the most probable set that may enter a model as unnamed causes."""
        return self.search.unnamed_members(self.best.key)

    def _unnamed(self, candidate: int) -> bool:
        """Return True if a candidate is an unnamed cause."""
        return self.search.candidates[candidate].unnamed

    def _equivalent_candidates(self, candidate: int) -> set[int]:
        """Return the candidates that count as evidence for the same effect as `candidate`.

        If it degrades a rotor: those in `sets` that degrade that rotor, of its effect or unnamed.
        If it has no rotor: itself and its effect's single-arm ones in `sets`. Else: only itself.
        """
        every, term = self.search.candidates, self.search.candidates[candidate].term
        if term.degraded_rotor is None:
            arms = {
                c
                for s in self.sets
                for c in s.key
                if every[c].term.effect.name == term.effect.name
                and every[c].term.effect.of_one_arm
                and term.rotor is None
            }
            return {candidate} | arms
        return {
            c
            for s in self.sets
            for c in s.key
            if self.search.candidates[c].term.degraded_rotor == term.rotor
            and (self._unnamed(c) or self.search.candidates[c].term.effect.name == term.effect.name)
        }

    def estimate(self, candidate: int) -> EffectEstimate:
        """Return the estimate of a candidate's values, averaged over the sets that contain it.

        Sets are weighted by their posterior probability; the error includes the variance between
        sets. `candidate` must be in one of them. The probability is that of the effect with its
        equivalents.
        """
        term = self.search.candidates[candidate].term
        total, mean, square = 0.0, 0.0, 0.0
        for one in self.sets:
            if candidate not in one.key:
                continue
            trial = one.effects[candidate]
            before = sum(len(h.candidate.free) for c, h in one.effects.items() if c < candidate)
            weight = float(np.exp(one.total - self.sets[0].total))
            values, errors = trial.values.copy(), np.zeros_like(trial.values)
            for k, (parameter, flight) in enumerate(trial.candidate.free):
                rows = slice(None) if flight is None else flight
                values[rows, parameter] += one.set_score.step[before + k]
                errors[rows, parameter] = one.set_score.variance[before + k]
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

    def estimates(
        self, kept: Sequence[int], alternatives: Collection[int] = ()
    ) -> list[EffectEstimate]:
        """Return estimates of the effects of `kept` whose intervals exclude zero when fitted alone.

        Values are those of a fit of these effects together with `alternatives`, because predictions
        use that set. Errors also contain the shift between this fit and the average over all sets.
        Dropping an effect changes the fit, so this repeats until none is dropped.
        """
        kept, estimates = sorted(kept), []
        while kept:
            alone = Posterior.from_sets(
                self.search, [self.fit_alone({*kept, *alternatives})], self.steepness
            )
            estimates, still_clear = [], []
            for c in kept:
                averaged, own = self.estimate(c), alone.estimate(c)
                error = np.hypot(own.error, averaged.value - own.value)
                estimates.append(
                    replace(averaged, value=own.value, error=np.maximum(error, averaged.error))
                )
                if _excludes_zero(own) and _excludes_zero(estimates[-1]):
                    still_clear.append(c)
            if still_clear == kept:
                break
            kept, estimates = still_clear, []
        return estimates

    def fit_alone(self, kept: Iterable[int]) -> EffectSet:
        """Return the set of exactly the effects `kept`, fitted or found among fitted sets.

        The fit starts from each effect's values in the most probable set that contains it.
        """
        key = frozenset(kept)
        near = {c: h for s in self.sets[::-1] for c, h in s.effects.items()}
        return self.search.fitted.get(key) or self.search.fit_near(key, near)

    def alternatives(self) -> tuple[SetWeight, ...]:
        """Return the sets with a posterior probability of at least OPEN_PROBABILITY."""
        return tuple(
            SetWeight(probability=float(w), terms=s.terms)
            for s, w in zip(self.sets, self.weights, strict=True)
            if w >= OPEN_PROBABILITY
        )

    def one_of(self, named: Sequence[int]) -> tuple[OneOf, ...]:
        """Return groups of unreported effects of which at least one is present with probability
        SURE.

        `named` are the reported candidates. A group is as small as possible, of two effects or
        more, of which mostly exactly one is present (probability CHOICE or more): effects that
        occur together are no choice. An effect is in one group only.
        """
        rest = {c for s in self.sets for c in s.key if not self._unnamed(c)} - set(named)
        by_weight = sorted(
            (c for c in rest if self.probability([c]) >= OPEN_PROBABILITY),
            key=lambda c: -self.probability([c]),
        )
        groups = []
        while by_weight and self.probability(by_weight) >= SURE:
            group = [by_weight[0]]
            while self.probability(group) < SURE:
                others = [c for c in by_weight if c not in group]
                group.append(max(others, key=lambda c: self.probability([*group, c])))
            alone = sum(
                w
                for s, w in zip(self.sets, self.weights, strict=True)
                if len(s.key & set(group)) == 1
            )
            if len(group) == 1 or alone < CHOICE:
                del by_weight[0]
                continue
            groups.append(
                OneOf(
                    terms=tuple(self.search.candidates[c].term for c in group),
                    probabilities=tuple(self.probability([c]) for c in group),
                )
            )
            by_weight = [c for c in by_weight if c not in group]
        return tuple(groups)

    def mentioned(self, named: Sequence[int]) -> tuple[tuple[Mentioned, int], ...]:
        """List rotors that are neither reported nor cleared, each with its most probable candidate,
        by rotor.

        A rotor is listed if all effects and unnamed causes on it jointly have more than
        OPEN_PROBABILITY, and one of them is named: the candidate is then the most probable named
        one. `named` are the reported candidates.
        """
        candidates = self.search.candidates
        safe = {candidates[c].term.degraded_rotor for c in named}
        rotors: dict[int, list[int]] = {}
        for c in {c for s in self.sets for c in s.key}:
            rotor = candidates[c].term.degraded_rotor
            if rotor is not None and rotor not in safe:
                rotors.setdefault(rotor, []).append(c)
        mentions = []
        for rotor, members in sorted(rotors.items()):
            probability = self.probability(members)
            if probability <= OPEN_PROBABILITY:
                continue
            named_ones = [c for c in members if not self._unnamed(c)]
            if not named_ones:
                continue
            most_probable = max(named_ones, key=lambda c: self.probability([c]))
            estimate = self.estimate(most_probable)
            largest = int(np.argmax(np.abs(estimate.value[:, 0])))
            loss, half = (float(v[largest, 0]) for v in (estimate.value, estimate.half_width))
            one = Mentioned(
                rotor=rotor, probability=probability, loss=loss, ci95=(loss - half, loss + half)
            )
            mentions.append((one, most_probable))
        return tuple(mentions)

    def gaining_rotors(self) -> frozenset[int]:
        """Return the rotors (0-based) whose most probable degradation has a negative loss.

        Such rotors have more thrust than expected. Rotors whose degradation has a probability of at
        most OPEN_PROBABILITY are left out.
        """
        of_rotors: dict[int, list[int]] = {}
        for c in {c for one in self.sets for c in one.key if not self._unnamed(c)}:
            rotor = self.search.candidates[c].term.degraded_rotor
            if rotor is not None:
                of_rotors.setdefault(rotor, []).append(c)
        gaining = set()
        for rotor, candidates in of_rotors.items():
            most_probable = max(candidates, key=lambda c: self.probability([c]))
            if self.probability(candidates) > OPEN_PROBABILITY:
                values = self.estimate(most_probable).value[:, 0]
                if values[np.argmax(np.abs(values))] < 0.0:
                    gaining.add(rotor)
        return frozenset(gaining)

    def excluded(self, linear: LinearisedSets, named: Sequence[int]) -> tuple[Excluded, ...]:
        """Return for effects that were not found the size that is excluded with probability SURE.

        `linear` is the problem linearised about the best set, to which each effect is added alone.
        Left out: `named` candidates, effects with more than one main value, on one arm, beginning
        at a time, or of a probability above OPEN_PROBABILITY; and sizes beyond the physical bound,
        which need no excluding.
        """
        best, excluded = self.best, []
        for c, candidate in enumerate(self.search.candidates):
            main = [
                k
                for k, p in enumerate(candidate.parameters)
                if p.absent is not None and not p.detail
            ]
            if c in named or len(main) != 1 or candidate.term.effect.begins:
                continue
            if candidate.term.effect.of_one_arm:
                continue  # the limit of the variant without an arm holds for it
            if self.probability([c]) > OPEN_PROBABILITY:
                continue
            key = best.key | {c}
            scored = linear.score(key)
            place = sum(len(self.search.candidates[k].free) for k in sorted(key) if k < c) + main[0]
            p = candidate.parameters[main[0]]
            value = linear.trials[c].free_values[main[0]] + scored.step[place] - (p.absent or 0.0)
            error = float(np.hypot(np.sqrt(scored.variance[place]), linear.law_error(c, main[0])))
            above = float(abs(value) + ndtri(SURE) * error)
            absent = p.absent or 0.0
            if above >= max(p.upper - absent, absent - p.lower):
                continue  # an impossible size need not be excluded
            excluded.append(
                Excluded(
                    term=candidate.term,
                    parameter=p.name,
                    unit=p.unit,
                    above=above,
                )
            )
        return tuple(excluded)


def _interpolate_unknown_knots(one: Candidate, value: Floats, error: Floats) -> Floats:
    """Return a copy of the values (F, K) of a curve, with poorly determined knots interpolated
    linearly from the other knots.

    A knot is poorly determined if its error is at least 1 / sqrt(2) of its prior scale, e.g. beyond
    the flights' range; a fixed knot is known. All flights share a curve: knots and errors of the
    first flight are used for all. Values after the KNOTS knots stay.
    """
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
    """List a term's main parameters, without shape parameters: (index, value if absent)."""
    every = enumerate(term.effect.parameters)
    return [(k, p.absent) for k, p in every if p.absent is not None and not p.detail]


def _excludes_zero(estimate: EffectEstimate) -> bool:
    """Return True if the interval of any main value excludes its absent value; True without any."""
    away = [
        np.abs(estimate.value[:, k] - absent) > ERRORS * estimate.error[:, k]
        for k, absent in _main_values(estimate.term)
    ]
    return not away or bool(np.any(away))


def posterior_of(search: Search, steepness: float = 0.0) -> Posterior:
    """Return the posterior over all sets that a search has fitted.

    `steepness`: relative standard error of the thrust curve of motor outputs, 0 for measured
    speeds.
    """
    return Posterior.from_sets(search, search.fitted.values(), steepness)


def add_law_error(search: Search, estimate: EffectEstimate) -> EffectEstimate:
    """Return the estimate with the inaccuracy of the effect's equation added to its errors.

    The prediction of an effect is accurate to the share FORM. For each main value that flights
    share, the error added is the shift that changes the prediction by as much (root mean square).
    """
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
