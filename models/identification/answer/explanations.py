"""Explanations of the same flights: sets of effects, each fitted to the flown rows.

Works in mode amplitudes over the noise of a row, with derivatives by central differences.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from thrustmargin.models.effects import effects_for
from thrustmargin.models.effects.base import Parameter, Placed
from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.effects.compose import BaseTable, rotor_speed_rpm, tolerant
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.rows.candidates import Term
from thrustmargin.models.identification.rows.modes import modes
from thrustmargin.models.identification.rows.problem import BLOCK_SECONDS, Problem
from thrustmargin.models.model.rotor_model import RotorModel

MOST_FITTED = 2000  # rows of the flown ones that an explanation is fitted to
FIT_STEPS = 6  # of Gauss and Newton: effects are nearly linear in thrust
STEP = 0.05  # of a parameter's usual size, on both sides, for its derivative


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Explanation:
    """An explanation: effects with values, and the covariance of all values in their order."""

    terms: tuple[Term, ...]
    values: Floats  # (P,)
    covariance: Floats  # (P, P)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModePrediction:
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
                return np.nan_to_num(rotor_speed_rpm(base, every, x))

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

    def columns(
        self, terms: Sequence[Term], values: Floats, along: Sequence[int] | None = None
    ) -> Floats:
        """(T R, P) derivatives by the values, or by those `along`: central differences."""
        parameters = _parameters(terms)
        made = [np.empty((self.channels.time_s.size * self.directions.shape[0], 0))]
        for k in range(len(parameters)) if along is None else along:
            step = np.zeros(values.size)
            step[k] = STEP * parameters[k].scale
            ends = [self.modes(terms, values + side * step).ravel() for side in (1.0, -1.0)]
            made.append(((ends[0] - ends[1]) / (2.0 * step[k]))[:, None])
        return np.concatenate(made, axis=1)

    def scatter(self, background_rpm: Floats | float) -> Floats:
        """(T R, N) by which a sound aircraft's flight may be off: one deviation a column.

        Each mode's mean, and every effect by its scatter from flight to flight, as the model file
        has it from good flights, else the usual one.
        """
        rows, rotors = self.channels.time_s.size, self.directions.shape[0]
        noise = 1.0 / np.linalg.norm(self.directions, axis=0)
        means = np.tile(np.diag(np.broadcast_to(background_rpm, rotors) / noise), (rows, 1))
        made = [means]
        good = self.model.good_flights
        shown = good.scatter if good is not None else {}
        for effect in effects_for(self.model.airframe):
            if effect.begins:
                continue
            own = [shown.get(f"{effect.key}.{p.name}", p.smallest) for p in effect.parameters]
            moving = [k for k, size in enumerate(own) if size > 0.0]
            absent = np.array([_absent(p) for p in effect.parameters])
            for rotor in range(rotors) if effect.of_one_rotor else (None,):
                columns = self.columns((Term(effect=effect, rotor=rotor),), absent, moving)
                made.append(columns * np.array(own)[moving])
        return np.nan_to_num(np.concatenate(made, axis=1))


def fitted_explanation(problem: Problem, terms: Sequence[Term], noise_rpm: Floats) -> Explanation:
    """The terms with the values at which they explain the flown rows best (Gauss-Newton).

    Values are alike in all flights, with the parameters' usual sizes as prior; the covariance has
    the scatter of a sound aircraft in it. A step within a flight counts as it is afterwards.
    """
    terms = tuple(_lasting(term) for term in terms)
    stride = -(-problem.measured_rpm.shape[0] // MOST_FITTED)
    rows = np.arange(0, problem.measured_rpm.shape[0], stride)
    x = problem.channels.rows(rows)
    seconds = float(np.sum(problem.durations)) / rows.size
    predict = ModePrediction.of(problem.model, problem.base, x, noise_rpm / np.sqrt(seconds))
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
    return Explanation(terms=terms, values=values, covariance=inverse * np.outer(size, size))


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


def _parameters(terms: Sequence[Term]) -> list[Parameter]:
    return [p for term in terms for p in term.effect.parameters]


def _absent(parameter: Parameter) -> float:
    return parameter.start if parameter.absent is None else parameter.absent


def _lasting(term: Term) -> Term:
    return Term(effect=term.effect.afterwards or term.effect, rotor=term.rotor)
