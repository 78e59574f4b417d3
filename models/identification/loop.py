"""Close the loop: residual -> missing effect -> added effect -> error before and after.

`identify` scores sets of effects on flights with measured rotor speeds, beside a free form that
competes with them; it names what nearly all the weight holds, lists what cannot be distinguished
and what is excluded, and states the error on flights that no step has used.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from itertools import combinations

import numpy as np
from threadpoolctl import threadpool_limits

from thrustmargin.models.effects import CATALOGUE, effects_for
from thrustmargin.models.effects.base import Effect
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.identification.answer.adequacy import closest_to, unexplained, with_free
from thrustmargin.models.identification.answer.already_followed import followed_wind
from thrustmargin.models.identification.answer.floor import floor_rpm
from thrustmargin.models.identification.answer.left_out import LeftOut, on_new_flights
from thrustmargin.models.identification.answer.posterior import (
    EffectEstimate,
    posterior_of,
)
from thrustmargin.models.identification.answer.result import Found, Identification
from thrustmargin.models.identification.answer.unseen_errors import Unseen, errors_of
from thrustmargin.models.identification.rows.modes import sensor_noise_rpm
from thrustmargin.models.identification.rows.output_shares import effects_on_shares, steepness_of
from thrustmargin.models.identification.rows.problem import assemble
from thrustmargin.models.identification.rows.reduced import rows_and_means
from thrustmargin.models.identification.rows.usable_flights import Flown, require_airframe
from thrustmargin.models.identification.sets.onsets import onset_candidates, without_rotors
from thrustmargin.models.identification.sets.search_space import search_space
from thrustmargin.models.identification.sets.set_search import Search
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_model import RotorModel

Progress = Callable[[str, float], None]
#: of the error on flights left out, that an effect must take to be worth a name: what the scatter
#: of a sound propeller (0.4 % of its thrust) does to rotor speeds that are good to 0.6 %
LEAST_FALL = 0.02


def identify(
    flights: Sequence[Flown] | Flown,
    model: RotorModel | None = None,
    *,
    held_out: Sequence[Flown] = (),
    catalogue: Sequence[Effect] = CATALOGUE,
    progress: Progress | None = None,
) -> Identification:
    """Find the effects that `model` lacks on flights; report errors on the flights `held_out`.

    A flight is a FlightTrack or a log that was read; the model, without one, that which ships, for
    logs that are recognised as of its airframe. Effects are looked for at the size of the model's
    aircraft. Without held-out flights the errors are cross-validated: each flight (of one flight,
    each fifth) predicted with values found without it. Raises DataError when no flight can be
    fitted, or one is not of the model's airframe, and AirframeError for a wrong rotor count.

        >>> found = identify(read_log("sitl_logs/dev/worn_prop_1.tlog"))
        >>> print(found)
        topxgun-f16-sitl, 1 flight: rotor speed error 41.3 -> 10.8 rpm, each fifth left out in turn
        rotor_degradation of rotor 1: loss 0.081 (0.072 to 0.089)
    """
    flights = flights if isinstance(flights, Sequence) else [flights]
    fit, unused_tracks = _tracks(flights), _tracks(held_out)
    if not fit:
        raise DataError("no flight to identify from; give at least one log with rotor speeds")
    given = model is not None
    model = model or shipped_model()
    require_airframe((*flights, *held_out), model, given=given)
    return identify_checked(
        fit, model, held_out=unused_tracks, catalogue=catalogue, progress=progress
    )


@threadpool_limits.wrap(limits=1)  # small matrices: threads would only wait for each other
def identify_checked(
    fit: Sequence[FlightTrack],
    model: RotorModel,
    *,
    held_out: Sequence[FlightTrack] = (),
    catalogue: Sequence[Effect] = CATALOGUE,
    progress: Progress | None = None,
) -> Identification:
    """As `identify`, of flights that `require_airframe` holds for, or what a command does of it.

    Tracks are looked at one at a time, so that they may lie on disk.
    """
    catalogue = effects_for(model.airframe, catalogue)
    problem, means = rows_and_means(model, fit)
    if problem.of_outputs:
        catalogue = effects_on_shares(catalogue)
    space = search_space(model, fit, catalogue, means)
    search = Search(space.reduced, space.nuisance, space.candidates)
    search.run(progress)
    steps = onset_candidates(search, search.best) if not problem.of_outputs else []
    if steps and search.add(steps, without_rotors(search, search.best.key)):
        search.run(progress)
    answer = posterior_of(search, steepness_of(fit) if problem.of_outputs else 0.0)
    named = answer.named()
    first, any_name = search, bool(named)
    left = unexplained(space, search, answer.best, named=any_name)
    closest = closest_to(left, named, search, answer.best)
    if left is not None and any_name and not left.wanders:
        # What no effect explains may have lent its weight to a name: who stands beside it?
        beside = Search(space.reduced, with_free(space, left), search.candidates)
        beside.run(progress)
        standing = posterior_of(beside, answer.steepness)
        if lost := set(named) - {*closest, *standing.named()}:
            # What it had lent its weight to may have hidden what is there.
            search, answer, named = beside, standing, standing.named()
            closest = [*closest_to(left, named, search, answer.best), *closest, *sorted(lost)]
            closest = list(dict.fromkeys(closest))
    if progress:
        progress("errors on flights not used", 1.0)
    left_out = LeftOut.of(problem, search, answer.best)
    kept = [c for c in named if c not in closest]

    def error(some: Sequence[int]) -> float:
        return _size(left_out.with_set(some))

    matter = _that_matter(error, kept)
    one_of = answer.one_of(named)
    firsts = {one.terms[0].key for one in one_of}
    either = {c for c, k in enumerate(search.candidates) if k.term.key in firsts}
    estimates = answer.estimates(matter, either)
    matter = [e.candidate for e in estimates]
    aside = [c for c in named if c not in matter]
    if left is not None and any_name and not matter and not _that_matter(error, named):
        left = unexplained(space, first, first.best)  # good flights may leave as much
        closest = closest if left is not None else []
    said = {*matter, *either}
    if left is None and (silent := sorted(answer.best.key - said)):
        # What is likely but not said explains nothing.
        left = unexplained(space, first, posterior_of(first).of_alone(said))
        closest = closest_to(left, silent, search, answer.best)
    values = {e.candidate: e.value for e in estimates}
    before, after = left_out.residual({}), left_out.residual(values)
    # With nothing added the model stays what it was, and so does its error.
    chosen = left_out.with_choice(matter, aside) if matter else before
    unseen = [Unseen(problem=problem, before_rpm=before, after_rpm=chosen, role="fit")]
    if held_out:
        unused = assemble(model, held_out)
        unseen.append(
            Unseen(
                problem=unused,
                before_rpm=unused.measured_rpm - unused.speeds(),
                after_rpm=on_new_flights(unused, estimates),
                role="held_out",
            )
        )
    last = unseen[-1]
    wind = followed_wind(problem, after, left_out.held(values), fit)
    return Identification(
        model=model,
        problem=problem,
        found=_found(left_out, estimates),
        left=left,
        closest=tuple(search.candidates[c].term for c in closest),
        unseen=tuple(unseen),
        before=errors_of(last.problem, last.before_rpm),
        after=errors_of(last.problem, last.after_rpm),
        residual_after_rpm=after,
        residual_carried_rpm=left_out.with_carried(matter),
        floor_rpm=floor_rpm(last.problem, last.after_rpm, (problem, after) if held_out else None),
        sensor_noise_rpm=sensor_noise_rpm(problem.in_modes(after), problem.follows),
        alternatives=answer.alternatives(),
        one_of=one_of,
        # Motors and ESCs of one make differ by more than outputs scatter: they clear no rotor.
        excluded=tuple(
            e
            for e in answer.excluded(search.linearise(answer.best), named)
            if e.term.rotor is None or not problem.of_outputs
        ),
        mentioned=answer.mentioned(matter),
        untried={e.name: lacks for e in catalogue if (lacks := problem.lacks(e))},
        followed=() if wind is None else (wind,),
    )


def _tracks(flights: Sequence[Flown]) -> list[FlightTrack]:
    return [f if isinstance(f, FlightTrack) else f.track for f in flights]


def _that_matter(error: Callable[[Sequence[int]], float], members: Collection[int]) -> list[int]:
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


def _size(residual_rpm: Floats) -> float:
    return float(np.sqrt(np.mean(residual_rpm**2)))


def _found(left_out: LeftOut, estimates: Sequence[EffectEstimate]) -> tuple[Found, ...]:
    """The named effects, that which takes most of the error first."""

    def error(some: Sequence[EffectEstimate]) -> float:
        return _size(left_out.residual({e.candidate: e.value for e in some}))

    order: list[EffectEstimate] = []
    errors = [error(())]
    rest = list(estimates)
    while rest:
        trials = [error([*order, e]) for e in rest]
        best = int(np.argmin(trials))
        order.append(rest.pop(best))
        errors.append(trials[best])
    found = []
    for k, e in enumerate(order):
        found.append(
            Found(
                term=e.term,
                value=e.value,
                lower=e.value - e.half_width,
                upper=e.value + e.half_width,
                rmse_before_rpm=errors[k],
                rmse_after_rpm=errors[k + 1],
                p_value=1.0 - e.probability,
                indistinguishable_from=(),
                probability=e.probability,
            )
        )
    return tuple(found)
