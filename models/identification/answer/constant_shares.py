"""Report constant differences between motor outputs and a model without known sound flights.

A weak rotor, an offset centre of gravity, a tilted motor and unequal motors all make the autopilot
hold a constant roll, pitch and yaw, because its mixer has nothing else. Four outputs in hover have
four unknowns, and more rotors add none: outputs stay in the mixer's span. So none of these causes
is reported as the one. The difference is reported rotor by rotor, with the size that each cause
would have if it acted alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from thrustmargin.models.effects import BY_KEY
from thrustmargin.models.effects.base import TORQUE_SHARE, Placed
from thrustmargin.models.effects.thrust_effects import LOSS, ROTOR_DEGRADATION
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.rows.candidates import TrialEffect, placed_effects
from thrustmargin.models.identification.rows.output_shares import lacks_sound_flights
from thrustmargin.models.identification.rows.problem import Problem, thin_rows

#: RMS difference over rotors, relative to the mean speed, from which it is reported: twice the
#: scatter of sound propellers, motors and ESCs, as 2 % of thrust
REPORTED = 0.01
IN_COMMON = 0.5  # share of a flight's largest difference that the mean of all flights must reach
ROWS = 200  # rows that sizes are solved on: a constant needs few
LEAST_LOSS = 0.02  # least loss of a rotor that is listed as a cause
MATCHED = 0.1  # share of the difference that a cause may leave
AXES = slice(1, 4)  # roll, pitch and yaw among the modes
#: Returns the change (3,) rpm of AXES by effects.
Change = Callable[[Sequence[Placed]], Floats]


@dataclass(frozen=True, slots=True, kw_only=True)
class ShareCause:
    """A cause, with its sizes, that would produce the constant difference in the outputs."""

    cg_x: float  # m, forward of the model's
    cg_y: float  # m, to the right
    yaw_moment: float = 0.0  # N m, in hover with half a tank
    rotor: int | None = None  # 0-based rotor with less thrust
    loss: float = 0.0  # share of its thrust, with the usual share of its torque
    #: range of the loss, for torque shares one standard deviation from the usual
    loss_range: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class ConstantShares:
    """The constant measured minus predicted speed of each of R rotors, and its possible causes."""

    rotor_rpm: tuple[float, ...]  # (R,) mean of all flights, or of `flight`
    #: the flight with the largest difference if flights differ too much, else None
    flight: int | None
    per_flight_rpm: tuple[tuple[float, ...], ...]  # (F, R)
    trim: ShareCause | None  # centre of gravity and yaw moment; None where no size fits
    #: one rotor with a centre of gravity offset, largest loss first
    weak_rotors: tuple[ShareCause, ...]


def constant_shares(
    problem: Problem, trials: Sequence[TrialEffect], residual_rpm: Floats
) -> ConstantShares | None:
    """Return the constant difference between motor outputs and the model with the effects `trials`.

    With it come the causes that would produce it: an offset centre of gravity, or one weak rotor.
    `residual_rpm` (T, R) is measured minus predicted with these effects. None for measured speeds,
    for a model trained on fault-free flights, and for a difference below REPORTED. If flights
    differ, the difference is that of the flight with the largest one.
    """
    if not problem.of_outputs or not lacks_sound_flights(problem.model):
        return None
    flights = np.stack(
        [residual_rpm[problem.flight == f].mean(axis=0) for f in range(problem.flights)]
    )
    mean, sizes = flights.mean(axis=0), np.sqrt(np.mean(flights**2, axis=1))
    if sizes.max() < REPORTED * float(problem.measured_rpm.mean()):
        return None
    flight = None
    if np.sqrt(np.mean(mean**2)) < IN_COMMON * sizes.max():
        flight = int(np.argmax(sizes))
        mean = flights[flight]
    few = thin_rows(problem, max(1, problem.measured_rpm.shape[0] // ROWS))
    target = problem.mode_amplitudes(mean)[AXES]
    others = placed_effects(few, trials)
    still = few.speeds(others)

    def moved(effects: Sequence[Placed]) -> Floats:
        """Return the mean change (3,) rpm of roll, pitch and yaw modes by additional effects."""
        change = few.speeds([*others, *effects]) - still
        return few.mode_amplitudes(change.mean(axis=0))[AXES]

    rotors = [
        one
        for rotor in range(problem.measured_rpm.shape[1])
        if (one := _weak_rotor_cause(moved, target, rotor)) is not None
    ]
    return ConstantShares(
        rotor_rpm=tuple(mean.tolist()),
        flight=flight,
        per_flight_rpm=tuple(tuple(one.tolist()) for one in flights),
        trim=_trim_cause(moved, target),
        weak_rotors=tuple(sorted(rotors, key=lambda one: -one.loss)),
    )


def _trim_cause(moved: Change, target: Floats) -> ShareCause | None:
    """Return the centre of gravity, m, and yaw moment, N m, that produce a change; None if none do.

    `target` (3,) is the change of the roll, pitch and yaw modes, rpm; `moved` computes it for
    effects.
    """
    yaw = BY_KEY["yaw_trim"].parameters[0]
    solved = _solve_sizes(
        lambda v: moved([_cg_offset(v[0], v[1]), _placed_effect("yaw_trim", {yaw.name: v[2]})]),
        target,
        scale=(CG.scale, CG.scale, yaw.scale),
        most=(CG.upper, CG.upper, yaw.upper),
    )
    return (
        None if solved is None else ShareCause(cg_x=solved[0], cg_y=solved[1], yaw_moment=solved[2])
    )


def _weak_rotor_cause(moved: Change, target: Floats, rotor: int) -> ShareCause | None:
    """Return the loss of `rotor`, from 0, and the centre of gravity that together produce a change.

    `target` (3,) is the change of the roll, pitch and yaw modes, rpm; `moved` computes it for
    effects. Yaw determines the loss through the torque share that the rotor keeps, known to one
    standard deviation; `loss_range` covers that. None if the loss is below LEAST_LOSS or no size
    fits.
    """
    tries = [
        _solve_sizes(
            lambda v, share=share: moved(
                [
                    _cg_offset(v[0], v[1]),
                    _placed_effect(
                        ROTOR_DEGRADATION.key, {"loss": v[2], TORQUE_SHARE.name: share}, rotor
                    ),
                ]
            ),
            target,
            scale=(CG.scale, CG.scale, LOSS.scale),
            most=(CG.upper, CG.upper, LOSS.upper),
        )
        for share in (TORQUE_SHARE.start, *_torque_share_limits())
    ]
    first, *others = tries
    if first is None or first[2] < LEAST_LOSS:
        return None
    losses = [one[2] for one in (first, *others) if one is not None]
    return ShareCause(
        cg_x=first[0],
        cg_y=first[1],
        rotor=rotor,
        loss=first[2],
        loss_range=(min(losses), max(losses)),
    )


def _torque_share_limits() -> tuple[float, float]:
    """Return a degraded rotor's usual torque share minus and plus one standard deviation."""
    return TORQUE_SHARE.start - TORQUE_SHARE.scale, TORQUE_SHARE.start + TORQUE_SHARE.scale


CG = BY_KEY["cg_offset"].parameters[0]


def _cg_offset(x: float, y: float) -> Placed:
    """Return a centre of gravity offset (m forward, m right) as a placed effect."""
    return _placed_effect("cg_offset", {"x": x, "y": y})


def _placed_effect(key: str, values: Mapping[str, float], rotor: int | None = None) -> Placed:
    """Return the effect `key` with the given values, the others at their starts."""
    effect = BY_KEY[key]
    whole = {p.name: p.start for p in effect.parameters} | dict(values)
    return Placed(effect=effect, values=whole, rotor=rotor)


def _solve_sizes(
    change: Callable[[Floats], Floats],
    target: Floats,
    *,
    scale: tuple[float, float, float],
    most: tuple[float, float, float],
) -> list[float] | None:
    """Return three values for which `change` of them is `target` (3,), rpm; None if there are none.

    Each value is within its `most` of zero; `scale` is its typical size, for the solver. Accepted
    is a remaining difference of up to MATCHED of the target.
    """
    sizes, bounds = np.array(scale), np.array(most) / np.array(scale)
    solution = least_squares(
        lambda v: change(v * sizes) - target, np.zeros(3), bounds=(-bounds, bounds)
    )
    if np.linalg.norm(solution.fun) > MATCHED * np.linalg.norm(target):
        return None
    return [float(v) for v in solution.x * sizes]
