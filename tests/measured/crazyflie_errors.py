"""Errors of the rotors' thrust together, in percent of the weight.

(kappa a S - D)/(m g), S = sum of N_i², with kappa and demand D as a model has them on flights left
out, or with D = m|f|, mass times the specific force that the accelerometer felt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tests.measured.findings import rmse
from tests.measured.thrust_check import FAST
from thrustmargin.models.effects.base import Kind, Placed
from thrustmargin.models.effects.channels import LAGS
from thrustmargin.models.effects.compose import coefficient
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.identification.problem import Problem
from thrustmargin.models.model.flown import table_of
from thrustmargin.models.physics.atmosphere import G0

BOOTSTRAPS = 2000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThrustLeft:
    """Errors of the rotors' thrust together on flights left out, percent of the weight."""

    error: Floats  # (T,)
    fast: Bools  # (T,) faster than FAST
    flight: np.ndarray  # (T,)

    @property
    def all(self) -> float:
        return rmse(self.error)

    @property
    def in_fast(self) -> float:
        return rmse(self.error[self.fast])

    def interval(self) -> tuple[float, float]:
        """95 % interval of `all`, by drawing whole flights anew; NaN without rows."""
        flights = np.unique(self.flight)
        if not flights.size:
            return float("nan"), float("nan")
        square = np.array([np.sum(self.error[self.flight == f] ** 2) for f in flights])
        count = np.array([np.sum(self.flight == f) for f in flights])
        drawn = np.random.default_rng(0).integers(flights.size, size=(BOOTSTRAPS, flights.size))
        draws = np.sqrt(square[drawn].sum(axis=1) / count[drawn].sum(axis=1))
        low, high = np.quantile(draws, [0.025, 0.975])
        return float(low), float(high)


def joined_errors(parts: Sequence[ThrustLeft]) -> ThrustLeft:
    """The errors of several groups of flights as one; flights of different groups stay apart."""
    starts = np.cumsum([0, *(p.flight.max() + 1 for p in parts[:-1])])
    return ThrustLeft(
        error=np.concatenate([p.error for p in parts]),
        fast=np.concatenate([p.fast for p in parts]),
        flight=np.concatenate([p.flight + s for p, s in zip(parts, starts, strict=True)]),
    )


def fast_part(errors: ThrustLeft) -> ThrustLeft:
    """The errors of the rows that are fast."""
    rows = errors.fast
    return ThrustLeft(error=errors.error[rows], fast=rows[rows], flight=errors.flight[rows])


def thrust_left(
    problem: Problem, placed: Sequence[Placed], *, mass: float, felt: bool = False
) -> ThrustLeft:
    """Thrust of the measured rotor speeds less what the flight asked for, over the weight.

    `felt`: what it asked for is mass times the accelerometer's specific force, whatever the model.
    """
    x, base = problem.channels, table_of(problem.model)
    squares = problem.measured_rpm**2
    kappa = coefficient(placed, x, squares.shape[1], np)
    thrust = base.thrust_coefficient * np.sum(squares * kappa, axis=1)
    demand = base.look_up(x.airspeed, x.tank_kg).sum(axis=1)
    for item in placed:
        if item.effect.kind is Kind.DEMAND:
            demand = item.effect.apply(item.values, x, demand, np)
    if felt:
        demand = mass * G0 * x.specific_force_shifts[:, LAGS.index(0.0)]
    return ThrustLeft(
        error=100.0 * (thrust - demand) / (mass * G0),
        fast=x.airspeed > FAST,
        flight=problem.flight,
    )
