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
from itertools import combinations
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
        return _largest(airframe, yaw_kept=yaw_kept, lost=rotor)

    return Holdable(
        intact=_largest(airframe, yaw_kept=True),
        yaw_kept=np.array([without(i, True) for i in rotors]),
        yaw_uncontrolled=np.array([without(i, False) for i in rotors]),
    )


@lru_cache(maxsize=256)
def trim_curve(airframe: Airframe, rotor: int, yaw_kept: bool = True) -> TrimCurve:
    """The least that rotor `rotor` (from 0) must make for each level collective.

    The least rotor for a collective is the program's dual: the highest of lines in the collective,
    one a corner of the dual. The curve follows the highest line from the collective held without
    the rotor to the largest one with it.
    """
    collective, largest = (_largest(airframe, yaw_kept=yaw_kept, lost=r) for r in (rotor, None))
    moments = _moments(airframe, yaw_kept)
    turn, size, columns = _independent(np.vstack([np.ones(airframe.rotor_count), moments]))
    alone = np.eye(airframe.rotor_count)[rotor]
    corners = np.vstack([np.zeros(size.size), _corners(columns, alone)])
    slope = corners @ (turn[0] / size)
    start = -np.maximum(corners @ columns - alone, 0.0) @ airframe.rotor_effectiveness
    points = [(collective, 0.0)]
    while collective < largest - ROUNDING:
        height = start + slope * collective
        k = int(np.argmax(np.where(height >= points[-1][1] - ROUNDING, slope, -np.inf)))
        steeper = slope > slope[k] + ROUNDING
        meets = (start[k] - start[steeper]) / (slope[steeper] - slope[k])
        collective = float(np.min(meets[meets > collective + ROUNDING], initial=largest))
        points.append((collective, float(start[k] + slope[k] * collective)))
    collectives, least = np.array(points).T
    return TrimCurve(collective=collectives, rotor=least)


def _largest(airframe: Airframe, *, yaw_kept: bool, lost: int | None = None) -> float:
    """Largest level collective, by the program's dual: the least over l of sum of ceiling x
    max(0, 1 + l . moments) is found at a corner, where as many of its terms as l is long are 0."""
    works = np.arange(airframe.rotor_count) != (-1 if lost is None else lost)
    columns = _independent(_moments(airframe, yaw_kept)[:, works])[2]
    corners = _corners(columns, -np.ones(columns.shape[1]))
    sums = np.maximum(1.0 + corners @ columns, 0.0) @ airframe.rotor_effectiveness[works]
    return float(sums.min())


def _moments(airframe: Airframe, yaw_kept: bool) -> Floats:
    """(2 or 3, R) rows that are 0 in trim, scaled to about 1."""
    matrix = mixer(airframe)
    arm = float(np.max(np.hypot(matrix[1], matrix[2])))
    rows: Floats = matrix[1:3] / arm
    return np.vstack([rows, airframe.rotor_spin]) if yaw_kept else rows


def _independent(rows: Floats) -> tuple[Floats, Floats, Floats]:
    """Singular vectors and values of rows (m, R): (m, q), (q,) and (q, R), q those that are none
    of the others: rotors on a line make one row of nothing."""
    turn, size, columns = np.linalg.svd(rows, full_matrices=False)
    rank = int(np.sum(size > ROUNDING))
    return turn[:, :rank], size[:rank], columns[:rank]


def _corners(columns: Floats, level: Floats) -> Floats:
    """(K, q) points l where q of the planes l . column = level of columns (q, R) meet in one."""
    size, count = columns.shape
    picks = np.array(list(combinations(range(count), size)), dtype=np.int64)
    planes = columns.T[picks]
    meet = np.abs(np.linalg.det(planes)) > ROUNDING
    found = np.linalg.solve(planes[meet], level[picks[meet]][..., None])[..., 0]
    return np.asarray(found, dtype=np.float64)
