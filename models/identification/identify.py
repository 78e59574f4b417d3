"""Close the loop: residual -> missing effect -> added effect -> error before and after.

`identify` searches the table of effects on flights with measured rotor speeds, one effect at a
time, each cross-validated and held against chance; then asks what is left, what could not be
distinguished, and what it means on flights that no step has used.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from thrustmargin.models.effects import CATALOGUE, effects_for
from thrustmargin.models.effects.base import Effect
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.already_followed import followed_wind
from thrustmargin.models.identification.alternatives import confounded_alternatives
from thrustmargin.models.identification.autocorrelation import (
    AutocorrelatedResidual,
    autocorrelated_residual,
)
from thrustmargin.models.identification.candidate import cross_validated_rmse, warm_start
from thrustmargin.models.identification.cross_validation import (
    ParameterInterval,
    held_out_cost,
    intervals,
)
from thrustmargin.models.identification.fit import (
    Evaluator,
    Fit,
    background_of,
    fit_terms,
    mode_scales,
    one_thread,
    term_values,
)
from thrustmargin.models.identification.modes import sensor_noise_rpm
from thrustmargin.models.identification.output_shares import effects_on_shares
from thrustmargin.models.identification.problem import Problem, assemble
from thrustmargin.models.identification.result import (
    Found,
    Identification,
    Tried,
    tried_in,
)
from thrustmargin.models.identification.search import (
    LEAST_GAIN,
    MOST_EFFECTS,
    SearchConfig,
    Step,
    look,
    prune,
)
from thrustmargin.models.identification.terms import Term
from thrustmargin.models.identification.unexplained import LEAST_SHARE, Curve, best_curve, floor_rpm
from thrustmargin.models.identification.unseen_errors import (
    Errors,
    across_flights,
    errors_of,
    on_new_flights,
)
from thrustmargin.models.identification.usable_flights import Flown, require_airframe
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_model import RotorModel

Progress = Callable[[str, float], None]


IMITATED = 0.6  # of what an effect explains, in the very mode that keeps a slow residual
LEAVES = 1.5  # times the slow residual that is left, which an effect must explain of it
FORM_SHARE = 0.25  # of an effect's own gain, above which a free curve disproves its form


@one_thread()
def identify(
    flights: Sequence[Flown] | Flown,
    model: RotorModel | None = None,
    *,
    held_out: Sequence[Flown] = (),
    config: SearchConfig | None = None,
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
        rotor_degradation of rotor 1: loss 0.08 (0.077 to 0.082)
    """
    flights = flights if isinstance(flights, Sequence) else [flights]
    fit, unused_tracks = _tracks(flights), _tracks(held_out)
    if not fit:
        raise DataError("no flight to identify from; give at least one log with rotor speeds")
    given = model is not None
    model, config = model or shipped_model(), config or SearchConfig()
    require_airframe((*flights, *held_out), model, given=given)
    catalogue = effects_for(model.airframe, catalogue)
    problem = assemble(model, fit)
    if problem.of_outputs:
        catalogue = effects_on_shares(catalogue)
    untried = {e.name: lacks for e in catalogue if (lacks := problem.lacks(e))}
    evaluator = Evaluator(problem)
    generator = np.random.default_rng(config.seed)
    first = fit_terms(evaluator, (), scales=np.ones(model.airframe.rotor_count))
    first = fit_terms(evaluator, (), scales=mode_scales(problem, first.residual_rpm))
    tried: list[Tried] = []
    found, steps, last = _search(evaluator, first, catalogue, config, generator, progress, tried)
    found, curve, slow = _disprove(evaluator, found, steps, config, generator)
    alike = confounded_alternatives(evaluator, found, catalogue) if found.terms else {}
    if progress:
        progress("errors on flights not used", 0.0)
    before_rows = across_flights(evaluator, first)
    after_rows = across_flights(evaluator, found)
    unused = assemble(model, unused_tracks) if unused_tracks else None
    return Identification(
        model=model,
        problem=problem,
        held_out=unused,
        fit=found,
        interval=intervals(found, background_of(problem, found)),
        found=_found(evaluator, found, steps, alike),
        curve=curve,
        slow=slow,
        before=_errors(unused or problem, unused, evaluator, first, before_rows),
        after=_errors(unused or problem, unused, evaluator, found, after_rows),
        residual_before_rpm=first.residual_rpm,
        residual_after_rpm=found.residual_rpm,
        floor_rpm=floor_rpm(problem, found.residual_rpm),
        sensor_noise_rpm=sensor_noise_rpm(
            found.residual_rpm @ problem.modes.directions, problem.follows
        ),
        config=config,
        tried=tuple(tried),
        unflyable=last.unflyable,
        possible=last.possible,
        untried=untried,
        followed=tuple(f for f in [followed_wind(problem, found, fit)] if f is not None),
    )


def _tracks(flights: Sequence[Flown]) -> list[FlightTrack]:
    return [f if isinstance(f, FlightTrack) else f.track for f in flights]


def _search(
    evaluator: Evaluator,
    first: Fit,
    catalogue: Sequence[Effect],
    config: SearchConfig,
    generator: np.random.Generator,
    progress: Progress | None,
    tried: list[Tried],
) -> tuple[Fit, dict[str, Step], Step]:
    """Add effects until none beats chance; which step brought each, and the last step. `tried` gets
    all candidates."""
    current, steps, step = first, {}, None
    for number in range(MOST_EFFECTS):
        report = None
        if progress:
            report = lambda what, share, n=number: progress(f"effect {n + 1}: {what}", share)  # noqa: E731
        step = look(evaluator, current, catalogue, config, generator, report)
        tried += tried_in(step, number + 1)
        if step.chosen is None:
            break
        # Without the fits of all candidates, which are large.
        new = {t.key for t in step.chosen.fit.terms} - {t.key for t in current.terms}
        steps |= dict.fromkeys(new, replace(step, ranked=()))
        current = prune(evaluator, step.chosen.fit)
    assert step is not None
    return prune(evaluator, current, last_too=True), steps, step


def _disprove(
    evaluator: Evaluator,
    found: Fit,
    steps: dict[str, Step],
    config: SearchConfig,
    generator: np.random.Generator,
) -> tuple[Fit, Curve | None, AutocorrelatedResidual | None]:
    """What is left; effects that it disproves are taken out again."""
    problem = evaluator.problem
    while True:
        scales = mode_scales(problem, found.residual_rpm)
        found = fit_terms(evaluator, found.terms, scales=scales, start=found.values, steps=3)
        curve = best_curve(
            problem, found, scales, surrogates=config.surrogates, generator=generator
        )
        cost = float(held_out_cost(found.statistics).sum())
        if (
            curve is None
            or curve.p_value > config.significance
            or curve.share < LEAST_SHARE
            or curve.gain < LEAST_GAIN * cost
        ):
            curve = None
        slow = autocorrelated_residual(problem, found.residual_rpm)
        wrong = _of_other_form(found, curve, steps) or _stands_for(evaluator, found, slow)
        if wrong is None:
            return found, curve, slow
        rest = tuple(t for t in found.terms if t.key != wrong.key)
        start = warm_start(rest, found, problem.flights)
        found = fit_terms(evaluator, rest, scales=scales, start=start)


def _of_other_form(found: Fit, curve: Curve | None, steps: dict[str, Step]) -> Term | None:
    """The last effect whose own channel shows a form that is not its own."""
    if curve is None:
        return None
    wrong = [t for t in found.terms if curve.channel in t.effect.shape_channels]
    wrong = [t for t in wrong if curve.gain > FORM_SHARE * _gain(steps, t)]
    return wrong[-1] if wrong else None


def _stands_for(
    evaluator: Evaluator, found: Fit, slow: AutocorrelatedResidual | None
) -> Term | None:
    """The effect that explains less of a slow residual than it leaves, and little else.

    Such an effect only imitates, as far as its form allows, what has no name.
    """
    if slow is None:
        return None
    least: tuple[float, Term] | None = None
    for term in found.terms:
        rest = tuple(t for t in found.terms if t.key != term.key)
        start = warm_start(rest, found, evaluator.problem.flights)
        without = fit_terms(evaluator, rest, scales=found.scales, start=start, steps=5)
        change = without.residual_rpm**2, found.residual_rpm**2
        whole = float(np.mean(np.sum(change[0] - change[1], axis=1)))
        along = float(
            np.mean(
                (without.residual_rpm @ slow.direction) ** 2
                - (found.residual_rpm @ slow.direction) ** 2
            )
        )
        imitates = along < LEAVES * slow.rms_rpm**2 and along > IMITATED * whole
        if imitates and (least is None or whole < least[0]):
            least = whole, term
    return None if least is None else least[1]


def _gain(steps: dict[str, Step], term: Term) -> float:
    step = steps.get(term.key)
    if step is None or step.chosen is None:
        return np.inf
    return step.chosen.gain


def _found(
    evaluator: Evaluator, fit: Fit, steps: dict[str, Step], alike: dict[str, list[str]]
) -> tuple[Found, ...]:
    """The accepted effects in order, each with its values, interval and errors around it."""
    problem = evaluator.problem
    interval: ParameterInterval = intervals(fit, background_of(problem, fit))
    scales = mode_scales(problem, fit.residual_rpm)
    errors = []
    for count in range(len(fit.terms) + 1):
        terms = fit.terms[:count]
        start = warm_start(terms, fit, problem.flights)
        part = fit_terms(evaluator, terms, scales=scales, start=start, steps=5)
        errors.append(cross_validated_rmse(evaluator, part))
    found = []
    for k, term in enumerate(fit.terms):
        found.append(
            Found(
                term=term,
                value=term_values(fit, term),
                lower=term_values(fit, term, interval.lower),
                upper=term_values(fit, term, interval.upper),
                rmse_before_rpm=errors[k],
                rmse_after_rpm=errors[k + 1],
                p_value=steps[term.key].p_value,
                indistinguishable_from=tuple(alike.get(term.key, ())),
            )
        )
    return tuple(found)


def _errors(
    problem: Problem,
    unused: Problem | None,
    evaluator: Evaluator,
    fit: Fit,
    cross_validated,
) -> Errors:
    if unused is None:
        return errors_of(problem, cross_validated)
    return errors_of(unused, on_new_flights(unused, evaluator, fit))
