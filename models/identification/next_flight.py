"""The next flight: the manoeuvre that best tells two rival explanations of the flights apart.

Each rival is fitted to the flown rows. Over the rows of a manoeuvre the two then predict mode
amplitudes m_A and m_B (in units of the noise), with

    d = m_A - m_B,  S = I + J_A C_A J_A' + J_B C_B J_B' + N N'

C what the flown rows leave open of each rival's values, N how effects scatter from flight to flight
and by how much the base model is off. Kullback-Leibler divergence: d' S^-1 d / 2 nats; a choice
between the two by these rows is right with probability Phi(sqrt(d' S^-1 d) / 2).
S^-1 by Woodbury, so that only the Gram matrix of the columns is needed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from thrustmargin.models.effects import effects_for
from thrustmargin.models.effects.base import Parameter, Placed
from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.effects.compose import BaseTable, rotor_speed_rpm
from thrustmargin.models.effects.missing import tolerant
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.manoeuvres import (
    FlownLimits,
    Manoeuvre,
    flown_track,
    manoeuvres,
)
from thrustmargin.models.identification.modes import modes
from thrustmargin.models.identification.problem import BLOCK_SECONDS, Problem
from thrustmargin.models.identification.terms import Term
from thrustmargin.models.model.flown import model_channels, table_of
from thrustmargin.models.model.rotor_model import RotorModel

CERTAIN = 0.95  # probability of a right choice at which the rivals count as told apart
MOST_FITTED = 2000  # rows of the flown ones that a rival is fitted to
FIT_STEPS = 6  # of Gauss and Newton: effects are nearly linear in thrust
STEP = 0.05  # of a parameter's usual size, on both sides, for its derivative
ROW_S = 0.2  # between rows of a manoeuvre


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rival:
    """An explanation: effects with values, and the covariance of all values in their order."""

    terms: tuple[Term, ...]
    values: Floats  # (P,)
    covariance: Floats  # (P, P)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NextFlight:
    """What to fly next, and how well it would tell the rivals apart."""

    separates: tuple[tuple[Term, ...], tuple[Term, ...]]
    manoeuvre: Manoeuvre
    repeats: int  # of the manoeuvre, in the flight at each fill
    nats: float  # expected Kullback-Leibler divergence of it all
    certainty: float  # probability of a right choice by it alone

    @property
    def minutes(self) -> float:
        """All repeats at all fills, without take-off and landing."""
        return self.repeats * self.manoeuvre.minutes


def next_flight(
    model: RotorModel,
    rivals: tuple[Rival, Rival],
    *,
    limits: FlownLimits,
    noise_rpm: Floats,
    background_rpm: Floats | float = 0.0,
) -> NextFlight | None:
    """The shortest flight that tells two rivals apart, else the one that tells most.

    `noise_rpm` (R,) is that of a mean over one second, of each mode; `background_rpm` (R,) that of
    a flight's mean. None when no manoeuvre can be predicted.
    """
    best: NextFlight | None = None
    for manoeuvre in manoeuvres(limits):
        gram = _information(model, rivals, manoeuvre, limits, noise_rpm, background_rpm)
        if gram is None:
            continue
        most = max(1, int(limits.minutes * len(manoeuvre.fills_kg) / manoeuvre.minutes))
        for repeats in range(1, most + 1):
            square = _distance_square(gram, repeats)
            if square >= _CERTAIN_SQUARE:
                break
        made = NextFlight(
            separates=(rivals[0].terms, rivals[1].terms),
            manoeuvre=manoeuvre,
            repeats=repeats,
            nats=square / 2.0,
            certainty=_normal(math.sqrt(square) / 2.0),
        )
        if best is None or _preference(made) > _preference(best):
            best = made
    return best


def fitted_rival(problem: Problem, terms: Sequence[Term], noise_rpm: Floats) -> Rival:
    """The terms with the values at which they explain the flown rows best (Gauss-Newton).

    Values are alike in all flights, with the parameters' usual sizes as prior; the covariance has
    the scatter of a sound aircraft in it. A step within a flight counts as it is afterwards.
    """
    terms = tuple(_lasting(term) for term in terms)
    stride = -(-problem.measured_rpm.shape[0] // MOST_FITTED)
    rows = np.arange(0, problem.measured_rpm.shape[0], stride)
    x = problem.channels.rows(rows)
    seconds = float(np.sum(problem.durations)) / rows.size
    predict = _Prediction.of(problem.model, problem.base, x, noise_rpm / np.sqrt(seconds))
    wanted = problem.measured_rpm[rows] @ predict.directions
    parameters = _parameters(terms)
    prior = np.array([_absent(p) for p in parameters])
    size = np.array([p.scale for p in parameters])
    low, high = (np.array([getattr(p, end) for p in parameters]) for end in ("lower", "upper"))
    values: Floats = np.array([p.start for p in parameters], dtype=np.float64)
    for _ in range(FIT_STEPS):
        columns = predict.columns(terms, values) * size
        left = (wanted - predict.modes(terms, values)).ravel()
        pull = columns.T @ left + (prior - values) / size
        step = np.linalg.solve(columns.T @ columns + np.eye(size.size), pull) * size
        values = np.minimum(np.maximum(values + step, low), high)
    columns = predict.columns(terms, values) * size
    columns = np.concatenate([columns, predict.scatter(problem.background_rpm)], axis=1)
    gram = columns.T @ columns + np.eye(columns.shape[1])
    inverse: Floats = np.asarray(np.linalg.inv(gram)[: size.size, : size.size], dtype=np.float64)
    return Rival(terms=terms, values=values, covariance=inverse * np.outer(size, size))


def second_noise_rpm(problem: Problem, residual_rpm: Floats) -> Floats:
    """(R,) rpm: noise of a mean over one second in each mode, from means over blocks of time.

    `residual_rpm` (T, R) is what the effects found leave on the rows of the problem. Means over
    BLOCK_SECONDS about that of their flight have what lasts for seconds in them.
    """
    amplitudes = residual_rpm @ problem.modes.directions
    count = np.bincount(problem.block).astype(float)[:, None]
    blocks = np.stack([np.bincount(problem.block, a) for a in amplitudes.T], axis=1) / count
    flights = np.bincount(problem.block_flight).astype(float)[:, None]
    means = np.stack([np.bincount(problem.block_flight, b) for b in blocks.T], axis=1) / flights
    about = blocks - means[problem.block_flight]
    free = max(1, blocks.shape[0] - means.shape[0])
    return np.sqrt(np.sum(about**2, axis=0) / free * BLOCK_SECONDS) + 1e-3


def _normal(z: float) -> float:
    return 0.5 * (1.0 + math.erf(z / math.sqrt(2.0)))


#: (2 x 1.645)²: squared distance at which a choice is right with probability CERTAIN.
_CERTAIN_SQUARE = 10.82


def _preference(made: NextFlight) -> tuple[bool, float]:
    told = made.certainty >= CERTAIN
    return told, -made.minutes if told else made.nats / made.minutes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Prediction:
    """Mode amplitudes of T rows with effects in place, in units of the noise of a row."""

    speed: Callable[[Sequence[Placed]], Floats]
    directions: Floats  # (R, R) modes over the noise
    model: RotorModel
    channels: Channels

    @classmethod
    def of(cls, model: RotorModel, base: BaseTable, x: Channels, row_noise_rpm: Floats):
        """`row_noise_rpm` (R,) is that of one row in each mode."""

        def speed(placed: Sequence[Placed]) -> Floats:
            every = [tolerant(item) for item in (*model.placed, *placed)]
            with np.errstate(invalid="ignore"):
                return np.nan_to_num(rotor_speed_rpm(base, every, x, np))

        directions = modes(model.airframe).directions / row_noise_rpm
        return cls(speed=speed, directions=directions, model=model, channels=x)

    def modes(self, terms: Sequence[Term], values: Floats) -> Floats:
        """(T, R) with the terms' parameters (P,) in their order."""
        placed, k = [], 0
        for term in terms:
            own = {p.name: values[k + i] for i, p in enumerate(term.effect.parameters)}
            placed.append(Placed(effect=term.effect, values=own, rotor=term.rotor))
            k += len(own)
        return self.speed(placed) @ self.directions

    def columns(self, terms: Sequence[Term], values: Floats) -> Floats:
        """(T R, P) derivatives by the values: central differences."""
        steps = STEP * np.array([p.scale for p in _parameters(terms)])
        return np.stack(
            [
                (self.modes(terms, values + step) - self.modes(terms, values - step)).ravel()
                / (2.0 * step[k])
                for k, step in enumerate(np.diag(steps))
            ],
            axis=1,
        )

    def scatter(self, background_rpm: Floats | float) -> Floats:
        """(T R, N) by which a sound aircraft's flight may be off: one deviation a column.

        Each mode's mean, and every effect by its usual scatter from flight to flight.
        """
        rows, rotors = self.channels.time_s.size, self.directions.shape[0]
        noise = 1.0 / np.linalg.norm(self.directions, axis=0)
        means = np.tile(np.diag(np.broadcast_to(background_rpm, rotors) / noise), (rows, 1))
        made = [means]
        for effect in effects_for(self.model.airframe):
            if effect.begins:
                continue
            for rotor in range(rotors) if effect.of_one_rotor else (None,):
                term = Term(effect=effect, rotor=rotor)
                absent = np.array([_absent(p) for p in effect.parameters])
                usual = np.array([p.smallest for p in effect.parameters])
                moving = usual > 0.0
                made.append((self.columns((term,), absent) * usual)[:, moving])
        return np.nan_to_num(np.concatenate(made, axis=1))


def _parameters(terms: Sequence[Term]) -> list[Parameter]:
    return [p for term in terms for p in term.effect.parameters]


def _absent(parameter: Parameter) -> float:
    return parameter.start if parameter.absent is None else parameter.absent


def _lasting(term: Term) -> Term:
    return Term(effect=term.effect.afterwards or term.effect, rotor=term.rotor)


def _information(
    model: RotorModel,
    rivals: tuple[Rival, Rival],
    manoeuvre: Manoeuvre,
    limits: FlownLimits,
    noise_rpm: Floats,
    background_rpm: Floats | float,
) -> Floats | None:
    """Gram matrix of the columns of S, with d last, of the manoeuvre flown once at each fill."""
    shared, apart, difference = [], [], []
    roots = [_root(rival.covariance) for rival in rivals]
    for fill_kg in manoeuvre.fills_kg:
        track = flown_track(manoeuvre, model, limits, fill_kg)
        used = [p.effect for p in model.placed]
        used += [*effects_for(model.airframe), *(t.effect for r in rivals for t in r.terms)]
        x = model_channels(model, track, effects=used)
        every = round(ROW_S / (track.time_s[1] - track.time_s[0]))
        x = x.rows(np.arange(0, track.time_s.size, every))
        predict = _Prediction.of(model, table_of(model), x, noise_rpm / np.sqrt(ROW_S))
        ours, theirs = (predict.modes(rival.terms, rival.values) for rival in rivals)
        if not np.any(ours):
            return None
        difference.append((ours - theirs).ravel())
        shared.append(
            np.concatenate(
                [
                    predict.columns(rival.terms, rival.values) @ root
                    for rival, root in zip(rivals, roots, strict=True)
                ],
                axis=1,
            )
        )
        apart.append(predict.scatter(background_rpm))
    width = apart[0].shape[1]
    columns = np.zeros((sum(d.size for d in difference), len(apart) * width))
    row = 0
    for k, own in enumerate(apart):
        columns[row : row + own.shape[0], k * width : (k + 1) * width] = own
        row += own.shape[0]
    table = np.column_stack([np.concatenate(shared), columns, np.concatenate(difference)])
    return table.T @ table


def _distance_square(gram: Floats, repeats: int) -> float:
    """d' S^-1 d when the rows come so many times, in the same flights."""
    whole = repeats * gram
    inner, along = whole[:-1, :-1], whole[:-1, -1]
    explained = along @ np.linalg.solve(np.eye(inner.shape[0]) + inner, along)
    return float(max(0.0, whole[-1, -1] - explained))


def _root(covariance: Floats) -> Floats:
    sizes, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(sizes, 0.0))
