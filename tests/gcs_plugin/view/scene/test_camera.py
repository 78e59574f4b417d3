"""The overview shows all of the field, whatever its shape and the picture's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from thrustmargin.gcs_plugin.view.scene.shown_row import wxyz_from_attitude
from thrustmargin.gcs_plugin.view.scene.surroundings import nose_north, overview

#: As the code has them, written down by hand: a change there is to be seen here.
FIELD_OF_VIEW = np.radians(75.0)
FILL = 0.84

LENGTH = st.floats(0, 2000)


@given(
    st.tuples(LENGTH, LENGTH, st.floats(0, 100)),
    st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), st.floats(-50, 50)),
    st.floats(0.4, 3.0),
)
def test_every_corner_is_in_the_picture_and_one_is_at_its_rim(size, low, aspect):
    low = np.array(low)
    high = low + size
    position, look_at = overview(low, high, aspect)
    ahead = (look_at - position) / np.linalg.norm(look_at - position)
    right = np.array([1.0, 0.0, 0.0])
    above = np.cross(right, ahead)
    half = np.maximum((high - low) / 2, 2.5)
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    offset = look_at + signs * half - position
    depth = offset @ ahead
    assert np.all(depth > 0)
    rim = np.tan(FIELD_OF_VIEW / 2) * depth
    reach = np.maximum(np.abs(offset @ right) / (rim * aspect), np.abs(offset @ above) / rim)
    assert reach.max() == pytest.approx(FILL, rel=1e-6)


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5, np.pi])
def test_turning_the_nose_north_turns_it_north(yaw):
    matrix, _ = nose_north(wxyz_from_attitude(np.array([0.1, -0.1, yaw])))
    nose_enu = np.array([np.sin(yaw), np.cos(yaw), 0.0])
    np.testing.assert_allclose(matrix @ nose_enu, [0, 1, 0], atol=1e-9)
