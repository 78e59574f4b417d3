"""Choose the next flight: the manoeuvre that best distinguishes two explanations.

An explanation is a set of effects, fitted to the rows flown so far. Over the rows of a manoeuvre
two explanations predict mode amplitudes m_A and m_B (in units of the noise), with

    d = m_A - m_B,  S = I + J_A C_A J_A' + J_B C_B J_B' + N N'

C is the covariance of each one's values given the rows flown, N the between-flight scatter and the
base model's error. Kullback-Leibler divergence: d' S^-1 d / 2 nats; a choice between the two by
these rows is right with probability Phi(sqrt(d' S^-1 d) / 2). S^-1 by Woodbury, so that only the
Gram matrix of the columns is needed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.linalg import block_diag
from scipy.special import ndtr, ndtri

from thrustmargin.models.effects import effects_for
from thrustmargin.models.effects.base import Effect, Parameter
from thrustmargin.models.effects.compose import fill_neutral
from thrustmargin.models.effects.thrust_effects import ROTOR_DEGRADATION
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.identification.answer.result import Identification
from thrustmargin.models.identification.certainty import SURE
from thrustmargin.models.identification.next_flight.manoeuvres import (
    FlownLimits,
    Manoeuvre,
    flown_track,
    lightest_manoeuvres,
    manoeuvres,
)
from thrustmargin.models.identification.rows.candidates import (
    Term,
    TrialEffect,
    candidate,
    derivatives,
    predicted_modes,
    slopes,
    unnamed_candidates,
)
from thrustmargin.models.identification.rows.modes import modes
from thrustmargin.models.identification.rows.problem import (
    BLOCK_SECONDS,
    Problem,
    RowsToFit,
    thin_rows,
)
from thrustmargin.models.identification.rows.row_fit import fit_rows, move_values
from thrustmargin.models.model.rotor_model import RotorModel, model_channels, table_of


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FittedExplanation:
    """Effects with values that all flights share, and the covariance of these values."""

    trials: tuple[TrialEffect, ...]
    covariance: Floats  # (P, P)

    @property
    def terms(self) -> tuple[Term, ...]:
        """Return the terms of the effects."""
        return tuple(one.candidate.term for one in self.trials)


def fitted_explanation(
    problem: Problem, terms: Sequence[Term], noise_rpm: Floats
) -> FittedExplanation:
    """Fit the effects `terms` to the rows of `problem`, with values shared by all flights.

    A step within a flight is replaced by its final state. `noise_rpm` (R,) is the standard
    deviation, by mode, of a mean over one second. The prior of each value is its usual size; the
    covariance (P, P) of the P values includes the between-flight variance of a fault-free aircraft.
    """
    rows = thin_rows(problem, problem.stride)
    fit = fit_rows(rows, [_shared_effect(term, rows) for term in terms])
    noise = noise_rpm / np.sqrt(float(np.sum(problem.durations)) / rows.measured_rpm.shape[0])
    every = [p for one in fit.trials for p in one.candidate.parameters]
    size = np.array([p.scale for p in every])
    values = np.concatenate([np.zeros(0), *(one.free_values for one in fit.trials)])
    own = scale_by_noise(fit.columns * size, noise)
    remaining = np.nan_to_num(
        rows.mode_amplitudes(rows.measured_rpm) - predicted_modes(rows, fit.trials)
    )
    pull = own.T @ scale_by_noise(remaining[:, :, None], noise)[:, 0]
    pull += (np.array([_absent_value(p) for p in every]) - values) / size
    step = np.asarray(np.linalg.solve(own.T @ own + np.eye(size.size), pull), dtype=np.float64)
    most_probable = move_values(fit.trials, size * step)
    whole = np.hstack([own, scale_by_noise(scatter_columns(rows, problem.background_rpm), noise)])
    inverse = np.linalg.inv(whole.T @ whole + np.eye(whole.shape[1]))[: size.size, : size.size]
    of_values: Floats = np.asarray(inverse, dtype=np.float64) * np.outer(size, size)
    return FittedExplanation(
        trials=tuple(replace(one, values=one.values[:1]) for one in most_probable),
        covariance=of_values,
    )


def scale_by_noise(columns: Floats, noise_rpm: Floats) -> Floats:
    """Return columns (T, R, K), rpm in modes, as (T R, K) in units of the noise (R,) of a row."""
    rows, modes, count = columns.shape
    return (columns / noise_rpm[:, None]).reshape(rows * modes, count)


def scatter_columns(rows: RowsToFit, background_rpm: Floats | float) -> Floats:
    """Return columns (T, R, N), modal, rpm, each one standard deviation of a between-flight
    difference.

    They are the mean of each mode, by `background_rpm` (R,) or one for all, and each effect's main
    values, by their scatter between the model's training flights, or else the usual scatter.
    """
    shape = rows.measured_rpm.shape
    means = np.diag(np.broadcast_to(background_rpm, shape[1:]))
    columns = [np.broadcast_to(means, (*shape, shape[1]))]
    good = rows.model.good_flights
    shown = good.scatter if good is not None else {}
    for effect in effects_for(rows.model.airframe):
        if effect.begins or effect.of_one_arm:
            continue
        own = [shown.get(f"{effect.key}.{p.name}", p.smallest) for p in effect.parameters]
        moving = [k for k, size in enumerate(own) if size > 0.0]
        absent = np.array([[_absent_value(p) for p in effect.parameters]] * rows.flights)
        for rotor in range(shape[1]) if effect.of_one_rotor else (None,):
            one = candidate(Term(effect=effect, rotor=rotor), rows.flights)
            by_value = slopes(rows, [TrialEffect(candidate=one, values=absent)], 0, moving)
            columns.append(by_value * np.array(own)[moving])
    return np.nan_to_num(np.concatenate(columns, axis=2))


def second_noise_rpm(problem: Problem, residual_rpm: Floats) -> Floats:
    """Return the standard deviation (R,), rpm, of a mean over one second, by mode.

    `residual_rpm` (T, R) is the residual after identification. Estimated from means over blocks of
    BLOCK_SECONDS about their flight's mean, so variation that lasts for seconds is included.
    """
    amplitudes = problem.mode_amplitudes(residual_rpm)
    count = np.bincount(problem.block).astype(float)[:, None]
    blocks = np.stack([np.bincount(problem.block, a) for a in amplitudes.T], axis=1) / count
    flights = np.bincount(problem.block_flight).astype(float)[:, None]
    means = np.stack([np.bincount(problem.block_flight, b) for b in blocks.T], axis=1) / flights
    deviations = blocks - means[problem.block_flight]
    free = max(1, blocks.shape[0] - means.shape[0])
    return np.sqrt(np.sum(deviations**2, axis=0) / free * BLOCK_SECONDS) + 1e-3


def _shared_effect(term: Term, rows: RowsToFit) -> TrialEffect:
    """Return a term, a step as its state afterwards, with values shared by all flights."""
    lasting = Term(effect=term.effect.afterwards or term.effect, rotor=term.rotor)
    free = tuple((k, None) for k in range(len(lasting.effect.parameters)))
    one = replace(candidate(lasting, rows.flights), free=free)
    if one.unnamed:  # its curve covers the range of its channel in these flights
        one = next(known for known in unnamed_candidates(rows) if known.key == term.key)
    return one.initial_effect


def _absent_value(parameter: Parameter) -> float:
    """Return a parameter's absent value, or its start if it has none."""
    return parameter.start if parameter.absent is None else parameter.absent


Terms = tuple[Term, ...]

CHANCE = 0.6  # probability of a right choice, at or below which no manoeuvre is recommended
ROW_S = 0.2  # s between rows of a manoeuvre


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NextFlight:
    """The flight recommended next, and how well it would distinguish two explanations."""

    separates: tuple[Terms, Terms]
    manoeuvre: Manoeuvre
    repeats: int  # of the manoeuvre in the flight at each fill
    nats: float  # expected Kullback-Leibler divergence of all repeats at all fills
    #: probability of a right choice between the explanations from this flight alone
    certainty: float

    @property
    def minutes(self) -> float:
        """Return the duration of all repeats at all fills, without take-off and landing."""
        return self.repeats * self.manoeuvre.minutes


def plan_next_flight(
    identified: Identification, tracks: Sequence[FlightTrack]
) -> NextFlight | None:
    """Choose the next flight after an identification; `tracks` are its flights.

    None if no two explanations remain, or no manoeuvre would distinguish them with a probability
    above CHANCE.
    """
    pair = explanations_of(identified)
    if pair is None:
        return None
    noise = second_noise_rpm(identified.problem, identified.residual_after_rpm)
    try:
        limits = FlownLimits.from_tracks(tracks)
    except DataError:
        return None
    best = next_flight(
        identified.model,
        (
            fitted_explanation(identified.problem, pair[0], noise),
            fitted_explanation(identified.problem, pair[1], noise),
        ),
        limits=limits,
        noise_rpm=noise,
        background_rpm=identified.problem.background_rpm,
        of_outputs=identified.problem.of_outputs,
    )
    return best if best.certainty > CHANCE else None


def explanations_of(identified: Identification) -> tuple[Terms, Terms] | None:
    """Return the two most probable explanations that an identification could not distinguish.

    In order of preference: two effects of a "one of", two sets of effects, a rotor that is not
    cleared. None if nothing is left open.
    """
    named = tuple(f.term for f in identified.found)
    for one in identified.one_of:
        likely = sorted(zip(one.probabilities, one.terms, strict=True), key=lambda pair: -pair[0])
        first, second = (term for _, term in likely[:2])
        rest = tuple(t for t in named if t.key not in (first.key, second.key))
        return (*rest, first), (*rest, second)
    if len(identified.alternatives) > 1 and identified.alternatives[0].probability < SURE:
        return identified.alternatives[0].terms, identified.alternatives[1].terms
    for rotor in sorted(identified.mentioned, key=lambda one: -one.probability):
        return named, (*named, Term(effect=ROTOR_DEGRADATION, rotor=rotor.rotor))
    return None


def next_flight(
    model: RotorModel,
    explanations: tuple[FittedExplanation, FittedExplanation],
    *,
    limits: FlownLimits,
    noise_rpm: Floats,
    background_rpm: Floats | float = 0.0,
    of_outputs: bool = False,
) -> NextFlight:
    """Return the shortest flight that distinguishes two explanations, else the most efficient one.

    If an explanation has a bad rotor, only manoeuvres with the least fill are used. `noise_rpm`
    (R,) is the noise, by mode, of a mean over one second; `background_rpm` (R,) that of a flight's
    mean. With `of_outputs` rotor speeds are from motor outputs, so only each rotor's share counts.
    """

    @cache
    def flown_at(name: str, fill_kg: float) -> _FlownManoeuvre:
        """Predict both explanations over a manoeuvre at one fill."""
        track = flown_track(library[name], model, limits, fill_kg)
        return _fly_once(model, explanations, track, noise_rpm, background_rpm, of_outputs)

    every = manoeuvres(limits)
    if any(t.rotor is not None for one in explanations for t in one.terms):
        every = lightest_manoeuvres(every)
    library = {manoeuvre.name: manoeuvre for manoeuvre in every}
    proposals: list[NextFlight] = []
    for manoeuvre in every:
        gram = _gram([flown_at(manoeuvre.name, fill) for fill in manoeuvre.fills_kg])
        most = max(1, int(limits.minutes * len(manoeuvre.fills_kg) / manoeuvre.minutes))
        for repeats in range(1, most + 1):
            square = _distance_square(gram, repeats)
            if math.sqrt(square) / 2.0 >= ndtri(SURE):
                break
        proposals.append(
            NextFlight(
                separates=(explanations[0].terms, explanations[1].terms),
                manoeuvre=manoeuvre,
                repeats=repeats,
                nats=square / 2.0,
                certainty=float(ndtr(math.sqrt(square) / 2.0)),
            )
        )
    return max(proposals, key=_preference)


def _preference(proposal: NextFlight) -> tuple[bool, float]:
    """Return the sort key (larger is better): flights that distinguish first, the shortest best.

    Others rank by information, nats a minute.
    """
    distinguished = proposal.certainty >= SURE
    return distinguished, -proposal.minutes if distinguished else proposal.nats / proposal.minutes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _FlownManoeuvre:
    """A manoeuvre at one fill, N rows of all modes: columns of S, and d."""

    shared: Floats  # (N, P) uncertainty of the explanations' values, shared by all fills
    scatter: Floats  # (N, K) between-flight scatter, separate for each fill
    difference: Floats  # (N,)


def _fly_once(
    model: RotorModel,
    explanations: tuple[FittedExplanation, FittedExplanation],
    track: FlightTrack,
    noise_rpm: Floats,
    background_rpm: Floats | float,
    of_outputs: bool,
) -> _FlownManoeuvre:
    """Predict the difference of two explanations over a simulated track, and its uncertainty.

    All are divided by the noise; arguments are as in `next_flight`. The uncertainty is in columns,
    each one standard deviation: of the explanations' values, and of what differs between flights.
    """
    rows = rows_of(model, track, [t.effect for one in explanations for t in one.terms], of_outputs)
    noise = noise_rpm / np.sqrt(ROW_S)
    ours, theirs = (np.nan_to_num(predicted_modes(rows, one.trials)) for one in explanations)
    columns = [
        np.nan_to_num(derivatives(rows, one.trials, k))
        for one in explanations
        for k in range(len(one.trials))
    ]
    open_ = np.concatenate([np.zeros((*ours.shape, 0)), *columns], axis=2)
    covariance = np.asarray(block_diag(*(one.covariance for one in explanations)))
    return _FlownManoeuvre(
        shared=scale_by_noise(open_, noise) @ _covariance_root(covariance),
        scatter=scale_by_noise(scatter_columns(rows, background_rpm), noise),
        difference=scale_by_noise((ours - theirs)[:, :, None], noise)[:, 0],
    )


def rows_of(
    model: RotorModel, track: FlightTrack, effects: Sequence[Effect], of_outputs: bool
) -> RowsToFit:
    """Return rows of a track, ROW_S seconds apart, with the model's own prediction as rotor speeds.

    The channels include those that the effects of the model, of its airframe and `effects` need.
    With `of_outputs` the rows count as of motor outputs, of which only shares are used.
    """
    used = [*(p.effect for p in model.placed), *effects_for(model.airframe), *effects]
    every = round(ROW_S / (track.time_s[1] - track.time_s[0]))
    which = np.arange(0, track.time_s.size, every)
    x = model_channels(model, track, effects=used).rows(which)
    for item in model.placed:
        x = fill_neutral(item.effect, item.values, x)
    rows = RowsToFit(
        model=model,
        base=table_of(model),
        modes=modes(model.airframe),
        channels=x,
        measured_rpm=np.zeros((which.size, model.airframe.rotor_count)),
        flight=np.zeros(which.size, dtype=np.intp),
        follows=which > 0,
        names=(track.name,),
        of_outputs=False,
    )
    return replace(rows, measured_rpm=rows.speeds(), of_outputs=of_outputs)


def _gram(flown: Sequence[_FlownManoeuvre]) -> Floats:
    """Return the Gram matrix of uncertainty columns and, last, the difference of two explanations.

    The rows are those of a manoeuvre flown once at each fill, one element of `flown` a fill.
    Uncertainty between flights has columns of its own in each.
    """
    table = np.column_stack(
        [
            np.concatenate([one.shared for one in flown]),
            np.asarray(block_diag(*(one.scatter for one in flown))),
            np.concatenate([one.difference for one in flown]),
        ]
    )
    return table.T @ table


def _distance_square(gram: Floats, repeats: int) -> float:
    """Return d' S^-1 d, the squared distance of two explanations in standard deviations.

    The rows of `gram` occur `repeats` times. `gram` has columns of one prior standard deviation
    each, which make up S with the unit noise, and, last, the difference d.
    """
    whole = repeats * gram
    inner, gradient = whole[:-1, :-1], whole[:-1, -1]
    explained = gradient @ np.linalg.solve(np.eye(inner.shape[0]) + inner, gradient)
    return float(max(0.0, whole[-1, -1] - explained))


def _covariance_root(covariance: Floats) -> Floats:
    """Return a matrix root A of a covariance A A', negative eigenvalues set to 0."""
    sizes, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(sizes, 0.0))
