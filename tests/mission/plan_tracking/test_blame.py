"""Who is blamed for figures made by hand, without a flight."""

import math
from dataclasses import replace

import pytest

from thrustmargin.mission.forecast.battery import FlightBattery
from thrustmargin.mission.forecast.plan_flight import PlanConditions
from thrustmargin.mission.plan_tracking.blame import Off, ShownDay, which_was_off
from thrustmargin.mission.plan_tracking.stretches import Pair, PlanComparison, StretchComparison

ALIKE = Pair(1.0, 1.0)
GIVEN = PlanConditions(fill_kg=8.0, density=1.2, battery=FlightBattery(voltage=50.0))
#: Nothing is shown but the wind.
STILL = ShownDay(wind_ned=(0.0, 0.0, 0.0), fill_kg=math.nan, density=math.nan)


def differing(*, thrust: float = 0.0, volts: float = 0.0) -> PlanComparison:
    """One stretch whose thrust and voltage are off by so much."""
    stretch = StretchComparison(
        item=1,
        kind="leg",
        seconds=Pair(10.0, 10.0),
        speed=ALIKE,
        utilisation_mean=Pair(0.4, 0.4 + thrust),
        utilisation_peak=ALIKE,
        interval=(0.9, 1.1),
        tank_end_kg=ALIKE,
        voltage=Pair(50.0, 50.0 + volts),
    )
    return PlanComparison(stretches=(stretch,))


def blamed(
    wind: tuple[float, float, float], *, as_given: PlanComparison, else_made: PlanComparison
) -> list[Off]:
    """Who is blamed where any change of what was given makes `else_made` of `as_given`."""
    given = replace(GIVEN, wind_ned=wind)
    return list(which_was_off(lambda c: as_given if c == given else else_made, given, STILL))


def test_what_takes_half_of_the_squares_away_is_blamed():
    """0.03 of thrust is twice what a good forecast has, so 4; 0.021 leaves 1.96 of it."""
    as_given, else_made = differing(thrust=0.03), differing(thrust=0.021)
    made = blamed((2.0, 0.0, 0.0), as_given=as_given, else_made=else_made)
    assert [one.what for one in made] == ["wind", "model"]


@pytest.mark.parametrize(
    ("as_given", "else_made"),
    [
        # 0.022 leaves 2.2.
        pytest.param({"thrust": 0.03}, {"thrust": 0.022}, id="not half"),
        # 0.01 of thrust is what any good forecast has; the 1 V stays.
        pytest.param({"thrust": 0.01, "volts": 1.0}, {"volts": 1.0}, id="half of what was near"),
    ],
)
def test_what_takes_less_away_is_not_blamed(
    as_given: dict[str, float], else_made: dict[str, float]
):
    made = blamed((2.0, 0.0, 0.0), as_given=differing(**as_given), else_made=differing(**else_made))
    assert "wind" not in [one.what for one in made]


@pytest.mark.parametrize("thrust", [0.0, 0.03])
def test_a_wind_is_as_strong_as_it_blows_level(thrust: float):
    """3 m/s north, 4 east and 12 down blow with 5, whether they took thrust or not."""
    made = blamed((3.0, 4.0, 12.0), as_given=differing(thrust=thrust), else_made=differing())
    (one,) = made
    assert (one.what, one.mattered) == ("wind", thrust > 0.0)
    assert one.amount == Pair(5.0, 0.0)


@pytest.mark.parametrize(("stated", "again"), [(50.0, 48.0), (0.0, 49.5), (math.nan, 49.5)])
def test_a_battery_is_shifted_from_what_was_stated_or_else_forecast(stated: float, again: float):
    """2 V less than was forecast: from the volts at rest, or from the mean under load."""
    given = replace(GIVEN, battery=FlightBattery(voltage=stated))
    low = differing(volts=-2.0)
    low = PlanComparison(stretches=(replace(low.stretches[0], voltage=Pair(51.5, 49.5)),))
    flown: list[float] = []

    def fly(conditions: PlanConditions) -> PlanComparison:
        flown.append(conditions.battery.voltage)
        return low if conditions is given else differing()

    (one,) = which_was_off(fly, given, replace(STILL, wind_ned=(math.nan, math.nan, 0.0)))
    assert (one.what, one.amount) == ("battery", Pair(51.5, 49.5))
    assert flown[-1] == pytest.approx(again)
