"""Home, wind and sprayed ground: drawn where they were reported, and only there."""

import numpy as np
import pytest

from thrustmargin.gcs_plugin.view.scene.surroundings import SprayedGround, arrow

MOST = 6000  # stretches of sprayed ground that are kept


def line(count: int) -> np.ndarray:
    return np.column_stack([np.arange(count) * 2.0, np.zeros(count), np.full(count, 5.0)])


def test_ground_is_sprayed_while_the_pump_is_on_and_at_no_other_time():
    ground = SprayedGround()
    ground.add(line(7), np.array([0.0, 1.0, 1.0, 0.0, np.nan, 1.0, 1.0]), 3.0)
    np.testing.assert_allclose(
        ground.points[..., 0], [[2.0, 4.0], [10.0, 12.0]]
    )  # not from 4 to 10
    np.testing.assert_allclose(ground.points[..., 2], 3.02)


def test_a_stretch_goes_on_from_batch_to_batch():
    ground, whole = SprayedGround(), SprayedGround()
    for part in np.split(line(10), [3, 4, 8]):
        ground.add(part, np.ones(len(part)), 0.0)
    whole.add(line(10), np.ones(10), 0.0)
    np.testing.assert_array_equal(ground.points, whole.points)
    assert len(whole.points) == 9


def test_an_unknown_place_is_not_crossed_and_memory_is_bounded():
    ground = SprayedGround()
    places = line(4)
    places[1] = np.nan
    ground.add(places, np.ones(4), 0.0)
    assert ground.points[..., 0].tolist() == [[4.0, 6.0]]
    ground.add(line(MOST + 500), np.ones(MOST + 500), 0.0)
    assert len(ground.points) == MOST


@pytest.mark.parametrize("degrees", [0.0, 37.0, 180.0, 271.0])
def test_the_arrow_points_the_way_the_air_moves(degrees: float):
    way = np.array([np.sin(np.radians(degrees)), np.cos(np.radians(degrees))])
    shaft, *head = arrow(way, np.array([10.0, 20.0, 1.0]), 8.0)
    np.testing.assert_allclose(shaft[1] - shaft[0], [*8.0 * way, 0.0], atol=1e-9)
    for edge in head:
        np.testing.assert_allclose(edge[0], shaft[1])
        assert (edge[1] - edge[0])[:2] @ way < 0.0  # back from the tip
