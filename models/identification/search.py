"""The search: which effect of the table, added to those already in, makes left-out flights better.

Every candidate is fitted together with everything accepted and scored on flights left out one at a
time. It is taken only if the fall in held-out cost beats that of the whole search on surrogates,
its interval excludes "absent", and its value is physically possible and worth reporting.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.effects.base import Effect
from thrustmargin.models.effects.rotor_degradation import ONSETS
from thrustmargin.models.effects.rotor_degradation import ROTOR_DEGRADATION as WORN
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification import onset
from thrustmargin.models.identification.candidate import (
    Scored,
    candidates,
    credible,
    cross_validated_rmse,
    score,
    warm_start,
)
from thrustmargin.models.identification.cross_validation import (
    held_out_cost,
)
from thrustmargin.models.identification.fit import Evaluator, Fit, fit_terms, linearise, mode_scales
from thrustmargin.models.identification.onset import Onset
from thrustmargin.models.identification.standing_trim import (
    PossibleLoss,
    Unflyable,
    possible_losses,
    trim_instead,
    unflyable,
)
from thrustmargin.models.identification.surrogates import (
    Linear,
    best_gains,
    p_value,
    surrogate_residuals,
)
from thrustmargin.models.identification.terms import FitLayout, Term, columns_of, layout_of

SHORT_LIST = 5  # candidates that are fitted in full
ONSET_GAIN = 1.15  # times that of a rotor bad all along, for a step in time to be believed
ONSET_LEAVES = 0.8  # of the cost that a rotor bad all along leaves, which will do as well
ONE_FLIGHT_GAIN = 1.1  # times that of a step that other flights share, for one of a single flight
MOST_EFFECTS = 10
LEAST_FALL = 0.01  # of the cross-validated RMSE in rpm, for an effect worth a name
TIE = 0.1  # of the best gain, within which the plain error on left-out flights decides
LEAST_GAIN = 0.002  # share of the held-out cost that an effect must take away

Progress = Callable[[str, float], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchConfig:
    """Settings of a search; what is learnt is in its results."""

    surrogates: int = 99
    significance: float = 0.02
    seed: int = 0

    def __post_init__(self) -> None:
        """Raises DataError for too few surrogates: the least p-value is 1 / (surrogates + 1)."""
        fewest = math.ceil(1.0 / self.significance - 1e-9) - 1
        if self.surrogates < fewest:
            raise DataError(
                f"{self.surrogates} surrogates cannot tell an effect from chance at "
                f"{100 * self.significance:g} %; give {fewest} or more"
            )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Step:
    """One look through all candidates."""

    base: Fit
    base_held_out: Floats  # (B,)
    ranked: tuple[Scored, ...]  # best first
    chosen: Scored | None
    p_value: float
    unflyable: tuple[Unflyable, ...] = ()  # losses that would have been chosen
    possible: tuple[PossibleLoss, ...] = ()  # and one that is likely


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
        near = _near(evaluator, base, terms, layout, scales)
        offset = base.whitened - near.whitened if term.effect.affine else None
        linear.append(Linear(statistics=near.statistics, jacobian=near.jacobian, offset=offset))
        cost = held_out_cost(near.statistics)
        rough.append(Scored(term=term, fit=near, held_out=cost, gain=base_cost - cost.sum()))
        if progress:
            progress("candidates", (done + 1) / len(pool))
    rough.sort(key=lambda s: -s.gain)
    rough = _short_list_first(rough, base_cost)
    ranked = [
        score(evaluator, base, base_cost, s.fit.terms, s.term, scales=scales, start=s.fit.values)
        for s in rough[:SHORT_LIST]
    ]
    losses = _losses(linear, pool, base)
    begun = onset.scan(problem, losses, base.whitened)
    steady = max((s.gain for s in ranked if s.term.effect is WORN), default=0.0)
    shared = 0.0
    for effect in reversed(ONSETS):
        found = begun.get(effect.variant)
        if effect not in catalogue or found is None or found.gain < LEAST_GAIN * base_cost:
            continue
        if found.gain < onset.gain_all_along(losses[found.rotor], base.whitened):
            continue
        sudden = _onset(evaluator, base, base_cost, scales, found, effect)
        clear = sudden.gain > ONSET_GAIN * steady or (
            base_cost - sudden.gain < ONSET_LEAVES * (base_cost - steady)
        )
        if clear and sudden.gain > ONE_FLIGHT_GAIN * shared:
            ranked.append(sudden)
        shared = max(shared, sudden.gain)
    ranked.sort(key=lambda s: -s.gain)
    ranked += [replace(s, gain=min(s.gain, ranked[-1].gain)) for s in rough[SHORT_LIST:]]
    error = cross_validated_rmse(evaluator, base)
    worthy = [
        s
        for s in ranked[: SHORT_LIST + 1]
        if s.gain > LEAST_GAIN * base_cost
        and credible(s, base, problem, tries=len(pool))
        and _of_most_flights(base_held_out - s.held_out, problem.block_flight, s.term)
        and cross_validated_rmse(evaluator, s.fit) < (1.0 - LEAST_FALL) * error
    ]
    ruled_out = [(s, unflyable(problem, s)) for s in worthy]
    worthy = [s for s, reason in ruled_out if reason is None]
    nothing = Step(
        base=base,
        base_held_out=base_held_out,
        ranked=tuple(ranked),
        chosen=None,
        p_value=1.0,
        unflyable=tuple(reason for _, reason in ruled_out if reason is not None),
        possible=possible_losses(problem, base, ranked[: SHORT_LIST + 1]),
    )
    if not worthy:
        return nothing
    level = [s for s in worthy if s.gain >= (1.0 - TIE) * worthy[0].gain]
    best = min(level, key=lambda s: cross_validated_rmse(evaluator, s.fit))
    if best.term.effect is WORN:
        best = trim_instead(evaluator, base, base_cost, scales, best, pool) or best
    noise = surrogate_residuals(
        problem, best.fit.whitened, config.surrogates, generator, problem.background(scales)
    )
    if best.term.effect.begins:
        chance = onset.best_gains(problem, losses, noise)
        p = p_value(begun[best.term.effect.variant].gain, chance)
    else:
        without = Linear(statistics=base.statistics, jacobian=base.jacobian)
        chance = best_gains(problem, without, linear, noise)
        p = p_value(best.gain, chance)
    return replace(nothing, chosen=best if p <= config.significance else None, p_value=p)


def _losses(linear: Sequence[Linear], pool: Sequence[Term], base: Fit) -> Floats:
    """(R, T, R) weighted derivative by the loss of each rotor; 0 of one that is known to be bad."""
    losses = np.zeros((base.whitened.shape[1], *base.whitened.shape))
    for near, term in zip(linear, pool, strict=True):
        if term.effect is WORN:
            columns = columns_of((*base.terms, term))[term.key]
            losses[term.rotor] = near.jacobian[:, :, columns["loss"]]
    return losses


def _short_list_first(rough: Sequence[Scored], base_cost: float) -> list[Scored]:
    """Candidates, best first, with the two of the rest that would fit best moved into the short
    list: one straight step can be wild on a flight left out where the whole fit is not."""
    whole = SHORT_LIST - 2
    rest = sorted(rough[whole:], key=lambda s: -_fitted_gain(s, base_cost))
    return [*rough[:whole], *rest[:2], *[s for s in rough[whole:] if s not in rest[:2]]]


def _fitted_gain(scored: Scored, base_cost: float) -> float:
    """Fall of the cost by one straight step on all blocks."""
    s = scored.fit.statistics
    hessian, gradient = s.normal(np.ones(s.owner.size, dtype=np.bool_))
    step = np.linalg.solve(hessian + np.diag(s.prior), gradient + s.pull)
    left = float(s.cost.sum() - 2.0 * gradient @ step + step @ hessian @ step)
    return base_cost - left


def _near(
    evaluator: Evaluator, base: Fit, terms: Sequence[Term], layout: FitLayout, scales: Floats
) -> Fit:
    """The problem with the last term at its start; of several starts, each flight takes the one
    from which a step leaves it least."""
    flights = evaluator.problem.flights
    start = warm_start(terms, base, flights)
    near = linearise(evaluator, terms, layout, start, scales, known=base.jacobian)
    effect = terms[-1].effect
    if not effect.seeds:
        return near
    owner = near.statistics.owner
    chosen = start.copy()
    least = np.bincount(owner, held_out_cost(near.statistics), minlength=flights)
    names = columns_of(terms)[terms[-1].key]
    columns = layout.places[:, list(names.values())]
    for seed in effect.seeds:
        trial = start.copy()
        for k, name in enumerate(names):
            trial[columns[:, k]] = seed[name]
        other = linearise(evaluator, terms, layout, trial, scales, known=base.jacobian)
        left = np.bincount(owner, held_out_cost(other.statistics), minlength=flights)
        better = left < least
        chosen[columns[better]] = trial[columns[better]]
        least = np.minimum(least, left)
    return linearise(evaluator, terms, layout, chosen, scales, known=base.jacobian)


def _onset(
    evaluator: Evaluator, base: Fit, base_cost: float, scales: Floats, found: Onset, effect: Effect
) -> Scored:
    """The step found by the scan, fitted with everything accepted."""
    problem = evaluator.problem
    term = Term(effect=effect, rotor=found.rotor)
    terms = (*base.terms, term)
    start = warm_start(terms, base, problem.flights)
    layout = layout_of(terms, problem.flights)
    columns = columns_of(terms)[term.key]
    loss = layout.places[:, columns["loss"]]
    own = layout.parameters[columns["loss"]].per_flight
    start[loss] = 0.0
    start[loss[found.flight] if own else loss] = found.loss
    if "onset_clock" in columns:
        began = problem.flight_start_unix_s[found.flight] - problem.first_row_s[found.flight]
        start[layout.places[:, columns["onset_clock"]]] = began + found.time_s
    else:
        start[layout.places[:, columns["onset_time"]]] = found.time_s
    fit = fit_terms(evaluator, terms, scales=scales, start=start)
    cost = held_out_cost(fit.statistics)
    return Scored(term=term, fit=fit, held_out=cost, gain=base_cost - float(cost.sum()))


def _of_most_flights(gains: Floats, owner: NDArray[np.intp], term: Term) -> bool:
    """True when most flights gain, and all but the one that gains most do so together."""
    by_flight = np.bincount(owner, gains)
    if by_flight.size < 3 or term.effect.begins:
        return True
    most = np.count_nonzero(by_flight > 0) > by_flight.size / 2
    return bool(most and by_flight.sum() > by_flight.max())


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
                    loss if credible(kept, trial, evaluator.problem) else -np.inf,
                    trial,
                )
            )
        loss, best = min(trials, key=lambda pair: pair[0])
        if loss > LEAST_GAIN * cost:
            return fit
        fit = best
    return fit
