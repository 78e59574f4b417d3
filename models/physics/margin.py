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

Define thrust margin, redundancy and largest fill, once for forecast, view and report.

    ceiling          N_max = N_max,ref min(V/V_ref, 1)^n,   T_max,i = a e_i rho/rho_ref N_max²
    utilisation      u_i = T_i/T_max,i = (N_i/N_max)²       thrust margin = 1 - u_i
    redundancy       largest level collective with one rotor lost / weight; >= 1 survives in trim
    trimmable loss   largest share of one rotor's thrust that may be lost with the weight held level

a thrust coefficient at rho_ref, e_i effectiveness of rotor i, V battery voltage. Rotors are the
last axis, time the first: T rows, R rotors. NaN in gives NaN out. On a quad redundancy with yaw
uncontrolled is 1/(2u): it crosses 1 at u = 0.5, the origin of the 50 % limit.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from math import nan
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from thrustmargin.models.flight import Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0
from thrustmargin.models.physics.thrust import speed_from_thrust, thrust_from_speed
from thrustmargin.models.statement import Statement, state

ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Holdable:
    """The largest level collectives of R rotors, in units of a free rotor's ceiling."""

    intact: float  # all rotors work, yaw kept; NaN without rotors
    yaw_kept: Floats  # (R,) rotor i lost, yaw kept
    yaw_uncontrolled: Floats  # (R,) rotor i lost, yaw uncontrolled


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrimCurve:
    """The least thrust of one rotor in trim, by the level collective; both (K,), increasing."""

    collective: Floats
    rotor: Floats


def mixer(airframe: Airframe) -> Floats:
    """Return the matrix (4, R) from rotor thrusts, N, to collective, N, and roll, pitch and yaw
    moment, N m, in the body frame (forward, right, down)."""
    x, y = airframe.rotor_position_frd[:, :2].T
    return np.stack([np.ones_like(x), -y, x, airframe.rotor_spin * airframe.torque_ratio])


@lru_cache(maxsize=256)
def holdable(airframe: Airframe) -> Holdable:
    """Compute the largest level collective with all rotors, and with each of them lost.

    The collective is the total thrust in level flight, in units of a free rotor's ceiling. NaN
    without rotors. On a quad with any offset of the centre of gravity a rotor on its side cannot be
    lost: two rotors on a diagonal hold only a weight on the line between them.
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
    """Compute the least thrust of rotor number `rotor`, from 0, for each level collective.

    Both are in units of a free rotor's ceiling. By the linear program's dual, the least thrust is
    the maximum of lines in the collective, one for each corner of the dual. The curve has the
    corners of the highest line, from the largest collective without the rotor to the largest one
    with it.
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
    """Compute the largest level collective, in units of a free rotor's ceiling.

    `lost` is a rotor, from 0, without thrust; `yaw_kept`: the yaw moment must vanish too. By the
    linear program's dual: the minimum over l of sum of ceiling x max(0, 1 + l . moments) lies at a
    corner, where as many of its terms as l has components are 0.
    """
    works = np.arange(airframe.rotor_count) != (-1 if lost is None else lost)
    columns = _row_space(_moments(airframe, yaw_kept)[:, works])[2]
    corners = _intersections(columns, -np.ones(columns.shape[1]))
    sums = np.maximum(1.0 + corners @ columns, 0.0) @ airframe.rotor_effectiveness[works]
    return float(sums.min())


def _moments(airframe: Airframe, yaw_kept: bool) -> Floats:
    """Return the moments (2, or 3 with yaw kept; R) that must be 0 in trim, scaled to about 1."""
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
    """Return the K points l (K, q) that solve l . c = level for q of the R columns c at once.

    `columns` is (q, R), `level` (R,). Every choice of q linearly independent columns gives a point.
    """
    size, count = columns.shape
    picks = np.array(list(combinations(range(count), size)), dtype=np.int64)
    planes = columns.T[picks]
    meet = np.abs(np.linalg.det(planes)) > ROUNDING
    points = np.linalg.solve(planes[meet], level[picks[meet]][..., None])[..., 0]
    return np.asarray(points, dtype=np.float64)


Criterion = Literal["utilisation", "yaw uncontrolled", "yaw kept"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ceiling:
    """The largest speed and thrust of the rotors in T rows."""

    max_rotor_speed_rpm: Floats  # (T,) rpm
    free_thrust: Floats  # (T,) N of a rotor outside other rotors' wash
    max_thrust: Floats  # (T, R) N
    voltage_basis: Statement


def ceiling(airframe: Airframe, density: ArrayLike, voltage: ArrayLike | None = None) -> Ceiling:
    """Compute the rotors' largest speed and thrust at `density` (T,) or a number, kg/m³.

    `voltage` (T,) is the battery's, V; an unknown one (NaN, 0) is replaced by the nominal voltage,
    as `voltage_basis` states. Above the ceiling's own voltage the speed does not increase, because
    it was not measured there.
    """
    rho = np.atleast_1d(np.asarray(density, dtype=np.float64))
    given = np.nan if voltage is None else voltage
    rho, volts = np.broadcast_arrays(rho, np.asarray(given, dtype=np.float64))
    known = np.isfinite(volts) & (volts > 0.0)
    volts = np.where(known, volts, airframe.nominal_voltage)
    share = np.minimum(volts / airframe.ceiling_voltage, 1.0) ** airframe.ceiling_voltage_exponent
    speed = airframe.max_rotor_speed_rpm * share
    free = thrust_from_speed(
        speed,
        coefficient=airframe.thrust_coefficient,
        density=rho,
        reference_density=airframe.reference_density,
    )
    nominal = airframe.nominal_voltage
    if np.all(known):
        basis = state("measured voltage")
    elif not np.any(known):
        basis = state("nominal voltage", nominal=nominal)
    else:
        rows = float(np.count_nonzero(~known))
        basis = state("partly measured voltage", nominal=nominal, rows=rows)
    return Ceiling(
        max_rotor_speed_rpm=speed,
        free_thrust=free,
        max_thrust=free[:, None] * airframe.rotor_effectiveness,
        voltage_basis=basis,
    )


def nameplate_ceiling(airframe: Airframe) -> Ceiling:
    """Return the ceiling, one row, by the maker's printed maximum thrust, N, whatever the air and
    battery.

    The free thrust (1,) is that of a sound rotor, `max_thrust` (1, R) that of each rotor with its
    effectiveness.
    """
    free = np.array([airframe.nameplate_max_thrust])
    return Ceiling(
        max_rotor_speed_rpm=speed_from_thrust(free, coefficient=airframe.thrust_coefficient),
        free_thrust=free,
        max_thrust=free[:, None] * airframe.rotor_effectiveness,
        voltage_basis=state("nameplate"),
    )


def weight(airframe: Airframe, tank_kg: ArrayLike) -> Floats:
    """Return the weight, N, of the aircraft with `tank_kg` of liquid (any shape)."""
    return (airframe.empty_mass + np.asarray(tank_kg, dtype=np.float64)) * G0


def rotor_thrust(airframe: Airframe, rotor_speed_rpm: Floats, density: Floats) -> Floats:
    """Return the thrust (T, R), N, of rotor speeds (T, R) in air of `density` (T,), by the
    thrust curve."""
    free = thrust_from_speed(
        rotor_speed_rpm,
        coefficient=airframe.thrust_coefficient,
        density=density[:, None],
        reference_density=airframe.reference_density,
    )
    return free * airframe.rotor_effectiveness


def utilisation(rotor_speed_rpm: Floats, max_rotor_speed_rpm: Floats) -> Floats:
    """Return u (T, R) of rotor speeds (T, R) under a ceiling (T,), both rpm.

    Thrust over largest thrust at one density and one coefficient: both cancel.
    """
    return (rotor_speed_rpm / max_rotor_speed_rpm[:, None]) ** 2


def hover_use(airframe: Airframe, limits: Ceiling, load: ArrayLike) -> Floats:
    """Return the worst rotor's u (T,) for a `load` in N, (T,) or a number, shared as well as
    possible.

    On a symmetric airframe that is the equal share of hover.
    """
    return np.asarray(load, dtype=np.float64) / (limits.free_thrust * holdable(airframe).intact)


def redundancy(airframe: Airframe, limits: Ceiling, load: ArrayLike, *, yaw_kept: bool) -> Floats:
    """Return the largest level thrust (T,) with the worst single rotor lost, over `load` (T,) in
    N."""
    capacity = holdable(airframe)
    worst = float(np.min(capacity.yaw_kept if yaw_kept else capacity.yaw_uncontrolled))
    return worst * limits.free_thrust / np.asarray(load, dtype=np.float64)


def trimmable_loss(
    airframe: Airframe, limits: Ceiling, load: ArrayLike, *, yaw_kept: bool = True
) -> Floats:
    """Return the share (T,) of its largest thrust that any rotor can lose in level flight.

    `load` (T,) is the weight, N. The share is that of the worst-placed rotor: 1 where any rotor can
    be lost altogether, 0 or less without a reserve; NaN where the load is NaN. On a quad with
    heading kept it is the thrust margin 1 - u, with yaw uncontrolled 2 (1 - u) up to 1.
    """
    collective = np.asarray(load, dtype=np.float64) / limits.free_thrust
    worst = np.where(np.isnan(collective), np.nan, np.inf)
    for rotor, full in enumerate(airframe.rotor_effectiveness):
        curve = trim_curve(airframe, rotor, yaw_kept)
        needed = np.interp(collective, curve.collective, curve.rotor)
        worst = np.minimum(worst, 1.0 - needed / full)
    return worst


def yaw_reserve(airframe: Airframe, thrust: Floats) -> Floats:
    """Return the unused share (T,) of the yaw authority: 1 in the middle of its range, 0 at an end.

    `thrust` (T, R) is in units of a free rotor's ceiling. The authority is the range of yaw moments
    that the rotors can make with collective, roll and pitch moment unchanged, and no rotor below 0
    or above its ceiling; the reserve is the distance to its nearer end over half of its width. A
    rotor at its ceiling in a steady roll or pitch moment takes authority on one side or both. NaN
    where a rotor's thrust is unknown.
    """
    matrix = mixer(airframe)
    arm = float(np.max(np.hypot(matrix[1], matrix[2]), initial=1e-9))
    kept = matrix[:3] / np.array([[1.0], [arm], [arm]])
    turn, size, columns = _row_space(kept)
    moments = (thrust @ kept.T) @ (turn / size)  # (T, q), as the columns are scaled
    yaw = thrust @ airframe.rotor_spin
    left = np.stack([_most(airframe, columns, way, moments) - way * yaw for way in (1.0, -1.0)])
    width = left.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.clip(2.0 * left.min(axis=0) / width, 0.0, 1.0)
    return np.where(width > ROUNDING, share, np.where(np.isnan(width), np.nan, 0.0))


def _most(airframe: Airframe, columns: Floats, way: float, moments: Floats) -> Floats:
    """Return the largest yaw moment (T,) in one direction with the other `moments` (T, q)
    unchanged.

    `way` is the sign of that yaw moment: 1 right, -1 left; `columns` (q, R) are the rotors' shares
    in the moments. Computed by linear programming's dual: the minimum, over its corners l, of l .
    moments plus the sum over rotors of ceiling x max(0, way x spin - l . column).
    """
    gain = way * airframe.rotor_spin
    corners = _intersections(columns, gain)
    rest = np.maximum(gain - corners @ columns, 0.0) @ airframe.rotor_effectiveness
    return np.min(moments @ corners.T + rest, axis=1, initial=np.inf)


def largest_fill(
    airframe: Airframe,
    limits: Ceiling,
    *,
    criterion: Criterion = "utilisation",
    limit: float | None = None,
) -> Floats:
    """Return the fill (T,), kg, at which the worst rotor's u, or the redundancy, equals `limit`.

    `criterion` is "utilisation", or redundancy with "yaw kept" or "yaw uncontrolled"; `limit` is
    0.5 for utilisation and 1 for redundancy unless given. The result is not limited to the tank:
    above its capacity a full tank is within the limit, below 0 even the empty aircraft exceeds it.
    """
    capacity = holdable(airframe)
    if criterion == "utilisation":
        collective = (0.5 if limit is None else limit) * capacity.intact
    else:
        lost = capacity.yaw_kept if criterion == "yaw kept" else capacity.yaw_uncontrolled
        collective = float(np.min(lost)) / (1.0 if limit is None else limit)
    return collective * limits.free_thrust / G0 - airframe.empty_mass
