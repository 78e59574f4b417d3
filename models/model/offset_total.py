"""Compare the total of an aircraft's mode offsets since its last repair with a weak rotor's.

The mode walk (`mode_walk`) follows every slow drift, a propeller that loses half a percent a flight
among them, and the residual of each single flight stays small. So the total since the last noted
repair is compared with patterns: the offsets of one rotor that must turn faster for its thrust, and
of one mode alone (a load, a centre of gravity, a yaw trim). Each may have come at once or flight by
flight, from any day on. Sound days scatter too: the offsets of a day about the pattern are normal
in each mode, with a variance that is marginalised (a Student t density), because its size is
learnt from the same few days.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Self

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.flight import Floats
from thrustmargin.models.model.mode_walk import FlightOffsets, mode_columns
from thrustmargin.models.model.rotor_model import RotorModel

#: Degrees of freedom of the variance's prior: as two sound days would have.
PRIOR_DAYS = 2.0
#: Least standard deviations of a mode from day to day and among the flights of a day, shares of
#: rotor speed: simulated flights repeat better than those of any real aircraft.
LEAST_OF_DAYS, LEAST_OF_FLIGHTS = 0.004, 0.0015
#: Prior probability that some rotor or some mode of a sound aircraft has changed for good.
CHANGED = 0.1
#: Posterior probability from which on a rotor is named, as `identify` names effects.
NAMED = 0.95
#: Losses of thrust that are compared, and the largest lasting change of one mode.
MOST_LOSS, MOST_MODE, GRID = 0.4, 0.1, 81
MOST_DAYS = 60  # the last ones; a pattern may begin on each


@dataclass(frozen=True, slots=True, kw_only=True)
class RotorTotal:
    """A rotor, and the loss of thrust that the offsets since the last repair add up to."""

    rotor: int  # from 0
    loss: float  # share of its thrust at the last flight
    low: float  # ends of the 90 % interval
    high: float
    since_unix_s: float  # first flight of the day from which on it most probably began
    flights: int  # on which the total rests
    probability: float


def rotor_total(
    flights: Sequence[FlightOffsets],
    model: RotorModel,
    *,
    since_unix_s: float = -math.inf,
    jump_unix_s: float = -math.inf,
) -> RotorTotal | None:
    """Return the weak rotor that the mode offsets of an aircraft's flights, taken together, show,
    with the 90 % interval of its loss.

    None if its posterior probability is below NAMED, or without a flight. Only `flights` after the
    last repair at `since_unix_s` (Unix time, s) count, and of these the last MOST_DAYS days with
    flights. At `jump_unix_s` the offsets moved more than the random walk allows: the flights from
    then on must show the loss by themselves, because the jump may be an unreported repair.
    """
    rows = sorted((one for one in flights if one.start_unix_s > since_unix_s), key=_start)
    if not rows:
        return None
    days = [list(of_day) for _, of_day in groupby(rows, key=lambda one: one.day)][-MOST_DAYS:]
    found = _posterior(days, model)
    rotors = mode_columns(model.airframe).shape[0]
    of_rotor = np.logaddexp.reduce(found[:rotors].reshape(rotors, -1), axis=1)
    total = np.logaddexp.reduce(found, axis=None)
    best = int(np.argmax(of_rotor))
    probability = float(np.exp(of_rotor[best] - total))
    if probability < NAMED:
        return None
    weight = np.exp(found[best] - of_rotor[best])
    size, began = weight.sum(axis=(0, 1)), weight.sum(axis=(0, 2))
    sizes = np.cumsum(size)
    losses = _losses()
    low, middle, high = (float(np.interp(at, sizes, losses)) for at in (0.05, 0.5, 0.95))
    columns = mode_columns(model.airframe)
    pattern = -0.5 * math.log(1.0 - middle) * columns[best] / rotors
    since_jump = [one for one in rows if one.start_unix_s >= jump_unix_s]
    if len(since_jump) < len(rows) and not _still_lost(since_jump, pattern, model):
        return None
    return RotorTotal(
        rotor=best,
        loss=middle,
        low=low,
        high=high,
        since_unix_s=days[int(np.argmax(began))][0].start_unix_s,
        flights=len(rows),
        probability=probability,
    )


def _still_lost(rows: Sequence[FlightOffsets], pattern: Floats, model: RotorModel) -> bool:
    """Return True if the flights' offsets fit the loss `pattern` (R,) better than no loss."""
    offsets = np.array([one.offset for one in rows])
    day = np.unique([one.day for one in rows], return_inverse=True)[1]
    courses = np.ones((2, 1, len(rows)))
    density = _LogDensity.of(offsets, courses, day, _scatter(model, pattern.size))
    lost, sound = density.at(np.stack([pattern, 0.0 * pattern]))[0, 0]
    return bool(lost > sound)


def _start(one: FlightOffsets) -> float:
    """Return the start of a flight, Unix time, s."""
    return one.start_unix_s


def _losses() -> Floats:
    """Return the losses of thrust (GRID,) that are compared, without 0."""
    return np.linspace(0.0, MOST_LOSS, GRID + 1)[1:]


def _posterior(days: Sequence[Sequence[FlightOffsets]], model: RotorModel) -> Floats:
    """Return ln of the unnormalised posterior (2 R + 1, 2, D, GRID) over patterns of change.

    Axis 0: R weak rotors, R single modes, and no change, which has all of its probability in one
    cell. Axis 1: the change is there at once, or grows flight by flight. Axis 2: the day, of D, on
    which it begins. Axis 3: sizes. `days` has the flights of each day, in order.
    """
    columns = mode_columns(model.airframe)
    rotors, count = columns.shape[0], len(days)
    offsets = np.array([one.offset for day in days for one in day])
    day = np.repeat(np.arange(count), [len(one) for one in days])
    first, number = np.searchsorted(day, np.arange(count)), np.arange(day.size) + 1.0
    # (2, D, N): course, first day, flight
    at_once = (number > first[:, None]).astype(np.float64)
    gradual = np.clip((number - first[:, None]) / (day.size - first[:, None]), 0.0, 1.0)
    courses = np.stack([at_once, gradual])
    density = _LogDensity.of(offsets, courses, day, _scatter(model, rotors))
    # One rotor's speed, in modes, at equal thrust: thrust falls with the square of the speed.
    faster = -0.5 * np.log(1.0 - _losses())
    half = np.linspace(0.0, MOST_MODE, GRID // 2 + 2)[1:]
    signed = np.concatenate([-half[::-1], half])[:GRID]
    made = np.full((2 * rotors + 1, 2, count, GRID), -np.inf)
    prior = math.log(CHANGED / (2 * rotors) / (2 * count * GRID))
    for k in range(rotors):
        made[k] = prior + density.at(faster[:, None] * columns[k] / rotors)
        made[rotors + k] = prior + density.at(signed[:, None] * np.eye(rotors)[k])
    made[-1, 0, 0, 0] = math.log(1.0 - CHANGED) + density.at(np.zeros((1, rotors)))[0, 0, 0]
    return made


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _LogDensity:
    """The density of the offsets of N flights about patterns, by sums over flights.

    The means of D days, and the flights of a day about their mean, have a variance each in every
    mode. Both have an inverse gamma prior of PRIOR_DAYS degrees of freedom and are marginalised.
    """

    #: of the means of days and of flights about them: sums (R,) of y y, (2, D, R) of x y and
    #: (2, D) of x x for offsets y and courses x, prior scatter (R,), and degrees of freedom
    parts: tuple[tuple[Floats, Floats, Floats, Floats, int], ...]

    @classmethod
    def of(cls, offsets: Floats, courses: Floats, day: NDArray[np.intp], scatter: Floats) -> Self:
        """Compute the sums of a log density over N flights, split into between and within days.

        `offsets` (N, R) are the modes' offsets; `courses` (2, D, N) the shares of the final change
        that flights have, by form and first day; `day` (N,) the number of each flight's day, from
        0; `scatter` (R,) the modes' prior deviation between flights.
        """
        days = int(day[-1]) + 1
        of_day = np.equal.outer(np.arange(days), day) / np.bincount(day)[:, None]
        means, mean_courses = of_day @ offsets, courses @ of_day.T
        parts = []
        for y, x, freedom, least in (
            (means, mean_courses, days, LEAST_OF_DAYS),
            (
                offsets - means[day],
                courses - mean_courses[..., day],
                day.size - days,
                LEAST_OF_FLIGHTS,
            ),
        ):
            sums = np.sum(y**2, axis=0), x @ y, np.sum(x**2, axis=-1)
            parts.append((*sums, np.maximum(scatter, least), freedom))
        return cls(parts=tuple(parts))

    def at(self, sizes: Floats) -> Floats:
        """Return ln of the density (2, D, S), without its constant, for final offsets (S, R)."""
        total = 0.0
        for squares, along, own, scatter, freedom in self.parts:
            left = squares - 2.0 * along[:, :, None] * sizes + own[:, :, None, None] * sizes**2
            each = np.log1p(np.maximum(left, 0.0) / scatter**2 / PRIOR_DAYS)
            total = total - 0.5 * (PRIOR_DAYS + freedom) * np.sum(each, axis=-1)
        return np.asarray(total)


def _scatter(model: RotorModel, rotors: int) -> Floats:
    """Return the standard deviation (R,) of each mode between the flights a model was trained on,
    over the mean rotor speed.

    0 where the model does not contain it.
    """
    good = model.good_flights
    if good is None or len(good.mode_scatter_rpm) != rotors:
        return np.zeros(rotors)
    return np.array(good.mode_scatter_rpm) / good.mean_speed_rpm
