"""Modes of a layout, and the sensor noise of a residual, against noise of known size."""

import numpy as np
import pytest

from thrustmargin.models.identification.rows.modes import (
    modes,
    robust_scale,
    sensor_noise_rpm,
)
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.physics.margin import mixer

F16 = load_airframe("topxgun-f16-sitl")


def test_modes_of_a_quad_are_orthonormal_and_each_changes_one_moment():
    found = modes(F16)
    d = found.directions
    np.testing.assert_allclose(d.T @ d, np.eye(4), atol=1e-12)
    assert found.names == ("collective", "roll", "pitch", "yaw")
    np.testing.assert_allclose(d[:, 0], [0.5] * 4)  # all rotors alike, faster is positive
    # Motor 1 is right and front, 2 left and rear, 3 left and front, 4 right and rear; to roll right
    # the left ones turn faster, to pitch up the front ones, 1 and 2 turn against 3 and 4.
    np.testing.assert_allclose(d[:, 1], [-0.5, 0.5, 0.5, -0.5], atol=1e-12)
    np.testing.assert_allclose(d[:, 2], [0.5, -0.5, 0.5, -0.5], atol=1e-12)
    np.testing.assert_allclose(d[:, 3], [0.5, 0.5, -0.5, -0.5], atol=1e-12)


def test_a_hexacopter_has_two_modes_more_which_no_moment_sees():
    hexa = load_airframe("agras-t20")
    found = modes(hexa)
    np.testing.assert_allclose(found.directions.T @ found.directions, np.eye(6), atol=1e-12)
    assert found.names[4:] == ("rest 1", "rest 2")
    np.testing.assert_allclose(mixer(hexa) @ found.directions[:, 4:], 0.0, atol=1e-9)


def test_the_scale_of_residuals_is_about_zero_and_ignores_a_wild_one():
    assert robust_scale(np.array([-2.0, 2.0, 2.0, -2.0, 900.0])) == pytest.approx(1.4826 * 2.0)
    assert robust_scale(np.array([1.0, np.nan, 3.0])) == pytest.approx(1.4826 * 2.0)
    assert np.isnan(robust_scale(np.array([np.nan])))


def test_noise_of_a_sensor_is_that_of_the_quietest_mode_whatever_motion_is_under_it():
    rng = np.random.default_rng(4)
    t = np.arange(4000) * 0.1
    smooth = 300.0 * np.sin(0.2 * t)[:, None] + 5.0 * t[:, None]
    noise = rng.standard_normal((t.size, 2)) * [3.0, 12.0]
    step = np.ones(t.size, dtype=bool)
    assert sensor_noise_rpm(smooth + noise, step) == pytest.approx(3.0, rel=0.06)


def test_rows_after_a_pause_say_nothing_of_the_noise():
    """1, -1, 1 ... has second differences of 4; jumps at pauses must not count."""
    e = np.tile([1.0, -1.0], 50)[:, None]
    step = np.ones(100, dtype=bool)
    expected = 1.4826 * 4.0 / np.sqrt(6.0)
    assert sensor_noise_rpm(e, step) == pytest.approx(expected)
    step[50], jumps = False, e.copy()
    jumps[50:] += 700.0
    assert sensor_noise_rpm(jumps, step) == pytest.approx(expected)
    step[::2] = False  # no three rows in a row without a pause
    assert np.isnan(sensor_noise_rpm(e, step))
    step = np.ones(100, dtype=bool)
    assert np.isnan(sensor_noise_rpm(e[:11], np.ones(11, dtype=bool)))
    assert np.isfinite(sensor_noise_rpm(e[:12], np.ones(12, dtype=bool)))
