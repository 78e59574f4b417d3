"""Learn what each figure of each arm is on a sound aircraft, from earlier flights of it.

The expected figure of an arm is the mean over the days of each day's flights. Flights differ in
two ways: all arms together (air, battery, wind: not evidence of an arm) and each arm by itself. The
second is the yardstick, between days and within one; while days are few it is drawn towards a usual
scatter, which counts as PRIOR_FLIGHTS values.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from thrustmargin.models.arms.figures import ArmFigure, ArmFigures, Quantity
from thrustmargin.models.errors import ModelError
from thrustmargin.models.flight import Floats
from thrustmargin.models.physics.between_flights import PRIOR_FLIGHTS
from thrustmargin.models.physics.electric_power import POWER_SCATTER

#: Fewest flights from which an arm's own figures are expected of a further one.
LEAST_FLIGHTS = 3
#: Standard deviation between flights of one arm about the others, as a share, before any is seen.
#: Power: that of the whole aircraft. Output: that from motor to motor of one make. Resistance and
#: offset: one step, 0.1 V, of what most ESCs report, at 50 V. Thrust: trims of `rotor_faults`, a
#: third. Heat: a reading of whole degrees in a rise of 7 K. Vibration: a hundredth of g, the noise of
#: a mounted IMU. Jumps: 0.3 % of speed, the noise of an ESC's speed.
USUAL_SCATTER: Mapping[Quantity, float] = MappingProxyType(
    {
        Quantity.THRUST: 0.03,
        Quantity.POWER: POWER_SCATTER,
        Quantity.OUTPUT: 0.015,
        Quantity.RESISTANCE: 0.002,
        Quantity.OFFSET: 0.002,
        Quantity.ESC_HEAT: 0.15,
        Quantity.MOTOR_HEAT: 0.15,
        Quantity.VIBRATION: 0.01,
        Quantity.JUMPS: 0.003,
    }
)
#: Standard deviation, as a share, of what moves all arms of a flight together.
TOGETHER = 0.3
#: Of a sound instrument the offset is zero, whatever earlier flights had. Its scatter is a step of
#: the reading, which is known as well as if ABSOLUTE_FREEDOM values had shown it.
ABSOLUTE = frozenset({Quantity.OFFSET})
ABSOLUTE_FREEDOM = 30.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmLaw:
    """The figures of the flights that a further one is compared with.

    Raises ModelError where the flights have different numbers of arms.
    """

    flights: tuple[ArmFigures, ...]

    def __post_init__(self) -> None:
        counts = {len(figure.value) for one in self.flights for figure in one.figures}
        if len(counts) > 1:
            raise ModelError(f"its arms' figures are of {sorted(counts)} arms")

    @property
    def days(self) -> int:
        """Return the number of days of the flights."""
        return len({one.day for one in self.flights})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Departure:
    """How far the arms of one flight are from what is expected, in one quantity, as shares.

    `departure` (R,) is NaN where unknown; `covariance` (R, R) is that of a sound aircraft, without
    what moves all arms together; `freedom` is the number of flights that its scale is known from.
    """

    quantity: Quantity
    departure: Floats
    covariance: Floats
    own: Floats  # (R, R) the part of it that this flight's own blocks show
    freedom: float


def departures(
    flight: ArmFigures, law: ArmLaw | None, modes: Floats | None = None
) -> tuple[Departure, ...]:
    """Return the departures of a flight's arms from `law`, the earlier flights of the aircraft.

    `modes` (R, R) has the modes of the layout as columns of unit length: thrust is shared by modes,
    as the centre of gravity moves arms together. Quantities with fewer than LEAST_FLIGHTS earlier
    flights are left out, but for the offsets of instruments, which need none.
    """
    found = []
    for figure in flight.figures:
        earlier = [] if law is None else [one for one in law.flights if one.flight != flight.flight]
        of = [(one.day, seen) for one in earlier if (seen := one.of(figure.quantity)) is not None]
        absolute = figure.quantity in ABSOLUTE
        if len(of) < LEAST_FLIGHTS and not absolute:
            continue
        used = modes if figure.quantity is Quantity.THRUST else None
        found.append(_absolute(figure) if absolute else _departure(figure, of, used))
    return tuple(found)


def _absolute(figure: ArmFigure) -> Departure:
    """Return the departure of an instrument from zero."""
    rotors = len(figure.value)
    usual = USUAL_SCATTER[figure.quantity]
    return Departure(
        quantity=figure.quantity,
        departure=np.array(figure.value) / figure.unit,
        covariance=usual**2 * np.eye(rotors),
        own=np.diag(_squares(figure)),
        freedom=ABSOLUTE_FREEDOM,
    )


def _squares(figure: ArmFigure) -> Floats:
    """Return the squared standard errors (R,) of a figure as shares; 0 where unknown."""
    return np.nan_to_num(np.array(figure.error) / figure.unit) ** 2


def _departure(
    figure: ArmFigure, earlier: Sequence[tuple[int, ArmFigure]], modes: Floats | None
) -> Departure:
    """Return the departure of one quantity from its mean over days in `earlier` flights."""
    values = np.array([one.value for _, one in earlier]) / figure.unit
    days = np.array([day for day, _ in earlier])
    rotors = values.shape[1]
    numbers = np.unique(days)
    with np.errstate(invalid="ignore"):
        by_day = np.array([_mean(values[days == day]) for day in numbers])
        expected = _mean(by_day)
    axes = np.eye(rotors) if modes is None else modes
    # Arms of one make scatter alike; the common part has taken one arm's worth away.
    alike = modes is None
    usual, counted = USUAL_SCATTER[figure.quantity], rotors - 1 if alike else 1
    between = _squares_of(by_day - expected, axes, alike=alike)
    within = _squares_of(values - by_day[np.searchsorted(numbers, days)], axes, alike=alike)
    freedom = PRIOR_FLIGHTS + (len(numbers) - 1) * counted
    variance = (PRIOR_FLIGHTS * usual**2 + between) / freedom * (1.0 + 1.0 / len(numbers))
    variance = variance + within / max((len(earlier) - len(numbers)) * counted, 1)
    return Departure(
        quantity=figure.quantity,
        departure=np.array(figure.value) / figure.unit - expected,
        covariance=axes @ np.diag(variance) @ axes.T,
        own=np.diag(np.maximum(_squares(figure) - _usual_error(earlier, figure.unit), 0.0)),
        freedom=freedom,
    )


def _squares_of(left: Floats, axes: Floats, *, alike: bool) -> Floats:
    """Return the sums of squares (R,) of values (F, R) along each of the `axes` (R, R).

    `alike`: one sum of all arms about their mean. Rows with an unknown arm are left out.
    """
    left = left[np.isfinite(left).all(axis=1)]
    if alike:
        left = left - left.mean(axis=1, keepdims=True)
        return np.full(left.shape[1], np.sum(left**2))
    return np.sum((left @ axes) ** 2, axis=0)


def _usual_error(earlier: Sequence[tuple[int, ArmFigure]], unit: float) -> Floats:
    """Return the mean squared standard errors (R,) of earlier flights: their scatter has them."""
    return np.mean([np.nan_to_num(np.array(one.error) / unit) ** 2 for _, one in earlier], axis=0)


def _mean(values: Floats) -> Floats:
    """Return the mean over the first axis of the finite values; NaN where there is none."""
    finite = np.isfinite(values)
    count = finite.sum(axis=0)
    total = np.where(finite, values, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), math.nan)
