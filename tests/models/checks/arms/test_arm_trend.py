"""Arms whose power grows over the flights of an aircraft."""

import numpy as np
import pytest

from thrustmargin.models.checks.arms.arm_figures import ArmFigure, ArmFigures, ArmQuantity
from thrustmargin.models.checks.arms.arm_trend import power_trends


def flights(growth, count=21, per_day=1, scatter=0.005, seed=1):
    """Flights in which ln power of arm 3 grows by `growth` from the first to the last."""
    rng = np.random.default_rng(seed)
    made = []
    for k in range(count):
        together = 0.05 * rng.standard_normal()
        power = together + scatter * rng.standard_normal(4)
        power[2] += growth * k / (count - 1)
        one = ArmFigure(quantity=ArmQuantity.POWER, value=tuple(power), error=(0.001,) * 4)
        made.append(ArmFigures(flight=str(k), day=k // per_day, figures=(one,)))
    return made


def test_an_arm_that_needs_more_and_more_power_is_found_with_its_growth():
    (found,) = power_trends(flights(0.08))
    assert (found.arm, found.flights) == (2, 21)
    assert found.lower < np.expm1(0.08) < found.upper
    assert found.change == pytest.approx(0.08, abs=0.015)


def test_less_power_and_what_all_arms_need_more_is_no_wear():
    assert power_trends(flights(-0.03)) == ()
    together = flights(0.0)
    assert power_trends(together) == ()


def test_sound_aircraft_have_no_trend_but_one_in_a_hundred():
    found = sum(bool(power_trends(flights(0.0, count=10, seed=k))) for k in range(200))
    assert found <= 5


def test_few_days_show_no_trend_however_many_flights():
    assert power_trends(flights(0.08, count=21, per_day=5)) == ()
    assert power_trends([]) == ()
