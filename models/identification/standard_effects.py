"""What belongs to every aircraft, fitted to its good flights: no search, and nothing is named.

Moments of turning and of the flow, thrust of turns and gusts, drag and lift of forward flight
beyond what the base model has, inflow in climb, where the centre of gravity stands, the trim of
yaw, the density of the air and how late telemetry comes are part of every aircraft. All of them are
fitted together. An effect stays if flights left out in turn are predicted better with it, by more
than the standard error of that gain; the least needed goes first. A gain is the logarithm of a
flight's cost without over that with, so that a flight with many sharp turns has no more to say than
a quiet one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from thrustmargin.models.effects import BY_KEY
from thrustmargin.models.effects.stored import EffectRecord, Identified
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.identification.cross_validation import held_out_cost, intervals
from thrustmargin.models.identification.fit import (
    Evaluator,
    Fit,
    Statistics,
    background_of,
    fit_terms,
    mode_scales,
    term_values,
    warm_start,
)
from thrustmargin.models.identification.output_shares import effects_on_shares
from thrustmargin.models.identification.problem import Problem, assemble
from thrustmargin.models.identification.terms import Term, columns_of, layout_of
from thrustmargin.models.model.rotor_model import RotorModel

STANDARD = (
    "sensor_lag",
    "sensor_lag:rotor speed",
    "parasite_drag",
    "load_factor",
    "cg_offset",
    "cg_offset:tank",
    "flow_moment",
    "drag_moment",
    "yaw_trim",
    "manoeuvre_moment",
    "air_density",
    "translational_lift",
    "climb_inflow",
)
#: Without a network the base follows the air of each row (Eq. 6), so its density is no choice.
BY_NATURE = "air_density"


def standard_effects(model: RotorModel, problem: Problem) -> list[Term]:
    """The effects of STANDARD for which every row has its channels."""
    effects = [BY_KEY[key].scaled(model.airframe) for key in STANDARD]
    if problem.of_outputs:
        effects = list(effects_on_shares(effects))
    possible = [e for e in effects if e.possible_on(model.airframe) and not problem.lacks(e)]
    return [Term(effect=e) for e in possible]


def with_standard_effects(
    model: RotorModel, tracks: Sequence[FlightTrack], *, date: str = ""
) -> RotorModel:
    """The model with the standard effects that its flights show, fitted together on `tracks`.

    At least 2 flights. Raises DataError when one has too few rows to fit.
    """
    # How these flights differ shows in the fit itself: before it, wind and balance are in there.
    problem = replace(
        assemble(model, tracks),
        background_rpm=np.zeros(model.airframe.rotor_count),
        background_degrees=np.inf,
    )
    evaluator = Evaluator(problem)
    first = fit_terms(evaluator, (), scales=np.ones(model.airframe.rotor_count))
    fit = _fitted(evaluator, standard_effects(model, problem), first)
    if model.network is not None:
        fit = _without_density_if_unneeded(evaluator, fit)
    kept = _needed(fit)
    while kept != fit.terms:  # a value may shrink when those that opposed it are gone
        fit = _fitted(evaluator, kept, fit)
        kept = tuple(t for t in fit.terms if _of_note(fit, t))
    interval = intervals(fit, background_of(problem, fit))
    records = tuple(
        EffectRecord(
            name=term.effect.name,
            variant=term.effect.variant,
            rotor=None,
            parameters={
                p.name: Identified(value=float(v), unit=p.unit, ci95=(float(low), float(high)))
                for p, v, low, high in zip(
                    term.effect.parameters,
                    *(
                        term_values(fit, term, of)[0]
                        for of in (None, interval.lower, interval.upper)
                    ),
                    strict=True,
                )
            },
            flights=problem.names,
            date=date,
        )
        for term in fit.terms
    )
    return replace(model, effects=(*model.effects, *records))


def _fitted(evaluator: Evaluator, terms: Sequence[Term], near: Fit) -> Fit:
    """All terms together, once at the scales of what is left before and once after."""
    problem = evaluator.problem
    for _ in range(2):
        near = fit_terms(
            evaluator,
            tuple(terms),
            scales=mode_scales(problem, near.residual_rpm),
            start=warm_start(terms, near, problem.flights),
        )
    return near


def _without_density_if_unneeded(evaluator: Evaluator, fit: Fit) -> Fit:
    """The fit, without the density of the air if flights left out do not ask for it."""
    rest = tuple(t for t in fit.terms if t.effect.key != BY_NATURE)
    without = _fitted(evaluator, rest, fit)
    gain, error = gain_and_error(_costs(without.statistics), _costs(fit.statistics))
    return fit if gain > error else without


def _needed(fit: Fit) -> tuple[Term, ...]:
    """The terms that stay, by the sufficient statistics of the fit with all of them.

    An effect with a value at a bound is not what happens, one of less than its least worth naming
    is not worth a line: they go first.
    """
    kept = [t for t in fit.terms if _of_note(fit, t)]
    while True:
        whole = _costs(held_at_absent(fit, kept))
        gains = []
        for term in kept:
            if term.effect.key != BY_NATURE:
                rest = [t for t in kept if t != term]
                gain, error = gain_and_error(_costs(held_at_absent(fit, rest)), whole)
                gains.append((gain - error, rest))
        if not gains or min(gains, key=lambda g: g[0])[0] > 0.0:
            return tuple(kept)
        kept = min(gains, key=lambda g: g[0])[1]


def held_at_absent(fit: Fit, kept: Sequence[Term]) -> Statistics:
    """The statistics of a fit with the other terms' effect held at nothing, the rest free."""
    s, columns = fit.statistics, columns_of(fit.terms)
    free, move = [], np.zeros(len(fit.layout.parameters))
    for term in fit.terms:
        for parameter, k in zip(term.effect.parameters, columns[term.key].values(), strict=True):
            if term in kept:
                free.append(k)
            elif parameter.absent is not None:
                move[k] = parameter.absent - fit.values[fit.layout.places[0, k]]
    pushed = s.hessian @ move
    where = fit.layout.places[0, free]
    return replace(
        s,
        layout=layout_of(kept, fit.layout.places.shape[0]),
        hessian=s.hessian[:, free][:, :, free],
        gradient=(s.gradient - pushed)[:, free],
        cost=s.cost - 2.0 * s.gradient @ move + pushed @ move,
        prior=s.prior[where],
        pull=s.pull[where],
    )


def _of_note(fit: Fit, term: Term) -> bool:
    """True when all values that make the effect are inside their bounds and one is worth naming;
    always of an effect that is no choice."""
    if term.effect.key == BY_NATURE:
        return True
    pairs = zip(term.effect.parameters, term_values(fit, term)[0], strict=True)
    main = [(p, value) for p, value in pairs if not p.detail]
    return all(p.lower < value < p.upper for p, value in main) and any(
        abs(value - (p.absent or 0.0)) >= p.smallest for p, value in main
    )


def _costs(statistics: Statistics) -> Floats:
    """(F,) cost of each flight under values found without it."""
    return np.bincount(statistics.owner, held_out_cost(statistics)).astype(np.float64)


def gain_and_error(without: Floats, having: Floats) -> tuple[float, float]:
    """Mean over flights of log(cost without / cost with), and its standard error.

    Costs (F,) above 0 of at least 2 flights, the same in both.
    """
    gains = np.log(without / having)
    return float(gains.mean()), float(np.std(gains, ddof=1) / np.sqrt(gains.size))
