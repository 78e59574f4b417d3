"""Lines over an area and their order: their number by hand, cells where something divides them."""

import numpy as np
import pytest
import shapely

from tests.mission.fields_made import SHAPES, rectangle
from thrustmargin.gcs_plugin.office.cover.spray_lines import fewest_turns, lines_in_order

CORNER = np.zeros(2)


def over(*shapes, swath=4.0, heading=90.0):
    return lines_in_order(shapely.MultiPolygon([*shapes]), swath, heading, CORNER)


@pytest.mark.parametrize(
    ("name", "heading", "cells"),
    [
        ("square", 90.0, 1),
        ("L", 90.0, 1),
        ("U", 90.0, 3),  # below the notch, and the arms left and right of it
        ("U", 0.0, 1),
        ("hole", 90.0, 4),  # below, left, right, above
        ("split", 90.0, 2),
    ],
)
def test_a_notch_and_a_hole_divide_the_lines_into_cells(name, heading, cells):
    assert over(*SHAPES[name][0], heading=heading).cells == cells


@pytest.mark.parametrize(
    ("height", "lines"),
    [
        (200.0, 50),
        (201.0, 50),  # 4.02 m apart
        (203.0, 51),
        (3.0, 1),  # narrower than a swath
        (4.1, 2),  # one line would leave gaps of more than 2 %
        (4.05, 1),
    ],
)
def test_lines_are_as_many_as_the_width_takes(height, lines):
    found = over(rectangle(300.0, height))
    assert len(found.lines) == lines
    assert found.spacing[0] == pytest.approx(height / lines)
    assert found.spacing[0] <= 4.0 * 1.02


def test_neighbouring_lines_are_flown_there_and_back_from_the_start():
    found = lines_in_order(shapely.MultiPolygon([rectangle()]), 4.0, 90.0, np.array([300.0, 200.0]))
    assert found.lines[0] == pytest.approx(np.array([[300.0, 198.0], [0.0, 198.0]]))
    assert found.lines[1] == pytest.approx(np.array([[0.0, 194.0], [300.0, 194.0]]))


def test_a_line_through_a_corner_is_counted_once():
    diamond = shapely.Polygon([(0, 0), (10, 10), (0, 20), (-10, 10)])
    found = over(diamond, swath=20.0 / 3)  # its middle line goes through two corners
    lengths = np.hypot(*np.moveaxis(found.lines[:, 1] - found.lines[:, 0], -1, 0))
    assert sorted(lengths) == pytest.approx([20.0 / 3, 20.0 / 3, 20.0])


@pytest.mark.parametrize("turned", [0.0, 20.0, 77.0, 135.0])
def test_the_heading_with_the_fewest_turns_is_along_the_field(turned):
    field = shapely.affinity.rotate(rectangle(400.0, 60.0), turned)  # counter-clockwise from east
    found = fewest_turns(field, 4.0)
    assert abs((found - (90.0 - turned) + 90.0) % 180.0 - 90.0) < 0.1
