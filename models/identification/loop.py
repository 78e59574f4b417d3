"""Identify the effects that a rotor speed model lacks, from flights with measured rotor speeds.

`identify` searches over sets of effects, which compete with a nonparametric discrepancy. It reports
effects with a posterior probability of at least 0.95, lists confounded alternatives and excluded
sizes, and states the error on held-out or cross-validated flights.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from thrustmargin.models.checks.arms.arm_causes import Cause
from thrustmargin.models.checks.arms.arm_posterior import loss_evidence
from thrustmargin.models.checks.loss_of_control import before_loss, loss_of_control
from thrustmargin.models.effects import CATALOGUE, effects_for
from thrustmargin.models.effects.base import Effect
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.answer.acceptance import (
    LEAST_FALL,
    AcceptedEffects,
    accept_effects,
    open_cause,
    residual_rms,
)
from thrustmargin.models.identification.answer.constant_shares import constant_shares
from thrustmargin.models.identification.answer.cross_validation import (
    CrossValidation,
    held_out_residual,
)
from thrustmargin.models.identification.answer.floor import floor_rpm
from thrustmargin.models.identification.answer.held_out_errors import HeldOutResidual, errors_of
from thrustmargin.models.identification.answer.posterior import EffectEstimate
from thrustmargin.models.identification.answer.result import (
    Identification,
    ReportedEffect,
    weak_rotors,
)
from thrustmargin.models.identification.answer.wind_in_airspeed import wind_in_airspeed
from thrustmargin.models.identification.rows.candidates import Candidate, slopes, with_arm_evidence
from thrustmargin.models.identification.rows.modes import sensor_noise_rpm
from thrustmargin.models.identification.rows.output_shares import (
    effects_on_shares,
    is_constant_share,
    lacks_sound_flights,
    steepness_of,
)
from thrustmargin.models.identification.rows.problem import Problem, assemble
from thrustmargin.models.identification.rows.reduced import Reduced, rows_and_means
from thrustmargin.models.identification.rows.usable_flights import Flown, require_airframe
from thrustmargin.models.identification.sets.onsets import drop_rotor_effects, onset_candidates
from thrustmargin.models.identification.sets.search_space import search_space
from thrustmargin.models.identification.sets.set_search import Progress, Search
from thrustmargin.models.model.flight_arms import figures_of, flights_arm_answer
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_model import RotorModel


def identify(
    flights: Sequence[Flown] | Flown,
    model: RotorModel | None = None,
    *,
    held_out: Sequence[Flown] = (),
    catalogue: Sequence[Effect] = CATALOGUE,
    progress: Progress | None = None,
) -> Identification:
    """Find the effects that `model` lacks on `flights`; report errors on the flights `held_out`.

    A flight is a FlightTrack or a log that was read. Without `model`, the shipped model is used; it
    requires logs that are recognised as of its airframe. Effects are scaled to the size of the
    model's aircraft. Without held-out flights the errors are cross-validated: each flight (of a
    single flight, each fifth) is predicted with values fitted without it. Raises DataError when no
    flight can be fitted or one is not of the model's airframe, and AirframeError for a wrong rotor
    count.

        >>> found = identify(read_log("sitl_logs/dev/worn_prop_1.tlog"))
        >>> print(found)
        topxgun-f16-sitl, 1 flight: rotor speed error 41.3 -> 10.8 rpm, each fifth left out in turn
        rotor_degradation of rotor 1: loss 0.079 (0.072 to 0.087)
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
    """Identify the effects that explain the flights `fit`, from tracks that have passed
    `require_airframe` already.

    `held_out` are flights to test the result on, which are not fitted; without any, errors are by
    cross-validation. `catalogue` are the effects to consider. `progress` is called with a sentence
    and the share done. Tracks are read one at a time, so a sequence may load each from disk.
    """
    catalogue = effects_for(model.airframe, catalogue)
    problem, means = rows_and_means(model, fit)
    if problem.of_outputs:
        catalogue = effects_on_shares(catalogue)
    space = search_space(model, fit, catalogue, means)
    figures = figures_of(model, fit)
    arms = loss_evidence(figures, model.arms)
    candidates = with_arm_evidence((*space.candidates, *space.unnamed), arms)
    search = Search(space.reduced, space.nuisance, candidates)
    search.run(progress)
    # With reports seconds apart, slow noise cannot be distinguished from a step in time.
    stepwise = not (problem.of_outputs or space.nuisance.whitening.unfiltered.any())
    steps = onset_candidates(search, search.best) if stepwise else []
    if lacks_sound_flights(model):  # other changes between two flights are of unknown size
        steps = [one for one in steps if not is_constant_in_flights(space.reduced, one)]
    if steps and search.add(steps, drop_rotor_effects(search, search.best.key)):
        search.run(progress)
    steepness = steepness_of(fit) if problem.of_outputs else 0.0
    accepted = accept_effects(space, search, problem, steepness=steepness)
    unused = assemble(model, held_out) if held_out else None
    if unused is not None and not unnamed_causes_help(unused, accepted):
        accepted = accepted.without_unnamed()
    answer = accepted.answer
    left_out, estimates = accepted.left_out, accepted.estimates
    if progress:
        progress("errors on flights not used", 1.0)
    values = {e.candidate: e.value for e in estimates}
    before, after = left_out.residual({}), left_out.residual(values)
    unseen = [
        HeldOutResidual(
            problem=problem, before_rpm=before, after_rpm=accepted.left_out_rpm, role="fit"
        )
    ]
    if unused is not None:
        unseen.append(
            HeldOutResidual(
                problem=unused,
                before_rpm=unused.measured_rpm - unused.speeds(),
                after_rpm=held_out_residual(unused, estimates),
                role="held_out",
            )
        )
    last, reported = unseen[-1], _reported_effects(left_out, estimates)
    open_keys = {search.candidates[c].key for c in accepted.unnamed_members}
    shares = constant_shares(problem, left_out.trial_effects(values), left_out.residual(values))
    wind = wind_in_airspeed(problem, after, left_out.trial_effects(values), fit)
    named = [f for f in reported if f.term.key not in open_keys]
    by_arms = flights_arm_answer(model, figures, sorted(weak_rotors(named)))
    read_wrong = {
        one.arm for one in by_arms.findings if one.cause is Cause.SPEED_READING
    } & weak_rotors(named)
    return Identification(
        model=model,
        problem=problem,
        found=tuple(f for f in named if f.term.degraded_rotor not in read_wrong),
        misread=tuple(f for f in named if f.term.degraded_rotor in read_wrong),
        arms=by_arms,
        left=accepted.unexplained,
        contradicted=tuple(search.candidates[c].term for c in accepted.contradicted),
        closest=tuple(search.candidates[c].term for c in accepted.lookalikes),
        unseen=tuple(unseen),
        before=errors_of(last.problem, last.before_rpm),
        after=errors_of(last.problem, last.after_rpm),
        residual_after_rpm=after,
        residual_transferable_rpm=left_out.with_persistent_effects(accepted.members),
        floor_rpm=floor_rpm(last.problem, last.after_rpm, (problem, after) if held_out else None),
        sensor_noise_rpm=sensor_noise_rpm(problem.mode_amplitudes(after), problem.follows),
        alternatives=answer.alternatives(),
        one_of=accepted.one_of,
        # Motors and ESCs of one make differ by more than outputs scatter: no rotor is cleared.
        excluded=tuple(
            e
            for e in answer.excluded(answer.search.linearise(answer.best), accepted.probable)
            if e.term.rotor is None or not problem.of_outputs
        ),
        mentioned=accepted.mentioned,
        gaining=answer.gaining_rotors(),
        open_causes=tuple(open_cause(f, answer) for f in reported if f.term.key in open_keys),
        untried={e.name: lacks for e in catalogue if (lacks := problem.lacks(e))},
        followed=() if wind is None else (wind,),
        constant_shares=shares,
    )


def unnamed_causes_help(unused: Problem, accepted: AcceptedEffects) -> bool:
    """Return True if unnamed causes lower the error on the held-out flights `unused` by LEAST_FALL.

    Also True without unnamed causes. They already lowered the cross-validated error, which is the
    only reason why a model includes them.
    """
    if not accepted.unnamed_members:
        return True
    without, having = (
        residual_rms(held_out_residual(unused, estimates))
        for estimates in (accepted.reported, accepted.estimates)
    )
    return without >= (1.0 + LEAST_FALL) * having


def is_constant_in_flights(reduced: Reduced, step: Candidate) -> bool:
    """Return True if the change by a rotor's step `step` is constant within each flight.

    Then it cannot be distinguished from a load or a trim that was changed between two flights.
    """
    effect = step.term.effect
    main = [k for k, p in enumerate(effect.parameters) if p.absent is not None and not p.detail]
    change = np.nan_to_num(slopes(reduced, [step.initial_effect], 0, main))
    return is_constant_share(change, reduced.flight)


def _tracks(flights: Sequence[Flown]) -> list[FlightTrack]:
    """Return the track of each flight, truncated at the moment control was lost."""
    tracks = [f if isinstance(f, FlightTrack) else f.track for f in flights]
    return [before_loss(track, loss_of_control(track)) for track in tracks]


def _reported_effects(
    left_out: CrossValidation, estimates: Sequence[EffectEstimate]
) -> tuple[ReportedEffect, ...]:
    """Return the reported effects, the one that lowers the error most first.

    Each has the RMSE, rpm, before and after it is added to the effects before it.
    """

    def error(some: Sequence[EffectEstimate]) -> float:
        """Return the RMS residual, rpm, with the given estimates on all rows."""
        return residual_rms(left_out.residual({e.candidate: e.value for e in some}))

    order: list[EffectEstimate] = []
    errors = [error(())]
    rest = list(estimates)
    while rest:
        trials = [error([*order, e]) for e in rest]
        best = int(np.argmin(trials))
        order.append(rest.pop(best))
        errors.append(trials[best])
    effects = []
    for k, e in enumerate(order):
        effects.append(
            ReportedEffect(
                term=e.term,
                value=e.value,
                lower=e.value - e.half_width,
                upper=e.value + e.half_width,
                rmse_before_rpm=errors[k],
                rmse_after_rpm=errors[k + 1],
                probability=e.probability,
            )
        )
    return tuple(effects)
