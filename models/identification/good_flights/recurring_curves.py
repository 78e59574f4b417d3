"""Learn what good flights repeat along each channel, so that `identify` accuses nobody of it.

In `identify` unnamed causes compete: curves of a mode along a channel (`effects.unnamed`). A curve
that good flights repeat is an error of the model and no fault, but `identify` would report it of
every later flight. So the curves of all modes along all channels are fitted to good flights
together, on top of the standard effects; one curve alone would only move the error to another
channel. The least needed curve is dropped first, until each of the others improves the prediction
of held-out flights by more than the standard error of the gain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.special import stdtrit

from thrustmargin.models.effects.compose import EffectRecord, Identified
from thrustmargin.models.effects.unnamed import CONSTANT, MODES, UNNAMED, place_of
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.identification.certainty import SURE
from thrustmargin.models.identification.good_flights.standard_effects import gain_and_error
from thrustmargin.models.identification.rows.candidates import (
    Candidate,
    Term,
    candidate,
    curve_candidate,
    curve_ranges,
    derivatives,
)
from thrustmargin.models.identification.rows.noise import unfiltered_whitening
from thrustmargin.models.identification.rows.problem import Problem, assemble, thin_rows
from thrustmargin.models.identification.rows.row_fit import RIDGE, RowSums, half_widths
from thrustmargin.models.model.rotor_model import RotorModel


def with_recurring_curves(
    model: RotorModel, tracks: Sequence[FlightTrack], *, date: str = ""
) -> RotorModel:
    """Return the model with curves added along channels that its residual shows in all flights.

    A curve is added if held-out flights are predicted better with it. Unchanged for motor outputs,
    which show no curve, and for a single flight, which cannot show that one recurs. `date` is
    stored with the curves. Raise DataError when a flight has too few rows to fit.
    """
    problem = assemble(model, tracks)
    if problem.of_outputs or problem.flights < 2:
        return model
    curves = mode_curves(problem)
    records = []
    for mode, sums in enumerate(curve_sums(problem, curves)):
        own = [one for one in curves if MODES.index(place_of(one.term.effect)[0]) == mode]
        records += _records(problem, own, sums, date)
    return replace(model, effects=(*model.effects, *records))


def mode_curves(problem: Problem) -> list[Candidate]:
    """Return the candidate curves: each mode along each varying channel, and its constant.

    All modes have the same channels, in the same order. A channel's range is the whole range of the
    flights, because beyond it the model's interval doubles.
    """
    ranges, curves = curve_ranges(problem, (0.0, 1.0)), []
    for mode in MODES[: problem.measured_rpm.shape[1]]:
        curves.append(candidate(Term(effect=UNNAMED[mode, CONSTANT]), problem.flights))
        curves += [
            curve_candidate(problem, Term(effect=UNNAMED[mode, name]), ends)
            for name, ends in ranges.items()
        ]
    return curves


def curve_sums(problem: Problem, curves: Sequence[Candidate]) -> list[RowSums]:
    """Return for each mode the products of its curve columns and its residual, whitened, summed by
    flight, of rows thinned by the problem's stride.

    A column is the derivative of rotor speed by one value of a curve; the residual is last. A curve
    also acts a little in other modes (a share of thrust of unequal rotors); that is neglected here,
    and cross-validation of the model includes it.
    """
    some = thin_rows(problem, problem.stride)
    residual = np.nan_to_num(some.mode_amplitudes(some.measured_rpm - some.speeds()))
    modes = residual.shape[1]
    columns: list[list[Floats]] = [[] for _ in range(modes)]
    for one in curves:
        mode = MODES.index(place_of(one.term.effect)[0])
        change = derivatives(some, [one.initial_effect], 0)
        columns[mode].append(np.nan_to_num(change[:, mode, :]))
    filter_ = unfiltered_whitening(residual, some.flight, some.of_outputs)
    own = np.stack([np.concatenate(of_mode, axis=1) for of_mode in columns[: len(MODES)]], axis=1)
    whole = np.zeros((*residual.shape, own.shape[2] + 1))
    whole[:, : own.shape[1], :-1] = own
    whole[:, :, -1] = residual
    z = filter_.apply(whole)
    values, scale = own.shape[2], curves[0].parameters[0].scale
    return [
        RowSums(
            sums=np.stack(
                [
                    z[some.flight == f, mode].T @ z[some.flight == f, mode]
                    for f in range(some.flights)
                ]
            ),
            owner=np.arange(some.flights),
            prior=np.full(values, RIDGE * residual.shape[0] / scale**2),
            pull=np.zeros(values),
            flights=some.flights,
        )
        for mode in range(own.shape[1])
    ]


def needed_curves(sums: RowSums, places: Sequence[slice]) -> tuple[int, ...]:
    """Return the indices of the curves without which held-out flights are predicted significantly
    worse.

    By backward elimination: the curve that helps least is dropped first. `places` are the indices
    of each curve's values in `sums`.
    """
    kept = tuple(range(len(places)))
    while kept:
        whole = _only(sums, places, kept).held_out_costs()
        gains = []
        for one in kept:
            rest = tuple(c for c in kept if c != one)
            gain, error = gain_and_error(_only(sums, places, rest).held_out_costs(), whole)
            gains.append((gain - stdtrit(sums.flights - 1, SURE) * error, rest))
        least, rest = min(gains, key=lambda pair: pair[0])
        if least > 0.0:
            break
        kept = rest
    return kept


def _only(sums: RowSums, places: Sequence[slice], kept: Sequence[int]) -> RowSums:
    """Return the sums with the values of the curves `kept` free, and all others zero."""
    free = [k for c in kept for k in range(places[c].start, places[c].stop)]
    return sums.fix_values(free, np.zeros(sums.prior.size))


def _records(
    problem: Problem, curves: Sequence[Candidate], sums: RowSums, date: str
) -> list[EffectRecord]:
    """Return the records of those `curves` of one mode that are needed, with 95 % intervals.

    `sums` are that mode's of `curve_sums`; `date` is the date of identification. Empty if none is
    needed.
    """
    ends = np.cumsum([0, *(len(one.free) for one in curves)]).tolist()
    places = [slice(a, b) for a, b in pairwise(ends)]
    kept = needed_curves(sums, places)
    if not kept:
        return []
    chosen = _only(sums, places, kept)
    solved = chosen.move(chosen.by_flight().sum(axis=0))
    half = half_widths(chosen.fix_values(range(solved.size), solved), np.zeros((solved.size, 0)))[0]
    records, first = [], 0
    for c in kept:
        one, effect = curves[c], curves[c].term.effect
        values, errors = one.start[0].copy(), np.zeros(one.start.shape[1])
        for k, (parameter, _) in enumerate(one.free):
            values[parameter], errors[parameter] = solved[first + k], half[first + k]
        first += len(one.free)
        limits = zip(effect.parameters, values.tolist(), errors.tolist(), strict=True)
        records.append(
            EffectRecord(
                name=effect.name,
                variant=effect.variant,
                rotor=None,
                parameters={
                    p.name: Identified(value=v, unit=p.unit, ci95=(v - e, v + e))
                    for p, v, e in limits
                },
                flights=problem.names,
                date=date,
            )
        )
    return records
