"""The drawn route: few segments, no corner lost, and never a worst moment lost."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from thrustmargin.mission.route import route_segments
from thrustmargin.models.errors import TrackError

FLOATS = st.floats(-50, 50, allow_nan=False, width=32)


@st.composite
def flights(draw):
    """Rows with gaps in position, holes in the values, and any limit."""
    rows = draw(st.integers(0, 60))
    position = draw(hnp.arrays(np.float64, (rows, 3), elements=FLOATS | st.just(np.nan)))
    values = draw(hnp.arrays(np.float64, rows, elements=FLOATS | st.just(np.nan)))
    shown = draw(hnp.arrays(np.bool_, rows))
    return position, values, shown, draw(st.integers(1, 30))


def straight(rows: int) -> np.ndarray:
    return np.column_stack([np.arange(rows), np.zeros(rows), np.full(rows, -3.0)]).astype(float)


@given(flights())
@settings(max_examples=300, deadline=None)
def test_no_worst_value_of_a_drawn_row_is_ever_lost(flight):
    position, values, shown, limit = flight
    route = route_segments(position, [values], shown=shown, limit=limit)
    placed = shown & np.isfinite(position).all(axis=1)
    assert route.count <= limit
    assert np.all(route.covers(len(position))[placed])
    for drawn, sign in ((route.worst(values, "max"), 1.0), (route.worst(values, "min"), -1.0)):
        known = values[placed & np.isfinite(values)]
        if known.size:
            assert np.nanmax(sign * drawn) >= np.max(sign * known)
        for s in range(route.count):
            inside = values[route.first_row[s] : route.last_row[s] + 1]
            inside = inside[np.isfinite(inside)]
            expected = sign * np.max(sign * inside) if inside.size else np.nan
            np.testing.assert_array_equal(drawn[s], expected)
    absolute = route.worst(values, "abs")
    np.testing.assert_array_equal(
        np.abs(absolute),
        np.fmax(np.abs(route.worst(values, "max")), np.abs(route.worst(values, "min"))),
    )


@given(flights())
@settings(max_examples=100, deadline=None)
def test_neighbouring_segments_meet_and_start_where_their_row_is(flight):
    position, values, shown, limit = flight
    route = route_segments(position, [values], shown=shown, limit=limit)
    np.testing.assert_array_equal(route.start_ned, position[route.first_row])
    np.testing.assert_array_equal(route.end_ned, position[route.last_row])
    assert np.all(route.last_row >= route.first_row)
    assert np.all(route.first_row[1:] >= route.last_row[:-1])


def test_a_straight_flight_of_one_colour_is_one_segment_and_its_corners_stay():
    leg = straight(101)
    side = np.column_stack([np.full(50, 100.0), np.arange(50.0), np.full(50, -3.0)])
    corner = np.vstack([leg, side])
    assert route_segments(leg, [np.ones(101)]).count == 1
    route = route_segments(corner, [np.ones(151)])
    assert route.count == 2
    np.testing.assert_allclose(route.end_ned[0], [100, 0, -3])


def test_a_climb_in_place_is_drawn_though_it_has_no_length_in_plan():
    up = np.column_stack([np.zeros(50), np.zeros(50), -np.arange(50.0)])
    away = straight(50) + np.array([0, 0, -46])
    route = route_segments(np.vstack([up, away]))
    assert route.end_ned[:, 2].min() == -49.0
    assert route.count == 2


def test_a_turn_of_colour_on_a_straight_line_is_kept():
    values = np.r_[np.full(40, 0.3), np.full(21, 0.7), np.full(40, 0.3)]
    route = route_segments(straight(101), [values])
    colour = route.worst(values, "max")
    orange = colour > 0.5
    # The worst spreads over at most the one-row segments that touch the stretch.
    assert route.start_ned[orange, 0].min() >= 39
    assert route.end_ned[orange, 0].max() <= 61


def test_a_stretch_without_data_is_kept_as_one():
    values = np.full(101, 0.4)
    values[30:60] = np.nan
    route = route_segments(straight(101), [values])
    unknown = np.isnan(route.worst(values, "max"))
    assert route.start_ned[unknown, 0].min() == pytest.approx(30, abs=1)
    assert route.end_ned[unknown, 0].max() == pytest.approx(59, abs=1)


def test_the_drawn_line_stays_within_its_stated_tolerance():
    rng = np.random.default_rng(3)
    position = np.cumsum(rng.normal(0, 0.4, (4000, 3)), axis=0)
    route = route_segments(position, limit=300)
    assert route.count <= 300
    assert route.tolerance > 0.1  # it had to grow, and says so
    for s in range(route.count):
        a, b = route.start_ned[s, :2], route.end_ned[s, :2]
        inside = position[route.first_row[s] : route.last_row[s] + 1, :2]
        along = (b - a) / max(np.linalg.norm(b - a), 1e-9)
        share = np.clip((inside - a) @ along, 0, np.linalg.norm(b - a))
        distance = np.linalg.norm(inside - a - share[:, None] * along, axis=1)
        assert distance.max() <= route.tolerance * 1.0001


def test_a_lost_position_breaks_the_line_and_invents_no_bridge():
    position = straight(100)
    position[40:60] = np.nan
    route = route_segments(position)
    assert route.count == 2
    np.testing.assert_array_equal(route.last_row, [39, 99])
    np.testing.assert_array_equal(route.first_row, [0, 60])


def test_the_worst_row_is_the_row_itself_and_absent_when_nothing_is_known():
    values = np.full(100, np.nan)
    route = route_segments(straight(100), [values])
    assert route.worst_row(values, "max") is None
    values[17], values[80] = -9.0, 4.0
    assert route.worst_row(values, "max") == 80
    assert route.worst_row(values, "min") == 17
    assert route.worst_row(values, "abs") == 17


def test_a_row_that_is_not_drawn_is_not_the_worst_of_the_route():
    values = np.arange(100.0)
    shown = np.arange(100) < 50
    assert route_segments(straight(100), [values], shown=shown).worst_row(values, "max") == 49


def test_shapes_that_disagree_and_an_impossible_limit_are_refused():
    with pytest.raises(TrackError, match="position_ned"):
        route_segments(np.zeros((5, 2)))
    with pytest.raises(TrackError, match="values"):
        route_segments(np.zeros((5, 3)), [np.zeros(4)])
    with pytest.raises(TrackError, match="at most 0"):
        route_segments(np.zeros((5, 3)), limit=0)
