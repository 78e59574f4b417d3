"""Test whether each reported rotor speed belongs to the motor that the airframe says.

The body's response is compared with the airframe's layout by Euler's equation about one axis, with
the moment of the rotors' thrusts (the mixer's rows):
    dw/dt = g m + d w + e S + c,     m = sum_i b_i N_i^2,     S = sum_i N_i^2
w [rad/s] is the body rate, N [rpm] the measured rotor speeds, b the mixer's row of that axis. The
gain g > 0 is thrust coefficient over inertia, d damping, e and c an off-centre load; the running
mean is subtracted from all signals, because trim is slow. Each assignment of the reported speeds to
the airframe's places gives other moments m; how well they explain dw/dt, beyond the last three
terms, is the assignment's likelihood (Gaussian residuals, sample size reduced for autocorrelation
after Bartlett 1946, gain not negative), once with the airframe's spins and once with all spins
reversed. A free arm for every rotor represents another layout; it is penalised for its R parameters
(Schwarz 1978). A moment accelerates at every frequency, so another order or layout must show in
means over SLOW_ROWS too: vibration faster than the sampling may correlate with any.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, permutations
from typing import Literal

import numpy as np

from thrustmargin.models.checks.loss_of_control import FULL_OUTPUT
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.margin import mixer
from thrustmargin.models.physics.smoothing import running_mean
from thrustmargin.models.statement import Statement, state

#: How much more likely the best assignment must be than the next one, and than chance: e^10.
DECISIVE = 10.0
#: Correlation of roll and of pitch from which they respond to the rotors, wherever those are.
ANSWERS = 0.5
#: Rows needed before a verdict is given.
FEWEST_ROWS = 100
#: All assignments are tried up to this many rotors; beyond it only exchanges of up to two pairs.
ALL_UP_TO = 8
#: s by which telemetry may report rotor speeds late.
LATE_S = np.arange(1, 13) / 10
#: Rows of the means by which another order must hold as well, and the share of the correlation of
#: roll and pitch that must be left there: it grows where the order is right, as noise is less.
SLOW_ROWS, SLOW_SHARE = 5, 0.8
#: Correlation of roll and of pitch acceleration with themselves one difference (two rows) later,
#: below which the rows are too sparse to resolve rotation; flights have 0.2 to 0.9.
RESOLVED = 0.1
TURNED = 0.1  # rad within which all rotors are rotated by one angle
#: By which moments, per share of their largest, of one assignment are those of another.
ALIKE = 1e-6
#: s; a row this far from its neighbours is not differentiated.
_LONGEST_STEP = 0.5
#: Rows of the running mean that is removed: five seconds at 10 Hz.
_TREND_ROWS = 51


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorOrder:
    """The result of the test of motor order."""

    verdict: Literal["agrees", "differs", "other layout", "unclear"]
    found: Statement
    #: place of the airframe, from 0, to which each reported rotor speed belongs by the response
    places: tuple[int, ...]
    #: pairs of rotors, from 0, whose exchange is not DECISIVE less likely than the airframe's order
    open_pairs: tuple[tuple[int, int], ...]
    #: correlation of angular acceleration with the airframe's moments: roll, pitch, yaw
    correlation: tuple[float, float, float]
    #: log-likelihood by which the best assignment leads the next
    lead: float
    rows: int


def check_motor_order(track: FlightTrack, airframe: Airframe) -> MotorOrder:
    """Compare roll, pitch and yaw response in flight with the airframe's motor order and spin.

    Needs measured speeds of all R rotors and body rates. The verdict is "unclear" with too few rows
    or too little manoeuvring to distinguish the orders.
    """
    nan = float("nan")
    same = tuple(range(airframe.rotor_count))
    rows = response_samples(track)[-1].size
    if rows < FEWEST_ROWS or track.rotor_count != airframe.rotor_count:
        return MotorOrder(
            verdict="unclear",
            found=state("order without speeds"),
            places=same,
            open_pairs=tuple(combinations(same, 2)),
            correlation=(nan, nan, nan),
            lead=0.0,
            rows=rows,
        )
    places = np.array(list(assignments(airframe.rotor_count)))
    arms = mixer(airframe)[1:] * airframe.rotor_effectiveness
    likelihood, correlation = order_likelihood(track, places, arms)
    order = decide_order(airframe, places, likelihood, correlation, rows)
    if order.verdict != "agrees":
        # Speeds reported late can fit another order of motors: try delays.
        for late in LATE_S:
            other, at_delay = order_likelihood(_shift_speeds(track, late), places, arms)
            if other[0, 0] > likelihood[0, 0]:
                correlation = at_delay
            likelihood = np.maximum(likelihood, other)
        order = decide_order(airframe, places, likelihood, correlation, rows)
        seen = _is_resolved(track) or not _is_rotated_layout(airframe, order.places)
        if order.verdict == "differs" and not (
            seen and _persists_in_means(track, order.places, arms)
        ):
            found = state("order of vibration", rows=rows)
            order = replace(order, verdict="unclear", found=found, places=same)
    if (
        order.verdict in ("agrees", "unclear")
        and _is_resolved(track)
        and _is_half_rotated(track, arms)
    ):
        found = state("arms turned", airframe=airframe.name, layout=airframe.layout)
        return replace(order, verdict="other layout", found=found, places=same)
    if (
        order.verdict == "unclear"
        and _is_resolved(track)
        and all(
            _fits_free_arms(samples, axis, arms[axis])
            for samples in (response_samples(track), _slow_means(response_samples(track)))
            for axis in range(2)
        )
    ):
        found = state("other layout", airframe=airframe.name, layout=airframe.layout)
        return replace(order, verdict="other layout", found=found)
    return order


def order_likelihood(
    track: FlightTrack, places: np.ndarray, arms: Floats
) -> tuple[Floats, tuple[float, float, float]]:
    """Return the log-likelihood (2, P) of P motor orders, and the correlations of the airframe's
    order.

    `places` (P, R) gives the place of each motor in each order, the airframe's order first; `arms`
    (3, R) are the roll, pitch and yaw arms by place. Row 0 is with the airframe's spin directions,
    row 1 with all reversed. The correlations are those of roll, pitch and yaw.
    """
    acceleration, rate, squares, step = response_samples(track)
    likelihood = np.zeros((2, len(places)))
    correlation = []
    for axis in range(3):
        weights = arms[axis][places]  # (P, R): arm of each reported speed under each assignment
        correlated, effective = response_correlations(
            acceleration[:, axis], rate[:, axis], squares, weights, step
        )
        correlation.append(float(correlated[0]))
        for spins, sign in enumerate((1.0, -1.0 if axis == 2 else 1.0)):
            explained = np.clip(sign * correlated, 0.0, 0.999999) ** 2
            likelihood[spins] -= 0.5 * effective * np.log1p(-explained)
    return likelihood, (correlation[0], correlation[1], correlation[2])


def _is_rotated_layout(airframe: Airframe, places: tuple[int, ...]) -> bool:
    """Return True if an assignment of rotors is the whole layout rotated about the vertical axis.

    A swing about that axis, to which rotors respond late, looks the same.
    """
    x, y = airframe.rotor_position_frd[:, :2].T
    angle = np.arctan2(y, x)
    apart = np.exp(1j * (angle[list(places)] - angle))
    return bool(np.abs(apart - apart[0]).max() < TURNED)


def _is_half_rotated(track: FlightTrack, arms: Floats) -> bool:
    """Return True if roll and pitch respond as if the layout were rotated by half the rotors'
    spacing.

    `arms` (3, R) are the rotors' moment arms. No order of the rotors represents this, and a plus
    frame taken for an X still correlates by 0.7. The log-likelihood gain must be DECISIVE in single
    rows and in means over SLOW_ROWS, at every delay of the speeds.
    """
    angle = np.pi / arms.shape[1]
    turned = [
        np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]]) @ arms[:2]
        for a in (angle, -angle)
    ]

    samples = response_samples(track)
    fast, slow = (
        max(_roll_and_pitch(of, a) for a in turned) for of in (samples, _slow_means(samples))
    )
    for late in (0.0, *LATE_S):
        own = response_samples(_shift_speeds(track, late)) if late else samples
        if fast - _roll_and_pitch(own, arms) < DECISIVE:
            return False
        if slow - _roll_and_pitch(_slow_means(own), arms) < DECISIVE:
            return False
    return True


def _roll_and_pitch(samples: tuple[Floats, Floats, Floats, Floats], arms: Floats) -> float:
    """Return the log-likelihood gained by the rotors' moments in roll and pitch.

    `samples` are those of `response_samples`: angular acceleration, rate, squared speeds, step.
    `arms` (2 or more, R) are each rotor's roll and pitch arms in its first two rows.
    """
    acceleration, rate, squares, step = samples
    total = 0.0
    for axis in range(2):
        (correlated,), (count,) = response_correlations(
            acceleration[:, axis], rate[:, axis], squares, arms[axis][None], step
        )
        total -= 0.5 * float(count * np.log1p(-(np.clip(correlated, 0.0, 0.999999) ** 2)))
    return total


def _is_resolved(track: FlightTrack) -> bool:
    """Return True if roll and pitch acceleration correlate from one difference of the rates to
    the next."""
    acceleration = response_samples(track)[0][:, :2]
    power = np.sum(acceleration**2, axis=0)
    return bool(np.all(np.sum(acceleration[2:] * acceleration[:-2], axis=0) > RESOLVED * power))


def _persists_in_means(track: FlightTrack, places: tuple[int, ...], arms: Floats) -> bool:
    """Return True if an order of the rotors explains roll and pitch also in means over SLOW_ROWS.

    Vibration correlates in single rows only. `places` gives the place of each motor, `arms` (3, R)
    the moment arms by place. The best correlation in means, over all delays of the speeds, must
    reach SLOW_SHARE of that in single rows.
    """
    fast, slow = [], []
    for late in (0.0, *LATE_S):
        samples = response_samples(_shift_speeds(track, late) if late else track)
        for found, (acceleration, rate, squares, step) in (
            (fast, samples),
            (slow, _slow_means(samples)),
        ):
            found.append(
                sum(
                    float(
                        response_correlations(acceleration[:, k], rate[:, k], squares, row, step)[
                            0
                        ][0]
                    )
                    for k, row in enumerate(arms[:2, None, list(places)])
                )
            )
    return max(slow) >= SLOW_SHARE * max(fast)


def _shift_speeds(track: FlightTrack, late: float) -> FlightTrack:
    """Shift the rotor speeds `late` seconds earlier."""
    speeds = [
        np.interp(track.time_s + late, track.time_s, column, right=np.nan)
        for column in track.rotor_speed_rpm.T
    ]
    return replace(track, rotor_speed_rpm=np.stack(speeds, axis=1))


def response_samples(track: FlightTrack) -> tuple[Floats, Floats, Floats, Floats]:
    """Return angular acceleration (n, 3), rate (n, 3), squared speeds (n, R) in 1e6 rpm² and step
    (n,), s.

    Rates are in rad/s, roll, pitch, yaw. Acceleration is the central difference over two rows; the
    speeds are smoothed in the same way. Trends are subtracted. Empty with fewer than FEWEST_ROWS.
    """
    time_s, rate = track.time_s, track.angular_rate_frd
    squares = (track.rotor_speed_rpm / 1000.0) ** 2
    if time_s.size < 3:
        return np.empty((0, 3)), np.empty((0, 3)), np.empty((0, track.rotor_count)), np.empty(0)
    step = time_s[2:] - time_s[:-2]
    acceleration = (rate[2:] - rate[:-2]) / step[:, None]
    smooth = 0.25 * squares[:-2] + 0.5 * squares[1:-1] + 0.25 * squares[2:]
    use = track.flying[:-2] & track.flying[1:-1] & track.flying[2:] & (step <= 2 * _LONGEST_STEP)
    use &= np.isfinite(acceleration).all(axis=1) & np.isfinite(rate[1:-1]).all(axis=1)
    use &= np.isfinite(smooth).all(axis=1) if smooth.shape[1] else False
    # A rotor at full output may stand still, so a speed made from its output is not used.
    inferred = track.standard_errors.get("rotor_speed_rpm", np.zeros_like(squares)) > 0.0
    use &= ~((track.throttle >= FULL_OUTPUT) & inferred)[1:-1].any(axis=1)
    if np.sum(use) < FEWEST_ROWS:
        use[:] = False
    return (
        detrend(acceleration[use]),
        detrend(rate[1:-1][use]),
        detrend(smooth[use]),
        step[use],
    )


def _slow_means(
    samples: tuple[Floats, Floats, Floats, Floats],
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the samples as running means over SLOW_ROWS."""
    acceleration, rate, squares = (running_mean(v, SLOW_ROWS) for v in samples[:3])
    return acceleration, rate, squares, samples[3]


def detrend(values: Floats) -> Floats:
    """Subtract the running mean over _TREND_ROWS rows (T, ...).

    Slow changes, as the tank empties, and jumps, when a propeller is damaged, are no manoeuvres.
    """
    return values - running_mean(values, _TREND_ROWS)


def assignments(rotors: int) -> Iterator[tuple[int, ...]]:
    """Yield tuples with the place of each motor, the airframe's own order first.

    All permutations up to ALL_UP_TO rotors; with more rotors, exchanges of one or two pairs.
    """
    same = tuple(range(rotors))
    if rotors <= ALL_UP_TO:
        yield from permutations(same)
        return
    yield same
    pairs = list(combinations(same, 2))
    for first in pairs:
        yield _exchange(same, first)
    for first, second in combinations(pairs, 2):
        if not set(first) & set(second):
            yield _exchange(_exchange(same, first), second)


def _exchange(places: tuple[int, ...], pair: tuple[int, int]) -> tuple[int, ...]:
    """Exchange two places in an assignment."""
    changed = list(places)
    changed[pair[0]], changed[pair[1]] = changed[pair[1]], changed[pair[0]]
    return tuple(changed)


def response_correlations(
    acceleration: Floats, rate: Floats, squares: Floats, weights: Floats, step: Floats
) -> tuple[Floats, Floats]:
    """Correlate an axis's angular acceleration with the moment of P assignments of rotors.

    `acceleration` and `rate` (n,) are of the axis, `squares` (n, R) squared rotor speeds, `weights`
    (P, R) each speed's arm in an assignment, `step` (n,), s. A constant, the rate and the
    collective are regressed out first. Return the correlations (P,), 0 for an assignment without
    moment, and the effective numbers (P,) of independent samples.
    """
    known = np.stack([np.ones_like(rate), rate, squares.sum(axis=1)], axis=1)
    basis = np.linalg.qr(known)[0]

    def remove_known(values: Floats) -> Floats:
        """Subtract from each column of (T, ...) its least-squares fit by rate, collective and 1."""
        return values - basis @ (basis.T @ values)

    response, speeds = remove_known(acceleration), remove_known(squares)
    power = response @ response
    gram, cross = speeds.T @ speeds, speeds.T @ response
    # A moment is a weighted sum of the speeds, so every assignment comes from the same sums.
    moment_power = np.sum((weights @ gram) * weights, axis=1)
    scale = np.sqrt(np.maximum(moment_power * power, 1e-300))
    with np.errstate(invalid="ignore"):
        correlated = np.where(moment_power > 1e-12 * np.trace(gram), weights @ cross / scale, 0.0)
    lagged = speeds[1:].T @ speeds[:-1]
    own = np.sum((weights @ lagged) * weights, axis=1) / np.maximum(moment_power, 1e-300)
    alike = np.clip(own * float(response[1:] @ response[:-1]) / max(power, 1e-300), 0.0, 0.999)
    # Rows overlap by half, because each difference spans two steps.
    samples = 0.5 * step.size * (1.0 - alike) / (1.0 + alike)
    return np.nan_to_num(correlated), samples


def _fits_free_arms(
    samples: tuple[Floats, Floats, Floats, Floats], axis: int, own_arms: Floats
) -> bool:
    """Return True if freely fitted arms explain an axis that the airframe's arms (R,) do not.

    `samples` are those of `response_samples`, `axis` is 0 roll, 1 pitch, 2 yaw. The log-likelihood
    must rise by DECISIVE; the penalty is one independent sample for each fitted arm.
    """
    acceleration, rate, squares, step = samples
    response, rates = acceleration[:, axis], rate[:, axis]
    known = np.stack([np.ones_like(rates), rates, squares.sum(axis=1)], axis=1)
    solved = np.linalg.lstsq(np.hstack([known, squares]), response)[0]
    arms = solved[known.shape[1] :].astype(np.float64)
    (freely,), (count,) = response_correlations(response, rates, squares, arms[None], step)
    (own,), _ = response_correlations(response, rates, squares, own_arms[None], step)
    explained = np.clip([own, freely], 0.0, 0.999999) ** 2
    own_likelihood, likelihood = -0.5 * max(count - arms.size, 0.0) * np.log1p(-explained)
    lead = likelihood - own_likelihood - 0.5 * arms.size * np.log(max(count, 1.0))
    return bool(freely > ANSWERS and own < 0.5 * freely and lead >= DECISIVE)


def decide_order(
    airframe: Airframe,
    places: np.ndarray,
    likelihood: Floats,
    correlation: tuple[float, float, float],
    rows: int,
) -> MotorOrder:
    # By places and spins alone: the lower effectiveness of coaxial rotors is a guess.
    """Return the verdict from the log-likelihoods (2, P) of P assignments `places` (P, R).

    Row 0 is with the airframe's spins, row 1 with all reversed. `correlation` (roll, pitch, yaw)
    and the number of `rows` are passed on to the result.
    """
    layouts = mixer(airframe)[1:][:, places]  # (3, P, R)
    layouts = np.concatenate([layouts, layouts * np.array([1.0, 1.0, -1.0])[:, None, None]], axis=1)
    flat = likelihood.ravel()
    best = int(np.argmax(flat))
    # Assignments that exchange identical places are the same aircraft.
    alike = np.all(np.abs(layouts - layouts[:, best, None, :]) < ALIKE, axis=(0, 2))
    others = flat[~alike]
    lead = float(flat[best] - others.max()) if others.size else float(flat[best])
    first = int(np.argmax(alike))
    chosen, reversed_spins = places[first % len(places)], first >= len(places)
    same = np.array_equal(chosen, np.arange(chosen.size))
    verdict: Literal["agrees", "differs", "unclear"] = "differs"
    if flat[best] < DECISIVE or lead < DECISIVE:
        verdict, found = "unclear", state("order not shown")
    elif same and not reversed_spins:
        verdict, found = "agrees", state("order agrees")
    elif same:
        found = state("spins reversed", airframe=airframe.name)
    else:
        found = _difference(chosen, airframe, *(("with every spin",) if reversed_spins else ()))
    return MotorOrder(
        verdict=verdict,
        found=found,
        places=tuple(int(place) for place in chosen),
        open_pairs=_open_pairs(places, likelihood[0], layouts[:, : len(places)]),
        correlation=correlation,
        lead=lead,
        rows=rows,
    )


def _open_pairs(
    places: np.ndarray, likelihood: Floats, layouts: Floats
) -> tuple[tuple[int, int], ...]:
    """List the pairs of rotors, from 0, that the flight cannot distinguish from the airframe's
    order.

    `places` (P, R) are the orders, the airframe's first, with log-likelihoods `likelihood` (P,). A
    pair is listed if its exchange alone is within DECISIVE of the airframe's order. Pairs that are
    alike in `layouts` (3, P, R), the arms of each order, are excluded.
    """
    moved = places != places[0]
    found = []
    for k in np.flatnonzero(
        (np.count_nonzero(moved, axis=1) == 2) & (likelihood > likelihood[0] - DECISIVE)
    ):
        if not np.allclose(layouts[:, k], layouts[:, 0]):
            first, second = np.flatnonzero(moved[k])
            found.append((int(first), int(second)))
    return tuple(found)


def _difference(places: np.ndarray, airframe: Airframe, *clauses: str) -> Statement:
    """Describe how `places` (R,), each motor's place from 0, differ from the airframe's order."""
    clauses, own = (*clauses, "against airframe"), airframe.name
    moved = np.flatnonzero(places != np.arange(places.size)).tolist()
    if len(moved) == 2:
        return state("swapped", *clauses, first=moved[0] + 1, second=moved[1] + 1, airframe=own)
    listed = tuple(state("is motor", rotor=k + 1, motor=int(places[k]) + 1) for k in moved)
    return state("out of order", *clauses, listed=listed, airframe=own)
