"""Decide which effects to report, from the posterior over sets and the cross-validated errors.

`accept_effects` applies the rules in this order:

1. `drop_larger_sets`: drop the best set while a smaller one has a lower cross-validated error.
   Without it, effects that only fit noise are reported.
2. `drop_worse_sets`: drop sets whose cross-validated error is clearly above that of the best one.
   Without it, effects count as confounded though held-out flights distinguish them. Not for a
   single flight: its parts share its own deviation, which any effect that fits it would explain.
3. `Posterior.named_candidates`: select effects with a posterior inclusion probability of at least
   0.95 and a 95 % interval that excludes zero. This is the promise of the answer.
4. `effects_resembling`: drop effects that resemble an unexplained residual (`find_unexplained`).
   Without it, the closest effect of the catalogue is reported for a cause that it lacks.
5. `needed_effects`: drop effects, or pairs, that the cross-validated error does not need.
   Without it, two effects that cancel each other are both reported.
   `exceeds_law_error`: also drop those that the inaccurate laws of larger effects may explain.
   Without it, a tilted arm's 300 rpm report a sound rotor as weak by 0.8 %.
6. `Posterior.estimates`: refit the remaining effects alone; drop those whose interval then includes
   zero. Predictions use that refit, so its intervals count.
   Without it, the new model has an effect whose size may be zero.
7. `names_that_hold`: drop all effects if one is improbable without some flight, or if selecting
   them again without each flight makes the error of that flight larger.
   Without it, an effect of some flights is reported of all, with an error after above that before.
8. `unnamed_terms_worth_keeping`: add unnamed causes that lower the cross-validated error.
   Without it, the new model keeps an error that recurs in every flight.
9. `needs_inspection`: report a rotor as suspect only if the expected cost of a missed inspection
   is higher and its loss lowers the cross-validated error.
   Without it, pilots are asked to inspect sound rotors.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations

import numpy as np
from scipy.special import stdtrit

from thrustmargin.models.effects.base import Kind
from thrustmargin.models.effects.channels import froude_time_scale
from thrustmargin.models.effects.unnamed import ALONG, place_of
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.answer.cross_validation import CrossValidation, FoldSums
from thrustmargin.models.identification.answer.posterior import (
    EffectEstimate,
    Posterior,
    add_law_error,
    posterior_of,
)
from thrustmargin.models.identification.answer.result import (
    Mentioned,
    OneOf,
    OpenCause,
    ReportedEffect,
    Unexplained,
)
from thrustmargin.models.identification.certainty import (
    CHOICE,
    COSTS,
    ERRORS,
    OPEN_PROBABILITY,
)
from thrustmargin.models.identification.rows.candidates import (
    TrialEffect,
    predicted_modes,
)
from thrustmargin.models.identification.rows.problem import Problem
from thrustmargin.models.identification.sets.discrepancy import FORM, MEANS, WANDER, slow_wander
from thrustmargin.models.identification.sets.linear_sets import EffectSet, LinearisedSets
from thrustmargin.models.identification.sets.search_space import USUAL_SHARE, SearchSpace
from thrustmargin.models.identification.sets.set_search import FAR, Search


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AcceptedEffects:
    """The accepted effects and all other results to report; candidates are indices of
    `answer.search`."""

    answer: Posterior
    left_out: CrossValidation
    probable: tuple[int, ...]  # candidates that rule 3 selects, before any is dropped
    reported: tuple[EffectEstimate, ...]  # of the effects that are reported by name
    estimates: tuple[EffectEstimate, ...]  # of these and the unnamed causes, fitted together
    one_of: tuple[OneOf, ...]
    unnamed_members: tuple[int, ...]  # candidates among `estimates` that are not reported by name
    unexplained: Unexplained | None
    lookalikes: tuple[int, ...]  # probable candidates that resemble the unexplained residual
    mentioned: tuple[Mentioned, ...]
    contradicted: tuple[int, ...]  # candidates that rule 7 dropped
    #: (T, R) residuals with effects selected again without each row's fold: reported effects alone,
    #: and with unnamed causes
    reported_rpm: Floats
    left_out_rpm: Floats

    def without_unnamed(self) -> AcceptedEffects:
        """Return the accepted effects without unnamed causes."""
        return replace(
            self,
            estimates=self.reported,
            unnamed_members=(),
            left_out_rpm=self.reported_rpm,
        )

    @property
    def members(self) -> list[int]:
        """Return the accepted candidates and the unnamed causes."""
        return [e.candidate for e in self.estimates]


def accept_effects(
    space: SearchSpace,
    search: Search,
    problem: Problem,
    *,
    steepness: float = 0.0,
) -> AcceptedEffects:
    """Decide which effects of a finished search to report, by rules 1 to 10 of the module.

    `problem` has the rows for cross-validation; `steepness` is the relative error of the slope of
    the rotor speed law.
    """
    # Rules 1 and 2
    answer, left_out = cross_validated_posterior(problem, posterior_of(search, steepness))

    def error(members: Sequence[int]) -> float:
        """Return the cross-validated RMS error, rpm, with exactly these effects."""
        return residual_rms(left_out.with_effects(members))

    # Rules 3 to 5
    probable = answer.named_candidates()
    unexplained = find_unexplained(space, answer)
    lookalikes = effects_resembling(unexplained, probable, answer)
    needed = needed_effects(error, [c for c in probable if c not in lookalikes])
    linear = search.linearise(answer.best)
    needed = [c for c in needed if exceeds_law_error(linear, answer.estimate(c))]
    # Rule 6: while values are fitted, the most probable effect represents each "one of"
    one_of = answer.one_of(probable)
    first_keys = {one.terms[0].key for one in one_of}
    alternatives = {c for c, one in enumerate(search.candidates) if one.term.key in first_keys}
    estimates = answer.estimates(needed, alternatives)
    # Rule 7
    fitted = [e.candidate for e in estimates]
    accepted, reported_rpm = names_that_hold(left_out, fitted, probable)
    estimates = estimates if accepted else []
    # Rule 8: shares of motor outputs show no curve along a channel
    unnamed, left_out_rpm = list[int](), reported_rpm
    if not problem.of_outputs:
        unnamed, left_out_rpm = unnamed_terms_worth_keeping(
            left_out, answer, accepted, probable, reported_rpm
        )
    reported = estimates
    if unnamed:
        estimates = answer.estimates([*accepted, *unnamed], alternatives)
    # Rule 9
    members = [e.candidate for e in estimates]
    contradicted = [c for c in fitted if c not in accepted]
    reported_else = {search.candidates[c].term.rotor for c in contradicted}
    reported_else |= {None if unexplained is None else unexplained.rotor}
    causes = {search.candidates[c].term.rotor for c in probable_causes(answer)}
    mentioned = tuple(
        one
        for one, c in answer.mentioned(members)
        if is_sole_cause(one.rotor, reported_else, causes)
        and needs_inspection(one.probability, error(members), error([*members, c]))
    )
    return AcceptedEffects(
        answer=answer,
        left_out=left_out,
        probable=tuple(probable),
        reported=tuple(add_law_error(search, one) for one in reported),
        estimates=tuple(add_law_error(search, one) for one in estimates),
        one_of=one_of,
        unnamed_members=tuple(unnamed),
        unexplained=unexplained,
        lookalikes=tuple(lookalikes),
        mentioned=mentioned,
        contradicted=tuple(contradicted),
        reported_rpm=reported_rpm,
        left_out_rpm=left_out_rpm,
    )


def residual_rms(residual_rpm: Floats) -> float:
    """Return the RMS of a residual (T, R) over rows and rotors."""
    return float(np.sqrt(np.mean(residual_rpm**2)))


#: share of the cross-validated RMS error that an effect must remove to be reported: the change that
#: the scatter of a sound propeller (0.4 % of its thrust) makes to speeds accurate to 0.6 %
LEAST_FALL = 0.02
NEGLIGIBLE = 0.1 * OPEN_PROBABILITY  # posterior probability that decides no report


def cross_validated_posterior(
    problem: Problem, answer: Posterior
) -> tuple[Posterior, CrossValidation]:
    """Drop sets of effects that cross-validation does not confirm (rules 1 and 2).

    Return the posterior of the remaining sets, and the cross-validation about the best of them.
    """
    out = FoldSums.from_nuisance(answer.search.nuisance)

    def fold_squares(one: EffectSet) -> Floats:
        """Return the mean square (folds,), rpm², of the held-out residual of the set `one`."""
        own = CrossValidation.about_set(problem, answer.search, one, alone=True, out=out)
        return own.fold_squares(own.with_effects(one.key))

    kept = drop_unconfirmed_sets(answer, fold_squares, single_flight=problem.flights == 1)
    return kept, CrossValidation.about_set(problem, answer.search, kept.best, out=out)


def drop_unconfirmed_sets(
    answer: Posterior,
    fold_squares: Callable[[EffectSet], Floats],
    *,
    single_flight: bool = False,
) -> Posterior:
    """Drop sets by rule 1 and, unless all folds are of a single flight, by rule 2.

    `fold_squares` returns a set's held-out mean squares (folds,), rpm²; it is called once a set.
    """
    fold_squares = lru_cache(maxsize=None)(fold_squares)
    answer = drop_larger_sets(answer, fold_squares)
    return answer if single_flight else drop_worse_sets(answer, fold_squares)


def drop_larger_sets(answer: Posterior, fold_squares: Callable[[EffectSet], Floats]) -> Posterior:
    """Rule 1: drop the best set while a set with fewer effects has a lower held-out error.

    Additional effects must improve the prediction. Only sets within FAR of the original best log
    evidence may replace it: less probable ones cannot explain the flights.
    """
    most, dropped = answer.best.total, set()
    while any(
        fold_squares(other).mean() < fold_squares(answer.best).mean()
        for other in answer.sets
        if len(other.key) < len(answer.best.key) and other.total > most - FAR
    ):
        dropped.add(answer.best.key)
        answer = answer.drop_sets(dropped)
    return answer


def drop_worse_sets(answer: Posterior, fold_squares: Callable[[EffectSet], Floats]) -> Posterior:
    """Rule 2: drop sets that predict held-out flights clearly worse than the best set.

    The least probable sets, NEGLIGIBLE together, are not tried: they change no report.
    """
    probable = np.cumsum(answer.weights) - answer.weights < 1.0 - NEGLIGIBLE
    others = [one for one, tried in zip(answer.sets, probable, strict=True) if tried][1:]
    least = fold_squares(answer.best) if others else np.zeros(0)
    return answer.drop_sets(
        {one.key for one in others if is_clearly_worse(fold_squares(one), least)}
    )


def is_clearly_worse(squares: Floats, other: Floats) -> bool:
    """Return True if the held-out mean squares `squares` (folds,) clearly exceed `other` (folds,).

    Their RMS must be larger by LEAST_FALL, and the difference significant (Student's paired test).
    False with fewer than two folds.
    """
    if squares.size < 2 or squares.mean() < (1.0 + LEAST_FALL) ** 2 * other.mean():
        return False
    excess, folds = squares - other, squares.size
    error = excess.std(ddof=1) / folds**0.5
    return bool(excess.mean() > stdtrit(folds - 1, 1.0 - OPEN_PROBABILITY / 2.0) * error)


#: of the explained mean square of a mode, that may stay unexplained; and of the variance left,
#: below which an unexplained residual is minor
MOST_UNEXPLAINED = 0.15
SLOW_FACTOR = 3.0  # times the slow noise of good flights, beyond which a mode is unexplained


def find_unexplained(space: SearchSpace, answer: Posterior) -> Unexplained | None:
    """Describe the unexplained residual; None where none is probable and large enough.

    It is the largest unnamed cause beyond the limits of `exceeds_limits`, with causes on a rotor
    first; without one it is a mode with too much slow noise.
    """
    search, best = answer.search, answer.best
    named_square = _named_change_square(answer)
    usual = np.mean(space.hats**2, axis=0) @ (space.sizes**2).T  # (R,) rpm² on a sound aircraft
    candidates = {
        c: square
        for c, square in probable_causes(answer).items()
        if exceeds_limits(square, named_square, usual, search.candidates[c].term.rotor is not None)
    }
    if not candidates:
        return _slow_mode(space, search, best)
    rotors = [c for c in candidates if search.candidates[c].term.rotor is not None]
    main = max(rotors or candidates, key=lambda c: float(candidates[c].sum()))
    equivalent = [
        main,
        *(c for c in search.interchangeable(main) if answer.probability([c]) > OPEN_PROBABILITY),
    ]
    unexplained = float(np.mean(np.nan_to_num(best.residual) ** 2, axis=0).sum())
    open_ = float(np.sum(list(candidates.values())))
    channels = dict.fromkeys(place_of(search.candidates[c].term.effect)[1] for c in equivalent)
    share = float(candidates[main].sum()) / max(open_ + unexplained, 1e-12)
    return Unexplained(
        mode=int(np.argmax(candidates[main])),
        channel=next(iter(channels)),
        channels=tuple(channels),
        share=share,
        rms_rpm=float(np.sqrt(candidates[main].sum())),
        rotor=search.candidates[main].term.rotor,
        minor=not rotors and share < MOST_UNEXPLAINED,
    )


def probable_causes(answer: Posterior) -> dict[int, Floats]:
    """Map the best set's probable unnamed causes to the mean square (R,), rpm², of their change.

    Keys are candidates. Causes in one mode or on one rotor count as one, because two may cancel
    each other: they share one entry, with the change of all, keyed by the candidate with the
    largest change. Only causes with a joint probability above CHOICE are included.
    """
    search, best = answer.search, answer.best
    members = best.effects
    whole = predicted_modes(search.reduced, best.trials)

    def square(members_out: Collection[int]) -> Floats:
        """Return the mean square (R,), rpm², of the change by some of the best set's candidates."""
        rest = [trial for c, trial in members.items() if c not in members_out]
        return np.mean(np.nan_to_num(whole - predicted_modes(search.reduced, rest)) ** 2, axis=0)

    causes: dict[int, Floats] = {}
    seen: set[int] = set()
    for c in sorted(best.key):
        equivalent = set(search.interchangeable(c)) if search.candidates[c].unnamed else set()
        if c not in seen and answer.probability(equivalent) > CHOICE:
            group = equivalent & best.key
            seen |= group
            causes[max(group, key=lambda k: float(square([k]).sum()))] = square(group)
    return causes


def _named_change_square(answer: Posterior) -> Floats:
    """Return the mean square (R,), rpm², of the change by all catalogue effects of the best set
    together."""
    reduced = answer.search.reduced
    named = [h for h in answer.best.trials if not h.candidate.unnamed]
    change = predicted_modes(reduced, named) - predicted_modes(reduced, ())
    return np.mean(np.nan_to_num(change) ** 2, axis=0)


def exceeds_limits(square: Floats, named_square: Floats, usual: Floats, of_rotor: bool) -> bool:
    """Return True if an unnamed cause is too large to ignore.

    Mean squares (R,), rpm²: `square` of its change, `named_square` of the change by catalogue
    effects, `usual` of the residual of a sound aircraft. In its modes, a cause must exceed
    MOST_UNEXPLAINED of all explained change and SLOW_FACTOR times the usual residual. The uneven
    loss of a rotor must exceed SLOW_FACTOR times the accuracy of the laws of losses, FORM.
    """
    done = float(square.sum())
    if of_rotor:
        return done > (SLOW_FACTOR * FORM) ** 2 * float(named_square.sum())
    # weight of each mode, 1 for the cause's main one
    own = square / max(float(square.max()), 1e-12)
    return done > max(
        MOST_UNEXPLAINED * (done + float(own @ named_square)), SLOW_FACTOR**2 * float(own @ usual)
    )


def _slow_mode(space: SearchSpace, search: Search, best: EffectSet) -> Unexplained | None:
    """Describe the mode whose slow noise exceeds that of the model's training flights by most.

    `best` is the set whose residual is used. None where no mode exceeds SLOW_FACTOR, or the model
    contains no training flights.
    """
    reduced = space.reduced
    known = reduced.model.good_flights
    if known is None or not known.slow_rpm:
        return None
    rest = residual_at_best(search, best)
    knot_spacing = WANDER * froude_time_scale(reduced.model.airframe)
    size = slow_wander(rest, reduced.channels.time_s, reduced.flight, knot_spacing)
    usual = USUAL_SHARE * float(reduced.measured_rpm.mean())
    ratio = size / np.maximum(known.slow_rpm, usual) * reduced.scored_modes
    mode = int(np.argmax(ratio))
    if not ratio[mode] > SLOW_FACTOR:
        return None
    rms = MEANS * float(size[mode])
    share = min(1.0, rms**2 / max(float(np.mean(rest**2, axis=0).sum()), 1e-12))
    return Unexplained(
        mode=mode,
        channel="time_s",
        channels=("time_s",),
        share=share,
        rms_rpm=rms,
        wanders=True,
        minor=share < MOST_UNEXPLAINED,
    )


def residual_at_best(search: Search, best: EffectSet) -> Floats:
    """Return the residual (N, R), rpm in modes, of a set at its optimum.

    The optimum may be one linear step away from the values that the set is stored with.
    """
    return np.nan_to_num(best.residual) - search.final_step_change(best)


def effects_resembling(
    unexplained: Unexplained | None, named: Sequence[int], answer: Posterior
) -> list[int]:
    """Rule 4: list the effects of `named` that may only imitate an unexplained cause.

    If a rotor's loss varies along a channel, effects that do not act on such a rotor may only
    compensate for it, unless they change far more than it does (MOST_UNEXPLAINED). Beside a
    probable cause along its own channel, however small, an instrument is not at fault for certain.
    Otherwise, an effect resembles the unexplained residual if it acts on the same rotor or reads
    one of the same channels. A residual that is only slow noise resembles no effect.
    """
    search, best = answer.search, answer.best
    likely = probable_causes(answer)
    terms = {c: search.candidates[c].term for c in {*named, *likely}}
    uneven = {
        rotor: float(square.sum())
        for c, square in likely.items()
        if (rotor := terms[c].rotor) is not None
    }
    open_reads = {needed for c in likely for needed in ALONG[place_of(terms[c].effect)[1]].needs}
    trials = best.effects
    read: set[str] = set()
    if unexplained is not None and not unexplained.wanders:
        read = {needed for channel in unexplained.channels for needed in ALONG[channel].needs}

    def resembles(c: int) -> bool:
        """Return True if candidate `c` resembles the unexplained residual, by the criteria of
        `effects_resembling`: uneven loss of a rotor, its own instrument's channel, the same rotor
        or channel, or mostly the same modes."""
        if uneven and terms[c].degraded_rotor not in uneven:
            own = float(mean_square_change(search, trials[c]).sum()) if c in trials else 0.0
            if sum(uneven.values()) > MOST_UNEXPLAINED * own:
                return True
        effect = terms[c].effect
        instrument = effect.kind is Kind.INPUT and not effect.of_its_flights
        if instrument and open_reads & set(effect.needs):
            return True
        if not read or unexplained is None:
            return False
        of_rotor = unexplained.rotor is not None and terms[c].rotor == unexplained.rotor
        return of_rotor or bool(read & set(terms[c].effect.needs))

    return [c for c in named if resembles(c)]


def mean_square_change(search: Search, trial: TrialEffect) -> Floats:
    """Return the mean square (R,), rpm², of the change in each mode by one effect alone."""
    change = predicted_modes(search.reduced, [trial]) - predicted_modes(search.reduced, ())
    return np.mean(np.nan_to_num(change) ** 2, axis=0)


def needed_effects(error: Callable[[Sequence[int]], float], members: Collection[int]) -> list[int]:
    """Rule 5: return the effects that, each or in pairs, the cross-validated error needs.

    `error` returns the RMS, rpm, with only the effects of its argument. The effect or pair that
    increases the error least is dropped, until dropping any increases it by LEAST_FALL. Pairs are
    tried because, of two effects that are only needed together, neither can be dropped alone.
    """
    kept = list(members)
    while kept:
        whole = error(kept)
        groups = [*combinations(kept, 1), *combinations(kept, 2)]
        without = [error([c for c in kept if c not in g]) for g in groups]
        least = int(np.argmin(without))
        if without[least] >= (1.0 + LEAST_FALL) * whole:
            break
        kept = [c for c in kept if c not in groups[least]]
    return kept


def exceeds_law_error(linear: LinearisedSets, estimate: EffectEstimate) -> bool:
    """Return True if an estimate's interval excludes zero with the errors of all effects'
    equations.

    `linear` is the problem linearised about the most probable set. True for an effect without a
    shared main value.
    """
    one = linear.trials[estimate.candidate].candidate
    away = [
        abs(float(estimate.value[0, k]) - p.absent)
        > ERRORS * np.hypot(estimate.error[0, k], linear.law_error(estimate.candidate, place))
        for place, ((k, flight), p) in enumerate(zip(one.free, one.parameters, strict=True))
        if flight is None and p.absent is not None and not p.detail
    ]
    return not away or any(away)


def names_that_hold(
    left_out: CrossValidation, names: Sequence[int], before: Collection[int]
) -> tuple[list[int], Floats]:
    """Rule 7: return `names`, or none if a fold excludes one or selecting anew lowers no error.

    Also return the cross-validated residual (T, R), rpm: with effects, or without if none are
    returned. An effect that explains some flights and predicts the others worse, or that is
    improbable without one of them, is no property of the aircraft. If no fold selects any, because
    fewer flights are less certain, the residual is that of `names` with values fitted without each
    fold. `before` are the probable candidates before any was dropped.
    """
    without = left_out.residual({})
    if not names or left_out.excludes_any(names):
        return [], without
    having = left_out.with_selected_effects(names, [c for c in before if c not in names])
    if residual_rms(having) == residual_rms(without):
        having = left_out.with_effects(names)
    return (list(names), having) if residual_rms(having) < residual_rms(without) else ([], without)


def unnamed_terms_worth_keeping(
    left_out: CrossValidation,
    answer: Posterior,
    names: Sequence[int],
    before: Collection[int],
    reported_rpm: Floats,
) -> tuple[list[int], Floats]:
    """Rule 8: return the probable unnamed terms that lower the error when added to `names`.

    `reported_rpm` (T, R) is the cross-validated residual with `names`; that with the terms is
    returned as well.

    Terms must be needed by the cross-validated error (`needed_effects`). In addition, selecting all
    terms again without each fold must lower the error by LEAST_FALL, or no term is kept: then the
    selection was chance. `before` are the probable candidates before any was dropped.
    """

    def error(some: Sequence[int]) -> float:
        """Return the cross-validated RMS error, rpm, with `names` and the given terms."""
        return residual_rms(left_out.with_effects([*names, *some]))

    kept = needed_effects(error, [c for c in answer.unnamed_members() if c not in names])
    if not kept:
        return [], reported_rpm
    members = [*names, *kept]
    dropped = [c for c in before if c not in members]
    having = left_out.with_selected_effects(members, dropped, open_=True)
    if residual_rms(reported_rpm) < (1.0 + LEAST_FALL) * residual_rms(having):
        return [], reported_rpm
    return kept, having


def is_sole_cause(
    rotor: int, reported_else: Collection[int | None], causes: Collection[int | None]
) -> bool:
    """Rule 9: return True if `rotor` is not reported otherwise and all `causes` are of it alone.

    `reported_else` are rotors with an uneven loss, which is reported separately, or with an effect
    that rule 7 dropped. `causes` are the rotors (None: of no rotor) of the probable unnamed causes;
    one of another rotor may be what `rotor` only imitates.
    """
    return rotor not in reported_else and set(causes) <= {rotor}


def needs_inspection(probability: float, without_rpm: float, with_rpm: float) -> bool:
    """Rule 9: return True if an unreported rotor should be inspected.

    Its probability must make a missed bad rotor costlier than a needless inspection, and its loss
    must lower the cross-validated error, `without_rpm` to `with_rpm`, by LEAST_FALL.
    """
    likely = probability >= COSTS["rotor"].action_threshold
    return likely and without_rpm >= (1.0 + LEAST_FALL) * with_rpm


def open_cause(effect: ReportedEffect, answer: Posterior) -> OpenCause:
    """Describe an unnamed term of the new model by the RMS change of rotor speed, rpm, it predicts.

    Also list the channels of other unnamed causes that could replace it with a probability above
    OPEN_PROBABILITY; none if it is an effect of the catalogue.
    """
    search = answer.search
    candidates = search.candidates
    own = next(c for c, one in enumerate(candidates) if one.key == effect.term.key)
    trials = TrialEffect(candidate=candidates[own], values=effect.value)
    change = predicted_modes(search.reduced, [trials]) - predicted_modes(search.reduced, ())
    place = search.interchangeable(own) if candidates[own].unnamed else ()
    equivalent = (c for c in place if c != own and answer.probability([c]) > OPEN_PROBABILITY)
    return OpenCause(
        found=effect,
        alike=tuple(place_of(candidates[c].term.effect)[1] for c in equivalent),
        rms_rpm=float(np.sqrt(np.mean(np.nan_to_num(change) ** 2))),
    )
