"""Residuals before and after on rows that no value was found on, and their errors by rotor.

Held-out flights where there are some; else every row is predicted with values found without its
flight (of one flight, without its fifth).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.fit import Evaluator, layout_of
from thrustmargin.models.identification.left_out import across_flights, on_new_flights
from thrustmargin.models.identification.modes import r_squared
from thrustmargin.models.identification.problem import Problem
from thrustmargin.models.identification.result import Identification, errors_of


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Unseen:
    """Residuals (T, R) rpm on the rows of `problem`, measured minus predicted."""

    problem: Problem
    before_rpm: Floats
    after_rpm: Floats
    role: str  # "fit" or "held_out"


@dataclass(frozen=True, slots=True, kw_only=True)
class RotorErrors:
    """Errors of one rotor, or of all together (`rotor` None), with 95 % intervals of the RMSE."""

    rotor: int | None  # 0-based
    before_rpm: float
    before_ci95_rpm: tuple[float, float]
    after_rpm: float
    after_ci95_rpm: tuple[float, float]
    bias_before_rpm: float
    bias_after_rpm: float
    r2_before: float
    r2_after: float


def unseen_residuals(found: Identification) -> tuple[Unseen, ...]:
    """Of the fitted flights, cross-validated, and of the held-out flights if there are any.

    The last one is that which the errors of the identification come from.
    """
    evaluator = Evaluator(found.problem)
    problem = found.problem
    fitted = Unseen(
        problem=problem,
        before_rpm=found.residual_before_rpm,
        after_rpm=across_flights(evaluator, found.fit),
        role="fit",
    )
    if found.held_out is None:
        return (fitted,)
    new = found.held_out
    before = Evaluator(new).predict((), layout_of((), new.flights), np.zeros(0))
    unused = Unseen(
        problem=new,
        before_rpm=new.measured_rpm - before,
        after_rpm=on_new_flights(new, evaluator, found.fit),
        role="held_out",
    )
    return fitted, unused


def rotor_errors(unseen: Unseen) -> tuple[RotorErrors, ...]:
    """All rotors together, then each; the intervals are from blocks of time within flights."""
    rotors = unseen.before_rpm.shape[1]
    every = np.arange(rotors)
    return tuple(
        _errors(unseen, columns, rotor)
        for rotor, columns in [(None, every), *((k, every[k : k + 1]) for k in range(rotors))]
    )


def _errors(unseen: Unseen, columns: NDArray[np.intp], rotor: int | None) -> RotorErrors:
    measured = unseen.problem.measured_rpm[:, columns]
    part = replace(unseen.problem, measured_rpm=measured)
    before, after = unseen.before_rpm[:, columns], unseen.after_rpm[:, columns]
    first, second = errors_of(part, before), errors_of(part, after)
    return RotorErrors(
        rotor=rotor,
        before_rpm=first.rmse_rpm,
        before_ci95_rpm=first.rmse_ci95_rpm,
        after_rpm=second.rmse_rpm,
        after_ci95_rpm=second.rmse_ci95_rpm,
        bias_before_rpm=first.bias_rpm,
        bias_after_rpm=second.bias_rpm,
        r2_before=r_squared(measured, before),
        r2_after=r_squared(measured, after),
    )
