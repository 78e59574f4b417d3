"""Flights made by hand beside the forecast of their plan: what differs is found, and nothing else.

The flight is the plan flown under conditions that the test knows, with rotor speeds of its own.
"""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from tests.mission.plans_made import HOME, TWO_LINES, plan_of
from thrustmargin.mission.forecast.battery import FlightBattery
from thrustmargin.mission.forecast.limits import flight_limits
from thrustmargin.mission.forecast.plan_flight import PlanConditions, PlanFlight, fly_plan
from thrustmargin.mission.forecast.way import Span, course, plan_legs
from thrustmargin.mission.plan_tracking.blame import ShownDay, which_was_off
from thrustmargin.mission.plan_tracking.stretches import (
    FlownWay,
    PlanComparison,
    compare_with_plan,
    flown_way,
    stretch_ends,
)
from thrustmargin.mission.steps import plan_steps
from thrustmargin.models.flight import Origin
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

MODEL = physics_model(load_airframe("topxgun-f16-sitl"))
LIMITS = flight_limits({"WPNAV_ACCEL": 150.0})
PLAN = plan_of(*TWO_LINES)
COURSE = course(plan_legs(PLAN, plan_steps(PLAN), LIMITS), LIMITS)
CLAIM = AirframeMatch()
TRUE = PlanConditions(fill_kg=8.0, density=1.15, flow=0.05, battery=FlightBattery(voltage=54.0))
FOUND = ShownDay(wind_ned=(0.0, 0.0, 0.0), fill_kg=8.0, density=1.15)


def flown_by(given: PlanConditions) -> PlanFlight:
    return fly_plan("made", COURSE, MODEL, given)


def forecast_of(flight: PlanFlight) -> FlightAnalysis:
    return analyse(flight.track, MODEL, flight.density, airframe_match=CLAIM)


@cache
def flight(
    speed_factor: float = 1.0,
    seconds: float = 1e9,
    aside: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> FlownWay:
    """What was flown under TRUE, until so many s, with rotors so much faster and placed aside."""
    made = flown_by(TRUE)
    speeds = forecast_of(made).prediction.rotor_speed_rpm * speed_factor
    latitude, longitude, altitude = HOME
    track = replace(
        made.track,
        rotor_speed_rpm=speeds,
        position_ned=made.track.position_ned + np.array(aside),
        origin=Origin(latitude_deg=latitude, longitude_deg=longitude, altitude=altitude),
    ).rows(made.track.time_s < seconds)
    density = made.density[: track.time_s.size]
    return flown_way(analyse(track, MODEL, density, airframe_match=CLAIM), HOME)


def compared(given: PlanConditions, way: FlownWay) -> PlanComparison:
    made = flown_by(given)
    return compare_with_plan(made, forecast_of(made), way)


def off(given: PlanConditions, way: FlownWay, found: ShownDay = FOUND) -> list[str]:
    return [one.what for one in which_was_off(lambda c: compared(c, way), given, found)]


def test_a_flight_as_forecast_differs_in_nothing():
    made = compared(TRUE, flight())
    assert made.left_at is None
    assert {s.kind for s in made.stretches} >= {"leg", "turn", "climb"}
    for stretch in made.stretches:
        for pair, near in (
            (stretch.seconds, 1e-9),
            (stretch.speed, 0.05),
            (stretch.utilisation_mean, 0.003),
            (stretch.tank_end_kg, 0.01),
            (stretch.voltage, 0.01),
        ):
            assert pair.flown == pytest.approx(pair.forecast, abs=near)
    assert off(TRUE, flight()) == []


@pytest.mark.parametrize(
    ("what", "wrong", "forecast", "flown"),
    [
        ("fill", replace(TRUE, fill_kg=6.0), 6.0, 8.0),
        ("flow", replace(TRUE, flow=0.08), None, None),
        ("battery", replace(TRUE, battery=FlightBattery(voltage=48.0)), 48.0, 54.0),
        ("wind", replace(TRUE, wind_ned=(5.0, 0.0, 0.0)), 5.0, 0.0),
    ],
)
def test_the_one_assumption_that_was_off_is_named_with_its_amounts(
    what: str, wrong: PlanConditions, forecast: float | None, flown: float | None
):
    (one,) = which_was_off(lambda c: compared(c, flight()), wrong, FOUND)
    assert one.what == what
    if forecast is not None:
        assert one.amount.forecast == pytest.approx(forecast, abs=0.2)
        assert one.amount.flown == pytest.approx(flown, abs=0.2)
    else:  # 0.08 kg/s in place of 0.05
        assert one.amount.forecast / one.amount.flown == pytest.approx(1.6, abs=0.01)


def test_a_wind_that_takes_no_thrust_is_said_to_have_taken_none():
    blown = replace(TRUE, wind_ned=(5.0, 0.0, 0.0))
    (one,) = which_was_off(lambda c: compared(c, flight()), blown, FOUND)
    assert not one.mattered


def test_two_that_were_off_are_both_named():
    wrong = replace(TRUE, fill_kg=5.0, battery=FlightBattery(voltage=48.0))
    assert set(off(wrong, flight())) == {"fill", "battery"}


def test_two_that_were_off_by_as_much_do_not_hide_each_other():
    """0.8 kg of 0.16 kg that a good forecast has, and 2.5 V of 0.5 V: five times each."""
    wrong = replace(TRUE, fill_kg=7.2, battery=FlightBattery(voltage=51.5))
    assert set(off(wrong, flight())) == {"fill", "battery"}


def test_what_no_assumption_explains_is_left_to_the_model():
    # Rotors 6 % faster take 12 % more thrust: of 40 % in use about five points.
    (one,) = which_was_off(lambda c: compared(c, flight(1.06)), TRUE, FOUND)
    assert one.what == "model"
    assert one.amount.flown / one.amount.forecast == pytest.approx(1.1236, abs=0.02)
    assert one.item > 0


def test_a_gauge_that_is_silent_blames_no_fill():
    silent = replace(FOUND, fill_kg=float("nan"))
    wrong = replace(TRUE, fill_kg=5.0)
    assert "fill" not in off(wrong, flight(), silent)


def test_a_flight_that_ends_early_leaves_the_plan_there():
    made = compared(TRUE, flight(seconds=20.0))
    assert made.left_at is not None
    assert 0 < len(made.stretches) < len(compared(TRUE, flight()).stretches)


def test_a_flight_elsewhere_is_none_of_this_plan():
    made = compared(TRUE, flight(aside=(0.0, 200.0, 0.0)))
    assert made.stretches == ()
    assert made.left_at == COURSE.legs[0].leg.item


@pytest.mark.parametrize("aside", [(5.0, 0.0, 0.0), (0.0, 5.0, 0.0), (0.0, 0.0, -10.0)])
def test_a_flight_5_m_beside_or_10_m_above_its_way_is_still_on_it(
    aside: tuple[float, float, float],
):
    """5 m of 2 m that a flight is off are 2.5 of 3; 0.4 of 10 m are 2 of 3."""
    assert compared(TRUE, flight(aside=aside)).left_at is None


def planned_along(step_ned: tuple[float, float, float]) -> PlanFlight:
    """20 s along one direction, m each second."""
    made = SimpleNamespace(
        track=SimpleNamespace(
            time_s=np.arange(21.0), position_ned=np.outer(np.arange(21.0), step_ned)
        ),
        course=SimpleNamespace(spans=(Span(item=1, kind="leg", first=0, last=20),)),
    )
    return cast(PlanFlight, made)


def way_along(step_ned: tuple[float, float, float]) -> FlownWay:
    unknown = np.full(60, np.nan)
    time_s = np.arange(60.0)
    return FlownWay(
        time_s=time_s,
        place_ned=np.outer(time_s, step_ned),
        speed=unknown,
        utilisation=unknown,
        tank_kg=unknown,
        voltage=unknown,
    )


@pytest.mark.parametrize(("late_s", "ends"), [(20.0, 1), (22.0, 0)])
def test_a_stretch_of_20_s_may_be_21_s_late(late_s: float, ends: int):
    """3 s and a fifth of the stretch are usual, 7 s, and three times as much is still this plan."""
    way = way_along((1000.0 / (20.0 + late_s), 0.0, 0.0))
    assert stretch_ends(planned_along((50.0, 0.0, 0.0)), way) == (int(20.0 + late_s),) * ends


def test_a_climb_that_was_not_flown_is_where_the_plan_was_left():
    """Of 10 m up, 3 in 20 s: 2 m are usual, three times as much is still this plan."""
    up = planned_along((0.0, 0.0, -0.5))
    assert stretch_ends(up, way_along((0.0, 0.0, -0.5))) == (20,)
    assert stretch_ends(up, way_along((0.0, 0.0, 0.0))) == ()
