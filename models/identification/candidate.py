"""A candidate effect: fitted with all accepted, scored on flights left out, believed or not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from thrustmargin.models.effects.base import Effect
from thrustmargin.models.flight import Floats
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
    term_values,
)
from thrustmargin.models.identification.problem import Problem
from thrustmargin.models.identification.terms import Term, columns_of, layout_of, starts
from thrustmargin.models.identification.unseen_errors import nearly_across_flights

LEAST_MOVE = 0.0008  # of rotor speed, RMS, below which an effect is not worth a name
MISSED = 0.05  # share of intervals that miss, shared among all candidates of a look


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scored:
    """A candidate fitted together with the accepted terms."""

    term: Term
    fit: Fit
    held_out: Floats  # (B,)
    gain: float  # fall of the summed held-out cost


def candidates(
    evaluator: Evaluator, accepted: Sequence[Term], catalogue: Sequence[Effect]
) -> Iterator[Term]:
    """Terms that could be added: channels reported, not in already."""
    taken = {t.key for t in accepted}
    begun = {t.rotor for t in accepted if t.effect.begins}
    rotors = evaluator.problem.measured_rpm.shape[1]
    for effect in catalogue:
        several = evaluator.problem.flights > 1 or not effect.by_flights
        if several and not evaluator.problem.lacks(effect):
            places = range(rotors) if effect.of_one_rotor else (None,)
            for rotor in places:
                term = Term(effect=effect, rotor=rotor)
                if term.key not in taken and not effect.begins and term.rotor not in begun:
                    yield term


def warm_start(terms: Sequence[Term], fit: Fit, flights: int) -> Floats:
    """Values of a fit carried over to a list of terms that may hold more, fewer or others."""
    layout = layout_of(terms, flights)
    values, known = starts(layout), columns_of(fit.terms)
    for key, columns in columns_of(terms).items():
        if key in known:
            before = fit.layout.places[:, list(known[key].values())]
            values[layout.places[:, list(columns.values())]] = fit.values[before]
    return values


def score(
    evaluator: Evaluator, base: Fit, base_cost: float, terms: Sequence[Term], term: Term, **given
) -> Scored:
    """Fit `terms` (which hold `term`) from where `base` stands, or from `start`, and score it."""
    start = given.pop("start", warm_start(terms, base, evaluator.problem.flights))
    fit = fit_terms(evaluator, terms, start=start, **given)
    cost = held_out_cost(fit.statistics)
    return Scored(term=term, fit=fit, held_out=cost, gain=base_cost - float(cost.sum()))


def cross_validated_rmse(evaluator: Evaluator, fit: Fit) -> float:
    """RMSE in rpm of every row under values found without its flight, the fit taken as straight."""
    return float(np.sqrt(np.mean(nearly_across_flights(evaluator.problem, fit) ** 2)))


def credible(
    scored: Scored,
    base: Fit | None = None,
    problem: Problem | None = None,
    interval: ParameterInterval | None = None,
    tries: float = 1.0,
) -> bool:
    """True when the effect is possible, its interval excludes absent, and it matters.

    With `problem` the interval holds what the base model may be off by, and an effect that has a
    weight must have it; of `tries` candidates each must be clear of absent so much surer.

    It matters when the parameter is as far from absent as is worth reporting and, given the `base`
    without it, when it moves the predicted rotor speeds by LEAST_MOVE of their size.
    """
    if interval is None:
        background = None if problem is None else background_of(problem, scored.fit)
        level = 1.0 - MISSED / tries
        interval = intervals(scored.fit, background, level, few=False)
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
            if scored.term.effect.begins and not _chips(value[:, k], p.per_flight):
                return False
            matters |= bool(np.any(clear & (np.abs(value[:, k] - p.absent) >= p.smallest)))
        elif p.smallest:
            asked = True
            matters |= bool(np.any(np.abs(value[:, k]) >= p.smallest))
    if asked and not matters:
        return False
    if problem is not None and not _weighty(problem, scored):
        return False
    if base is None:
        return True
    moved = np.sqrt(np.mean((scored.fit.prediction_rpm - base.prediction_rpm) ** 2))
    return bool(moved > LEAST_MOVE * np.mean(base.prediction_rpm))


def _chips(loss: Floats, per_flight: bool) -> bool:
    """True for losses (F,) that a damage in flight can make: none gives thrust, and where each
    flight has its own, it is not about as large in most of several flights."""
    size = np.abs(loss)
    largest = int(np.argmax(size))
    anew = np.sum(size > size[largest] / 2) > max(1, size.size / 2)
    return bool(loss[largest] > 0.0 and not (per_flight and anew))


def _weighty(problem: Problem, scored: Scored) -> bool:
    effect = scored.term.effect
    if effect.weight is None:
        return True
    rows = term_values(scored.fit, scored.term)[problem.flight]
    values = {p.name: rows[:, k] for k, p in enumerate(effect.parameters)}
    return bool(effect.weight(values, problem.channels, np) >= 1.0)
