"""The view's frames, and that a row shows what its analysis holds."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.gcs_plugin.view.view_flight import ROWS, flight
from thrustmargin.gcs_plugin.view.shown_rows import (
    MEASURED,
    NO_DATA,
    PREDICTED,
    Samples,
    enu,
    wxyz_from_attitude,
)


def turned(roll, pitch, yaw, vector):
    wxyz = wxyz_from_attitude(np.array([[roll, pitch, yaw]]))[0]
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
    wxyz = wxyz_from_attitude(np.array([[0, 0, 0], [0, np.nan, 0]]))
    assert np.all(np.isfinite(wxyz[0]))
    assert np.all(np.isnan(wxyz[1]))


def test_a_row_rests_on_measurement_else_on_prediction_else_on_nothing():
    analysis = flight()
    rpm = analysis.track.rotor_speed_rpm.copy()
    tank = analysis.track.tank_kg.copy()
    rpm[100:, 2] = np.nan
    tank[200:] = np.nan
    samples = Samples.of(flight(rotor_speed_rpm=rpm, tank_kg=tank))
    np.testing.assert_array_equal(samples.row(50).source, [MEASURED] * 4)
    np.testing.assert_array_equal(
        samples.row(150).source, [MEASURED, MEASURED, PREDICTED, MEASURED]
    )
    np.testing.assert_array_equal(samples.row(250).source, [MEASURED, MEASURED, NO_DATA, MEASURED])
    known = np.isfinite(samples.margin)
    np.testing.assert_array_equal(known, samples.source != NO_DATA)


def test_every_row_holds_the_numbers_of_its_analysis():
    analysis = flight()
    samples = Samples.of(analysis)
    for i in (0, 17, ROWS - 1):
        row = samples.row(i)
        np.testing.assert_array_equal(row.margin, analysis.margin[i])
        np.testing.assert_array_equal(row.rotor_speed_rpm, analysis.track.rotor_speed_rpm[i])
        assert row.tank_kg == analysis.track.tank_kg[i]
        assert row.redundancy_yaw_free == analysis.redundancy_yaw_free[i]
        assert row.worst_rotor == int(np.argmin(analysis.margin[i]))


def test_no_rotor_is_the_worst_when_none_is_known():
    rpm = np.full((ROWS, 4), np.nan)
    samples = Samples.of(flight(rotor_speed_rpm=rpm, tank_kg=np.full(ROWS, np.nan)))
    assert samples.row(10).worst_rotor is None


def test_the_row_of_a_time_is_the_last_one_before_it():
    samples = Samples.of(flight())
    assert samples.index_at(-5.0) == 0
    assert samples.index_at(1.0) == 10
    assert samples.index_at(1.05) == 10
    assert samples.index_at(1e9) == ROWS - 1
    rows = samples.between(1.0, 2.0)
    assert samples.time_s[rows][0] == pytest.approx(1.0)
    assert samples.time_s[rows][-1] == pytest.approx(2.0)
