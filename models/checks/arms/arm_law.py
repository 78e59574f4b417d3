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
from numpy.typing import NDArray

from thrustmargin.models.checks.arms.arm_figures import ArmFigures, ArmQuantity
from thrustmargin.models.errors import ModelError
from thrustmargin.models.flight import Floats
from thrustmargin.models.physics.electric_power import POWER_SCATTER
from thrustmargin.models.scores import PRIOR_FLIGHTS

#: Fewest flights from which an arm's own figures are expected of a further one.
LEAST_FLIGHTS = 3
#: Standard deviation between flights of one arm about the others, as a share, before any is seen.
#: Power: that of the whole aircraft. Output: that from motor to motor of one make. Resistance and
#: offset: one step, 0.1 V, of what most ESCs report, at 50 V. Thrust: a third of the trims of
#: `rotor_faults`. Heat: a reading of whole degrees in a rise of 7 K. Vibration: a hundredth of g,
#: the noise of a mounted IMU. Jumps: 0.3 % of speed, the noise of an ESC's speed. Desync and
#: glitches: one in 17 minutes; in 4.2 h of recorded flights there was none. Lost frames: in those
#: flights none was lost; one pause of half a second in 150 s. Standing: 0.2 A, two steps of an ESC,
#: at 20 A. Spool-up and shaking: of a heavy quad between flights or days. Clipping: a shock or two.
USUAL_SCATTER: Mapping[ArmQuantity, float] = MappingProxyType(
    {
        ArmQuantity.THRUST: 0.03,
        ArmQuantity.POWER: POWER_SCATTER,
        ArmQuantity.OUTPUT: 0.015,
        ArmQuantity.RESISTANCE: 0.002,
        ArmQuantity.OFFSET: 0.002,
        ArmQuantity.ESC_HEAT: 0.15,
        ArmQuantity.MOTOR_HEAT: 0.15,
        ArmQuantity.VIBRATION: 0.01,
        ArmQuantity.JUMPS: 0.003,
        ArmQuantity.DESYNC: 0.005,
        ArmQuantity.GLITCHES: 0.005,
        ArmQuantity.LOST: 0.003,
        ArmQuantity.STANDING: 0.01,
        ArmQuantity.SPOOL_UP: 0.05,
        ArmQuantity.SHAKING: 0.35,
        ArmQuantity.CLIPPING: 0.05,
    }
)
#: Standard deviation, as a share, of what moves all arms of a flight together.
TOGETHER = 0.3
#: Of a sound instrument the offset is zero, whatever earlier flights had; so are falls of speed,
#: lost frames, and current without speed. Their scatter is known as well as if ABSOLUTE_FREEDOM
#: values had shown it: an offset's is a step of the reading.
ABSOLUTE = frozenset(
    {
        *(ArmQuantity.OFFSET, ArmQuantity.DESYNC, ArmQuantity.GLITCHES),
        *(ArmQuantity.LOST, ArmQuantity.STANDING),
    }
)
ABSOLUTE_FREEDOM = 30.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmLaw:
    """The figures of the flights that a further one is compared with.

    Raises ModelError where the flights have different numbers of arms.
    """

    flights: tuple[ArmFigures, ...]

    def __post_init__(self) -> None:
        counts = {
            len(figure.value)
            for one in self.flights
            for figure in one.figures
            if not figure.quantity.of_aircraft
        }
        if len(counts) > 1:
            raise ModelError(f"its arms' figures are of {sorted(counts)} arms")

    def without(self, flights: Sequence[ArmFigures]) -> tuple[ArmFigures, ...]:
        """Return the earlier flights that are none of `flights`, so that no flight is compared with
        itself.
        """
        named = {one.flight for one in flights}
        return tuple(one for one in self.flights if one.flight not in named)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Departure:
    """Difference of one flight's arms from the expected figures of one quantity, as shares.

    `departure` (R,) is NaN where unknown; `covariance` (R, R) is that of a sound aircraft, without
    changes common to all arms; `freedom` is the number of flights that its scale is known from.
    """

    quantity: ArmQuantity
    departure: Floats
    covariance: Floats
    own: Floats  # (R, R) the part of it that this flight's own blocks show
    freedom: float


def departures(
    flights: Sequence[ArmFigures], law: ArmLaw | None, modes: Floats | None = None
) -> tuple[Departure, ...]:
    """Compare the arms in `flights` (as their mean) with the earlier flights of `law`, by quantity.

    `modes` (R, R) has the modes of the layout as columns of unit length: thrust is shared by modes,
    as the centre of gravity moves arms together; None: by arms. Quantities that no flight has, or
    fewer than LEAST_FLIGHTS earlier ones, are left out, but for those that are zero on a sound
    aircraft, which need no earlier flight.
    """
    earlier = () if law is None else law.without(flights)
    found = []
    for quantity in ArmQuantity:
        new, old = _Group.of(flights, quantity), _Group.of(earlier, quantity)
        if new is None:
            continue
        if quantity in ABSOLUTE:
            found.append(_absolute(new))
        elif old is not None and len(old.values) >= LEAST_FLIGHTS:
            used = modes if quantity is ArmQuantity.THRUST else None
            found.append(_departure(new, old, used))
    return tuple(found)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Group:
    """Values of one quantity in F flights on D days."""

    quantity: ArmQuantity
    unit: float  # median of the flights' units
    values: Floats  # (F, R)
    squared_errors: Floats  # (F, R) as shares; 0 where unknown
    day: NDArray[np.int64]  # (F,) index of the flight's day
    by_day: Floats  # (D, R) mean of each day's flights

    @classmethod
    def of(cls, flights: Sequence[ArmFigures], quantity: ArmQuantity) -> _Group | None:
        """Collect the values of `quantity` in `flights`, and their means by day.

        None if no flight has the quantity.
        """
        seen = [(one.day, found) for one in flights if (found := one.of(quantity)) is not None]
        if not seen:
            return None
        unit = float(np.median([one.unit for _, one in seen]))
        values = np.array([one.value for _, one in seen])
        errors = np.array([one.error for _, one in seen])
        numbers, day = np.unique([day for day, _ in seen], return_inverse=True)
        by_day = np.array([_mean(values[day == k]) for k in range(numbers.size)])
        squared = np.nan_to_num(errors / unit) ** 2
        return cls(
            quantity=quantity,
            unit=unit,
            values=values,
            squared_errors=squared,
            day=day,
            by_day=by_day,
        )


def _absolute(new: _Group) -> Departure:
    """Return the departure from zero of a quantity that is zero on a sound aircraft.

    Earlier flights are not needed; the covariance is the usual scatter.
    """
    usual = USUAL_SCATTER[new.quantity]
    return Departure(
        quantity=new.quantity,
        departure=_mean(new.by_day) / new.unit,
        covariance=usual**2 * np.eye(new.values.shape[1]),
        own=np.diag(np.mean(new.squared_errors, axis=0) / len(new.values)),
        freedom=ABSOLUTE_FREEDOM,
    )


def _departure(new: _Group, old: _Group, modes: Floats | None) -> Departure:
    """Return the difference of one quantity of R arms from its mean over the days of earlier
    flights.

    `new` are the flights to test, `old` the earlier ones. The variance between days is divided by
    the number of days on either side, that within a day by the number of new flights. All are in
    the unit of the new flights. `modes` (R, R) has as columns the directions that scatter
    independently; None: each arm.
    """
    values, by_day = old.values / new.unit, old.by_day / new.unit
    days, rotors = by_day.shape
    expected = _mean(by_day)
    axes = np.eye(rotors) if modes is None else modes
    # Arms of one make scatter alike; subtracting the mean removes one degree of freedom.
    alike = modes is None and not new.quantity.of_aircraft
    usual, counted = USUAL_SCATTER[new.quantity], rotors - 1 if alike else 1
    between = _squares_of(by_day - expected, axes, alike=alike)
    within = _squares_of(values - by_day[old.day], axes, alike=alike)
    freedom = PRIOR_FLIGHTS + (days - 1) * counted
    variance = (PRIOR_FLIGHTS * usual**2 + between) / freedom
    variance = variance * (1.0 / len(new.by_day) + 1.0 / days)
    variance = variance + within / max((len(values) - days) * counted, 1) / len(new.values)
    # Earlier flights' scatter has their own errors; only what this flight is worse counts again.
    own = np.mean(new.squared_errors, axis=0) - np.mean(old.squared_errors, axis=0)
    return Departure(
        quantity=new.quantity,
        departure=_mean(new.by_day) / new.unit - expected,
        covariance=axes @ np.diag(variance) @ axes.T,
        own=np.diag(np.maximum(own, 0.0) / len(new.values)),
        freedom=freedom,
    )


def _squares_of(left: Floats, axes: Floats, *, alike: bool) -> Floats:
    """Return the sums of squares (R,) of `left` (F, R) projected on the columns of `axes` (R, R).

    `alike`: all R results are the sum of squares of all arms about each row's mean. Rows with a NaN
    are left out.
    """
    left = left[np.isfinite(left).all(axis=1)]
    if alike:
        left = left - left.mean(axis=1, keepdims=True)
        return np.full(left.shape[1], np.sum(left**2))
    return np.sum((left @ axes) ** 2, axis=0)


def _mean(values: Floats) -> Floats:
    """Return the mean over the first axis of the finite values; NaN where none is finite."""
    finite = np.isfinite(values)
    count = finite.sum(axis=0)
    total = np.where(finite, values, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), math.nan)
