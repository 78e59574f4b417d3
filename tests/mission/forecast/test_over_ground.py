"""Plans over ground that is not level: heights, slopes, and places where thrust is short."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.mission.grounds import ascii_grid, north_slope
from tests.mission.plans_made import FIRST, HOME, SECOND, TWO_LINES, plan_of
from thrustmargin.mission.forecast.battery import climb_power
from thrustmargin.mission.forecast.plan_forecast import TakeOff, forecast
from thrustmargin.mission.terrain import read_terrain
from thrustmargin.models.errors import PlanError
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

MODEL = shipped_model()
DAY = TakeOff(fill_kg=4.0, flow=0.04)
ABOVE_GROUND = 10
LOST = "loses height"


def over_ground(plan):
    items = [replace(i, frame=ABOVE_GROUND) if i.command in (16, 22) else i for i in plan.items]
    return replace(plan, items=tuple(items))


PLAN = over_ground(plan_of(*TWO_LINES))


@pytest.fixture(scope="module")
def slope(tmp_path_factory):
    return read_terrain(ascii_grid(tmp_path_factory.mktemp("dem") / "slope.asc", north_slope))


@pytest.fixture(scope="module")
def uphill(slope):
    return forecast(PLAN, MODEL, DAY, terrain=slope)


def test_a_way_keeps_its_height_above_the_ground(uphill):
    track = uphill.flight.track
    lines = track.spraying > 0.0
    north, up = track.position_ned[lines, 0], -track.position_ned[lines, 2]
    # 3 m above a slope of 30 %, within what the corners cut off.
    assert up - 0.3 * north == pytest.approx(3.0, abs=1.5)
    assert "level ground" not in uphill.assumed
    level = forecast(PLAN, MODEL, DAY)
    assert "level ground" in level.assumed
    assert level.flight.track.height_agl.max() < 16.0 < up.max()


def test_a_hill_between_two_places_is_flown_over(tmp_path):
    """The ends of the line are at one height, and a hill of 20 m lies between."""

    def hill(latitude):
        middle = 0.5 * (FIRST + SECOND)
        return 500.0 + 20.0 * np.exp(-(((latitude - middle) / 0.0002) ** 2))

    ground = read_terrain(ascii_grid(tmp_path / "hill.asc", hill))
    track = forecast(PLAN, MODEL, DAY, terrain=ground).flight.track
    latitude = HOME[0] + track.position_ned[:, 0] / 111_200.0
    up = 500.0 - track.position_ned[:, 2]
    above = up - ground.height(latitude, np.full(latitude.size, 11.0))
    lines = track.spraying > 0.0
    assert up[lines].max() > 518.0
    assert above[lines] == pytest.approx(3.0, abs=1.5)


def test_a_slope_steeper_than_the_climb_limit_slows_the_vehicle(slope, uphill):
    assert not [place for place in uphill.places if place.kind == "slope slows"]
    fast = over_ground(plan_of(TWO_LINES[0], (178, 1.0, 12.0, -1.0), *TWO_LINES[2:]))
    places = forecast(fast, MODEL, DAY, terrain=slope).places
    found = {place.item: place for place in places if place.kind == "slope slows"}
    assert found[5].amount == pytest.approx(2.5 / 0.3, rel=0.05)  # WPNAV_SPEED_UP over the slope
    assert found[5].secondary == 12.0


def test_ground_that_the_file_lacks_is_named(tmp_path):
    small = ascii_grid(tmp_path / "s.asc", north_slope, south=47.9995, size=(12, 40))
    with pytest.raises(PlanError, match=r"s\.asc has no height of the ground at the way to item 5"):
        forecast(PLAN, MODEL, DAY, terrain=read_terrain(small))


def test_a_way_into_the_ground_is_named(slope):
    """Heights above home, and the hill is not in the plan."""
    made = forecast(plan_of(*TWO_LINES), MODEL, DAY, terrain=slope)
    found = {place.item: place.amount for place in made.places if place.kind == "into the ground"}
    assert found[5] == pytest.approx(0.3 * 166.9 - 3.0, abs=2.0)
    assert not [
        p for p in forecast(PLAN, MODEL, DAY, terrain=slope).places if p.kind == "into the ground"
    ]


def weak(share):
    """Return the model of an F16 whose rotors give `share` of its weight with 4 kg on board."""
    craft = load_airframe("topxgun-f16-sitl")
    weight = (craft.empty_mass + 4.0) * 9.80665
    top = (share * weight / (4.0 * craft.thrust_coefficient)) ** 0.5
    return physics_model(replace(craft, max_rotor_speed_rpm=top, ceiling_voltage_exponent=0.0))


def test_braking_without_reserve_loses_height_and_with_reserve_none():
    """From 10 m/s with 5 m/s² a copter leans 27°, which takes 1.12 of its weight."""
    day = replace(DAY, altitude=0.0, air_temperature=288.15, flow=math.nan)
    quick = {"WP_ACC": 5.0, "WP_JERK": 20.0, "WP_SPD": 10.0, "ATC_INPUT_TC": 0.1}
    plan = plan_of(TWO_LINES[0], *TWO_LINES[2:])
    lost = [
        [p for p in forecast(plan, weak(share), day, parameters=quick).places if p.kind == LOST]
        for share in (1.05, 1.2)
    ]
    assert lost[0]
    # It lacks 0.06 of its thrust, 0.7 m/s², for the 2 s of braking and turning.
    assert all(0.5 <= place.amount < 4.0 for place in lost[0])
    assert not lost[1]


def test_a_motor_at_idle_in_a_descent_is_named():
    """With such an idle the rotors cannot give less than hovering takes."""
    found = forecast(plan_of(*TWO_LINES), MODEL, DAY, parameters={"MOT_SPIN_MIN": 0.9}).places
    assert {place.kind for place in found} >= {"motors at idle"}
    usual = forecast(plan_of(*TWO_LINES), MODEL, DAY, parameters={"MOT_SPIN_MIN": 0.15}).places
    assert "motors at idle" not in {place.kind for place in usual}


def test_climbing_takes_energy_and_descending_gives_part_of_it_back():
    craft = MODEL.airframe
    thrust = np.full((3, 4), 25.0 * 9.80665 / 4.0)
    up, still, down = climb_power(craft, thrust, np.full(3, 1.225), np.array([2.0, 0.0, -2.0]))
    assert still == pytest.approx(0.0)
    # About half of the weight's power: the rotors' own wash falls as the air comes from above.
    assert up == pytest.approx(0.5 * 25.0 * 9.80665 * 2.0 / 0.85, rel=0.15)
    assert -up < down < 0.0
