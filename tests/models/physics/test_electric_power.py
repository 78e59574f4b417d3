"""The power law of an aircraft against sums by hand, and the battery of its earlier flights."""

import math

import pytest

from thrustmargin.models.errors import ModelError
from thrustmargin.models.physics.electric_power import (
    FlightPower,
    PowerLaw,
    power_factors,
    power_law,
)
from thrustmargin.models.physics.known_battery import known_battery


def flown(name: str, day: int, coefficient: float) -> FlightPower:
    return FlightPower(flight=name, day=day, coefficient=coefficient)


def test_the_law_is_the_mean_of_days_and_its_error_that_of_a_flight_on_a_further_day():
    # Two flights of one day count as one: exp((ln 1 + ln 4) / 2) = 2 with the other day's 2.
    law = PowerLaw(flights=(flown("a", 1, 1.0), flown("b", 1, 4.0), flown("c", 2, 2.0)))
    assert law.coefficient == pytest.approx(2.0)
    assert law.days == 2
    # Scatter: (3 flights of 3 % and twice ln 2 squared) over 3 + 3 - 1; half more for two days.
    squares = 3 * 0.03**2 + 2 * math.log(2.0) ** 2
    assert law.error == pytest.approx(math.sqrt(squares / 5.0 * 1.5))


def test_one_flight_is_as_sure_as_flights_of_a_measured_aircraft_scatter():
    law = PowerLaw(flights=(flown("a", 1, 1.4e-8),))
    assert law.coefficient == pytest.approx(1.4e-8)
    assert law.error == pytest.approx(0.03 * math.sqrt(2.0))


def test_without_a_current_the_interval_contains_30_per_cent_either_way():
    less, more = power_factors(0.25)
    assert less < 0.7
    assert more > 1.3
    assert more > 1.0 / 0.67  # also the formula that gave 33 % too little


def test_a_flight_counts_once_and_one_without_a_current_not_at_all():
    known = power_law([flown("a", 1, 1.0), flown("b", 2, math.nan)])
    assert known is not None
    assert [one.flight for one in known.flights] == ["a"]
    again = power_law([flown("a", 1, 1.1), flown("c", 3, 1.2)], known)
    assert again is not None
    assert [one.coefficient for one in again.flights] == [1.1, 1.2]
    assert power_law([flown("b", 2, math.nan)]) is None


@pytest.mark.parametrize("wrong", [(), (flown("a", 1, 0.0),), (flown("a", 1, math.inf),)])
def test_a_law_of_nothing_is_refused(wrong: tuple[FlightPower, ...]):
    with pytest.raises(ModelError, match="power"):
        PowerLaw(flights=wrong)


def test_the_battery_of_earlier_flights_is_their_middle():
    known = known_battery([58.0, math.nan, 54.0, 56.0], [(0.02, 0.001), (0.5, 0.4), (0.045, 0.001)])
    assert (known.rest_voltage, known.flights) == (56.0, 3)
    # Three flights of 3 % of 56 V, and 2 V above and below: over 5, and a third more for the mean.
    assert known.rest_voltage_error == pytest.approx(
        math.sqrt((3 * 1.68**2 + 8.0) / 5.0 * 4.0 / 3.0)
    )
    # The second one, 0.5 ohm give or take 0.4, says nothing; the root of 0.02 times 0.045 is 0.03.
    assert known.resistance == pytest.approx(0.03)
    assert known.resistance_error > 0.3 * 0.03  # they differ by a factor of two
    nothing = known_battery([math.nan], [(math.nan, math.nan)])
    assert math.isnan(nothing.rest_voltage)
    assert math.isnan(nothing.resistance)
    assert nothing.flights == 0
