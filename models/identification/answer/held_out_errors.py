"""Errors on rows that an answer has not seen: held-out flights where there are some, else every
row as it is predicted without its flight (of one flight, without its fifth).
"""

from __future__ import annotations

from dataclasses import dataclass

from thrustmargin.models import scores
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.rows.problem import Problem


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """Errors of measured minus predicted rotor speed; the interval is from blocks of time."""

    rmse_rpm: float
    bias_rpm: float
    r2: float  # of all rotors together, each about its own mean
    per_rotor_rmse_rpm: tuple[float, ...]  # (R,)
    rmse_ci95_rpm: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeldOutResidual:
    """Residuals (T, R) rpm on the rows of `problem`, measured minus predicted."""

    problem: Problem
    before_rpm: Floats
    after_rpm: Floats
    role: str  # "fit" or "held_out"


@dataclass(frozen=True, slots=True, kw_only=True)
class RotorErrors:
    """Errors before and after of one rotor, or of all together (`rotor` None)."""

    rotor: int | None  # 0-based
    before: Errors
    after: Errors


def errors_of(problem: Problem, residual_rpm: Floats, rotor: int | None = None) -> Errors:
    """Errors of a residual (T, R), of one rotor or of all; see `scores.by_block`."""
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
    """All rotors together, then each; the intervals are from blocks of time within flights."""
    return tuple(
        RotorErrors(
            rotor=rotor,
            before=errors_of(unseen.problem, unseen.before_rpm, rotor),
            after=errors_of(unseen.problem, unseen.after_rpm, rotor),
        )
        for rotor in (None, *range(unseen.before_rpm.shape[1]))
    )
