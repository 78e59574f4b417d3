"""Shortest ways inside an area, against lengths reckoned by hand."""

import numpy as np
import pytest
import shapely

from tests.mission.fields_made import comb, rectangle
from thrustmargin.gcs_plugin.office.cover.spray_lines import Detours


def length(*points):
    return float(np.sum(np.hypot(*np.diff(np.array(points, dtype=float), axis=0).T)))


def test_a_free_way_has_no_corner():
    way = Detours(rectangle()).way(np.array([1.0, 1.0]), np.array([299.0, 199.0]))
    assert way is not None
    assert way.shape == (0, 2)


def test_round_a_hole_on_the_shorter_side():
    area = rectangle(300, 200) - rectangle(20, 100, at=(140, 60))
    way = Detours(area).way(np.array([100.0, 80.0]), np.array([200.0, 80.0]))
    assert way == pytest.approx(np.array([[140.0, 60.0], [160.0, 60.0]]), abs=0.1)


def test_out_of_one_arm_of_a_u_into_the_other():
    area = rectangle(300, 200) - rectangle(100, 120, at=(100, 80))
    start, end = np.array([50.0, 200.0]), np.array([250.0, 200.0])
    way = Detours(area).way(start, end)
    assert way is not None
    by_hand = 2 * np.hypot(50.0, 120.0) + 100.0
    assert length(start, *way, end) == pytest.approx(by_hand, abs=0.1)


def test_no_way_leads_from_one_part_to_another():
    parts = shapely.MultiPolygon([rectangle(10, 10), rectangle(10, 10, at=(50, 0))])
    assert Detours(parts).way(np.array([5.0, 5.0]), np.array([55.0, 5.0])) is None


def test_a_thousand_corners_are_simplified_on_the_inside():
    ring = comb(500, 60.0)
    area = ring - ring.buffer(-150)
    way = Detours(area).way(np.array([-650.0, 0.0]), np.array([650.0, 0.0]))
    assert way is not None
    line = shapely.LineString([(-650.0, 0.0), *way, (650.0, 0.0)])
    assert area.buffer(0.1).covers(line)
    assert 1700.0 < line.length < 2600.0  # half way round is at least the half circle of 550 m
