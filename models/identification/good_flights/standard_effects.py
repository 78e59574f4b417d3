"""Fit the effects that every aircraft has to its good flights, without a search.

Standard effects are moments of turning and flow, thrust in turns and gusts, drag and lift of
forward flight beyond the base model, inflow in climb, centre of gravity, yaw trim, air density and
the delay of telemetry. All are fitted together. An effect is kept if it improves the prediction of
held-out flights by more than the standard error of the gain; the least needed effect is dropped
first. A flight's gain is the logarithm of its cost without the effect over that with it, so that a
flight with many sharp turns does not count more than a quiet one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from thrustmargin.models.effects import BY_KEY
from thrustmargin.models.effects.compose import EffectRecord, Identified
from thrustmargin.models.effects.unnamed import CONSTANT, UNNAMED
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.identification.rows.candidates import (
    Candidate,
    Term,
    TrialEffect,
    candidate,
)
from thrustmargin.models.identification.rows.noise import base_uncertainty_rpm
from thrustmargin.models.identification.rows.output_shares import effects_on_shares
from thrustmargin.models.identification.rows.problem import Problem, assemble, thin_rows
from thrustmargin.models.identification.rows.row_fit import (
    RowFit,
    RowSums,
    fit_rows,
    half_widths,
    held_out_costs_with,
)
from thrustmargin.models.model.rotor_model import RotorModel

#: A delay is a property of telemetry, not of the aircraft: it is kept if it removes more than WORTH
#: of the squared error, by a fit without it: linearising from a delay to none is too inaccurate.
DELAYS = ("sensor_lag", "sensor_lag:rotor speed")
WORTH = 0.01  # of the squared error, that a delay must remove
ROWS_TO_BEGIN = 2_000  # of all flights: enough for start values and delays
AIR_DENSITY, LEVEL = "air_density", UNNAMED["collective", CONSTANT]
#: Without a network the base uses the air density of each row (Eq. 6), so it is always kept. Where
#: the air is not measured, a constant takes its place: without either, drag and thrust in turns are
#: fitted to the error of the thrust curve and end at their bounds.
ALWAYS_KEPT = (AIR_DENSITY, LEVEL.key)
STANDARD = (
    *DELAYS,
    AIR_DENSITY,
    *(key for key, effect in BY_KEY.items() if effect.of_every_aircraft),
)


def standard_effects(model: RotorModel, problem: Problem) -> list[Term]:
    """Return the effects of STANDARD that are possible on the airframe and have all channels.

    LEVEL is added to a model without a network if the flights lack the air's density.
    """
    effects = [BY_KEY[key].scaled(model.airframe) for key in STANDARD]
    if problem.of_outputs:
        effects = list(effects_on_shares(effects))
    possible = [e for e in effects if e.possible_on(model.airframe) and not problem.lacks(e)]
    if model.network is None and not problem.of_outputs and problem.lacks(BY_KEY[AIR_DENSITY]):
        possible.append(LEVEL)
    return [Term(effect=e) for e in possible]


def with_standard_effects(
    model: RotorModel, tracks: Sequence[FlightTrack], *, date: str = ""
) -> RotorModel:
    """Return the model with the standard effects that improve its prediction of the flights
    `tracks`.

    Standard effects are those that every aircraft has. They are fitted together to all flights (2
    or more), and kept if held-out flights are predicted better with them. `date` is stored with
    them. Raise DataError when a flight has too few rows to fit.
    """
    problem = assemble(model, tracks)
    uncertainty = problem.mode_amplitudes(
        base_uncertainty_rpm(model, problem.base, problem.channels)
    )
    known = np.sqrt(np.sum(uncertainty**2, axis=0).mean(axis=0))
    terms = standard_effects(model, problem)
    some = thin_rows(problem, max(1, problem.measured_rpm.shape[0] // ROWS_TO_BEGIN))
    fit = _fit_from_start(some, terms, known)
    for key in DELAYS:
        fit = _drop_if_unneeded(some, fit, key, known, worth=WORTH)
    if model.network is not None:
        fit = _drop_if_unneeded(some, fit, AIR_DENSITY, known)
    fit = fit_rows(problem, fit.trials, known_rpm=known)
    kept = _needed_effects(fit)
    while kept != fit.trials:  # a value may shrink once an opposing effect is dropped
        fit = fit_rows(problem, kept, known_rpm=known)
        kept = tuple(h for h in fit.trials if _is_worth_storing(h))
    half = iter(mode_half_widths(fit, uncertainty))
    records = []
    for trial in fit.trials:
        parameters = {}
        for p, value in zip(trial.candidate.parameters, trial.free_values, strict=True):
            width = next(half) + p.resolution + p.accuracy * abs(value)
            ci95 = (float(value - width), float(value + width))
            parameters[p.name] = Identified(value=float(value), unit=p.unit, ci95=ci95)
        effect = trial.candidate.term.effect
        records.append(
            EffectRecord(
                name=effect.name,
                variant=effect.variant,
                rotor=None,
                parameters=parameters,
                flights=problem.names,
                date=date,
            )
        )
    return replace(model, effects=(*model.effects, *records))


def _fit_from_start(problem: Problem, terms: Sequence[Term], known: Floats) -> RowFit:
    """Fit all terms together: first their main values, then their shapes too.

    `known` (R,) is the base model's standard error, rpm. A lag, a derivative correction and rotor
    inertia imitate each other in sharp turns; fitted at once from zero, they would converge to a
    wrong combination.
    """
    whole = [candidate(t, problem.flights) for t in terms]
    trials = [TrialEffect(candidate=_fix_shapes(one), values=one.start) for one in whole]
    first = fit_rows(problem, trials, known_rpm=known).trials
    from_there = [replace(h, candidate=one) for h, one in zip(first, whole, strict=True)]
    return fit_rows(problem, from_there, known_rpm=known)


def _fix_shapes(one: Candidate) -> Candidate:
    """Return the candidate with only its main values free."""
    parameters = one.term.effect.parameters
    return replace(
        one, free=tuple(free for free in one.free if parameters[free[0]].absent is not None)
    )


def mode_half_widths(fit: RowFit, uncertainty: Floats) -> Floats:
    """Return the half widths (P,) of the 95 % intervals of a fit's P values.

    `uncertainty` (D, T, R), modal, rpm, holds D independent errors of the base model, whose
    influence is added. Between-flight variation is in the fit's block sums already.
    """
    z = fit.filter.apply(np.concatenate([fit.columns, np.moveaxis(uncertainty, 0, 2)], axis=2))
    count = fit.columns.shape[2]
    shared = np.einsum("trp,trk->pk", z[:, :, :count], z[:, :, count:])
    return half_widths(fit.sums, shared)[0]


def _drop_if_unneeded(
    problem: Problem, fit: RowFit, key: str, known: Floats, *, worth: float = 0.0
) -> RowFit:
    """Return the fit without the effect `key` if held-out flights do not need it; else `fit`
    itself.

    The effect is needed if it lowers the held-out cost by more than the gain's standard error and
    by more than `worth`. `known` (R,) is the base model's standard error by mode, rpm.
    """
    rest = [h for h in fit.trials if h.candidate.key != key]
    if len(rest) == len(fit.trials):
        return fit
    without = fit_rows(problem, rest, known_rpm=known)
    costs = held_out_costs_with(problem, without, fit.filter)
    gain, error = gain_and_error(costs, fit.sums.held_out_costs())
    return fit if gain > max(error, worth) else without


def _needed_effects(fit: RowFit) -> tuple[TrialEffect, ...]:
    """Return the effects to keep, by backward elimination on the sums of the full fit.

    Effects at a bound or below their least reportable size are dropped first.
    """
    kept = tuple(h for h in fit.trials if _is_worth_storing(h))
    while True:
        whole = sums_without_effects(fit, kept).held_out_costs()
        gains = []
        for one in kept:
            if one.candidate.key not in (*ALWAYS_KEPT, *DELAYS):
                rest = tuple(h for h in kept if h is not one)
                gain, error = gain_and_error(
                    sums_without_effects(fit, rest).held_out_costs(), whole
                )
                gains.append((gain - error, rest))
        if not gains or min(gains, key=lambda g: g[0])[0] > 0.0:
            return kept
        kept = min(gains, key=lambda g: g[0])[1]


def sums_without_effects(fit: RowFit, kept: Sequence[TrialEffect]) -> RowSums:
    """Return a fit's sums with effects outside `kept` fixed at the values without influence.

    A value that has no such value is fixed where it is. The values of effects in `kept` stay free.
    `kept` must contain objects of `fit.trials`.
    """
    free, move = [], []
    for trial in fit.trials:
        for p, value in zip(trial.candidate.parameters, trial.free_values, strict=True):
            stays = any(trial is h for h in kept)
            if stays:
                free.append(len(move))
            move.append(0.0 if stays or p.absent is None else p.absent - value)
    return fit.sums.fix_values(free, np.array(move))


def _is_worth_storing(trial: TrialEffect) -> bool:
    """Return True if an effect's main values are all within bounds, and one of them is large
    enough.

    Large enough is at least `smallest` from the value at which the effect is absent. Always True
    for the effect ALWAYS_KEPT.
    """
    if trial.candidate.key in ALWAYS_KEPT:
        return True
    pairs = zip(trial.candidate.parameters, trial.free_values, strict=True)
    main = [(p, value) for p, value in pairs if not p.detail]
    return all(p.lower < value < p.upper for p, value in main) and any(
        abs(value - (p.absent or 0.0)) >= p.smallest for p, value in main
    )


def gain_and_error(without: Floats, having: Floats) -> tuple[float, float]:
    """Return mean and standard error over flights of log(cost without / cost with).

    Costs (F,) are positive, of at least 2 flights, in the same order.
    """
    gains = np.log(without / having)
    return float(gains.mean()), float(np.std(gains, ddof=1) / np.sqrt(gains.size))
