"""Parameters of two names are read under both, in one unit."""

import math

import pytest

from thrustmargin.gcs_plugin.telemetry.settings.pulse_range import whole_number
from thrustmargin.gcs_plugin.telemetry.settings.reported_airframe import reported_airframe
from thrustmargin.mission.plan_check import OTHER_NAMES, parameter


def test_a_speed_is_in_metres_a_second_under_either_name():
    assert parameter({"WPNAV_SPEED": 850.0}, "WP_SPD") == pytest.approx(8.5)
    assert parameter({"WP_SPD": 8.5}, "WP_SPD") == 8.5
    # Both are there while a ground station keeps an older list: the vehicle flies by the newer.
    assert parameter({"WP_SPD": 6.0, "WPNAV_SPEED": 850.0}, "WP_SPD") == 6.0
    assert math.isnan(parameter({}, "WP_SPD"))
    assert math.isnan(parameter({}, "MOT_PWM_MIN"))
    # A damaged log can have a parameter without a name, which is nobody's.
    assert math.isnan(parameter({"": 3.0}, "BATT_MONITOR"))


def test_whole_numbers_go_by_both_names():
    assert whole_number({"SYSID_THISMAV": 7.0}, "MAV_SYSID") == 7
    assert whole_number({"FRAME": 0.0}, "FRAME_TYPE") == 0
    plus = reported_airframe({"FRAME": 0.0}, texts=("APM:Copter V3.2.1", "Frame: OCTA_QUAD"))
    cross = reported_airframe({"FRAME": 1.0}, texts=("APM:Copter V3.2.1", "Frame: OCTA_QUAD"))
    assert (plus.layout, cross.layout) == ("octo-coaxial-plus", "octo-coaxial-x8")


def test_no_name_is_its_own_other():
    others = {other for other, _ in OTHER_NAMES.values()}
    assert not others & OTHER_NAMES.keys()


def test_the_names_of_4_7_are_those_that_ardupilot_lists():
    """Every parameter of a mission that was renamed, written down from its list by hand."""
    renamed = {
        **{f"WPNAV_{old}": f"WP_{new}" for old, new in (("SPEED_UP", "SPD_UP"), ("JERK", "JERK"))},
        **{"WPNAV_SPEED_DN": "WP_SPD_DN", "WPNAV_ACCEL": "WP_ACC", "WPNAV_ACCEL_Z": "WP_ACC_Z"},
        **{"WPNAV_ACCEL_C": "WP_ACC_CNR", "WPNAV_RADIUS": "WP_RADIUS_M", "RTL_ALT": "RTL_ALT_M"},
        **{"LAND_SPEED": "LAND_SPD_MS", "LAND_ALT_LOW": "LAND_ALT_LOW_M"},
        **{"PSC_JERK_Z": "PSC_D_JERK", "ATC_SLEW_YAW": "ATC_RATE_WPY_MAX"},
    }
    for old, new in renamed.items():
        kept = 1.0 if "JERK" in old else 0.01
        assert parameter({old: 300.0}, new) == pytest.approx(300.0 * kept), old
