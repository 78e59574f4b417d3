"""The rest of a mission against what can be worked out by hand."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from thrustmargin.mission.forecast.battery import FlightBattery
from thrustmargin.mission.forecast.plan_flight import PlanConditions
from thrustmargin.mission.plan import MissionPlan, PlanItem
from thrustmargin.mission.route import (
    Forecast,
    forecast,
    margin_at_fill,
    remaining_route,
)
from thrustmargin.models.flight import Origin
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_model import RotorModel, physics_model
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
NOW = PlanConditions(fill_kg=10.0, flow=0.05, density=1.225, battery=FlightBattery(voltage=58.8))


PARAMETERS = {"WP_SPD": 2.0, "WP_ACC": 1.0, "RTL_ALT_M": 3.0, "SPRAY_SPEED_MIN": 0.0}


def legs_ahead(item: int, here: Any = HERE, plan: MissionPlan = PLAN, **options: bool):
    return remaining_route(plan, item, here, HOME, parameters=PARAMETERS, speed=2.0, **options)[0]


def ahead(now: PlanConditions = NOW, item: int = 4, model: RotorModel = MODEL) -> Forecast:
    legs, limits = remaining_route(PLAN, item, HERE, HOME, parameters=PARAMETERS, speed=2.0)
    found = forecast(legs, limits, model, now)
    assert found is not None
    return found


def test_legs_follow_the_places_with_the_speed_and_pump_of_the_mission():
    legs = legs_ahead(4)
    assert [(leg.item, leg.pump, leg.speed) for leg in legs[:3]] == [
        (5, True, 5.0),
        (7, False, 5.0),
        (8, False, 2.0),  # the return has its own speed, that of the parameters
    ]
    assert [round(float(np.linalg.norm(leg.vector))) for leg in legs[:3]] == [100, 100, 50]
    assert legs[-1].end_ned == pytest.approx([0.0, 0.0, 0.0], abs=0.1)  # landed


def test_only_what_is_left_of_the_mission_counts():
    there = HERE + np.array([30.0, 0.0, 0.0])
    assert {leg.item for leg in legs_ahead(7, there)} == {7, 8}
    legs, limits = remaining_route(PLAN, 9, HERE, HOME, parameters=PARAMETERS, speed=2.0)
    assert legs == ()
    assert forecast(legs, limits, MODEL, NOW) is None


def test_the_pump_stays_as_it_is_until_the_mission_says_otherwise():
    early = [leg for leg in legs_ahead(3, np.zeros(3), spraying=True) if leg.item == 3]
    assert [leg.pump for leg in early] == [True]
    assert [leg.pump for leg in legs_ahead(3, np.zeros(3)) if leg.item == 3] == [False]


def test_altitudes_above_the_sea_and_above_home_are_not_mixed_up():
    plan = MissionPlan(items=(place(1, 10.0, 30.0, frame=0), place(2, 20.0, 30.0)), home=PLAN.home)
    heights = [round(float(-leg.end_ned[2]), 1) for leg in legs_ahead(1, np.zeros(3), plan)]
    assert heights == [25.0, 30.0]


def test_places_are_counted_from_home_though_the_log_has_another_origin():
    elsewhere = Origin(latitude_deg=36.6509, longitude_deg=116.9, altitude=15.0)
    here = HERE - np.array([99.87, 0.0, -10.0])
    legs, _ = remaining_route(PLAN, 4, here, elsewhere, parameters=PARAMETERS, speed=2.0)
    assert legs[0].start_ned == pytest.approx(HERE, abs=0.2)


def test_the_tank_falls_only_where_the_pump_is_on():
    track = ahead().analysis.track
    assert track.time_s[0] == 0.0
    # 100 m at 5 m/s, less in turn and start, at 0.01 kg a metre over ground.
    assert track.tank_kg[-1] == pytest.approx(10.0 - 1.0, abs=0.05)
    assert np.all(np.diff(track.tank_kg) <= 0)


def test_a_hover_at_the_end_has_the_margin_of_its_weight():
    # Weight alone: the margin of a hover with that tank, once the mission has landed gently.
    found = ahead()
    share = (21.1 + 9.0) * 9.80665 / 4 / (2.011e-5 * 3000**2)
    assert found.margin[-20] == pytest.approx(1 - share, abs=0.01)
    assert np.min(found.margin) <= found.lasting_margin


def test_turns_take_from_the_least_margin_and_not_from_what_lasts():
    found = ahead(model=shipped_model())
    assert found.lasting_margin - np.min(found.margin) > 0.05


def test_a_tank_that_runs_dry_on_the_way_stays_empty():
    tank = ahead(replace(NOW, fill_kg=0.5)).analysis.track.tank_kg
    dry = np.flatnonzero(tank <= 0.0)
    assert 9.0 < dry[0] / 10.0 < 16.0  # 50 m of a line at 5 m/s, from rest
    assert not tank[dry[0] :].any()


def test_wind_is_in_the_airspeed_and_not_in_the_time():
    still, head = ahead(), ahead(replace(NOW, wind_ned=(-3.0, 0.0, 0.0)))
    assert head.analysis.track.duration == pytest.approx(still.analysis.track.duration)
    middle = int(np.argmax(still.analysis.track.velocity_ned[:, 0]))
    gained = head.analysis.track.airspeed[middle] - still.analysis.track.airspeed[middle]
    assert gained == pytest.approx(3.0, abs=0.01)


def test_an_unknown_tank_gives_an_unknown_margin_and_not_a_guess():
    unknown = ahead(replace(NOW, fill_kg=NAN))
    assert math.isnan(unknown.lasting_margin)


def test_a_refill_takes_margin():
    full = margin_at_fill(MODEL, NOW, 16.0, 0.0)
    share = (21.1 + 16.0) * 9.80665 / 4 / (2.011e-5 * 3000**2)
    assert full == pytest.approx(1 - share, abs=1e-6)
    assert full < margin_at_fill(MODEL, NOW, 4.0, 0.0)
