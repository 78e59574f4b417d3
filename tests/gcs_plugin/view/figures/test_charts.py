"""The charts show the flight's own rows around now, and gaps stay gaps."""

import re

import numpy as np
import pytest

from tests.gcs_plugin.view.view_flight import ROWS, flight
from thrustmargin.gcs_plugin.view.figures.charts import (
    Speeds,
    chart_data,
    chart_images,
    speed_range,
)

#: As the code has them, written down by hand: a change there is to be seen here.
POINTS = 240


def test_every_point_of_a_chart_is_a_row_of_the_flight():
    analysis = flight()
    track = analysis.track
    for rotor, (times, _, _, predicted, measured, _) in enumerate(
        chart_data(Speeds.of(analysis), 5.0, 15.0, 12.0, (0, 3000))
    ):
        assert np.all(np.diff(times) >= 0)
        assert (times[0], times[-1]) == (5.0, 15.0)
        shown = np.isfinite(measured)
        rows = np.searchsorted(track.time_s, times[shown])
        np.testing.assert_array_equal(track.time_s[rows], times[shown])
        np.testing.assert_array_equal(track.rotor_speed_rpm[rows, rotor], measured[shown])
        np.testing.assert_array_equal(
            analysis.prediction.rotor_speed_rpm[rows, rotor], predicted[shown]
        )
        assert shown.sum() == 101


def test_now_is_one_upright_line_through_the_chart():
    times, *_, now = chart_data(Speeds.of(flight()), 5.0, 15.0, 12.05, (1000, 2500))[0]
    drawn = np.isfinite(now)
    np.testing.assert_array_equal(times[drawn], [12.05, 12.05])
    np.testing.assert_array_equal(now[drawn], [1000, 2500])


@pytest.mark.parametrize("now", [0.0, 39.9, 20.0])
def test_the_window_may_reach_past_both_ends_of_the_flight(now):
    data = chart_data(Speeds.of(flight()), now - 30, now + 10, now, (0, 3000))
    for column in data[0]:
        assert column.shape == data[0][0].shape
    assert np.isfinite(data[0][5]).sum() == 2


def test_unmeasured_rows_are_gaps():
    rpm = flight().track.rotor_speed_rpm.copy()
    rpm[80:120] = np.nan
    times, *_, measured, _ = chart_data(Speeds.of(flight(rotor_speed_rpm=rpm)), 5, 15, 6, (0, 1))[0]
    inside = (times >= 8.0) & (times < 11.95)
    assert not np.isfinite(measured[inside]).any()


def test_a_long_window_is_thinned_to_rows_that_stay_put_as_it_moves():
    analysis = flight()
    first = chart_data(Speeds.of(analysis), 0.0, 39.0, 20.0, (0, 1))[0][0]
    assert first.size <= 2 * POINTS + 5
    long = flight()
    a = set(chart_data(Speeds.of(long), 0.0, 30.0, 3.0, (0, 1))[0][0].round(6)[1:-1]) - {3.0}
    b = set(chart_data(Speeds.of(long), 0.7, 30.7, 3.0, (0, 1))[0][0].round(6)[1:-1]) - {3.0}
    assert {t for t in a if t > 1} - b == set()


def test_limits_hold_every_flying_row_and_need_no_data():
    analysis = flight()
    track = analysis.track
    low, high = speed_range(Speeds.of(analysis))
    assert low <= np.nanmin(track.rotor_speed_rpm) <= np.nanmax(track.rotor_speed_rpm) <= high
    nothing = flight(rotor_speed_rpm=np.full((ROWS, 4), np.nan), tank_kg=np.full(ROWS, np.nan))
    assert speed_range(Speeds.of(nothing)) == (0.0, 3000.0)


def test_a_drawing_has_the_rows_as_points_and_gaps_between_them():
    analysis = flight()
    rpm = analysis.track.rotor_speed_rpm.copy()
    rpm[150:200, 1] = np.nan
    made = flight(rotor_speed_rpm=rpm)
    airframe, speeds = made.model.airframe, Speeds.of(made)
    images = chart_images(airframe, speeds, 20.0, window_s=20.0, ahead=0.5)
    assert [one["place"] for one in images] == list(airframe.rotor_names)
    whole, gap = (re.search(r'class="measured" d="([^"]*)"', images[k]["svg"]) for k in (0, 1))
    assert whole
    assert gap
    assert (whole[1].count("M"), gap[1].count("M")) == (2, 3)  # the line of now parts it too
    assert "nan" not in images[1]["svg"]
    low, high = speed_range(speeds)
    assert f"<span>{high:.0f}</span><span>{low:.0f}</span>" in images[0]["svg"]
