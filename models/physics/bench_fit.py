"""A thrust curve and its ceiling from a bench table, each with its 95 % interval.

    T = a N²         a by least squares over the points that agree (Eq. 4 of the paper)
    T = b N^n        n by regression of log T on log N: how far the first form holds
    N_max = N_ref (V/V_ref)^p        over the rows at full throttle, when their voltages differ

T thrust [N], N rotor speed [rpm], V voltage [V]. Intervals are by leaving out blocks of rows in
turn, which asks nothing of how scatter grows with thrust: single rows of a short table, twenty
stretches of a long recording, whose neighbouring rows are not independent.
A point far off the others' curve (a typing error, a sensor that slipped) is left out and named.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.physics.thrust import fit_thrust_curve
from thrustmargin.models.scores import Estimate, jackknife

BLOCKS = 20
FEWEST_POINTS = 4
#: Off the median of T/N² by more than this many of their usual scatter, and by this share at least.
FAR, FAR_SHARE = 5.0, 0.15
#: Of the largest throttle of a table from which a row is at it; and what that must be, as a share
#: of 100 % or of 1000 to 2000 µs (some ESCs are full at 1940), to be full throttle at all.
AT_LARGEST, FULL_THROTTLE = 0.985, 0.93
#: Range of the voltages at full throttle, as a share, from which they give the exponent.
VOLTAGE_RANGE = 0.05
NOTHING = Estimate(value=float("nan"), low=float("nan"), high=float("nan"))


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchFit:
    """What a bench table says of a motor with its propeller; NaN where it says nothing."""

    coefficient: Estimate  # N/rpm² in the air of the bench
    exponent: Estimate  # n of T = b N^n; 2 where the first form holds
    r2: float
    points: int
    left_out: tuple[int, ...]  # rows, from 0, that do not agree with the others
    max_rotor_speed_rpm: float  # at full throttle and ceiling_voltage
    ceiling_voltage: float  # V
    voltage_exponent: Estimate  # p
    max_thrust: float  # N, the largest of the rows that agree
    full_throttle: bool  # the table says that they are; else its fastest row stands for it


def fit_bench(
    *,
    rotor_speed_rpm: ArrayLike,
    thrust: ArrayLike,
    throttle: ArrayLike | None = None,
    voltage: ArrayLike | None = None,
) -> BenchFit:
    """Fit a bench table of n rows: rpm, thrust in N of any one sign, throttle of any unit, V.

    Raises DataError for fewer than 4 usable points, only one speed, or points on several curves.
    """
    speed, force = np.asarray(rotor_speed_rpm, np.float64), np.asarray(thrust, np.float64)
    if np.nansum(force) < 0.0:
        force = -force  # a load cell that is pushed instead of pulled
    use = np.isfinite(speed) & np.isfinite(force) & (speed > 0.0) & (force > 0.0)
    if throttle is not None:
        use &= np.isfinite(np.asarray(throttle, np.float64))
    rows = np.flatnonzero(use)
    if rows.size < FEWEST_POINTS or np.ptp(speed[rows]) == 0.0:
        raise DataError(
            f"{rows.size} bench points with rotor speed and thrust above 0; at least "
            f"{FEWEST_POINTS} at different speeds are needed"
        )
    agree = _agreeing(speed[rows], force[rows])
    left_out, rows = rows[~agree], rows[agree]
    n, f = speed[rows], force[rows]
    block = np.arange(rows.size) * min(rows.size, BLOCKS) // rows.size

    def figures(kept: Bools) -> Floats:
        slope = np.polyfit(np.log(n[kept]), np.log(f[kept]), 1)[0]
        return np.array([fit_thrust_curve(n[kept], f[kept]).coefficient, slope])

    coefficient, exponent = _estimates(*jackknife(figures, block))
    share = np.full(n.size, np.nan) if throttle is None else _share(throttle)[rows]
    stated = bool(np.max(share) >= FULL_THROTTLE)
    full = share >= AT_LARGEST * share.max() if stated else n == n.max()
    volts = np.full(n.size, np.nan) if voltage is None else np.asarray(voltage, np.float64)[rows]
    top, at_voltage, power = _ceiling(n[full], volts[full])
    return BenchFit(
        coefficient=coefficient,
        exponent=exponent,
        r2=fit_thrust_curve(n, f).r2,
        points=rows.size,
        left_out=tuple(left_out.tolist()),
        max_rotor_speed_rpm=top,
        ceiling_voltage=at_voltage,
        voltage_exponent=power,
        max_thrust=float(f.max()),
        full_throttle=stated,
    )


def _agreeing(speed: Floats, force: Floats) -> Bools:
    """(n,) points on one curve with most others: T/N² about its median, on a log scale."""
    off = np.log(force / speed**2)
    off -= np.median(off)
    usual = 1.4826 * float(np.median(np.abs(off)))
    if usual > FAR_SHARE:
        raise DataError(
            f"bench points lie {usual:.0%} about T = a N², too far for one curve; keep the rows of "
            "one motor with one propeller"
        )
    return np.abs(off) <= max(FAR * usual, FAR_SHARE)


def _share(throttle: ArrayLike) -> Floats:
    """(n,) of full throttle, from percent, a share, or pulses of 1000 to 2000 µs."""
    given = np.asarray(throttle, np.float64)
    top = float(np.nanmax(given))
    if top > 200.0:
        return (given - 1000.0) / 1000.0
    return given / 100.0 if top > 2.0 else given


def _ceiling(speed: Floats, volts: Floats) -> tuple[float, float, Estimate]:
    """Largest rotor speed, the voltage where it holds, and the exponent if the rows give it."""
    known = volts > 0.0
    if not known.any():
        return float(speed.max()), float("nan"), NOTHING
    speed, volts = speed[known], volts[known]
    reference = float(volts.max())
    if np.ptp(volts) < VOLTAGE_RANGE * reference or speed.size < FEWEST_POINTS:
        best = int(np.argmax(speed))
        return float(speed[best]), float(volts[best]), NOTHING
    line = np.log(volts / reference), np.log(speed)
    block = np.arange(speed.size) * min(speed.size, BLOCKS) // speed.size

    def figures(kept: Bools) -> Floats:
        return np.polyfit(line[0][kept], line[1][kept], 1)

    power, top = _estimates(*jackknife(figures, block))
    return float(np.exp(top.value)), reference, power


def _estimates(value: Floats, low: Floats, high: Floats) -> list[Estimate]:
    ends = zip(value.tolist(), low.tolist(), high.tolist(), strict=True)
    return [Estimate(value=v, low=a, high=b) for v, a, b in ends]
