"""Legs in time and the corners between them."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.mission.plans_made import FIRST, SECOND, plan_of, spot
from thrustmargin.mission.forecast.limits import flight_limits
from thrustmargin.mission.forecast.way import course, plan_legs, target, timed_legs, way_leg
from thrustmargin.mission.steps import plan_steps

LIMITS = flight_limits({"WP_SPD": 4.0, "WP_ACC": 1.5, "WP_RADIUS_M": 1.0, "ATC_INPUT_TC": 0.25})
CORNERS = np.array([[0.0, 0.0, -3.0], [60.0, 0.0, -3.0], [60.0, 40.0, -3.0]])


def flown(*, stops=False, wait_s=0.0, corners=CORNERS, limits=LIMITS):
    legs = [
        way_leg(limits, k, a, b, stops=stops, wait_s=wait_s)
        for k, (a, b) in enumerate(pairwise(corners), start=1)
    ]
    timed = timed_legs([leg for leg in legs if leg is not None])
    time_s = np.arange(0.0, timed[-1].end_s, 0.02)
    return timed, time_s, *target(timed, time_s)


def test_a_cut_corner_keeps_within_the_radius_and_the_acceleration():
    _, _, place, speed, gained = flown()
    off = np.linalg.norm(place - CORNERS[1], axis=1)
    assert 0.1 < off.min() <= 1.0
    assert np.linalg.norm(speed, axis=1).max() <= 4.0 + 1e-6
    assert np.hypot(gained[:, 0], gained[:, 1]).max() <= 3.0 + 1e-6
    assert np.linalg.norm(place[-1] - CORNERS[2]) < 0.01


def test_back_along_the_same_line_the_push_in_the_corner_has_its_limit():
    """2 m/s² of WP_ACC_CNR; braking and gaining speed at 1.5 m/s² at once would be 3."""
    back = CORNERS.copy()
    back[2] = CORNERS[0]
    most = {}
    for corner in (2.0, 9.0):
        limits = replace(LIMITS, corner_acceleration=corner, radius=9.0)
        most[corner] = np.abs(flown(corners=back, limits=limits)[4][:, 0]).max()
    assert most[2.0] == pytest.approx(2.0, abs=0.05)
    assert most[9.0] > 2.5


@pytest.mark.parametrize("names", [{"WP_SPD": 4.0}, {"WPNAV_SPEED": 400.0}])
def test_straight_up_and_down_again_the_vertical_push_has_its_limit(names):
    """1 m/s² of WP_ACC_Z by default; braking and sinking at once would be 2."""
    up = np.array([[0.0, 0.0, -3.0], [0.0, 0.0, -23.0], [0.0, 0.0, -3.0]])
    gained = flown(corners=up, limits=flight_limits({**names, "WP_RADIUS_M": 5.0}))[4]
    assert np.abs(gained[:, 2]).max() == pytest.approx(1.0, abs=0.01)


def test_over_a_crest_of_any_slope_legs_overlap_alike():
    """12 m up in 24 m and down again; each leg has the largest vertical acceleration by itself."""
    limits = replace(LIMITS, climb_speed=3.0, descent_speed=2.5, climb_acceleration=1.5)
    overlaps = []
    for rise in np.arange(11.5, 12.05, 0.1):
        crest = np.array([[0.0, 0.0, -3.0], [24.0, 0.0, -3.0 - rise], [48.0, 0.0, -3.0]])
        up, down = flown(corners=crest, limits=limits)[0]
        overlaps.append(up.end_s - down.start_s)
    assert np.ptp(overlaps) < 0.1


def test_a_corner_that_is_cut_is_never_stood_still_at():
    _, time_s, _, speed, _ = flown()
    inside = (time_s > 2.0) & (time_s < time_s[-1] - 3.0)
    assert np.linalg.norm(speed[inside], axis=1).min() > 0.5


def test_a_stop_is_a_stop_and_waits():
    timed, _, place, speed, _ = flown(stops=True, wait_s=3.0)
    still = np.linalg.norm(speed, axis=1) < 1e-6
    assert timed[1].start_s == pytest.approx(timed[0].end_s + 3.0)
    assert np.count_nonzero(still & (np.linalg.norm(place - CORNERS[1], axis=1) < 1e-3)) > 145


def test_position_is_the_sum_of_speed():
    _, time_s, place, speed, _ = flown()
    summed = np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time_s)[:, None], axis=0)
    assert np.abs(CORNERS[0] + summed - place[1:]).max() < 0.05


def test_straight_on_is_faster_than_around_a_corner():
    straight = CORNERS.copy()
    straight[2] = [100.0, 0.0, -3.0]
    assert flown(corners=straight)[1][-1] < flown()[1][-1]


@pytest.mark.parametrize(("up", "most"), [(20.0, 2.5), (-20.0, 1.5)])
def test_climb_and_descent_have_speeds_of_their_own(up, most):
    leg = way_leg(LIMITS, 1, np.array([0.0, 0.0, -30.0]), np.array([0.0, 0.0, -30.0 - up]))
    assert leg is not None
    assert leg.speed == pytest.approx(most)
    assert leg.acceleration == pytest.approx(1.0)


def test_a_leg_to_where_it_is_is_none():
    assert way_leg(LIMITS, 1, CORNERS[0], CORNERS[0]) is None


def legs_of(*rows, **parameters):
    limits = flight_limits({"RTL_ALT_M": 30.0, **parameters})
    plan = plan_of(*rows)
    return plan_legs(plan, plan_steps(plan), limits), limits


def test_a_take_off_without_a_place_climbs_to_its_own_height():
    """Ground stations write latitude and longitude 0 there; the return is at 30 m."""
    (up, along, *_), _ = legs_of((22, (0.0, 0.0, 7.0)), (16, spot(FIRST, 11.0, 7.0)), (20,))
    assert up.end_ned == pytest.approx([0.0, 0.0, -7.0])
    assert along.vector[2] == pytest.approx(0.0)


def test_a_place_without_degrees_is_a_change_of_height():
    legs, _ = legs_of((22, (0.0, 0.0, 7.0)), (16, spot(FIRST, 11.0, 7.0)), (16, (0.0, 0.0, 9.0)))
    assert legs[-1].vector == pytest.approx([0.0, 0.0, -2.0])
    stays, _ = legs_of((22, (0.0, 0.0, 7.0)), (16, spot(FIRST, 11.0, 7.0)), (16, (0.0, 0.0, 0.0)))
    assert len(stays) == 2


def test_a_landing_slows_down_once_and_meets_the_ground_moving():
    """From 30 m at 1.5 m/s, from 10 m on at 0.5 m/s: nowhere does it stop between."""
    legs, _ = legs_of((22, (0.0, 0.0, 30.0)), (20,), WP_ACC_Z=1.0)
    timed = timed_legs(legs)
    time_s = np.arange(0.0, timed[-1].end_s, 0.02)
    place, speed, _ = target(timed, time_s)
    down = speed[:, 2]
    landing = time_s > timed[-2].start_s + 2.0
    assert down[landing].min() > 0.3
    assert down[-1] == pytest.approx(0.5, abs=0.01)
    assert abs(place[-1, 2]) < 0.05
    # 20 m at 1.5 and 10 m at 0.5 m/s, and 1 s for each of the two changes of speed.
    took = time_s[-1] - timed[-2].start_s
    assert took == pytest.approx(20.0 / 1.5 + 10.0 / 0.5 + 1.5, abs=1.0)


def test_a_return_turns_home_before_its_climb_has_ended():
    """By 20 m, at the same time by the old and the new names."""
    rows = ((22, (0.0, 0.0, 10.0)), (16, spot(SECOND, 11.0, 10.0)), (20,))

    def early_s(px4: bool = False, **parameters: float) -> float:
        limits = flight_limits({"RTL_ALT_M": 30.0, "RTL_RETURN_ALT": 30.0, **parameters}, px4=px4)
        plan = plan_of(*rows)
        up, home = timed_legs(plan_legs(plan, plan_steps(plan), limits))[2:4]
        assert up.leg.vector == pytest.approx([0.0, 0.0, -20.0])
        assert home.leg.end_ned == pytest.approx([0.0, 0.0, -30.0])
        return up.end_s - home.start_s

    assert early_s(px4=True) == 0.0
    assert 3.0 < early_s(WP_SPD=4.0, WP_ACC_Z=0.5) < 6.0
    assert 3.0 < early_s(WPNAV_SPEED=400.0, WPNAV_ACCEL_Z=50.0) < 6.0


OUT = ((22, (0.0, 0.0, 30.0)), (16, spot(SECOND, 11.0, 30.0)), (20,))


@pytest.mark.parametrize(("behaviour", "turned"), [(1.0, 180.0), (2.0, 0.0)])
def test_on_the_return_the_nose_stays_or_turns_as_the_vehicle_is_set(behaviour, turned):
    legs, limits = legs_of(*OUT, WP_YAW_BEHAVIOR=behaviour)
    made = course(legs, limits)
    back = next(timed for timed in made.legs if timed.leg.nose_back or timed.leg.holds_nose)
    yaw = np.degrees(np.interp(back.end_s - 1.0, made.time_s, made.yaw))
    assert abs(yaw) == pytest.approx(turned, abs=1.0)


def test_over_home_the_nose_turns_as_before_take_off_and_then_it_lands():
    """From south to east with 10 °/s: 9 s, longer than the 5 s that it waits anyway."""
    slow = {"WP_YAW_BEHAVIOR": 1.0, "ATC_RATE_Y_MAX": 10.0}
    limits = flight_limits({"RTL_ALT_M": 30.0, **slow})
    plan, nose = plan_of(*OUT), np.radians(90.0)
    legs = plan_legs(plan, plan_steps(plan), limits, start_yaw=nose)
    waits = [leg.wait_s for leg in legs if leg.wait_s]
    assert waits == [pytest.approx(9.3, abs=0.7)]
    yaw = np.degrees(course(legs, limits, start_yaw=nose).yaw)
    assert np.remainder(yaw[-1], 360.0) == pytest.approx(90.0, abs=2.0)
    held, _ = legs_of(*OUT, WP_YAW_BEHAVIOR=2.0)
    assert [leg.wait_s for leg in held if leg.wait_s] == [5.0]


def test_the_first_turn_is_from_the_heading_before_take_off():
    legs, limits = legs_of((22, (0.0, 0.0, 5.0)), (16, spot(SECOND, 11.0, 5.0)))
    yaw = np.degrees(course(legs, limits, start_yaw=np.radians(90.0)).yaw)
    assert yaw[0] == pytest.approx(90.0)
    assert yaw[-1] == pytest.approx(0.0, abs=1.0)
    assert np.abs(np.degrees(course(legs, limits).yaw)).max() < 0.1
