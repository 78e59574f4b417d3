"""Heights of the ground: two formats, and files that are none."""

import numpy as np
import pytest

from tests.mission.grounds import ascii_grid, north_slope, tile
from thrustmargin.mission.terrain import read_terrain
from thrustmargin.models.errors import PlanError


def test_an_ascii_grid_is_read_by_centre_and_by_corner(tmp_path):
    by_centre = read_terrain(ascii_grid(tmp_path / "a.asc", north_slope))
    corner = f"xllcorner {10.998 - 0.00005}\nyllcorner {47.998 - 0.00005}\n"
    by_corner = read_terrain(ascii_grid(tmp_path / "b.asc", north_slope, head=corner))
    places = np.array([48.0, 48.001, 48.00155]), np.full(3, 11.0)
    expected = [500.0, 500.0 + 0.3 * 111.32, 500.0 + 0.3 * 1.55 * 111.32]
    for terrain in (by_centre, by_corner):
        assert terrain.height(*places) == pytest.approx(expected, abs=0.01)
    assert by_centre.spacing == pytest.approx(7.45, abs=0.05)


def test_outside_and_beside_a_hole_there_is_no_height(tmp_path):
    def holed(latitude):
        return -9999.0 if abs(latitude - 48.0) < 1e-6 else 500.0

    terrain = read_terrain(ascii_grid(tmp_path / "a.asc", holed))
    latitude = np.array([47.9, 48.00005, 48.002, 48.1])
    found = terrain.height(latitude, np.full(4, 11.00003))
    assert np.isnan(found).tolist() == [True, True, False, True]


def test_a_tile_is_placed_by_its_name(tmp_path):
    heights = np.add.outer(np.arange(5.0)[::-1], 10.0 * np.arange(5.0))  # north is higher
    heights[0, 0] = -32768
    path = tile(tmp_path, "S01W070.hgt", heights)
    terrain = read_terrain(path)
    assert terrain.height(np.array([-1.0]), np.array([-70.0])) == pytest.approx(0.0)
    assert terrain.height(np.array([-0.5]), np.array([-69.5])) == pytest.approx(22.0)
    assert np.isnan(terrain.height(np.array([0.0]), np.array([-70.0])))[0]


@pytest.mark.parametrize(
    ("name", "content", "answer"),
    [
        ("a.tif", b"II*", r"is no heights of the ground.*gdalwarp -t_srs EPSG:4326"),
        ("a.asc", b"", "its header needs ncols"),
        ("a.asc", b"ncols 2\nnrows 2\n", "its header needs ncols"),
        (
            "a.asc",
            b"ncols 2\nnrows 2\nxllcorner 691000\nyllcorner 5300000\ncellsize 10\n1 2\n3 4\n",
            r"in metres of a map.*gdalwarp",
        ),
        (
            "a.asc",
            b"ncols 2\nnrows 2\nxllcorner 11\nyllcorner 48\ncellsize 0.1\n1 2\n3\n",
            "has 3 heights where 2 x 2 are due",
        ),
        (
            "a.asc",
            b"ncols 2\nnrows 2\nxllcorner 11\nyllcorner 48\ncellsize 0.1\n1 2\n3 x\n",
            "a word where a height belongs",
        ),
        ("N48E011.hgt", b"12345", "no square of heights"),
        ("hill.hgt", bytes(8), "name it as N48E011.hgt"),
    ],
)
def test_another_file_is_refused_with_the_remedy(tmp_path, name, content, answer):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(PlanError, match=answer):
        read_terrain(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(PlanError, match=r"no file .*hill"):
        read_terrain(tmp_path / "hill.asc")
