"""ACCEPT"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations

import numpy as np
from scipy.special import stdtr, stdtrit

from thrustmargin.models.effects.channels import Channels, froude_time_scale
from thrustmargin.models.effects.instrument_effects import FOLLOWED_WIND, WIND
from thrustmargin.models.effects.unnamed import ALONG, place_of
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.identification.answer.cross_validation import CrossValidation, FoldSums
from thrustmargin.models.identification.answer.posterior import (
    EffectEstimate,
    Posterior,
    add_law_error,
    posterior_of,
)
from thrustmargin.models.identification.answer.result import (
    Found,
    Mentioned,
    OneOf,
    OpenCause,
    Unexplained,
)
from thrustmargin.models.identification.certainty import CHOICE, COSTS, DOUBT
from thrustmargin.models.identification.rows.candidates import (
    Term,
    TrialEffect,
    placed_effects,
    predicted_modes,
)
from thrustmargin.models.identification.rows.problem import BLOCK_SECONDS, Problem
from thrustmargin.models.identification.sets.discrepancy import FORM, MEANS, WANDER, slow_wander
from thrustmargin.models.identification.sets.linear_sets import FittedSet
from thrustmargin.models.identification.sets.search_space import USUAL_SHARE, SearchSpace
from thrustmargin.models.identification.sets.set_search import FAR, Search
from thrustmargin.models.physics.atmosphere import G0
from thrustmargin.models.physics.forward_flight import ForwardFlight, straight_rows, wind_by_drag


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AcceptedEffects:
    """The accepted names, with what else is reported; candidates are those of `answer.search`."""

    answer: Posterior
    left_out: CrossValidation
    named: tuple[int, ...]  # before any fell
    estimates: tuple[EffectEstimate, ...]  # of those that stand, and of causes without a name
    one_of: tuple[OneOf, ...]
    unnamed_members: tuple[int, ...]  # of the estimates, those without a name
    left: Unexplained | None
    closest: tuple[int, ...]  # to what is left
    mentioned: tuple[Mentioned, ...]

    @property
    def members(self) -> list[int]:
        """The candidates that stand, and causes without a name."""
        return [e.candidate for e in self.estimates]

    @property
    def dropped(self) -> list[int]:
        """The names that fell."""
        return [c for c in self.named if c not in self.members]


def accept_effects(
    space: SearchSpace,
    search: Search,
    problem: Problem,
    *,
    steepness: float = 0.0,
) -> AcceptedEffects:
    """The names of a search that has run; `steepness` is that of `posterior_of`."""
    answer, left_out = cross_validated_posterior(problem, posterior_of(search, steepness))
    named = answer.named_candidates()
    left = find_unexplained(space, answer)
    closest = effects_resembling(left, named, answer)

    def error(some: Sequence[int]) -> float:
        return residual_rms(left_out.with_effects(some))

    matter = needed_effects(error, [c for c in named if c not in closest])
    one_of = tuple(
        one for one in answer.one_of(named) if not resembles_unexplained(one, left, answer)
    )
    firsts = {one.terms[0].key for one in one_of}
    either = {c for c, k in enumerate(search.candidates) if k.term.key in firsts}
    estimates = answer.estimates(matter, either)
    standing = [e.candidate for e in estimates]
    open_ = (
        [] if problem.of_outputs else unnamed_terms_worth_keeping(left_out, answer, standing, named)
    )
    if open_:
        estimates = answer.estimates([*standing, *open_], either)
    members = [e.candidate for e in estimates]
    return AcceptedEffects(
        answer=answer,
        left_out=left_out,
        named=tuple(named),
        estimates=tuple(add_law_error(search, one) for one in estimates),
        one_of=one_of,
        unnamed_members=tuple(open_),
        left=left,
        closest=tuple(closest),
        mentioned=tuple(
            one
            for one, c in answer.mentioned(members)
            if (left is None or one.rotor != left.rotor)  # else that asks for a look at it
            and needs_inspection(one.probability, error(members), error([*members, c]))
        ),
    )


def unnamed_terms_worth_keeping(
    left_out: CrossValidation, answer: Posterior, names: Sequence[int], before: Collection[int]
) -> list[int]:
    """What has no name and is in the likeliest set, without which flights left out are predicted
    worse beside the `names`, of those named `before` any fell; none where the choice made anew
    without each flight is of no use."""

    def error(some: Sequence[int]) -> float:
        return residual_rms(left_out.with_effects([*names, *some]))

    pool = answer.search.unnamed_members(answer.best.key)
    kept = needed_effects(error, [c for c in pool if c not in names])
    if not kept:
        return []
    members = [*names, *kept]
    dropped = [c for c in before if c not in names]
    without = residual_rms(left_out.with_selected_effects(names, dropped))
    dropped = [c for c in before if c not in members]
    having = residual_rms(left_out.with_selected_effects(members, dropped, open_=True))
    return kept if without >= (1.0 + LEAST_FALL) * having else []


def resembles_unexplained(one: OneOf, left: Unexplained | None, answer: Posterior) -> bool:
    """True for a choice of which every effect may only be closest to what is left."""
    keys = {term.key for term in one.terms}
    of = [c for c, k in enumerate(answer.search.candidates) if k.term.key in keys]
    return set(effects_resembling(left, of, answer)) == set(of)


def needs_inspection(probability: float, without_rpm: float, with_rpm: float) -> bool:
    """Whether a person is asked to look at a rotor without a name: by its probability, and by the
    errors of flights left out without its loss and with it."""
    likely = probability >= COSTS["rotor"].asked_from
    return likely and without_rpm >= (1.0 + LEAST_FALL) * with_rpm


def needed_effects(error: Callable[[Sequence[int]], float], members: Collection[int]) -> list[int]:
    """The effects without any of which, or any two, flights left out would be predicted worse.

    `error` is that of flights left out with a set; what counts is LEAST_FALL of it. Two that oppose
    each other each look needed beside the other.
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


def residual_rms(residual_rpm: Floats) -> float:
    """RMS over rows and rotors."""
    return float(np.sqrt(np.mean(residual_rpm**2)))


#: of the error on flights left out, that an effect must take to be worth a name: what the scatter
#: of a sound propeller (0.4 % of its thrust) does to rotor speeds that are good to 0.6 %
LEAST_FALL = 0.02
NEGLIGIBLE = 0.1 * DOUBT  # of the weight: what no name hangs on


def cross_validated_posterior(
    problem: Problem, answer: Posterior
) -> tuple[Posterior, CrossValidation]:
    """The answer of sets that flights left out bear out, and these flights about its best one."""
    out = FoldSums.from_nuisance(answer.search.nuisance)

    def fold_squares(one: FittedSet) -> Floats:
        own = CrossValidation.about_set(problem, answer.search, one, alone=True, out=out)
        return own.fold_squares(own.with_effects(one.key))

    kept = drop_worse_sets(answer, fold_squares)
    return kept, CrossValidation.about_set(problem, answer.search, kept.best, out=out)


def drop_worse_sets(answer: Posterior, squares: Callable[[FittedSet], Floats]) -> Posterior:
    """The answer without sets that others do better than, by the mean squares (folds,) of a set.

    A best set goes that one with fewer effects does better than: what is more must be worth it.
    Then those of weight go than which the best set is clearly better.
    """
    squares = lru_cache(maxsize=None)(squares)
    likeliest, dropped = answer.best.total, set()
    while any(
        squares(other).mean() < squares(answer.best).mean()
        for other in answer.sets
        if len(other.key) < len(answer.best.key) and other.total > likeliest - FAR
    ):
        dropped.add(answer.best.key)
        answer = answer.drop_sets(dropped)
    heavy = np.cumsum(answer.weights) - answer.weights < 1.0 - NEGLIGIBLE
    others = [one for one, of_weight in zip(answer.sets, heavy, strict=True) if of_weight][1:]
    least = squares(answer.best) if others else np.zeros(0)
    return answer.drop_sets({one.key for one in others if is_clearly_worse(squares(one), least)})


def is_clearly_worse(squares: Floats, of_other: Floats) -> bool:
    """True where the mean squares (folds,) of parts left out are larger than those of another, by
    what is worth a name and more than their difference scatters (Student's paired test)."""
    if squares.size < 2 or squares.mean() < (1.0 + LEAST_FALL) ** 2 * of_other.mean():
        return False
    more, folds = squares - of_other, squares.size
    error = more.std(ddof=1) / folds**0.5
    return bool(more.mean() > stdtrit(folds - 1, 1.0 - DOUBT / 2.0) * error)


LEAST_BLOCKS = 4  # of a flight, for an interval
LEVEL_ERROR = np.radians(0.5)  # of the attitude, which both ways take for a wind


def wind_in_airspeed(
    problem: Problem,
    residual_rpm: Floats,
    trials: Sequence[TrialEffect],
    tracks: Sequence[FlightTrack],
) -> Found | None:
    """The wind of the flights where it is stronger than in training and the airspeed follows it.

    `residual_rpm` (T, R) is what the effects found, `held`, leave. The value (F, 2) is the mean of
    what the autopilot reports and of what drag says through tilt; how the two differ is in the
    interval, and what a level error would do to both. None where either is missing, or the speed
    over ground would do as well.
    """
    model, flight = problem.model, problem.model.forward_flight
    if model.training_domain is None or flight is None or problem.lacks(WIND):
        return None
    if not flight.rotor_drag > 0.0:
        return None
    winds = [_block_winds(track, problem, flight) for track in tracks]
    if any(w.shape[0] < LEAST_BLOCKS for w in winds):
        return None
    mean = np.stack([w.mean(axis=0) for w in winds])  # (F, 2 ways, 2)
    value = mean.mean(axis=1)
    half = np.hypot(_half_widths(winds, mean), G0 * LEVEL_ERROR / flight.rotor_drag)
    surely = np.hypot(*value.T) - np.hypot(*half.T)
    if not np.any(surely > model.training_domain.wind_speed[1]):
        return None
    x = problem.channels
    speed = np.hypot(x.velocity_north, x.velocity_east)
    shifts = np.repeat(speed[:, None], x.airspeed_shifts.shape[1], axis=1)
    over_ground = replace(x, airspeed=speed, airspeed_shifts=shifts)
    before, after, p = _errors_without_channels(problem, residual_rpm, trials, over_ground)
    if before < (1.0 + LEAST_FALL) * after or p > DOUBT / 2.0:
        return None
    return Found(
        term=Term(effect=FOLLOWED_WIND),
        value=value,
        lower=value - half,
        upper=value + half,
        rmse_before_rpm=before,
        rmse_after_rpm=after,
    )


def _block_winds(track: FlightTrack, problem: Problem, flight: ForwardFlight) -> Floats:
    """(B, 2, 2) m/s: in each block of time the wind reported and by drag, north and east."""
    by_drag = wind_by_drag(track, problem.model.airframe, flight)
    both = np.stack([track.wind_ned[:, :2], by_drag], axis=1)
    rows = straight_rows(track) & np.isfinite(both).all(axis=(1, 2))
    if not rows.any():
        return np.empty((0, 2, 2))
    block = (track.time_s[rows] // BLOCK_SECONDS).astype(np.intp)
    return np.stack([both[rows][block == b].mean(axis=0) for b in np.unique(block)])


def _half_widths(winds: Sequence[Floats], mean: Floats) -> Floats:
    """(F, 2) m/s: 95 % from the scatter of blocks, and from how the two ways differ in all."""
    scatter = np.stack(
        [
            stdtrit(w.shape[0] // 2, 0.975)
            * w.mean(axis=1).std(axis=0, ddof=1)
            / np.sqrt(w.shape[0])
            for w in winds
        ]
    )
    difference = mean[:, 0] - mean[:, 1]
    between = stdtrit(difference.size, 0.975) * np.sqrt(np.mean(difference**2)) / 2
    return np.hypot(scatter, between)


def _errors_without_channels(
    problem: Problem, residual_rpm: Floats, trials: Sequence[TrialEffect], without: Channels
) -> tuple[float, float, float]:
    """RMSE in rpm with the channels `drop_sets` and with the problem's, and how likely by chance.

    By Student's t of the blocks' differences, with half as many degrees of freedom as blocks.
    """
    blind = replace(problem, channels=without)
    worse_rpm = problem.measured_rpm - blind.speeds(placed_effects(blind, trials))
    squares = np.stack([worse_rpm**2, residual_rpm**2]).mean(axis=2)
    before, after = np.sqrt(squares.mean(axis=1))
    count = np.bincount(problem.block)
    gained = np.bincount(problem.block, squares[0] - squares[1]) / count
    error = float(np.std(gained, ddof=1)) / np.sqrt(gained.size)
    ratio = float(np.mean(gained)) / max(error, 1e-12)
    return float(before), float(after), float(stdtr(gained.size // 2, -ratio))


MOST_UNEXPLAINED = 0.15  # of what is explained in a mode, that names may leave
SLOW_FACTOR = 3.0  # times the slow noise of good flights, from which a mode wanders
MAIN_SHARE = (
    2 / 3
)  # of the square of an effect's change: two of the modes of a rotor are not most of it


def find_unexplained(space: SearchSpace, answer: Posterior) -> Unexplained | None:
    """The cause without a name that does most; None where none is likely and matters."""
    search, best = answer.search, answer.best
    taken = _named_change_square(answer)
    usual = np.mean(space.hats**2, axis=0) @ (space.sizes**2).T  # (R,) rpm² on a sound aircraft
    found = {
        c: square
        for c, square in _probable_causes(answer).items()
        if _exceeds_limits(square, taken, usual, search.candidates[c].term.rotor is not None)
    }
    if not found:
        return _slow_mode(space, search, best)
    rotors = [c for c in found if search.candidates[c].term.rotor is not None]
    main = max(rotors or found, key=lambda c: float(found[c].sum()))
    every = range(taken.size)
    modes = every if rotors else sorted({int(np.argmax(square)) for square in found.values()})
    alike = [
        main,
        *(c for c in _interchangeable_causes(main, search) if answer.probability([c]) > DOUBT),
    ]
    left = float(np.mean(np.nan_to_num(best.residual) ** 2, axis=0).sum())
    open_ = float(np.sum(list(found.values())))
    channels = dict.fromkeys(place_of(search.candidates[c].term.effect)[1] for c in alike)
    return Unexplained(
        mode=int(np.argmax(found[main])),
        modes=tuple(modes),
        channel=next(iter(channels)),
        channels=tuple(channels),
        share=float(found[main].sum()) / max(open_ + left, 1e-12),
        rms_rpm=float(np.sqrt(found[main].sum())),
        rotor=search.candidates[main].term.rotor,
    )


def _probable_causes(answer: Posterior) -> dict[int, Floats]:
    """Causes without a name in the likeliest set that are likelier than not there, in the same mode
    or of the same rotor: candidate -> (R,) mean square, rpm², of what all of these do together, for
    two may take back each other's changes. Of several the one that does most by itself."""
    search, best = answer.search, answer.best
    members = dict(zip(sorted(best.key), best.trials, strict=True))
    whole = predicted_modes(search.reduced, best.trials)

    def square(without: Collection[int]) -> Floats:
        rest = [trial for c, trial in members.items() if c not in without]
        return np.mean(np.nan_to_num(whole - predicted_modes(search.reduced, rest)) ** 2, axis=0)

    found: dict[int, Floats] = {}
    seen: set[int] = set()
    for c in sorted(best.key):
        alike = set(_interchangeable_causes(c, search)) if search.candidates[c].unnamed else set()
        if c not in seen and answer.probability(alike) > CHOICE:
            group = alike & best.key
            seen |= group
            found[max(group, key=lambda k: float(square([k]).sum()))] = square(group)
    return found


def _named_change_square(answer: Posterior) -> Floats:
    """(R,) mean square, rpm², of what the names of the likeliest set do together."""
    reduced = answer.search.reduced
    named = [h for h in answer.best.trials if not h.candidate.unnamed]
    change = predicted_modes(reduced, named) - predicted_modes(reduced, ())
    return np.mean(np.nan_to_num(change) ** 2, axis=0)


def _exceeds_limits(square: Floats, taken: Floats, usual: Floats, of_rotor: bool) -> bool:
    """Whether a cause without a name is beyond what a sound aircraft leaves, and more than what
    names may leave: mean squares (R,) of what it does, names do and a sound aircraft leaves.

    A mode may keep LEFT of what is explained in it. The loss of a rotor, which has a name beside
    it, may be uneven by as little as the laws of losses are good to.
    """
    done = float(square.sum())
    if of_rotor:
        return done > (SLOW_FACTOR * FORM) ** 2 * float(taken.sum())
    own = square / max(float(square.max()), 1e-12)  # how much each mode is its own
    return done > max(
        MOST_UNEXPLAINED * (done + float(own @ taken)), SLOW_FACTOR**2 * float(own @ usual)
    )


def _interchangeable_causes(c: int, search: Search) -> list[int]:
    """All causes without a name in the same mode or of the same rotor."""
    term = search.candidates[c].term
    return [
        k
        for k, one in enumerate(search.candidates)
        if one.unnamed
        and one.term.rotor == term.rotor
        and place_of(one.term.effect)[0] == place_of(term.effect)[0]
    ]


def open_cause(found: Found, answer: Posterior) -> OpenCause:
    """A cause without a name that goes into the model, with the channels along which it would go as
    well."""
    search = answer.search
    candidates = search.candidates
    own = next(c for c, one in enumerate(candidates) if one.key == found.term.key)
    trials = TrialEffect(candidate=candidates[own], values=found.value)
    change = predicted_modes(search.reduced, [trials]) - predicted_modes(search.reduced, ())
    place = _interchangeable_causes(own, search) if candidates[own].unnamed else ()
    alike = (c for c in place if c != own and answer.probability([c]) > DOUBT)
    return OpenCause(
        found=found,
        alike=tuple(place_of(candidates[c].term.effect)[1] for c in alike),
        rms_rpm=float(np.sqrt(np.mean(np.nan_to_num(change) ** 2))),
    )


def residual_at_best(search: Search, best: FittedSet) -> Floats:
    """(N, R) rpm that a set leaves at its likeliest values, which may be a step away from those
    that it is linearised at."""
    return np.nan_to_num(best.residual) - search.final_step_change(best)


def _slow_mode(space: SearchSpace, search: Search, best: FittedSet) -> Unexplained | None:
    """The mode that wanders most beyond what it does in good flights; None where none does, or
    where no good flights tell."""
    reduced = space.reduced
    known = reduced.model.good_flights
    if known is None or not known.slow_rpm:
        return None
    rest = residual_at_best(search, best)
    apart = WANDER * froude_time_scale(reduced.model.airframe)
    size = slow_wander(rest, reduced.channels.time_s, reduced.flight, apart)
    usual = USUAL_SHARE * float(reduced.measured_rpm.mean())
    beyond = size / np.maximum(known.slow_rpm, usual) * reduced.scored_modes
    mode = int(np.argmax(beyond))
    if not beyond[mode] > SLOW_FACTOR:
        return None
    rms = MEANS * float(size[mode])
    return Unexplained(
        mode=mode,
        modes=(mode,),
        channel="time_s",
        channels=("time_s",),
        share=min(1.0, rms**2 / max(float(np.mean(rest**2, axis=0).sum()), 1e-12)),
        rms_rpm=rms,
        wanders=True,
    )


def changes_mostly(search: Search, trials: TrialEffect, modes: Sequence[int]) -> bool:
    """True for an effect of which most of the change is in some modes."""
    change = predicted_modes(search.reduced, [trials]) - predicted_modes(search.reduced, ())
    square = np.mean(np.nan_to_num(change) ** 2, axis=0)
    return bool(square[list(modes)].sum() > MAIN_SHARE * square.sum())


def effects_resembling(
    left: Unexplained | None, named: Sequence[int], answer: Posterior
) -> list[int]:
    """The names that are only closest to what is left: they are of the rotor of which the loss is
    not steady, act mostly in modes that names do not explain, or go by a channel along which they
    do not. Beside a rotor of which the loss goes along a channel, however slightly, other names may
    only make up for that."""
    search, best = answer.search, answer.best
    likely = _probable_causes(answer)
    terms = {c: search.candidates[c].term for c in {*named, *likely}}
    uneven = {terms[c].rotor for c in likely} - {None}
    trials = dict(zip(sorted(best.key), best.trials, strict=True))
    along: set[str] = set()
    if left is not None and not left.wanders:
        along = {needed for channel in left.channels for needed in ALONG[channel].needs}

    def is_closest(c: int) -> bool:
        if uneven and terms[c].rotor not in uneven:
            return True
        if not along or left is None:
            return False
        of_rotor = left.rotor is not None and terms[c].rotor == left.rotor
        if of_rotor or along & set(terms[c].effect.needs):
            return True
        return c in trials and changes_mostly(search, trials[c], left.modes)

    return [c for c in named if is_closest(c)]
