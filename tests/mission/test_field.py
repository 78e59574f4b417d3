"""The sprayed field from where the pump was on."""

from itertools import pairwise

import numpy as np
import pytest
import shapely

from thrustmargin.mission.field import line_spacing, sprayed_field
from thrustmargin.models.errors import TrackError


def boustrophedon(lines: int, length: float, spacing: float, *, heading: float = 0.0):
    """A mission back and forth, pump off in turns: position (T, 3) and spraying (T,)."""
    rows, on = [], []
    for i in range(lines):
        along = np.linspace(0, length, 81)
        rows.append(np.column_stack([along[:: 1 if i % 2 == 0 else -1], np.full(81, i * spacing)]))
        on.append(np.ones(81))
        turn = np.linspace(i, i + 1, 11)[1:-1] * spacing
        rows.append(np.column_stack([np.full(9, rows[-1][-1, 0]), turn]))
        on.append(np.zeros(9))
    plan = np.vstack(rows)
    c, s = np.cos(heading), np.sin(heading)
    turned = plan @ np.array([[c, -s], [s, c]]).T
    return np.column_stack([turned, np.full(len(plan), -3.0)]), np.concatenate(on)


def flown(position, spraying, **given):
    """The field of rows a tenth of a second apart."""
    return sprayed_field(np.arange(spraying.size) / 10, position, spraying, **given)


@pytest.mark.parametrize("heading", [0.0, 0.4, np.pi / 2, 2.5])
def test_swath_and_area_are_those_flown_whatever_the_heading(heading):
    position, spraying = boustrophedon(6, 100.0, 5.0, heading=heading)
    field = flown(position, spraying)
    assert field is not None
    assert field.swath_width == pytest.approx(5.0, rel=1e-6)
    assert field.area == pytest.approx(6 * 5.0 * 100.0, rel=1e-4)
    assert len(field.swaths_ned) == 6
    assert len(field.ground.geoms) == 1
    assert field.ground.area == pytest.approx(3000.0, rel=1e-3)


def test_every_sprayed_row_lies_in_the_outline_and_the_way_home_does_not():
    position, spraying = boustrophedon(6, 100.0, 5.0)
    home = np.column_stack([np.linspace(0, -60, 30), np.full(30, -40.0), np.full(30, -3.0)])
    field = flown(np.vstack([position, home]), np.r_[spraying, np.zeros(30)])
    assert field is not None
    outline = field.ground.buffer(1e-3)
    assert all(outline.covers(shapely.Point(p[:2])) for p in position[spraying > 0])
    assert not any(outline.covers(shapely.Point(p[:2])) for p in home)


def test_ground_inside_a_sprayed_ring_is_not_sprayed():
    corner = np.array([[0.0, 0], [60, 0], [60, 60], [0, 60], [0, 0]])
    ring = np.concatenate([np.linspace(a, b, 40) for a, b in pairwise(corner)])
    position = np.column_stack([ring, np.full(len(ring), -3.0)])
    field = flown(position, np.ones(len(ring)), swath_width=5.0)
    assert field is not None
    assert not field.ground.contains(shapely.Point(30, 30))
    assert field.ground.area == pytest.approx(4 * 60 * 5, rel=0.05)


def test_overlapping_swaths_are_counted_once():
    position, spraying = boustrophedon(4, 80.0, 5.0)
    once = flown(position, spraying)
    twice = flown(np.vstack([position, position]), np.r_[spraying, spraying])
    assert once is not None
    assert twice is not None
    assert twice.area == pytest.approx(once.area, rel=1e-4)
    assert twice.swath_width == pytest.approx(5.0)


def test_one_line_alone_has_no_width_and_nothing_is_made_up():
    position, spraying = boustrophedon(1, 100.0, 5.0)
    field = flown(position, spraying)
    assert field is not None
    assert np.isnan(field.swath_width)
    assert np.isnan(field.area)
    assert field.ground.is_empty
    given = flown(position, spraying, swath_width=4.0)
    assert given is not None
    assert given.area == pytest.approx(400.0, rel=1e-4)


def test_a_pump_that_never_ran_or_was_not_reported_is_no_field():
    position, spraying = boustrophedon(3, 50.0, 5.0)
    assert flown(position, np.zeros_like(spraying)) is None
    assert flown(position, np.full_like(spraying, np.nan)) is None


def test_where_no_place_is_known_there_is_a_time_without_an_area():
    position, spraying = boustrophedon(1, 50.0, 5.0)
    field = flown(np.full_like(position, np.nan), spraying, swath_width=4.0)
    assert field is not None
    assert np.isnan([field.area, field.swath_width]).all()
    assert field.ground.is_empty
    assert not field.whole
    assert field.lost_s == field.sprayed_s == pytest.approx(8.1)  # 81 rows with the pump on


def one_line():
    """100 m in 100 s with the pump on, a row a second."""
    time_s = np.arange(101.0)
    return time_s, np.column_stack([time_s, np.zeros(101), np.zeros(101)]), np.ones(101)


# The row before the pump falls silent is known to spray until the next one.
@pytest.mark.parametrize(("lost", "lost_s"), [("place", 10.0), ("pause", 10.0), ("pump", 9.0)])
def test_what_is_lost_for_a_tenth_of_the_way_is_no_area_and_makes_it_a_part(lost, lost_s):
    time_s, position, spraying = one_line()
    middle = (time_s > 45.0) & (time_s < 55.0)
    if lost == "place":
        position[middle] = np.nan
    elif lost == "pump":
        spraying[middle] = np.nan
    else:
        time_s, position, spraying = time_s[~middle], position[~middle], spraying[~middle]
    field = sprayed_field(time_s, position, spraying, swath_width=4.0)
    assert field is not None
    # From 0 to 45 m and from 55 to 100 m: 90 m by 4 m.
    assert field.area == pytest.approx(360.0)
    assert [len(run) for run in field.rows] == [46, 46]
    assert (field.sprayed_s, field.lost_s) == pytest.approx((100.0, lost_s))
    assert not field.whole


@pytest.mark.parametrize(("seconds", "whole", "area"), [(2.0, True, 400.0), (2.1, False, 392.0)])
def test_a_pause_of_two_seconds_is_none(seconds, whole, area):
    time_s, position, spraying = one_line()
    kept = np.arange(101) != 50
    time_s = time_s + np.where(time_s > 50.0, seconds - 2.0, 0.0)
    field = sprayed_field(time_s[kept], position[kept], spraying[kept], swath_width=4.0)
    assert field is not None
    assert field.whole == whole
    assert field.area == pytest.approx(area)


@pytest.mark.parametrize(("lost", "whole"), [(1, True), (2, False)])
def test_a_hundredth_of_the_time_may_be_lost(lost, whole):
    time_s, position, spraying = one_line()
    spraying[40 : 40 + lost] = np.nan
    field = sprayed_field(time_s, position, spraying, swath_width=4.0)
    assert field is not None
    assert field.lost_s == lost
    assert field.whole == whole


def test_line_spacing_needs_two_lines():
    assert np.isnan(line_spacing(()))


def test_shapes_that_disagree_are_refused():
    with pytest.raises(TrackError, match="spraying"):
        flown(np.zeros((4, 3)), np.zeros(5))
    with pytest.raises(TrackError, match="time_s"):
        sprayed_field(np.zeros(4), np.zeros((5, 3)), np.zeros(5))


def lines(*across: float, length: float = 20.0, turned_deg: float = 0.0):
    """Spray lines of a length at these distances across; the last one turned."""
    made = []
    for k, at in enumerate(across):
        angle = np.radians(turned_deg if k == len(across) - 1 else 0.0)
        ends = np.array([[0.0, at], [length * np.cos(angle), at + length * np.sin(angle)]])
        made.append(np.column_stack([ends, np.zeros(2)]))
    return tuple(made)


@pytest.mark.parametrize(("length", "spacing"), [(5.1, 4.0), (4.9, np.nan)])
def test_a_line_is_five_metres_long(length, spacing):
    np.testing.assert_allclose(line_spacing(lines(0.0, 4.0, 8.0, length=length)), spacing)


@pytest.mark.parametrize(("again", "spacing"), [(0.9, 4.0), (1.1, 2.55)])
def test_lines_within_a_metre_are_the_same_line_flown_again(again, spacing):
    # Of gaps of 1.1 and 4 m the median is half way between.
    assert line_spacing(lines(0.0, again, again + 4.0)) == pytest.approx(spacing)


@pytest.mark.parametrize(("turned", "lines_used"), [(9.0, 3), (13.0, 2)])
def test_lines_within_ten_degrees_are_parallel(turned, lines_used):
    # Three lines of which the last one is turned: about two thirds of that from their mean.
    found = line_spacing(lines(0.0, 4.0, 20.0, turned_deg=1.5 * turned))
    assert (found == pytest.approx(4.0, abs=0.8)) == (lines_used == 2)


@pytest.mark.parametrize(("bend", "spacing"), [(0.4, 4.0), (0.6, np.nan)])
def test_bends_of_less_than_half_a_metre_are_steering(bend, spacing):
    """Two lines of 8 m that swerve in the middle: in halves they would be too short to be lines."""
    swerving = [
        np.array([[0.0, at, 0.0], [4.0, at + bend, 0.0], [8.0, at, 0.0]]) for at in (0.0, 4.0)
    ]
    np.testing.assert_allclose(line_spacing(tuple(swerving)), spacing)
