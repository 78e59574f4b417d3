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
    ground_height,
    row_at,
    wxyz_from_attitude,
)
from thrustmargin.gcs_plugin.wording.thrust_left import left_words


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
        (0.42, "1: 42%", "42 %"),
        (-0.003, "1: <0%", "none"),
        (-1.26, "1: <0%", "none"),
        (float("nan"), "1: ?", "unknown"),
    ],
)
def test_a_margin_is_never_shown_as_a_negative_share(margin, over_rotor, gauge):
    assert rotor_label(0, margin) == over_rotor
    assert left_words(margin) == gauge


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


def test_on_the_ground_the_margin_is_the_predicted_one_and_promises_nothing():
    """Rotors at idle have nearly all their thrust left, which says nothing of the flight."""
    idle = np.full((ROWS, 8), 300.0)
    analysis = flight(airframe="agras-t40", rotor_speed_rpm=idle, flying=np.zeros(ROWS, dtype=bool))
    row = ShownRow(analysis, 50)
    assert not row.flying
    assert row.measured.all()
    assert 1.0 - analysis.utilisation[50].max() > 0.9
    np.testing.assert_array_equal(row.margin, 1.0 - analysis.utilisation_predicted[50])
    assert np.isnan(row.coloured).all()  # enough, but only predicted
    assert row.basis(0) == "predicted"


def test_a_disc_has_the_colour_of_the_least_that_may_be_left():
    analysis = flight(airframe="topxgun-f16")
    row = ShownRow(analysis, 50)
    assert row.measured.all()
    low = 1.0 - analysis.use_ends[1][50]
    assert (low < row.margin).all()
    np.testing.assert_array_equal(row.coloured, low)
    margin, rotor = row.worst
    assert rotor is not None
    assert row.surely_left == low[rotor] < margin


def test_with_one_rotor_unknown_nothing_is_surely_left():
    rpm = flight().track.rotor_speed_rpm.copy()
    rpm[:, 1] = np.nan
    row = ShownRow(flight(rotor_speed_rpm=rpm, tank_kg=np.full(ROWS, np.nan)), 50)
    assert row.unmeasured == 1
    assert np.isnan(row.surely_left)
    assert row.worst[1] is not None
    assert row.why_unknown == ""


def test_a_predicted_margin_that_is_too_low_is_coloured_all_the_same():
    nothing = np.full((ROWS, 4), np.nan)
    heavy = ShownRow(flight(rotor_speed_rpm=nothing, tank_kg=np.full(ROWS, 40.0)), 50)
    light = ShownRow(flight(rotor_speed_rpm=nothing, tank_kg=np.zeros(ROWS)), 50)
    assert heavy.unmeasured == light.unmeasured == 0
    assert heavy.margin.max() < 0.3
    assert light.margin.min() > 0.6
    assert np.isfinite(heavy.coloured).all()
    assert np.isnan(light.coloured).all()


@pytest.mark.parametrize(
    ("airframe", "kg", "survives"),
    [("agras-t40", 40.0, True), ("topxgun-f16", 16.0, False), ("agras-t20", 40.0, False)],
)
def test_an_aircraft_survives_where_the_least_thrust_with_a_rotor_lost_holds_its_weight(
    airframe, kg, survives
):
    row = ShownRow(flight(airframe=airframe, tank_kg=np.full(ROWS, kg)), 50)
    held, low, high = row.redundancy
    assert low < held < high
    assert (low >= 1.0) is survives
    assert row.survives is survives


def test_the_ground_is_below_the_aircraft_by_its_height_else_at_its_lowest_place():
    track = flight().track
    assert ground_height(track) == pytest.approx(0.0)
    hill = track.position_ned - [0.0, 0.0, 12.0]
    assert ground_height(replace(track, position_ned=hill)) == pytest.approx(12.0)
    climb = track.position_ned.copy()
    climb[:, 2] = np.linspace(-7.0, -30.0, ROWS)
    climb[0] = np.nan
    lost = replace(track, position_ned=climb, height_agl=np.full(ROWS, np.nan))
    assert ground_height(lost) == pytest.approx(7.0, abs=0.1)
    assert ground_height(replace(lost, position_ned=np.full((ROWS, 3), np.nan))) == 0.0
