"""The view's frames, and that a row shows what its analysis holds."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.gcs_plugin.view.view_flight import ROWS, flight
from thrustmargin.gcs_plugin.view.scene.aircraft import rotor_label
from thrustmargin.gcs_plugin.view.scene.shown_row import (
    ShownRow,
    enu,
    row_at,
    wxyz_from_attitude,
)
from thrustmargin.gcs_plugin.wording.language import margin_or_beyond


def turned(roll, pitch, yaw, vector):
    wxyz = wxyz_from_attitude(np.array([roll, pitch, yaw]))
    return Rotation.from_quat(wxyz, scalar_first=True).apply(vector)


def test_the_nose_points_north_at_yaw_zero_and_east_at_ninety_degrees():
    np.testing.assert_allclose(turned(0, 0, 0, [1, 0, 0]), [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(turned(0, 0, np.pi / 2, [1, 0, 0]), [1, 0, 0], atol=1e-12)


def test_pitch_lifts_the_nose_and_roll_lowers_the_right_side():
    assert turned(0, 0.2, 0, [1, 0, 0])[2] == pytest.approx(np.sin(0.2))
    right = [0, -1, 0]
    assert turned(0.2, 0, 0, right)[2] == pytest.approx(-np.sin(0.2))
    np.testing.assert_allclose(turned(0, 0, 0, right), [1, 0, 0], atol=1e-12)


def test_up_is_up_and_unknown_attitude_stays_unknown():
    np.testing.assert_array_equal(enu(np.array([1.0, 2.0, -3.0])), [2, 1, 3])
    assert np.all(np.isnan(wxyz_from_attitude(np.array([0, np.nan, 0]))))


def test_a_margin_rests_on_measurement_else_on_prediction_else_on_nothing():
    analysis = flight()
    rpm = analysis.track.rotor_speed_rpm.copy()
    tank = analysis.track.tank_kg.copy()
    rpm[100:, 2] = np.nan
    tank[200:] = np.nan
    analysis = flight(rotor_speed_rpm=rpm, tank_kg=tank)
    before, predicted, nothing = (ShownRow(analysis, row) for row in (50, 150, 250))
    assert before.measured.all()
    np.testing.assert_array_equal(predicted.measured, [True, True, False, True])
    assert predicted.margin[2] == analysis.margin_predicted[150, 2]
    np.testing.assert_array_equal(np.isfinite(nothing.margin), [True, True, False, True])


def test_a_silent_rotor_is_never_called_the_worst_while_others_are_measured():
    """Its prediction beside measurements would be compared with them."""
    rpm = np.full((ROWS, 4), 1200.0)
    rpm[:, 2] = np.nan
    row = ShownRow(flight(rotor_speed_rpm=rpm, tank_kg=np.full(ROWS, 16.0)), 10)
    assert np.nanargmin(row.margin) == 2
    margin, rotor = row.worst
    assert rotor in (0, 1, 3)
    assert margin == pytest.approx(row.margin[rotor])
    rpm[:] = np.nan
    row = ShownRow(flight(rotor_speed_rpm=rpm), 10)
    assert row.worst[0] == pytest.approx(row.margin_predicted.min())


def test_every_row_holds_the_numbers_of_its_analysis_where_its_scene_is():
    analysis = flight()
    for i in (0, 17, ROWS - 1, -1):
        row = ShownRow(analysis, i, np.array([100.0, 30.0, -2.0]))
        np.testing.assert_array_equal(row.margin, analysis.margin[i])
        north, east, down = analysis.track.position_ned[i]
        np.testing.assert_allclose(row.position_enu, [east + 30.0, north + 100.0, 2.0 - down])
        assert row.worst == (
            pytest.approx(analysis.margin[i].min()),
            int(np.argmin(analysis.margin[i])),
        )


def test_no_rotor_is_the_worst_when_none_is_known():
    rpm = np.full((ROWS, 4), np.nan)
    margin, rotor = ShownRow(flight(rotor_speed_rpm=rpm, tank_kg=np.full(ROWS, np.nan)), 10).worst
    assert np.isnan(margin)
    assert rotor is None


def test_the_row_of_a_time_is_the_last_one_before_it():
    time_s = flight().track.time_s
    assert row_at(time_s, -5.0) == 0
    assert row_at(time_s, 1.0) == 10
    assert row_at(time_s, 1.05) == 10
    assert row_at(time_s, 1e9) == ROWS - 1


@pytest.mark.parametrize(
    ("margin", "over_rotor", "gauge"),
    [
        (0.42, "1: 42%", "margin 42 %"),
        (-0.003, "1: <0%", "beyond the ceiling"),
        (-1.26, "1: <0%", "beyond the ceiling"),
        (float("nan"), "1: ?", "margin unknown"),
    ],
)
def test_a_margin_is_never_shown_as_a_negative_share(margin, over_rotor, gauge):
    assert rotor_label(0, margin) == over_rotor
    assert margin_or_beyond(margin) == gauge


def test_thrust_with_a_rotor_lost_has_an_interval_of_90_percent():
    """1.2 times the weight, its logarithm known to 0.1 downwards and to 0.06 upwards."""
    analysis = replace(
        flight(),
        redundancy_yaw_uncontrolled=np.full(ROWS, 1.2),
        redundancy_error=np.full(ROWS, 0.1),
        redundancy_beyond=0.04,
    )
    row = ShownRow(analysis, 10)
    # exp(-0.1645) is 0.848 and exp(0.0987) is 1.104.
    assert row.redundancy == pytest.approx((1.2, 1.018, 1.3245), abs=1e-3)
    assert row.survives
