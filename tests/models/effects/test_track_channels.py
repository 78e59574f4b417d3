"""The channels of a flight that no effect's own test looks at, by hand."""

import numpy as np
import pytest

from tests.models.effects.test_hand_values import AIRFRAME, ROW, steady
from thrustmargin.models.effects.channels import Channels, channels_of


def channels(**given) -> Channels:
    return channels_of(steady(**given), AIRFRAME, reference_density=1.225, reference_voltage=50.0)


@pytest.mark.parametrize(("yaw", "heading"), [(0.5, 0.5), (-0.5, 2 * np.pi - 0.5), (7.0, 0.71681)])
def test_a_heading_is_within_one_turn(yaw, heading):
    attitude = np.zeros((60, 3))
    attitude[:, 2] = yaw
    assert channels(attitude=attitude).heading[ROW] == pytest.approx(heading, abs=1e-5)


@pytest.mark.parametrize(
    ("velocity", "growth"),
    [
        ((0.6, 0.8, 5.0), 1.0),  # m/s² north, east, down: the horizontal speed is all that counts
        ((-0.6, -0.8, 0.0), 1.0),
        ((0.0, 2.0, 0.0), 2.0),
        ((0.0, 0.0, 3.0), 0.0),
    ],
)
def test_the_horizontal_speed_grows_by_its_own_acceleration(velocity, growth):
    time_s = 1.0 + 0.1 * np.arange(60)
    made = channels(velocity_ned=time_s[:, None] * np.array(velocity))
    assert made.along_acceleration[ROW] == pytest.approx(growth)


def test_a_speed_that_is_unknown_grows_by_nothing():
    unknown = channels(velocity_ned=np.full((60, 3), np.nan))
    np.testing.assert_array_equal(unknown.along_acceleration, 0.0)
