"""Limits of a vehicle by its parameters, of old and new names."""

import math

import numpy as np
import pytest

from thrustmargin.mission.forecast.limits import flight_limits


def test_old_and_new_names_mean_the_same():
    old = {"WPNAV_SPEED": 400.0, "WPNAV_RADIUS": 100.0, "ATC_ACCEL_Y_MAX": 2500.0}
    new = {"WP_SPD": 4.0, "WP_RADIUS_M": 1.0, "ATC_ACC_Y_MAX": 25.0}
    one, two = flight_limits(old), flight_limits(new)
    assert one == two
    assert (one.speed, one.radius) == (4.0, 1.0)
    assert one.yaw_acceleration == pytest.approx(math.radians(25.0))


def test_what_no_parameter_says_has_its_default_and_is_named():
    made = flight_limits({"WPNAV_SPEED": 400.0})
    assert (made.acceleration, made.jerk, made.yaw_rate) == (2.5, 1.0, math.radians(60.0))
    assert "WP_ACC 2.5" in made.assumed
    assert not any(name.startswith("WP_SPD ") for name in made.assumed)


def test_a_corner_accelerates_twice_as_a_leg_unless_named():
    assert flight_limits({"WPNAV_ACCEL": 150.0}).corner_acceleration == 3.0
    named = flight_limits({"WPNAV_ACCEL": 150.0, "WPNAV_ACCEL_C": 100.0})
    assert named.corner_acceleration == 1.0


def test_the_lower_of_two_yaw_rates_holds():
    assert flight_limits({"ATC_RATE_Y_MAX": 45.0}).yaw_rate == pytest.approx(math.radians(45.0))
    assert flight_limits({"ATC_RATE_Y_MAX": 90.0}).yaw_rate == pytest.approx(math.radians(60.0))


def test_px4_has_its_own_names():
    made = flight_limits({"MPC_XY_CRUISE": 7.0, "WPNAV_SPEED": 400.0}, px4=True)
    assert (made.speed, made.acceleration) == (7.0, 3.0)
    assert not made.sprays_by_speed


def test_a_nose_that_is_told_to_stay_does_not_follow():
    assert flight_limits({}).nose_ahead
    assert not flight_limits({"WP_YAW_BEHAVIOR": 0.0}).nose_ahead


def test_on_the_return_only_some_noses_follow():
    """WP_YAW_BEHAVIOR 2, the default, is "next waypoint except on the return"."""
    assert not flight_limits({}).nose_home
    assert flight_limits({"WP_YAW_BEHAVIOR": 1.0}).nose_home
    assert flight_limits({"WP_YAW_BEHAVIOR": 3.0}).nose_home


def test_a_return_has_its_own_parameters():
    made = flight_limits({"RTL_SPEED": 300.0, "RTL_LOIT_TIME": 1500.0, "LAND_SPEED_HIGH": 80.0})
    assert (made.return_speed, made.return_wait_s, made.fast_landing) == (3.0, 1.5, 0.8)
    usual = flight_limits({"WP_SPD": 4.0, "WP_SPD_DN": 1.2})
    assert (usual.return_speed, usual.return_wait_s, usual.fast_landing) == (4.0, 5.0, 1.2)


def test_a_return_climbs_within_a_cone_and_by_a_least_climb():
    height, away = np.array([2.0, 2.0, 20.0]), np.array([4.0, 100.0, 100.0])
    top = flight_limits({"RTL_ALT_M": 15.0}).return_top(height, away)
    np.testing.assert_allclose(top, [12.0, 15.0, 20.0])
    steep = flight_limits({"RTL_ALT_M": 15.0, "RTL_CONE_SLOPE": 0.0, "RTL_CLIMB_MIN_M": 3.0})
    np.testing.assert_allclose(steep.return_top(height, away), [15.0, 15.0, 23.0])
