"""The planned path lies where the mission's items are."""

import numpy as np
import pytest

from thrustmargin.gcs_plugin.view.scene.shown_row import distinct_legs, plan_enu
from thrustmargin.mission.plan_items import PlanItem
from thrustmargin.models.flight import Origin

ORIGIN = Origin(latitude_deg=36.65, longitude_deg=116.9, altitude=20.0)


def item(number, *, north=0.0, east=0.0, altitude=3.0, command=16, frame=6, **place) -> PlanItem:
    metres = 111_000.0
    latitude = place.get("latitude_deg", 36.65 + north / metres)
    longitude = place.get("longitude_deg", 116.9 + east / metres / np.cos(np.radians(36.65)))
    return PlanItem(
        number=number,
        command=command,
        frame=frame,
        parameters=(0.0, 0.0, 0.0, 0.0, latitude, longitude, altitude),
    )


def test_places_are_east_north_and_up_of_the_origin():
    path = plan_enu([item(1, north=100), item(2, east=50)], ORIGIN, ground=-0.5)
    np.testing.assert_allclose(path, [[0, 100, 2.5], [50, 0, 2.5]], rtol=5e-3, atol=0.02)


def test_an_altitude_above_the_sea_is_taken_as_one():
    assert plan_enu([item(1, altitude=32.0, frame=0)], ORIGIN, ground=0.0)[0, 2] == pytest.approx(
        12
    )


def test_home_items_without_a_place_and_commands_are_left_out():
    items = [
        item(0),
        item(1, latitude_deg=np.nan),
        item(2, latitude_deg=0.0, longitude_deg=0.0),
        item(3, command=178),
        item(4, north=10),
    ]
    assert len(plan_enu(items, ORIGIN, 0.0)) == 1


def test_without_an_origin_nothing_is_placed():
    assert plan_enu([item(1), item(2)], None, 0.0).shape == (0, 3)


def rows_of(count: int, apart: float, length: float):
    """The corners of `count` lines, flown there and back."""
    east = np.repeat(np.arange(count) * apart, 2)
    north = np.tile([0.0, length, length, 0.0], count)[: 2 * count]
    return np.column_stack([east, north]).astype(np.float64)


def test_of_a_plan_as_it_is_flown_every_leg_is_drawn():
    """40 lines of 200 m, 5 m apart, and the 39 ways between them."""
    assert distinct_legs(rows_of(40, 5.0, 200.0)).shape == (79, 2, 2)


def test_of_lines_closer_than_a_picture_shows_one_is_drawn():
    """5000 lines on 10 km: 2000 pixels hold 2000 of them, and as many ways between them."""
    legs = distinct_legs(rows_of(5000, 2.0, 500.0))
    assert 3900 < len(legs) < 4100
    assert np.ptp(legs[..., 0]) == pytest.approx(9998.0, abs=5.0)


def test_a_plan_at_one_place_has_no_leg():
    assert distinct_legs(np.zeros((3, 2))).shape == (0, 2, 2)
    assert distinct_legs(np.zeros((0, 2))).shape == (0, 2, 2)
