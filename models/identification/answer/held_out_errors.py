"""Errors on rows that an answer was not fitted on.

These are held-out flights if there are any, else every row, predicted without its flight (of a
single flight, without its fifth).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from thrustmargin.models import scores
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.rows.problem import Problem
from thrustmargin.models.network.records import GoodFlights


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """Error measures of measured minus predicted rotor speed, with an interval from
    blocks of time."""

    rmse_rpm: float
    bias_rpm: float
    r2: float  # of all rotors together, each relative to its own mean
    per_rotor_rmse_rpm: tuple[float, ...]  # (R,)
    rmse_ci95_rpm: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeldOutResidual:
    """Residuals (T, R), rpm, measured minus predicted, before and after identification."""

    problem: Problem
    before_rpm: Floats
    after_rpm: Floats
    role: str  # "fit" or "held_out"


@dataclass(frozen=True, slots=True, kw_only=True)
class RotorErrors:
    """Errors before and after identification of one rotor, or of all rotors (`rotor` None)."""

    rotor: int | None  # 0-based
    before: Errors
    after: Errors


def errors_of(problem: Problem, residual_rpm: Floats, rotor: int | None = None) -> Errors:
    """Compute RMSE, bias and R² of a residual (T, R), rpm, for one rotor, from 0, or all (None).

    The 95 % interval of the RMSE is by bootstrap over blocks of time.
    """
    columns = slice(None) if rotor is None else slice(rotor, rotor + 1)
    measured, residual = problem.measured_rpm[:, columns], residual_rpm[:, columns]
    terms = scores.error_terms(measured, measured - residual)
    whole = terms.sum(axis=0)
    drawn = scores.by_block(terms.sum(axis=1), problem.block, problem.block_flight)
    together = whole.sum(axis=0)
    return Errors(
        rmse_rpm=float(scores.rmse(together)),
        bias_rpm=float(scores.bias(together)),
        r2=float(scores.r2(together)),
        per_rotor_rmse_rpm=tuple(scores.rmse(whole).tolist()),
        rmse_ci95_rpm=scores.percentiles(scores.rmse(drawn)),
    )


def rotor_errors(unseen: HeldOutResidual) -> tuple[RotorErrors, ...]:
    """Compute errors of all rotors together, then of each rotor."""
    return tuple(
        RotorErrors(
            rotor=rotor,
            before=errors_of(unseen.problem, unseen.before_rpm, rotor),
            after=errors_of(unseen.problem, unseen.after_rpm, rotor),
        )
        for rotor in (None, *range(unseen.before_rpm.shape[1]))
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ExcessError:
    """An error larger than that of sound flights, with the rotors that have most of it."""

    rmse_rpm: float
    limit_rpm: float  # that sound flights stay below in 95 of 100
    rotors: tuple[int, ...]  # 0-based, that with the largest error first; empty if none stands out


def excess_error(known: GoodFlights | None, error: Errors, floor_rpm: float) -> ExcessError | None:
    """Return the error if it exceeds that of the sound flights `known`; None if it does not.

    Compared, in squares, is the RMSE less its unavoidable part `floor_rpm`. A rotor stands out if
    its own RMSE exceeds that of the other rotors by the limit, in squares too. None without sound
    flights, or with fewer than three.
    """
    limit = math.nan if known is None else known.most_rmse_rpm()
    if not error.rmse_rpm**2 - floor_rpm**2 > limit**2:
        return None
    squares = np.square(error.per_rotor_rmse_rpm)
    others = (squares.sum() - squares) / max(squares.size - 1, 1)
    by_size = np.argsort(-squares, kind="stable")
    return ExcessError(
        rmse_rpm=error.rmse_rpm,
        limit_rpm=limit,
        rotors=tuple(int(r) for r in by_size if squares[r] - others[r] > limit**2),
    )
