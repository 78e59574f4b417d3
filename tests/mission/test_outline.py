"""Outlines of fields: what is none on Earth is refused, wherever it lies."""

import math

import numpy as np
import pytest
import shapely

from tests.mission.fields_made import PLANE, degrees, rectangle
from thrustmargin.mission.outline import field_outline
from thrustmargin.models.errors import PlanError


def test_an_area_is_that_of_the_ground():
    field = field_outline("north", [degrees(rectangle(1000.0, 2000.0))])
    assert field.area.area == pytest.approx(2e6, rel=1e-5)


def test_points_come_back_from_the_plane():
    points = np.array([[0.0, 0.0], [1500.0, -800.0]])
    there = shapely.points(PLANE.to_degrees(points)[:, ::-1])
    back = shapely.get_coordinates(PLANE.to_plane(there))
    assert back == pytest.approx(points, abs=0.02)


@pytest.mark.parametrize(
    ("corners", "area"),
    [
        # 0.002 degrees of longitude at 10 degrees north are 219.2 m, of latitude 221.2 m
        ([(179.999, 10), (-179.999, 10), (-179.999, 10.002), (179.999, 10.002)], 219.2 * 221.2),
        # a circle of 36 corners 111.7 m round the pole
        ([(10 * k, 89.999) for k in range(36)], 18 * 111.7**2 * math.sin(math.radians(10))),
    ],
)
def test_the_date_line_and_the_pole_are_places(corners, area):
    field = field_outline("edge", [shapely.Polygon(corners)])
    assert field.area.area == pytest.approx(area, rel=3e-3)
    assert np.abs(field.plane.to_degrees(np.array([[200.0, 0.0]]))).max() <= 180.0


@pytest.mark.parametrize(
    ("shape", "words"),
    [
        ([], "has no polygon"),
        ([shapely.Polygon()], "has no polygon"),
        ([shapely.Polygon([(0, 0), (0.01, 0.01), (0.01, 0), (0, 0.01)])], "crosses itself near"),
        ([shapely.box(500000, 5000000, 500100, 5000100)], "degrees are needed"),
        ([shapely.box(-80, -80, 80, 80)], "km across, which is no field"),
        ([shapely.box(0, 0, 1e-6, 1e-6)], "area below 1 m², which is no field"),
        ([shapely.Polygon([(0, 0), (0, 0.001), (0, 0.002)])], "crosses itself near"),
        ([degrees(shapely.Point(0, 0).buffer(100, quad_segs=3000))], "corners, over 10000"),
    ],
)
def test_what_is_no_field_is_refused(shape, words):
    with pytest.raises(PlanError, match=words) as caught:
        field_outline("odd.kml", shape)
    assert str(caught.value).startswith("odd.kml ")
    assert "\n" not in str(caught.value)


def test_a_corner_that_is_no_number_is_refused():
    with np.errstate(invalid="ignore"):
        shape = shapely.Polygon([(0, 0), (math.nan, 1), (1, 0)])
    with pytest.raises(PlanError, match="a corner that is no number"):
        field_outline("odd.kml", [shape])
