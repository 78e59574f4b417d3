"""What the rotors can hold together: the mixer, and linear programs for a lost or weak rotor.

Body axes are frd, thrust T_i [N] points up, rotor i at (x_i, y_i) from the centre of gravity:
    collective = sum T_i     roll = -sum y_i T_i     pitch = sum x_i T_i     yaw = sum s_i k T_i
with s_i = +1 for a rotor that turns counter-clockwise seen from above (its drag turns the body to
the right) and k the torque ratio. Level trim is roll = pitch = 0, and yaw = 0 if heading is kept.

Thrusts here are in units of a free rotor's ceiling, so that each rotor lies in 0..its relative
ceiling (below 1 for the lower rotor of a coaxial pair). Air density and battery voltage scale all
rotors alike: the programs are solved once per airframe and only scaled afterwards.

A collective that can be held is a statement about steady trim. It leaves no reserve to turn or to
fight a gust, and says nothing of the moments after the failure. A hexacopter whose rotors alternate
holds 2/3 of its thrust with one rotor lost by stopping the opposite rotor too, and can then push
its nose to one side only: `yaw kept` is the best case. The lower rotor of a pair is given no credit
for the clean air that a lost upper rotor leaves it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import nan

import numpy as np

from thrustmargin.models.flight import Floats
from thrustmargin.models.physics.airframe import Airframe

ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Holdable:
    """Largest level collective of R rotors in units of a free rotor's ceiling."""

    intact: float  # all rotors work, yaw kept; NaN for an aircraft of unknown rotors
    yaw_kept: Floats  # (R,) rotor i lost, yaw kept
    yaw_uncontrolled: Floats  # (R,) rotor i lost, yaw uncontrolled


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrimCurve:
    """Least thrust that one rotor must still make at each level collective; both (K,), rising."""

    collective: Floats
    rotor: Floats


def mixer(airframe: Airframe) -> Floats:
    """(4, R) matrix from rotor thrusts, N, to collective, N, and roll, pitch, yaw moment, N m."""
    x, y = airframe.rotor_position_frd[:, :2].T
    return np.stack([np.ones_like(x), -y, x, airframe.rotor_spin * airframe.torque_ratio])


@lru_cache(maxsize=256)
def holdable(airframe: Airframe) -> Holdable:
    """Largest level collectives with all rotors, and with each of them lost.

    On a quad any offset of the centre of gravity makes a rotor on its side impossible to lose: two
    rotors on a diagonal hold a weight between them and no other.
    """
    rotors = range(airframe.rotor_count)
    if not rotors:
        return Holdable(intact=nan, yaw_kept=np.array([nan]), yaw_uncontrolled=np.array([nan]))

    def without(rotor: int, yaw_kept: bool) -> float:
        return float(_best(airframe, yaw_kept=yaw_kept, lost=rotor).sum())

    return Holdable(
        intact=float(_best(airframe, yaw_kept=True).sum()),
        yaw_kept=np.array([without(i, True) for i in rotors]),
        yaw_uncontrolled=np.array([without(i, False) for i in rotors]),
    )


@lru_cache(maxsize=256)
def trim_curve(airframe: Airframe, rotor: int, yaw_kept: bool = True) -> TrimCurve:
    """The least that rotor `rotor` (from 0) must make for each level collective.

    The set of (collective, thrust of the rotor) that can be trimmed is a convex polygon; this is
    its lower edge, from the collective held without the rotor to the largest one with it. Corners
    are found one by one: look outwards from an edge until nothing lies beyond it.
    """

    def corner(of_collective: float, of_rotor: float) -> tuple[float, float]:
        thrust = _best(airframe, yaw_kept=yaw_kept, favour=(of_collective, rotor, of_rotor))
        return float(thrust.sum()), float(thrust[rotor])

    alone = float(_best(airframe, yaw_kept=yaw_kept, lost=rotor).sum())
    # A touch of weight on the rotor picks, of all largest collectives, the one that spares it.
    points = [(alone, 0.0), corner(1.0, -1e-4)]
    edge = 0
    while edge < len(points) - 1:
        (c0, t0), (c1, t1) = points[edge], points[edge + 1]
        normal = (t1 - t0, c0 - c1)
        beyond = corner(*normal)
        gain = normal[0] * (beyond[0] - c0) + normal[1] * (beyond[1] - t0)
        if gain > ROUNDING and not any(np.allclose(beyond, p, atol=ROUNDING) for p in points):
            points.insert(edge + 1, beyond)
        else:
            edge += 1
    collective, least = np.array(points).T
    return TrimCurve(collective=collective, rotor=least)


def _best(
    airframe: Airframe,
    *,
    yaw_kept: bool,
    lost: int | None = None,
    favour: tuple[float, int, float] = (1.0, 0, 0.0),
) -> Floats:
    """(R,) thrusts that maximise favour[0] x collective + favour[2] x thrust of rotor favour[1]."""
    from scipy.optimize import linprog

    matrix = mixer(airframe)
    # Rows are scaled to about 1: zero stays zero, and the solver's tolerance means the same in all.
    arm = float(np.max(np.hypot(matrix[1], matrix[2])))
    rows = [matrix[1] / arm, matrix[2] / arm]
    if yaw_kept:
        rows.append(airframe.rotor_spin)
    ceiling = airframe.rotor_effectiveness.copy()
    if lost is not None:
        ceiling[lost] = 0.0
    gain = np.full(airframe.rotor_count, favour[0])
    gain[favour[1]] += favour[2]
    solution = linprog(
        -gain,
        A_eq=np.stack(rows),
        b_eq=np.zeros(len(rows)),
        bounds=np.stack([np.zeros_like(ceiling), ceiling], axis=1),
        method="highs",
    )
    if not solution.success:  # zero thrust is always a solution, so this is the solver's own fault
        raise RuntimeError(f"{airframe.name}: trim of rotors not solved: {solution.message}")
    return np.asarray(solution.x, dtype=np.float64)
