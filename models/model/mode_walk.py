"""Follow how the rotor speeds of one aircraft drift from its model, from flight to flight.

A model is made from the flights of one or two days. On the next day the trim of the aircraft, its
battery, its weight and its air differ a little, and all rotor speeds are offset in one of the
layout's modes: collective, roll, pitch, yaw, and the rest. The offset of each mode is a random
walk: a step with every flight, and a further one with every day. After each flight the walk is
updated with the flight's median residual, by a Kalman filter of one variable for each mode (Kalman,
J. Basic Eng. 82, 35 (1960)). Offsets are shares of the flight's mean rotor speed; a mode's
direction has entries of size 1 in the root mean square, so an offset of 0.01 in the collective is
1 % on every rotor.

A flight is predicted with the state before it, and updates the state afterwards, so no flight is
scored with itself. Each mode has steps of its own size, for a yaw trim moves more than a roll trim:
they maximise the marginal likelihood of the aircraft's own flights times a prior that a few flights
outweigh.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise, product
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np

from thrustmargin.models.errors import DataError, ModelError
from thrustmargin.models.flight import Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.margin import mixer

DAY_S = 86_400.0
#: Prior medians of the steps by flight and by day. Source: modes of a heavy quad, Quiver PT1, 22
#: flights of three days (github.com/Arrow-air/project-quiver).
FLIGHT_STEP, DAY_STEP = 0.015, 0.025
#: Standard deviation of ln of a step in the prior: a factor of two either way is usual.
STEP_SPREAD = math.log(2.0)
#: Factors of the prior medians among which the steps are chosen.
STEP_FACTORS = np.geomspace(0.05, 4.0, 45)
#: Standard deviation of the change that a repair makes to each mode. Source: the same aircraft,
#: whose modes changed by 1 to 5 % when motors were aligned and a propeller replaced.
REPAIR_STEP = 0.03
#: Probability with which a sound flight is reported as changed, if steps are normal: once in ten
#: seasons of 40 flights. Made seasons, whose days are drawn anew, have five times as many.
FALSE_CHANGE = 0.0025


@dataclass(frozen=True, slots=True, kw_only=True)
class WalkSizes:
    """The standard deviations of the walk's steps, as shares of rotor speed.

    One of all modes, or one of each mode (R,).
    """

    flight: float | tuple[float, ...] = FLIGHT_STEP
    day: float | tuple[float, ...] = DAY_STEP

    @property
    def typical(self) -> tuple[float, float]:
        """Return the root mean squares over the modes: of the step by flight, and of that by
        day."""
        flight, day = (math.sqrt(np.mean(np.square(one))) for one in (self.flight, self.day))
        return flight, day


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeState:
    """The offsets of the modes at one time, with their standard errors; shares of rotor speed.

    Raises ModelError where an error is negative or a number is not finite.
    """

    offset: tuple[float, ...]  # (R,)
    error: tuple[float, ...]  # (R,)

    def __post_init__(self) -> None:
        values = [*self.offset, *self.error]
        if len(self.offset) != len(self.error) or not all(map(math.isfinite, values)):
            raise ModelError("its mode state needs one finite error for each offset")
        if min(self.error, default=0.0) < 0.0:
            raise ModelError("its mode state has a negative error")


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightOffsets:
    """The middle residual of one flight in each mode, by the model without a mode state."""

    flight: str  # digest of the log
    start_unix_s: float
    longitude_deg: float  # of the place, for the day; NaN unknown
    offset: tuple[float, ...]  # (R,) median over blocks, share of the predicted speed
    error: tuple[float, ...]  # (R,) its standard error within the flight
    rows: int

    @property
    def day(self) -> int:
        """Return the number of the day at the flight's longitude, by mean solar time."""
        return local_day(self.start_unix_s, self.longitude_deg)


def local_day(unix_s: float, longitude_deg: float) -> int:
    """Return the number of the day of a Unix time, s, at a longitude, by mean solar time; of
    Greenwich where the longitude is NaN.
    """
    east_s = 240.0 * longitude_deg if math.isfinite(longitude_deg) else 0.0
    return math.floor((unix_s + east_s) / DAY_S)


@dataclass(frozen=True, slots=True, kw_only=True)
class WalkStep:
    """State of the modes before and after one flight, and the flight's difference from the
    state."""

    flight: FlightOffsets
    before: ModeState
    after: ModeState
    surprise: tuple[float, ...]  # (R,) difference over its expected standard deviation
    #: (R,) standard error of the state after the flight before it, without the step in between
    known: tuple[float, ...]

    @property
    def changed(self) -> tuple[int, ...]:
        """Return the modes, from 0, that differ from the state before by more than chance explains.

        Of fault-free flights a share of FALSE_CHANGE has such a mode.
        """
        beyond = surprise_limit(len(self.surprise))
        return tuple(np.flatnonzero(np.abs(self.surprise) > beyond).tolist())


@lru_cache(maxsize=16)
def surprise_limit(modes: int) -> float:
    """Return the limit, in standard deviations, that a mode exceeds by chance in FALSE_CHANGE of
    flights.

    It is for the largest of `modes` independent modes, either sign.
    """
    return NormalDist().inv_cdf(1.0 - FALSE_CHANGE / (2.0 * modes))


def mode_columns(airframe: Airframe) -> Floats:
    """Return the directions (R, R) of the modes, one a column, of root mean square 1.

    Collective, roll, pitch and yaw, as the mixer of the airframe moves them; the remaining columns
    complete an orthogonal basis.
    """
    rows = mixer(airframe)
    rows = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    rotors = rows.shape[1]
    columns = np.linalg.qr(np.concatenate([rows.T, np.eye(rotors)], axis=1))[0][:, :rotors]
    known = min(rows.shape[0], rotors)
    sign = np.sign(np.sum(columns[:, :known] * rows.T[:, :known], axis=0))
    columns[:, :known] *= np.where(sign == 0.0, 1.0, sign)
    return columns * math.sqrt(rotors)


def walk(
    flights: Sequence[FlightOffsets],
    steps: WalkSizes,
    *,
    last_training: FlightOffsets | None = None,
    repairs: Sequence[float] = (),
) -> tuple[WalkStep, ...]:
    """Filter the mode offsets of flights, in order of time: a random walk observed once a flight.

    `last_training` is the last flight that the model was made from; without one the first flight
    counts as of another day. `repairs` are the Unix times, s, of repairs and other noted changes,
    each of which lets every mode change by REPAIR_STEP. Before the first flight the state is 0 with
    the error of one step by flight and by day, because the model is the mean of other flights.
    Raises DataError where one flight is given twice.
    """
    return tuple(
        WalkStep(
            flight=one.flight,
            before=_state(one.mean, one.variance),
            after=_state(one.mean_after, one.variance_after),
            surprise=tuple((one.difference / np.sqrt(one.expected)).tolist()),
            known=tuple(np.sqrt(one.known).tolist()),
        )
        for one in _filtered(flights, steps, last_training, repairs)
    )


class _Update(NamedTuple):
    """Result of one update of the filter; arrays (..., R) for steps of any leading shape."""

    flight: FlightOffsets
    known: Floats  # variance before the step
    mean: Floats
    variance: Floats
    expected: Floats  # variance of the difference
    difference: Floats
    mean_after: Floats
    variance_after: Floats


def _filtered(
    flights: Sequence[FlightOffsets],
    steps: WalkSizes,
    last_training: FlightOffsets | None,
    repairs: Sequence[float],
) -> Iterator[_Update]:
    """Yield the Kalman filter's update by each flight, in order of time.

    `repairs` are Unix times, s; `last_training` is the last flight of the model's training, or
    None. The step sizes may be arrays (S, 1), to try S of them at once. Raise DataError where one
    flight is given twice.
    """
    ordered = sorted(flights, key=lambda one: one.start_unix_s)
    for one, other in pairwise(sorted(one.flight for one in ordered)):
        if one == other:
            raise DataError(f"flight {one} is given twice")
    if not ordered:
        return
    mean = np.zeros(len(ordered[0].offset))
    variance = mean + np.square(steps.day)
    last = last_training
    for one in ordered:
        known = variance
        variance = variance + _step_variance(last, one, steps, repairs)
        expected = variance + np.square(one.error)
        difference = np.array(one.offset) - mean
        gain = variance / expected
        after, left = mean + gain * difference, variance * (1.0 - gain)
        yield _Update(one, known, mean, variance, expected, difference, after, left)
        mean, variance, last = after, left, one


def _step_variance(
    last: FlightOffsets | None, one: FlightOffsets, steps: WalkSizes, repairs: Sequence[float]
) -> Floats:
    """Return the variance (..., R) or (..., 1) that is added to each mode between the `last` flight
    and flight `one`.

    It is that of one flight, plus that of a day if the days differ, plus that of each repair
    between.
    """
    since = -math.inf if last is None else last.start_unix_s
    repaired = sum(since < time_s <= one.start_unix_s for time_s in repairs)
    days = last is not None and last.day != one.day
    stepped = np.square(steps.flight) + days * np.square(steps.day)
    return stepped + repaired * REPAIR_STEP**2


def _state(mean: Floats, variance: Floats) -> ModeState:
    """Return a mode state from means and variances (R,)."""
    return ModeState(offset=tuple(mean.tolist()), error=tuple(np.sqrt(variance).tolist()))


def state_before(
    flights: Sequence[FlightOffsets],
    steps: WalkSizes,
    rotors: int,
    start_unix_s: float,
    *,
    longitude_deg: float = math.nan,
    last_training: FlightOffsets | None = None,
    repairs: Sequence[float] = (),
) -> ModeState:
    """Return the mode state with which to predict a flight that starts at `start_unix_s` (Unix
    time, s).

    `rotors` is the number of modes, `longitude_deg` the place of the flight, which sets its local
    day. Only `flights` that started earlier count. `steps` are the sizes of the random walk,
    `last_training` the last training flight (None: unknown) and `repairs` the Unix times of
    repairs, as in `walk`.
    """
    earlier = [one for one in flights if one.start_unix_s < start_unix_s]
    coming = FlightOffsets(
        flight="",
        start_unix_s=start_unix_s,
        longitude_deg=longitude_deg,
        offset=(0.0,) * rotors,
        error=(1.0,) * rotors,
        rows=0,
    )
    return walk([*earlier, coming], steps, last_training=last_training, repairs=repairs)[-1].before


def fit_steps(
    flights: Sequence[FlightOffsets],
    *,
    last_training: FlightOffsets | None = None,
    repairs: Sequence[float] = (),
) -> WalkSizes:
    """Fit the step sizes of each mode by maximum posterior density; without flights return the
    prior medians.

    ln of each step is normal about its prior median with standard deviation STEP_SPREAD.
    """
    return _fit_steps(tuple(flights), last_training, tuple(repairs))


@lru_cache(maxsize=16)  # report, walk and total of a flight all ask for the steps before it
def _fit_steps(
    flights: tuple[FlightOffsets, ...],
    last_training: FlightOffsets | None,
    repairs: tuple[float, ...],
) -> WalkSizes:
    """Fit the steps; the cached part of `fit_steps`."""

    if not flights:
        return WalkSizes()
    factors = np.array(list(product(STEP_FACTORS[::2], STEP_FACTORS[::2])))
    flight, day = FLIGHT_STEP * factors[:, :1], DAY_STEP * factors[:, 1:]
    density = -0.5 * np.sum((np.log(factors) / STEP_SPREAD) ** 2, axis=1, keepdims=True)
    sizes: Any = WalkSizes(flight=flight, day=day)  # type: ignore[arg-type]  # all at once
    for one in _filtered(flights, sizes, last_training, repairs):
        squares = one.difference**2 / one.expected + np.log(2.0 * math.pi * one.expected)
        density = density - 0.5 * squares
    best = np.argmax(density, axis=0)
    return WalkSizes(flight=tuple(flight[best, 0].tolist()), day=tuple(day[best, 0].tolist()))


def shift_rpm(state: ModeState, airframe: Airframe, speed_rpm: Floats) -> tuple[Floats, Floats]:
    """Return the offset (T, R) rpm of predicted speeds (T, R) rpm by a state, and its standard
    error."""
    columns = mode_columns(airframe)
    scale = np.mean(speed_rpm, axis=1, keepdims=True)
    share, error = np.array(state.offset) @ columns.T, np.square(state.error) @ columns.T**2
    return scale * share, scale * np.sqrt(error)
