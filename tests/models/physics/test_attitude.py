"""Directions of the body: by hand, and as scipy's rotations."""

import numpy as np
from scipy.spatial.transform import Rotation

from thrustmargin.models.flight import down_axis

HALF, ROOT3 = 0.5, np.sqrt(3.0) / 2.0  # sine and cosine of 30 degrees


def test_thirty_degrees_of_pitch_roll_and_yaw_by_hand():
    thirty, right = np.radians(30.0), np.radians(90.0)
    attitude = np.array(
        [
            [0.0, 0.0, 1.0],  # yaw alone leaves the down axis down
            [0.0, thirty, 0.0],  # nose up: the belly looks forward, north
            [thirty, 0.0, 0.0],  # right side down: the belly looks left, west
            [0.0, thirty, right],  # nose up while heading east
            [thirty, 0.0, right],  # right side down while heading east: the belly looks north
        ]
    )
    expected = [[0, 0, 1], [HALF, 0, ROOT3], [0, -HALF, ROOT3], [0, HALF, ROOT3], [HALF, 0, ROOT3]]
    np.testing.assert_allclose(down_axis(attitude), expected, atol=1e-15)


def test_any_attitude_is_scipys_rotation_of_the_down_axis():
    roll, pitch, yaw = np.random.default_rng(2).uniform(-3.0, 3.0, (3, 200))
    by_scipy = Rotation.from_euler("ZYX", np.stack([yaw, pitch, roll], axis=1)).apply([0, 0, 1])
    np.testing.assert_allclose(down_axis(np.stack([roll, pitch, yaw], axis=1)), by_scipy)
