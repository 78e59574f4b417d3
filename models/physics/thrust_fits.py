"""Fit a thrust curve to measurements in hover or on a bench, each number with its 95 % interval.

Hover (`fit_hover`). In steady hover the rotors of an aircraft of known mass m [kg] carry it at a
tilt theta:
    a = m g rho_ref / (rho cos theta sum e_i N_i²)
with N [rpm] measured rotor speeds, e effectiveness, rho the air's density. The estimate is the mean
over flights; its interval is by jackknife over flights, or over ten-second blocks of a single one,
because neighbouring rows are not independent. Wind is unknown: in wind a rotor makes more thrust at
a speed.

The trim of rotor i is its thrust over its share on a level, balanced aircraft:
    (e_i N_i² / sum e N²) / (e_i s_i / sum e s),   s the smallest s with B diag(e) s = (1, 0, 0, 0)
and B the mixer. It cannot distinguish an off-centre load, a tilted motor and a weak propeller.
Multiplied by the arms it gives the apparent place of the weight, and a constant yaw moment.

Bench table (`fit_bench`):
    T = a N²         a by least squares over the consistent points (Eq. 4 of the paper)
    T = b N^n        n by regression of log T on log N: a test of the first form
    N_max = N_ref (V/V_ref)^p        over the rows at full throttle, when their voltages differ
T thrust [N], N rotor speed [rpm], V voltage [V]. Intervals are by jackknife over blocks of rows,
which needs no assumption on how scatter grows with thrust: single rows of a short table, twenty
blocks of a long recording, whose neighbouring rows are not independent.
A point far off the others' curve (a typing error, a sensor that slipped) is excluded and reported.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0, track_air
from thrustmargin.models.physics.flight_phases import hover_rows
from thrustmargin.models.physics.margin import mixer
from thrustmargin.models.physics.thrust import fit_thrust_curve
from thrustmargin.models.scores import Estimate, jackknife
from thrustmargin.models.statement import Statement

BLOCK_S = 10.0
FEWEST_ROWS = 50  # five seconds of hover, in all
#: Largest ratio of thrust over weight, 95th over 5th percentile, of one hover in gusts.
ONE_HOVER = 1.6


@dataclass(frozen=True, slots=True, kw_only=True)
class HoverFit:
    """Thrust curve and trim of R rotors from steady hover, with 95 % intervals."""

    coefficient: Estimate  # N/rpm² at reference_density
    reference_density: float  # kg/m³, the median of the hover
    density_error: float  # kg/m³, its standard error; not in the coefficient's interval
    air: Statement  # source of the density, in the first flight
    trim: tuple[Estimate, ...]  # thrust of each rotor over its share on a balanced aircraft
    load_place: tuple[Estimate, Estimate]  # m, x and y frd, apparent place of the weight
    yaw_split: Estimate  # thrust of CCW minus CW rotors, over all
    flights: tuple[str, ...]  # those with hover
    rows: int


def fit_hover(tracks: Sequence[FlightTrack], airframe: Airframe) -> HoverFit:
    """Fit thrust coefficient and trim to the steady hover of flights with measured rotor speeds.

    Trim is each rotor's share of squared speed over that expected, the place of the load, and the
    yaw split; all with 95 % intervals. The weight is the airframe's empty mass and the tank's
    content; of the airframe only that mass and its rotors' places, spin and effectiveness are used.
    Raise DataError when there is too little steady hover with every rotor's speed, or flights have
    another number of rotors.
    """
    parts, airs = [], []
    for number, track in enumerate(tracks):
        if track.rotor_count != airframe.rotor_count:
            raise DataError(
                f"{track.name}: {track.rotor_count} rotors, but the airframe has "
                f"{airframe.rotor_count}; give flights of this aircraft"
            )
        air = track_air(track)
        airs.append(air)
        density = air.density
        masses = airframe.empty_mass + track.measured("tank_kg")
        upright = np.cos(track.attitude[:, 0]) * np.cos(track.attitude[:, 1])
        weight = masses * G0 / upright
        squares = airframe.rotor_effectiveness * track.rotor_speed_rpm**2
        use = hover_rows(track) & np.isfinite(weight) & np.isfinite(density)
        use &= np.all(track.rotor_speed_rpm > 0.0, axis=1)
        times = track.time_s[use]
        when = np.floor((times - times[:1]) / BLOCK_S) if times.size else times
        flight = np.full(times.size, float(number))
        parts.append(np.column_stack([flight, when, weight[use], density[use], squares[use]]))
    table = np.concatenate(parts) if parts else np.empty((0, 4 + airframe.rotor_count))
    if len(table) < FEWEST_ROWS:
        if all(not np.isfinite(track.tank_kg).any() for track in tracks):
            raise DataError("what is on board is not known; give --load KG")
        raise DataError(
            f"{len(table)} rows of steady hover with the speed of every rotor, {FEWEST_ROWS} are "
            "needed: give a flight that hovers for ten seconds or more, with ESC telemetry"
        )
    flight, when, weight, density, squares = *table[:, :4].T, table[:, 4:]
    needed = squares.sum(axis=1) * density / weight
    for number in np.unique(flight):
        check_one_hover(needed[flight == number])
    hovered = np.unique(flight)
    # The last, incomplete block of a single flight is merged with the one before.
    block = flight if hovered.size > 1 else np.minimum(when, max(when[-1] - 1.0, 0.0))
    reference = float(np.median(density))
    collective = squares.sum(axis=1)
    share = squares / collective[:, None]
    apparent = weight * reference / density
    matrix = mixer(airframe)
    level = np.linalg.pinv(matrix * airframe.rotor_effectiveness) @ [1.0, 0.0, 0.0, 0.0]
    expected = airframe.rotor_effectiveness * level
    expected /= expected.sum()

    def figures(kept: np.ndarray) -> Floats:
        """Return the HoverFit values of the rows flagged in `kept`, as means over flights."""
        means = []
        for one in np.unique(flight[kept]):
            rows = kept & (flight == one)
            shares = share[rows].mean(axis=0)
            coefficient = apparent[rows].sum() / collective[rows].sum()
            roll, pitch, yaw = matrix[1:] @ shares
            means.append(
                [coefficient, *(shares / expected), pitch, -roll, yaw / airframe.torque_ratio]
            )
        return np.array(means, dtype=np.float64).mean(axis=0)

    estimates = jackknife(figures, block)
    rotors = airframe.rotor_count
    return HoverFit(
        coefficient=estimates[0],
        reference_density=reference,
        density_error=float(np.median(airs[int(hovered[0])].density_error)),
        air=airs[int(hovered[0])].basis,
        trim=tuple(estimates[1 : 1 + rotors]),
        load_place=(estimates[1 + rotors], estimates[2 + rotors]),
        yaw_split=estimates[3 + rotors],
        flights=tuple(tracks[int(number)].name for number in hovered),
        rows=len(table),
    )


def check_one_hover(needed: Floats) -> None:
    """Raise DataError if thrust over weight, `needed` (n,), varies too much for one hover.

    The 95 % quantile must not exceed ONE_HOVER times the 5 % quantile.
    """
    low, high = np.percentile(needed, (5, 95))
    if high > ONE_HOVER * low:
        raise DataError(
            f"in what looks like hover its rotors make up to {high / low:.1f} times the thrust for "
            "one weight, and nothing climbs: was it held, were its propellers off, or did its load "
            "change? Give another flight"
        )


BLOCKS = 20
FEWEST_POINTS = 4
#: A point is excluded if off the median of T/N² by FAR times the scatter, and by FAR_SHARE or more.
FAR, FAR_SHARE = 5.0, 0.15
#: Of the largest throttle of a table from which a row is at it; and what that must be, as a share
#: of 100 % or of 1000 to 2000 µs (some ESCs are full at 1940), to be full throttle at all.
AT_LARGEST, FULL_THROTTLE = 0.985, 0.93
#: Range of the voltages at full throttle, as a share, from which they give the exponent.
VOLTAGE_RANGE = 0.05
NOTHING = Estimate(value=float("nan"), low=float("nan"), high=float("nan"))


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchFit:
    """The fit of a bench table of a motor with its propeller; NaN where the table has no data."""

    coefficient: Estimate  # N/rpm² in the air of the bench
    exponent: Estimate  # n of T = b N^n; 2 where the first form applies
    r2: float
    points: int
    left_out: tuple[int, ...]  # excluded rows, from 0
    max_rotor_speed_rpm: float  # at full throttle and ceiling_voltage
    ceiling_voltage: float  # V
    voltage_exponent: Estimate  # p
    max_thrust: float  # N, largest of the consistent rows
    full_throttle: bool  # stated by the table; else its fastest row is taken


def fit_bench(
    *,
    rotor_speed_rpm: ArrayLike,
    thrust: ArrayLike,
    throttle: ArrayLike | None = None,
    voltage: ArrayLike | None = None,
) -> BenchFit:
    """Fit a bench table of n rows: rpm, thrust in N of either sign, throttle in any unit, V.

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
    agree = _agree(speed[rows], force[rows])
    left_out, rows = rows[~agree], rows[agree]
    n, f = speed[rows], force[rows]
    block = np.arange(rows.size) * min(rows.size, BLOCKS) // rows.size

    def figures(kept: Bools) -> Floats:
        # The curve comes first: it raises for points of one speed, where LAPACK would fail.
        """Return coefficient and exponent of the rows in the mask."""
        coefficient = fit_thrust_curve(n[kept], f[kept]).coefficient
        return np.array([coefficient, np.polyfit(np.log(n[kept]), np.log(f[kept]), 1)[0]])

    coefficient, exponent = jackknife(figures, block)
    share = np.full(n.size, np.nan) if throttle is None else _throttle_share(throttle)[rows]
    stated = bool(np.max(share) >= FULL_THROTTLE)
    full = share >= AT_LARGEST * share.max() if stated else n == n.max()
    volts = np.full(n.size, np.nan) if voltage is None else np.asarray(voltage, np.float64)[rows]
    top, at_voltage, power = _fit_ceiling(n[full], volts[full])
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


def _agree(speed: Floats, force: Floats) -> Bools:
    """Flag the bench points (n,) on the curve that most of them share.

    They are those whose T/N² is near the median, on a log scale; `speed` in rpm, `force` in N.
    Raise DataError if most points scatter too much for one curve.
    """
    off = np.log(force / speed**2)
    off -= np.median(off)
    usual = 1.4826 * float(np.median(np.abs(off)))
    if usual > FAR_SHARE:
        raise DataError(
            f"bench points lie {100 * usual:.0f} % about T = a N², too far for one curve; keep the "
            "rows of "
            "one motor with one propeller"
        )
    return np.abs(off) <= max(FAR * usual, FAR_SHARE)


def _throttle_share(throttle: ArrayLike) -> Floats:
    """Return the share (n,) of full throttle, from percent, a share, or pulses of 1000 to 2000
    µs."""
    given = np.asarray(throttle, np.float64)
    top = float(np.nanmax(given))
    if top > 200.0:
        return (given - 1000.0) / 1000.0
    return given / 100.0 if top > 2.0 else given


def _fit_ceiling(speed: Floats, volts: Floats) -> tuple[float, float, Estimate]:
    """Return the largest rotor speed, rpm, its voltage, V, and the exponent of voltage.

    The exponent is NaN if the rows (n,) at full throttle have too little range of voltage.
    """
    known = volts > 0.0
    if not known.any():
        return float(speed.max()), float("nan"), NOTHING
    speed, volts = speed[known], volts[known]
    reference = float(volts.max())
    block = np.arange(speed.size) * min(speed.size, BLOCKS) // speed.size
    # An exponent that depends on one block has no interval.
    differ = min(np.ptp(volts[block != k]) if (block != k).any() else 0.0 for k in block) > 0.0
    if not differ or np.ptp(volts) < VOLTAGE_RANGE * reference or speed.size < FEWEST_POINTS:
        best = int(np.argmax(speed))
        return float(speed[best]), float(volts[best]), NOTHING
    line = np.log(volts / reference), np.log(speed)

    def figures(kept: Bools) -> Floats:
        """Return slope and intercept of log speed over log voltage."""
        return np.polyfit(line[0][kept], line[1][kept], 1)

    power, top = jackknife(figures, block)
    return float(np.exp(top.value)), reference, power
