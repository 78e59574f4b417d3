"""The rest of a mission against what can be worked out by hand."""

import math

import numpy as np
import pytest

from thrustmargin.mission.plan import MissionPlan, PlanItem
from thrustmargin.mission.rest_of_route import (
    Conditions,
    Leg,
    forecast,
    margin_at_fill,
    route_ahead,
)
from thrustmargin.models.flight import Origin
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

AIRFRAME = load_airframe("topxgun-f16-sitl")
MODEL = physics_model(AIRFRAME)
HOME = Origin(latitude_deg=36.65, longitude_deg=116.9, altitude=5.0)
NAN = math.nan


def item(number: int, command: int, *parameters: float, frame: int = 3) -> PlanItem:
    seven = (*parameters, *[0.0] * (7 - len(parameters)))
    return PlanItem(number=number, command=command, frame=frame, parameters=seven)  # type: ignore[arg-type]


def place(number: int, north: float, height: float = 3.0, frame: int = 3) -> PlanItem:
    """A waypoint `north` m of home (111.2 km a degree is near enough for these checks)."""
    latitude = HOME.latitude_deg + north / 110_970.0
    return item(number, 16, 0, 0, 0, 0, latitude, HOME.longitude_deg, height, frame=frame)


PLAN = MissionPlan(
    items=(
        item(1, 22, 0, 0, 0, 0, 0, 0, 3.0),
        item(2, 178, 1, 5.0),
        place(3, 50.0),
        item(4, 216, 1),
        place(5, 150.0),
        item(6, 216, 0),
        place(7, 50.0),
        item(8, 20),
    ),
    home=(HOME.latitude_deg, HOME.longitude_deg, 5.0),
)
HERE = np.array([50.0, 0.0, -3.0])
NOW = Conditions(tank_kg=10.0, flow=0.05, density=1.225, voltage=58.8)


def test_legs_follow_the_places_with_the_speed_and_pump_of_the_mission():
    legs = route_ahead(PLAN, 4, HERE, HOME, speed=2.0)
    assert [(leg.item, leg.spraying, leg.speed) for leg in legs] == [
        (5, True, 5.0),
        (7, False, 5.0),
        (8, False, 5.0),
    ]
    assert [round(leg.seconds) for leg in legs] == [20, 20, 10]
    assert legs[-1].end_ned[:2] == pytest.approx([0.0, 0.0], abs=0.1)


def test_only_what_is_left_of_the_mission_counts():
    there = HERE + np.array([30.0, 0.0, 0.0])
    assert [leg.item for leg in route_ahead(PLAN, 7, there, HOME, speed=2.0)] == [7, 8]
    assert route_ahead(PLAN, 9, HERE, HOME, speed=2.0) == ()


def test_altitudes_above_the_sea_and_above_home_are_told_apart():
    plan = MissionPlan(items=(place(1, 10.0, 30.0, frame=0), place(2, 20.0, 30.0)), home=PLAN.home)
    legs = route_ahead(plan, 1, np.zeros(3), HOME, speed=1.0)
    assert [round(float(-leg.end_ned[2]), 1) for leg in legs] == [25.0, 30.0]


def test_the_tank_falls_only_where_the_pump_is_on():
    found = forecast(route_ahead(PLAN, 4, HERE, HOME, speed=2.0), MODEL, NOW)
    assert found is not None
    track = found.analysis.track
    assert track.time_s[0] == 0.0
    assert track.time_s[-1] == pytest.approx(50.0, abs=0.2)
    assert track.tank_kg[-1] == pytest.approx(10.0 - 20 * 0.05, abs=0.01)
    assert np.all(np.diff(track.tank_kg) <= 0)
    assert np.all(track.tank_kg > 0.0)
    # Weight alone: the margin of a hover with that tank.
    share = (21.1 + 9.0) * 9.80665 / 4 / (2.011e-5 * 3000**2)
    assert found.margin[-1] == pytest.approx(1 - share, abs=1e-3)
    assert found.least_margin == pytest.approx(float(found.margin[0]))


def test_a_tank_that_will_not_last_says_when_it_is_empty():
    short = Conditions(tank_kg=0.5, flow=0.05, density=1.225, voltage=58.8)
    found = forecast(route_ahead(PLAN, 4, HERE, HOME, speed=2.0), MODEL, short)
    assert found is not None
    dry = found.analysis.track.time_s[found.analysis.track.tank_kg <= 0.0]
    assert dry[0] == pytest.approx(10.0, abs=5.0)


def test_wind_is_in_the_airspeed_and_not_in_the_time():
    leg = Leg(
        item=1, start_ned=np.zeros(3), end_ned=np.array([50.0, 0, 0]), speed=5.0, spraying=False
    )
    head = Conditions(tank_kg=5, flow=0, density=1.2, voltage=50, wind_ned=(-3.0, 0.0, 0.0))
    found = forecast([leg], MODEL, head)
    assert found is not None
    assert np.allclose(found.analysis.track.airspeed, 8.0)
    assert found.analysis.track.time_s[-1] == pytest.approx(10.0)


def test_no_way_left_is_no_forecast():
    assert forecast([], MODEL, NOW) is None


def test_an_unknown_tank_gives_an_unknown_margin_and_not_a_guess():
    unknown = Conditions(tank_kg=NAN, flow=0.05, density=1.225, voltage=58.8)
    found = forecast(route_ahead(PLAN, 4, HERE, HOME, speed=2.0), MODEL, unknown)
    assert found is not None
    assert math.isnan(found.least_margin)


def test_a_refill_takes_margin():
    full = margin_at_fill(MODEL, NOW, 16.0, 0.0)
    share = (21.1 + 16.0) * 9.80665 / 4 / (2.011e-5 * 3000**2)
    assert full == pytest.approx(1 - share, abs=1e-6)
    assert full < margin_at_fill(MODEL, NOW, 4.0, 0.0)


def test_a_tank_that_runs_dry_on_the_way_stays_empty():
    legs = route_ahead(PLAN, 4, HERE, HOME, speed=2.0)
    found = forecast(legs, MODEL, Conditions(tank_kg=2.0, flow=1.0, density=1.225, voltage=58.8))
    assert found is not None
    # 1 kg/s for 20 s of spraying, in rows of 5 s: all gone with the first.
    np.testing.assert_allclose(found.analysis.track.tank_kg[:3], [2.0, 0.0, 0.0])
    assert not found.analysis.track.tank_kg[1:].any()
