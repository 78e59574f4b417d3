"""Parameters of two names are read under both, in one unit."""

import math

import pytest

from thrustmargin.gcs_plugin.telemetry.reported_airframe import reported_airframe
from thrustmargin.gcs_plugin.telemetry.settings.parameter_values import (
    OTHER_NAMES,
    parameter,
    whole_number,
)


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
