"""A leg in time against sums by hand."""

import numpy as np
import pytest

from thrustmargin.mission.forecast.leg_profile import leg_profile


@pytest.mark.parametrize("length", [0.5, 3.0, 20.0, 400.0])
def test_a_leg_keeps_its_limits_and_ends_where_it_should(length):
    made = leg_profile(length, 4.0, 1.5, 1.0, 3.0)
    time_s = np.linspace(0.0, made.seconds, 20_001)
    way, speed, gained = made.at(time_s)
    step = time_s[1]
    assert way[0] == 0.0
    assert way[-1] == pytest.approx(length, rel=1e-6)
    assert speed.max() <= 4.0 + 1e-9
    assert np.abs(gained).max() <= 1.5 + 1e-9
    assert np.abs(np.diff(gained)).max() / step <= 1.0 * 1.02
    assert np.abs(np.diff(way) / step - 0.5 * (speed[1:] + speed[:-1])).max() < 0.02
    assert np.abs(np.diff(speed) / step - 0.5 * (gained[1:] + gained[:-1])).max() < 0.05


def test_with_endless_jerk_it_is_the_trapezium_of_the_books():
    made = leg_profile(100.0, 5.0, 2.5, 1e4, 1e9)
    assert made.seconds == pytest.approx(100.0 / 5.0 + 5.0 / 2.5, rel=1e-3)


def test_a_short_leg_never_reaches_its_speed():
    made = leg_profile(10.0, 5.0, 2.5, 1e4, 1e9)
    assert made.top_speed == pytest.approx(5.0, abs=0.011)
    assert leg_profile(2.5, 5.0, 2.5, 1e4, 1e9).top_speed == pytest.approx(2.5, abs=0.011)


def test_jerk_that_must_be_gained_takes_longer():
    """4 m/s at 1.5 m/s² with jerk 1 m/s³ and ramps of 0.5 s: 4/1.5 + 1.5/1 + 0.5 s."""
    made = leg_profile(200.0, 4.0, 1.5, 1.0, np.pi)
    assert made.pulse.seconds == pytest.approx(4.0 / 1.5 + 1.5 + 0.5, rel=1e-6)


def test_a_leg_that_does_not_brake_ends_at_its_speed():
    """10 m at 0.5 m/s with 1 m/s²: 0.5 s to gain it, over 0.125 m, and the rest at 0.5 m/s."""
    made = leg_profile(10.0, 0.5, 1.0, 1e4, 1e9, brakes=False)
    assert made.seconds == pytest.approx(0.5 + (10.0 - 0.125) / 0.5, rel=1e-3)
    way, speed, _ = made.at(np.array([made.seconds - 1e-6]))
    assert way[0] == pytest.approx(10.0, abs=1e-3)
    assert speed[0] == pytest.approx(0.5)
    short = leg_profile(0.02, 0.5, 1.0, 1e4, 1e9, brakes=False)
    assert short.top_speed == pytest.approx(0.2, abs=0.011)
