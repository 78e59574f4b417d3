"""The charts show the flight's own rows around now, and gaps stay gaps."""

import re

import numpy as np
import pytest

from tests.gcs_plugin.view.view_flight import ROWS, flight
from thrustmargin.gcs_plugin.view.figures.charts import (
    Speeds,
    chart_images,
    shown_rows,
    speed_range,
)

#: As the code has them, written down by hand: a change there is to be seen here.
POINTS = 240


def drawn(made, now_s: float, name: str, rotor: int = 0) -> list[tuple[float, float]]:
    """Seconds and rpm of the points of a line in a chart of 20 s, half of it ahead."""
    speeds = Speeds.of(made)
    low, high = speed_range(speeds)
    svg = chart_images(made.places, speeds, now_s, window_s=20.0, future_share=0.5)[rotor]["svg"]
    found = re.search(rf'class="{name}" d="([^"]*)"', svg)
    assert found
    points = re.findall(r"([\d.-]+),([\d.-]+)", found[1])
    return [(now_s - 10 + float(x) / 20, high - float(y) / 100 * (high - low)) for x, y in points]


@pytest.mark.parametrize("rotor", range(4))
def test_every_point_of_a_chart_is_a_row_of_the_flight(rotor):
    made = flight()
    time_s, rpm = made.track.time_s, made.track.rotor_speed_rpm[:, rotor]
    points = drawn(made, 15.0, "measured", rotor)
    inside = (time_s >= 5.0) & (time_s <= 25.0)
    assert len(points) == inside.sum() == 201
    np.testing.assert_allclose([t for t, _ in points], time_s[inside], atol=0.01)
    np.testing.assert_allclose([v for _, v in points], rpm[inside], atol=2.0)


@pytest.mark.parametrize("now", [0.0, 39.9, 20.0])
def test_now_is_one_upright_line_through_the_chart_also_past_both_ends(now):
    made = flight()
    shown = {"window_s": 40.0, "future_share": 0.25}
    for one in chart_images(made.places, Speeds.of(made), now, **shown):
        assert '<path class="now" d="M300.0,0V100"/>' in one["svg"]


def test_a_long_window_is_thinned_to_rows_that_stay_put_as_it_moves():
    time_s = np.arange(0.0, 100.0, 0.1)
    first, moved = (shown_rows(time_s, start, start + 60.0) for start in (0.0, 0.7))
    assert first.size <= 2 * POINTS
    both = np.arange(7, 600)
    np.testing.assert_array_equal(np.intersect1d(first, both), np.intersect1d(moved, both))


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
    images = chart_images(airframe.rotor_names, speeds, 20.0, window_s=20.0, future_share=0.5)
    assert [one["place"] for one in images] == list(airframe.rotor_names)
    whole, gap = (re.search(r'class="measured" d="([^"]*)"', images[k]["svg"]) for k in (0, 1))
    assert whole
    assert gap
    assert (whole[1].count("M"), gap[1].count("M")) == (1, 2)
    assert "nan" not in images[1]["svg"]
    low, high = speed_range(speeds)
    assert f"<span>{high:.0f}</span><span>{low:.0f}</span>" in images[0]["svg"]
