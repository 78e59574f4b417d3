"""One rule of thrust left: what reads below the limit is too little, and keeps its colour."""

import math

import numpy as np
import pytest

from thrustmargin.gcs_plugin.live.alarms.alarm import AlarmSettings
from thrustmargin.gcs_plugin.wording.language import speaking
from thrustmargin.gcs_plugin.wording.palette import thrust_left
from thrustmargin.gcs_plugin.wording.thrust_left import (
    below,
    clear,
    left_words,
    percent_down,
    percent_up,
    too_little,
    value_of_colour,
)


@pytest.mark.parametrize("used", [0.5, 0.55, 0.6, 0.7, 0.9])
def test_a_share_is_too_little_exactly_where_it_reads_so(used: float):
    least = 1.0 - AlarmSettings(max_utilisation=used).max_utilisation
    share = np.linspace(0.0, 1.0, 100_001)
    reads = np.array([percent_down(one) for one in share])
    np.testing.assert_array_equal(below(share, least), reads < round(100 * least))
    assert not below(least, least)
    assert not below(math.nan, least)
    assert not clear(math.nan, least)


def test_too_little_begins_at_the_limit_and_ends_three_points_above_it():
    left = np.array([[0.51, 0.49, 0.52, np.nan, 0.529, 0.531, 0.52, 0.499, 0.9]]).T
    low = too_little(left, 0.5)[:, 0].tolist()
    assert low == [False, True, True, True, True, False, False, True, False]


def test_how_it_was_before_lasts_between_the_two_thresholds():
    left = np.array([[0.52, 0.52, 0.54], [0.51, np.nan, 0.51]])
    before = [True, False, True]
    np.testing.assert_array_equal(too_little(left, 0.5, before), [[True, False, False]] * 2)
    assert too_little(np.full((3, 2), np.nan), 0.5, [True, False]).tolist() == [[True, False]] * 3
    assert too_little(np.empty((0, 2)), 0.5).shape == (0, 2)


def test_the_colour_is_that_of_the_side_on_which_it_counts():
    scale = thrust_left(0.4)
    left, low = np.array([0.41, 0.41, 0.39, np.nan]), np.array([True, False, True, False])
    orange, blue, darker, grey = scale.screen(value_of_colour(left, 0.4, low)).astype(int)
    assert orange[0] > orange[2]
    assert blue[2] > blue[0]
    assert darker[0] > darker[2]
    assert tuple(grey) == (165, 165, 165)
    # In the last bits below the limit it reads 40 % and is blue.
    np.testing.assert_array_equal(
        scale.screen(value_of_colour(np.array([0.4 - 1e-12]), 0.4, np.array([False]))),
        scale.screen([0.4]),
    )


def test_thrust_left_is_rounded_down_and_the_upper_end_up():
    assert left_words(0.4999) == "49 %"
    assert left_words(0.456, 0.401, 0.5001) == "45 % (40 to 51)"
    assert left_words(0.456, 0.456, 0.456) == "45 %"
    assert left_words(-0.13) == "none"
    assert left_words(0.02, -0.01, 0.05) == "2 % (0 to 5)"
    assert left_words(math.nan) == left_words(None) == "unknown"
    assert percent_up(0.5) == percent_down(0.5) == 50
    with speaking("de"):
        assert left_words(0.456, 0.401, 0.5001) == "45 % (40 bis 51)"
