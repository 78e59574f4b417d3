"""The nose follows the way flown as fast as it may."""

import math
from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.mission.forecast.limits import flight_limits
from thrustmargin.mission.forecast.way import heading

LIMITS = replace(
    flight_limits({"WP_SPD": 4.0}), yaw_rate=math.radians(45.0), yaw_acceleration=math.radians(25.0)
)
TIME = np.arange(0.0, 20.0, 0.1)


def turned(to_deg, limits=LIMITS, speed=4.0, over_s=0.0):
    """Degrees of a nose whose way turns from north to `to_deg` at 2 s."""
    way = np.radians(np.clip((TIME - 2.0) / max(over_s, 1e-6), 0.0, 1.0) * to_deg)
    velocity = speed * np.column_stack([np.cos(way), np.sin(way), 0.0 * way])
    gained = np.gradient(velocity, TIME, axis=0) * (over_s > 0.0)
    yaw, off = heading(TIME, velocity, gained, np.full(TIME.size, np.nan), limits, 0.0)
    return np.degrees(yaw), np.degrees(off)


def test_rate_and_its_gain_keep_their_limits():
    yaw, _ = turned(170.0)
    rate = np.diff(yaw) / 0.1
    assert rate.max() <= 45.0 + 1e-6
    assert np.abs(np.diff(rate)).max() / 0.1 <= 25.0 * 1.03
    assert yaw[-1] == pytest.approx(170.0, abs=0.1)


def test_a_step_takes_as_long_as_by_hand():
    """90° with 25 °/s² and no limit of rate: half gained, half lost, 2 sqrt(90/25) s; the last
    4.5° of it take sqrt(2 4.5/25) s."""
    yaw, _ = turned(90.0, replace(LIMITS, yaw_rate=10.0))
    arrived = TIME[np.flatnonzero(np.abs(yaw - 90.0) > 4.5)[-1]] - 2.0
    assert arrived == pytest.approx(3.79 - 0.60, abs=0.15)


def test_a_way_that_turns_faster_than_the_nose_makes_it_go_beyond():
    yaw, _ = turned(90.0, over_s=2.0)
    assert 93.0 < yaw.max() < 130.0
    quick = replace(LIMITS, yaw_rate=10.0, yaw_acceleration=20.0)
    assert turned(90.0, quick, over_s=2.0)[0].max() < 92.0


def test_it_stays_while_too_slow_and_where_it_is_not_to_follow():
    assert np.abs(turned(90.0, speed=0.1)[0]).max() == 0.0
    assert np.abs(turned(90.0, replace(LIMITS, nose_ahead=False))[0]).max() == 0.0


def test_the_short_way_around():
    yaw, _ = turned(-170.0, over_s=3.0)
    assert yaw[-1] == pytest.approx(-170.0, abs=0.1)
    velocity = np.tile([-4.0, -0.1, 0.0], (TIME.size, 1))
    yaw, _ = heading(
        TIME, velocity, 0.0 * velocity, np.full(TIME.size, np.nan), LIMITS, math.radians(175.0)
    )
    assert np.degrees(yaw[-1]) == pytest.approx(181.4, abs=0.2)


def test_what_the_plan_orders_comes_first():
    velocity = np.tile([4.0, 0.0, 0.0], (TIME.size, 1))
    yaw, _ = heading(
        TIME, velocity, 0.0 * velocity, np.full(TIME.size, math.radians(30.0)), LIMITS, 0.0
    )
    assert np.degrees(yaw[-1]) == pytest.approx(30.0, abs=0.1)
