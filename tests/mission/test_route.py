"""The drawn route: never too many segments, and never a worst moment lost."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from thrustmargin.mission.route import Trail

FLOATS = st.floats(-50, 50, allow_nan=False, width=32)


@st.composite
def flights(draw):
    """Rows of 10 Hz with gaps in position and holes in the values."""
    rows = draw(st.integers(0, 60))
    position = draw(hnp.arrays(np.float64, (rows, 3), elements=FLOATS | st.just(np.nan)))
    return position, draw(hnp.arrays(np.float64, rows, elements=FLOATS | st.just(np.nan)))


@given(flights())
@settings(max_examples=200, deadline=None)
def test_the_worst_of_each_segment_is_that_of_its_rows(flight):
    position, values = flight
    trail = Trail(["max"])
    trail.add(np.arange(len(values)) * np.float64(0.1), position, values[:, None])
    route, kept = trail.route, trail.values(0)
    np.testing.assert_array_equal(kept, values[np.isfinite(position).all(axis=1)])
    for drawn, sign in ((route.worst(kept, "max"), 1.0), (route.worst(kept, "min"), -1.0)):
        for s in range(route.count):
            inside = kept[route.first_row[s] : route.last_row[s] + 1]
            inside = inside[np.isfinite(inside)]
            expected = sign * np.max(sign * inside) if inside.size else np.nan
            np.testing.assert_array_equal(drawn[s], expected)
    np.testing.assert_array_equal(
        np.abs(route.worst(kept, "abs")),
        np.fmax(np.abs(route.worst(kept, "max")), np.abs(route.worst(kept, "min"))),
    )
    assert np.all(route.last_row > route.first_row)
    assert np.all(route.first_row[1:] >= route.last_row[:-1])


def fly(trail: Trail, time_s, values, *, speed: float = 1.0) -> None:
    """A straight flight north, in the few rows at a time that a monitor gives; (T,) and (T, K)."""
    time_s = np.asarray(time_s, dtype=float)
    for rows in np.array_split(np.arange(time_s.size), max(time_s.size // 7, 1)):
        place = np.outer(speed * time_s[rows], [1.0, 0.0, 0.0]) - np.array([0.0, 0.0, 3.0])
        trail.add(time_s[rows], place, np.asarray(values)[rows])


def test_the_worst_row_is_on_the_trail_however_long_it_gets():
    kinds = ("max", "min", "abs")
    trail = Trail(kinds, limit=50)
    time_s = 0.1 * np.arange(4000)
    peak = np.isclose(time_s, 123.4).astype(float)
    fly(trail, time_s, np.column_stack([peak, -peak, -2 * peak]))
    route = trail.route
    assert 25 <= route.count <= 51
    assert trail.values(0).size <= 500  # rows that no segment needs are forgotten
    worst = [route.worst(trail.values(k), kind) for k, kind in enumerate(kinds)]
    for k, most in enumerate((1.0, -1.0, -2.0)):
        at = int(np.argmax(np.abs(worst[k])))
        assert worst[k][at] == most
        assert np.count_nonzero(worst[k]) <= 2  # where it was and nowhere else
        assert route.start_ned[at, 0] <= 123.4 <= route.end_ned[at, 0]
    # One unbroken line from the first row to the last.
    assert np.array_equal(route.start_ned[1:], route.end_ned[:-1])
    assert route.start_ned[0, 0] == 0.0
    assert route.end_ned[-1, 0] == pytest.approx(399.9)


def test_a_pause_and_a_lost_position_break_the_trail():
    trail, none = Trail(["max"]), np.zeros((50, 1))
    assert trail.route.count == 0
    fly(trail, 0.1 * np.arange(50), none)
    trail.add(np.array([5.0]), np.full((1, 3), np.nan), none[:1])
    fly(trail, 5.1 + 0.1 * np.arange(50), none)
    fly(trail, 60.0 + 0.1 * np.arange(50), none)
    north = np.column_stack([trail.route.start_ned[:, 0], trail.route.end_ned[:, 0]])
    broken = np.flatnonzero(north[1:, 0] != north[:-1, 1])
    assert north[broken, 1] == pytest.approx([4.9, 10.0])
    assert north[broken + 1, 0] == pytest.approx([5.1, 60.0])
    assert np.max(np.diff(north, axis=1)) < 1.2


def test_an_aircraft_that_stands_still_makes_a_segment_every_two_seconds():
    trail = Trail(["max"])
    fly(trail, 0.1 * np.arange(600), np.zeros((600, 1)), speed=0.0)
    assert 25 <= trail.route.count <= 31


def segments(time_s, north_m) -> list[tuple[int, int]]:
    position = np.column_stack([north_m, np.zeros((len(north_m), 2))])
    trail = Trail(["max"])
    trail.add(np.asarray(time_s, float), position, np.zeros((len(north_m), 1)))
    return list(zip(trail.route.first_row.tolist(), trail.route.last_row.tolist(), strict=True))


def test_a_segment_is_half_a_metre_or_two_seconds_long():
    assert segments(np.arange(9) / 10, 0.125 * np.arange(9)) == [(0, 4), (4, 8)]
    assert segments(np.arange(9) / 2, np.zeros(9)) == [(0, 4), (4, 8)]


def test_a_pause_of_more_than_two_seconds_breaks_the_line():
    assert segments([0.0, 1.0, 3.0, 4.0], np.zeros(4)) == [(0, 2), (2, 3)]
    assert segments([0.0, 1.0, 3.1, 4.1], np.zeros(4)) == [(0, 1), (2, 3)]
