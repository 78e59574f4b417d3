"""Compute the thrust that rotors can hold in trim: the mixer, and programs for a lost or weak
rotor.

Body axes are frd, thrust T_i [N] points up, rotor i at (x_i, y_i) from the centre of gravity:
    collective = sum T_i     roll = -sum y_i T_i     pitch = sum x_i T_i     yaw = sum s_i k T_i
with s_i = +1 for a rotor that turns counter-clockwise seen from above (its drag turns the body to
the right) and k the torque ratio. Level trim is roll = pitch = 0, and yaw = 0 if heading is kept.

Thrusts here are in units of a free rotor's ceiling, so that each rotor lies in 0..its relative
ceiling (below 1 for the lower rotor of a coaxial pair). Air density and battery voltage scale all
rotors alike: the linear programs are solved once per airframe and only scaled afterwards.

The collective is that of steady trim. It leaves no reserve to turn or to resist a gust, and does
not cover the transient after the failure. A hexacopter whose rotors alternate holds 2/3 of its
thrust with one rotor lost by stopping the opposite rotor too, and can then push its nose to one
side only: `yaw kept` is the best case. The lower rotor of a pair is given no credit for the clean
air after a loss of the upper one.
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
    """The largest level collectives of R rotors, in units of a free rotor's ceiling."""

    intact: float  # all rotors work, yaw kept; NaN without rotors
    yaw_kept: Floats  # (R,) rotor i lost, yaw kept
    yaw_uncontrolled: Floats  # (R,) rotor i lost, yaw uncontrolled


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrimCurve:
    """The least thrust that one rotor must make at each level collective; both (K,), increasing."""

    collective: Floats
    rotor: Floats


def mixer(airframe: Airframe) -> Floats:
    """Return the matrix (4, R) from rotor thrusts, N, to collective, N, and roll, pitch, yaw
    moment, N m."""
    x, y = airframe.rotor_position_frd[:, :2].T
    return np.stack([np.ones_like(x), -y, x, airframe.rotor_spin * airframe.torque_ratio])


@lru_cache(maxsize=256)
def holdable(airframe: Airframe) -> Holdable:
    """Compute the largest level collectives with all rotors, and with each of them lost.

    On a quad with any offset of the centre of gravity a rotor on its side cannot be lost: two
    rotors on a diagonal hold only a weight on the line between them.
    """
    rotors = range(airframe.rotor_count)
    if not rotors:
        return Holdable(intact=nan, yaw_kept=np.array([nan]), yaw_uncontrolled=np.array([nan]))

    def with_rotor_lost(rotor: int, yaw_kept: bool) -> float:
        """Return the largest level collective with one rotor lost."""
        return _largest(airframe, yaw_kept=yaw_kept, lost=rotor)

    return Holdable(
        intact=_largest(airframe, yaw_kept=True),
        yaw_kept=np.array([with_rotor_lost(i, True) for i in rotors]),
        yaw_uncontrolled=np.array([with_rotor_lost(i, False) for i in rotors]),
    )


@lru_cache(maxsize=256)
def trim_curve(airframe: Airframe, rotor: int, yaw_kept: bool = True) -> TrimCurve:
    """Compute the least thrust of rotor `rotor` (from 0) for each level collective.

    By the program's dual, the least thrust is the maximum of lines in the collective, one for each
    corner of the dual. The curve follows the highest line from the largest collective without the
    rotor to the largest one with it.
    """
    collective, largest = (_largest(airframe, yaw_kept=yaw_kept, lost=r) for r in (rotor, None))
    moments = _moments(airframe, yaw_kept)
    turn, size, columns = _row_space(np.vstack([np.ones(airframe.rotor_count), moments]))
    alone = np.eye(airframe.rotor_count)[rotor]
    corners = np.vstack([np.zeros(size.size), _intersections(columns, alone)])
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
    """Compute the largest level collective, by the program's dual.

    The minimum over l of sum of ceiling x max(0, 1 + l . moments) lies at a corner, where as many
    of its terms as l has components are 0.
    """
    works = np.arange(airframe.rotor_count) != (-1 if lost is None else lost)
    columns = _row_space(_moments(airframe, yaw_kept)[:, works])[2]
    corners = _intersections(columns, -np.ones(columns.shape[1]))
    sums = np.maximum(1.0 + corners @ columns, 0.0) @ airframe.rotor_effectiveness[works]
    return float(sums.min())


def _moments(airframe: Airframe, yaw_kept: bool) -> Floats:
    """Return the rows (2 or 3, R) that are 0 in trim, scaled to about 1."""
    matrix = mixer(airframe)
    arm = float(np.max(np.hypot(matrix[1], matrix[2])))
    rows: Floats = matrix[1:3] / arm
    return np.vstack([rows, airframe.rotor_spin]) if yaw_kept else rows


def _row_space(rows: Floats) -> tuple[Floats, Floats, Floats]:
    """Return singular vectors and values of rows (m, R): (m, q), (q,) and (q, R), q their rank.

    Rotors on a line make one row zero.
    """
    turn, size, columns = np.linalg.svd(rows, full_matrices=False)
    rank = int(np.sum(size > ROUNDING))
    return turn[:, :rank], size[:rank], columns[:rank]


def _intersections(columns: Floats, level: Floats) -> Floats:
    """Return the points l (K, q) where q of the planes l . column = level meet, of columns (q,
    R)."""
    size, count = columns.shape
    picks = np.array(list(combinations(range(count), size)), dtype=np.int64)
    planes = columns.T[picks]
    meet = np.abs(np.linalg.det(planes)) > ROUNDING
    found = np.linalg.solve(planes[meet], level[picks[meet]][..., None])[..., 0]
    return np.asarray(found, dtype=np.float64)
