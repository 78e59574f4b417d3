"""Fit the electric power of an aircraft to its rotor speeds, from the flights that measured it.

    P = k rho / rho_ref sum of N³ over the rotors

Torque and thrust of a rotor are proportional to rho N², so its power is to rho N³ (Leishman,
Principles of Helicopter Aerodynamics, 2.3). The coefficient k contains propeller, motor and speed
controller, and also how the current sensor reads; it differs a little from flight to flight. Its
standard error is that of one flight on a further day.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist, fmean

from thrustmargin.models.errors import ModelError
from thrustmargin.models.scores import error_of_further

#: Standard deviation of ln k between flights before any is seen. Source: five flights of two days
#: of a heavy quad, Quiver PT1 (github.com/Arrow-air/project-quiver): 2.1 %.
POWER_SCATTER = 0.03
#: Standard error of ln P by a formula that no current has confirmed: its 90 % interval is 34 % less
#: to 51 % more. Source: of the same aircraft the formula gives 26 to 33 % too little.
UNMEASURED_POWER_ERROR = 0.25
POWER_COVERAGE = 0.9  # nominal coverage of every interval of power, energy and voltage
NORMAL = NormalDist().inv_cdf((1.0 + POWER_COVERAGE) / 2.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightPower:
    """The power coefficient that one flight measured."""

    flight: str  # digest of the log
    day: int  # number of the day; flights of one day share their battery and air
    coefficient: float  # W/rpm³ in air of the model's reference density


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerLaw:
    """The power coefficient of an aircraft with its standard error, from F flights.

    Raises ModelError without a flight, and for a coefficient that is not a positive number.
    """

    flights: tuple[FlightPower, ...]

    def __post_init__(self) -> None:
        if not self.flights:
            raise ModelError("its power law has no flight")
        for one in self.flights:
            if not (math.isfinite(one.coefficient) and one.coefficient > 0.0):
                raise ModelError(f"its power coefficient {one.coefficient} must be above 0")

    @property
    def days(self) -> int:
        """Return the number of days on which the flights were flown."""
        return len({one.day for one in self.flights})

    @property
    def coefficient(self) -> float:
        """Return k, W/rpm³: the geometric mean over the days of the mean of each day's flights."""
        return math.exp(self._mean)

    @property
    def error(self) -> float:
        """Return the standard error of ln k for one flight on a further day.

        It combines the scatter between flights, shrunk towards POWER_SCATTER where they are few,
        and the error of their mean, in which each day counts as one independent value.
        """
        values = [math.log(one.coefficient) for one in self.flights]
        prior, days = POWER_SCATTER, self.days
        return error_of_further(values, self._mean, prior=prior, independent=days)

    @property
    def _mean(self) -> float:
        """Return the mean of ln k over the days."""
        by_day: dict[int, list[float]] = {}
        for one in self.flights:
            by_day.setdefault(one.day, []).append(math.log(one.coefficient))
        return fmean(fmean(values) for values in by_day.values())


def power_law(flights: Sequence[FlightPower], known: PowerLaw | None = None) -> PowerLaw | None:
    """Return the power law of `flights` together with the flights of `known`; None without any.

    A flight in both counts once, with the value in `flights`. Flights without a coefficient (NaN)
    are left out.
    """
    new = {one.flight: one for one in flights if one.coefficient > 0.0}
    kept = [one for one in (known.flights if known else ()) if one.flight not in new]
    every = (*kept, *new.values())
    return PowerLaw(flights=every) if every else None


def power_factors(error: float) -> tuple[float, float]:
    """Return the factors from a power to the ends of its 90 % interval, if ln power has that
    `error`."""
    return math.exp(-NORMAL * error), math.exp(NORMAL * error)
