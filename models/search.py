"""The search: which effect of the table, added to those already in, makes left-out flights better.

Every candidate is fitted together with everything accepted and scored on flights left out one at a
time. It is taken only if the fall in held-out cost beats that of the whole search on surrogates,
its interval excludes "absent", and its value is physically possible and worth reporting.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from models import onset
from models.effects.base import Effect
from models.effects.coefficient import ROTOR_DEGRADATION as WORN
from models.effects.coefficient import ROTOR_DEGRADATION_ONSET as ONSET
from models.fit import (
    Evaluator,
    Fit,
    Term,
    fit_terms,
    layout_of,
    linearise,
    mode_scales,
    starts,
)
from models.flight import Floats
from models.judge import Interval, difference_in_doubt, held_out_cost, intervals
from models.onset import Onset
from models.predictions import across_flights
from models.surrogates import Linear, best_gains, p_value, surrogate_residuals

SHORT_LIST = 6  # candidates that are fitted to the end
LEAST_MOVE = 0.0008  # of rotor speed, RMS, below which an effect is not worth a name
ONSET_LEAVES = 0.8  # of the cost that a rotor bad all along would leave
LEAST_GAIN = 0.002  # share of the held-out cost that an effect must take away

Progress = Callable[[str, float], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchConfig:
    """Settings of a search; what is learnt is in its results."""

    surrogates: int = 99
    significance: float = 0.02
    most_effects: int = 8
    least_fall: float = 0.03  # of the cross-validated RMSE in rpm, for an effect worth a name
    tie: float = 0.0  # of the best gain, within which the plain error on left-out flights decides
    seed: int = 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scored:
    """A candidate fitted together with the accepted terms."""

    term: Term
    fit: Fit
    held_out: Floats  # (B,)
    gain: float  # fall of the summed held-out cost


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Step:
    """One look through all candidates."""

    base: Fit
    base_held_out: Floats  # (B,)
    ranked: tuple[Scored, ...]  # best first
    chosen: Scored | None
    p_value: float


def candidates(evaluator: Evaluator, accepted: Sequence[Term], catalogue: Sequence[Effect]):
    """Terms that could be added: channels reported, not in already."""
    taken = {t.key for t in accepted}
    rotors = evaluator.problem.measured_rpm.shape[1]
    for effect in catalogue:
        if evaluator.problem.has(effect):
            places = range(rotors) if effect.of_one_rotor else (None,)
            for rotor in places:
                term = Term(effect=effect, rotor=rotor)
                if term.key not in taken and effect.variant != ONSET.variant:
                    yield term


def warm_start(terms: Sequence[Term], fit: Fit, flights: int) -> Floats:
    """Values of a fit carried over to a list of terms that may hold more, fewer or others."""
    layout = layout_of(terms, flights)
    values = starts(layout)
    k = 0
    known: dict[str, Floats] = {}
    for term in fit.terms:
        n = len(term.effect.parameters)
        known[term.key] = fit.values[fit.layout.places[:, k : k + n]]
        k += n
    k = 0
    for term in terms:
        n = len(term.effect.parameters)
        if term.key in known:
            values[layout.places[:, k : k + n]] = known[term.key]
        k += n
    return values


def score(
    evaluator: Evaluator, base: Fit, base_cost: float, terms: Sequence[Term], term: Term, **given
) -> Scored:
    """Fit `terms` (which hold `term`) from where `base` stands and score it."""
    start = warm_start(terms, base, evaluator.problem.flights)
    fit = fit_terms(evaluator, terms, start=start, **given)
    cost = held_out_cost(fit.statistics)
    return Scored(term=term, fit=fit, held_out=cost, gain=base_cost - float(cost.sum()))


def look(
    evaluator: Evaluator,
    base: Fit,
    catalogue: Sequence[Effect],
    config: SearchConfig,
    generator: np.random.Generator,
    progress: Progress | None = None,
) -> Step:
    """One step of the search from an accepted fit: rank, test against chance, choose or not."""
    problem = evaluator.problem
    scales = mode_scales(problem, base.residual_rpm)
    base = fit_terms(evaluator, base.terms, scales=scales, start=base.values, steps=3)
    base_held_out = held_out_cost(base.statistics)
    base_cost = float(base_held_out.sum())
    pool = list(candidates(evaluator, base.terms, catalogue))
    linear: list[Linear] = []
    rough: list[Scored] = []
    for done, term in enumerate(pool):
        terms = (*base.terms, term)
        layout = layout_of(terms, problem.flights)
        start = warm_start(terms, base, problem.flights)
        near = linearise(evaluator, terms, layout, start, scales, known=base.jacobian)
        offset = base.whitened - near.whitened if term.effect.affine else None
        linear.append(Linear(statistics=near.statistics, jacobian=near.jacobian, offset=offset))
        cost = held_out_cost(near.statistics)
        rough.append(Scored(term=term, fit=near, held_out=cost, gain=base_cost - cost.sum()))
        if progress:
            progress("candidates", (done + 1) / len(pool))
    rough.sort(key=lambda s: -s.gain)
    ranked = [
        score(evaluator, base, base_cost, s.fit.terms, s.term, scales=scales)
        for s in rough[:SHORT_LIST]
    ]
    losses = np.stack(
        [n.jacobian[:, :, -2] for n, t in zip(linear, pool, strict=True) if t.effect is WORN]
        or [np.zeros_like(base.whitened)]
    )
    step_found = onset.scan(problem, losses, base.whitened)
    if step_found.gain > LEAST_GAIN * base_cost and ONSET in catalogue:
        worn = [t for t in pool if t.effect is WORN][step_found.rotor]
        steady = max((s.gain for s in ranked if s.term.effect is WORN), default=0.0)
        sudden = _onset(evaluator, base, base_cost, scales, step_found, worn)
        if base_cost - sudden.gain < ONSET_LEAVES * (base_cost - steady):
            ranked.append(sudden)
    ranked.sort(key=lambda s: -s.gain)
    ranked += [replace(s, gain=min(s.gain, ranked[-1].gain)) for s in rough[SHORT_LIST:]]
    error = cross_validated_rmse(evaluator, base)
    worthy = [
        s
        for s in ranked[: SHORT_LIST + 1]
        if s.gain > LEAST_GAIN * base_cost
        and credible(s, base, problem.background(scales))
        and cross_validated_rmse(evaluator, s.fit) < (1.0 - config.least_fall) * error
    ]
    if not worthy:
        return Step(
            base=base,
            base_held_out=base_held_out,
            ranked=tuple(ranked),
            chosen=None,
            p_value=1.0,
        )
    level = [s for s in worthy if s.gain >= (1.0 - config.tie) * worthy[0].gain]
    best = min(level, key=lambda s: cross_validated_rmse(evaluator, s.fit))
    noise = surrogate_residuals(
        problem, best.fit.whitened, config.surrogates, generator, problem.background(scales)
    )
    if best.term.effect.variant == ONSET.variant:
        chance = onset.best_gains(problem, losses, noise)
        p = p_value(step_found.gain, chance)
    else:
        nothing = Linear(statistics=base.statistics, jacobian=base.jacobian)
        chance = best_gains(problem, nothing, linear, noise)
        p = p_value(best.gain, chance)
    chosen = best if p <= config.significance else None
    return Step(
        base=base,
        base_held_out=base_held_out,
        ranked=tuple(ranked),
        chosen=chosen,
        p_value=p,
    )


def _onset(
    evaluator: Evaluator, base: Fit, base_cost: float, scales: Floats, found: Onset, worn: Term
) -> Scored:
    """The step found by the scan, fitted with everything accepted."""
    flights = evaluator.problem.flights
    term = Term(effect=ONSET, rotor=worn.rotor)
    terms = (*base.terms, term)
    start = warm_start(terms, base, flights)
    layout = layout_of(terms, flights)
    loss, time_s = layout.places[:, -3], layout.places[:, -2]
    start[loss] = 0.0
    start[loss[found.flight]] = found.loss
    start[time_s] = found.time_s
    fit = fit_terms(evaluator, terms, scales=scales, start=start)
    cost = held_out_cost(fit.statistics)
    return Scored(term=term, fit=fit, held_out=cost, gain=base_cost - float(cost.sum()))


def cross_validated_rmse(evaluator: Evaluator, fit: Fit) -> float:
    """RMSE in rpm of every row under values found without its flight."""
    return float(np.sqrt(np.mean(across_flights(evaluator, fit) ** 2)))


def term_values(fit: Fit, term: Term, values: Floats | None = None) -> Floats:
    """Values of one term of a fit, (F, parameters of the term)."""
    given = fit.values if values is None else values
    k = 0
    for other in fit.terms:
        n = len(other.effect.parameters)
        if other.key == term.key:
            return given[fit.layout.places[:, k : k + n]]
        k += n
    raise KeyError(term.key)


def credible(
    scored: Scored,
    base: Fit | None = None,
    background: Floats | None = None,
    interval: Interval | None = None,
) -> bool:
    """True when the effect is possible, its interval excludes absent, and it matters.

    It matters when the parameter is as far from absent as is worth reporting and, given the `base`
    without it, when it moves the predicted rotor speeds by LEAST_MOVE of their size.
    """
    interval = interval or intervals(scored.fit, background)
    value = term_values(scored.fit, scored.term)
    low = term_values(scored.fit, scored.term, interval.lower)
    high = term_values(scored.fit, scored.term, interval.upper)
    asked, matters = False, False
    for k, p in enumerate(scored.term.effect.parameters):
        inside = (value[:, k] > p.lower) & (value[:, k] < p.upper)
        if not p.detail and not inside.all():
            return False
        if p.absent is not None:
            asked = True
            clear = (low[:, k] > p.absent) | (high[:, k] < p.absent)
            matters |= bool(np.any(clear & (np.abs(value[:, k] - p.absent) >= p.smallest)))
        elif p.smallest:
            asked = True
            matters |= bool(np.any(np.abs(value[:, k]) >= p.smallest))
    if asked and not matters:
        return False
    if base is None:
        return True
    moved = np.sqrt(np.mean((scored.fit.prediction_rpm - base.prediction_rpm) ** 2))
    return bool(moved > LEAST_MOVE * np.mean(base.prediction_rpm))


def prune(evaluator: Evaluator, fit: Fit, *, last_too: bool = False) -> Fit:
    """Drop, one at a time, terms that left-out flights do not miss or that lost their credit."""
    while len(fit.terms) > (not last_too):
        scales = mode_scales(evaluator.problem, fit.residual_rpm)
        whole = fit_terms(evaluator, fit.terms, scales=scales, start=fit.values, steps=2)
        cost = float(held_out_cost(whole.statistics).sum())
        trials = []
        for term in fit.terms if last_too else fit.terms[:-1]:
            rest = tuple(t for t in fit.terms if t.key != term.key)
            start = warm_start(rest, fit, evaluator.problem.flights)
            trial = fit_terms(evaluator, rest, scales=scales, start=start, steps=4)
            loss = float(held_out_cost(trial.statistics).sum()) - cost
            kept = Scored(term=term, fit=whole, held_out=whole.statistics.cost, gain=loss)
            trials.append(
                (
                    loss
                    if credible(kept, trial, evaluator.problem.background(scales))
                    else -np.inf,
                    trial,
                )
            )
        loss, best = min(trials, key=lambda pair: pair[0])
        if loss > LEAST_GAIN * cost:
            return fit
        fit = best
    return fit


def rivals(evaluator: Evaluator, fit: Fit, catalogue: Sequence[Effect]) -> dict[str, list[str]]:
    """For each accepted term, the effects that would do as well in its place."""
    problem = evaluator.problem
    scales = mode_scales(problem, fit.residual_rpm)
    whole = held_out_cost(
        fit_terms(evaluator, fit.terms, scales=scales, start=fit.values, steps=1).statistics
    )
    found: dict[str, list[str]] = {}
    for term in fit.terms:
        rest = tuple(t for t in fit.terms if t.key != term.key)
        start = warm_start(rest, fit, problem.flights)
        without = fit_terms(evaluator, rest, scales=scales, start=start, steps=5)
        missed = float(held_out_cost(without.statistics).sum() - whole.sum())
        found[term.key] = []
        for other in candidates(evaluator, fit.terms, catalogue):
            if other.effect.name == term.effect.name and other.rotor == term.rotor:
                continue
            terms = (*rest, other)
            layout = layout_of(terms, problem.flights)
            near = linearise(
                evaluator,
                terms,
                layout,
                warm_start(terms, without, problem.flights),
                scales,
                known=without.jacobian,
            )
            lost = float(held_out_cost(near.statistics).sum() - whole.sum())
            if missed - lost < 0.3 * missed:
                continue
            trial = score(evaluator, without, 0.0, terms, other, scales=scales, steps=5)
            regained = missed - (float(trial.held_out.sum()) - float(whole.sum()))
            alike = difference_in_doubt(whole, trial.held_out, problem.block_flight)
            if (
                alike
                and regained > 0.5 * missed
                and credible(trial, without, problem.background(scales))
            ):
                found[term.key].append(_label(other))
    return found


def _label(term: Term) -> str:
    return (
        term.effect.name if term.rotor is None else f"{term.effect.name} of rotor {term.rotor + 1}"
    )
