"""A cause without a name is a curve that is held beyond the range in which it was seen."""

from types import SimpleNamespace

import numpy as np

from tests.models.known_effects import known_curve
from thrustmargin.models.effects.unnamed import curve_columns

VALUES = {"at_1": 0.01, "at_2": 0.02, "at_3": 0.04, "at_4": 0.08, "low": 0.0, "high": 3.0}
X = SimpleNamespace(airspeed=np.array([-5.0, 0.0, 0.5, 3.0, 40.0, np.nan]), arm=2.0)


def test_knots_share_a_value_between_them_and_its_ends_hold():
    columns = curve_columns(np.array([-1.0, 0.0, 1.5, 3.0, 9.0]), 0.0, 3.0)
    wanted = [[1, 0, 0, 0], [1, 0, 0, 0], [0, 0.5, 0.5, 0], [0, 0, 0, 1], [0, 0, 0, 1]]
    np.testing.assert_allclose(columns, wanted)


def test_of_the_collective_it_is_a_share_of_thrust_and_nothing_where_nothing_is_known():
    kappa = known_curve("collective", "airspeed").apply(VALUES, X)
    np.testing.assert_allclose(kappa, 1.0 - np.array([0.01, 0.01, 0.015, 0.08, 0.08, 0.0]))


def test_of_a_moment_it_is_thrust_times_arm_about_its_own_axis():
    roll, pitch, yaw = known_curve("pitch", "airspeed").apply(VALUES, X, np.full(6, 100.0))
    np.testing.assert_allclose(pitch, 200.0 * np.array([0.01, 0.01, 0.015, 0.08, 0.08, 0.0]))
    assert not np.any(roll)
    assert not np.any(yaw)


def test_it_was_seen_within_its_range_alone():
    seen = known_curve("pitch", "airspeed").seen
    assert seen is not None
    assert seen(VALUES, X).tolist() == [False, True, True, True, False, True]
