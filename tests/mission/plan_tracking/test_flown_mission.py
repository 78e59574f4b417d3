"""A mission that was flown as its plan, and one that differs by what the test made it."""

from dataclasses import replace

import numpy as np
import pytest

from tests.mission.plans_made import HOME, SECOND, TWO_LINES, plan_of, spot
from thrustmargin.mission.forecast.battery import FlightBattery
from thrustmargin.mission.forecast.limits import flight_limits
from thrustmargin.mission.forecast.plan_flight import PlanConditions, fly_plan, known_pump
from thrustmargin.mission.forecast.way import course, plan_legs
from thrustmargin.mission.plan_tracking.flown_mission import flown_mission
from thrustmargin.mission.steps import plan_steps
from thrustmargin.models.flight import Origin
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

MODEL = physics_model(load_airframe("topxgun-f16-sitl"))
PARAMETERS = {"WPNAV_ACCEL": 150.0, "BATT_CAPACITY": 22000.0}
PLAN = plan_of(*TWO_LINES)
BATTERY = FlightBattery(voltage=57.0, capacity_ah=22.0)


def flown(*, power: float = 1.0, speed: float = 1.0, seconds: float = 1e9) -> FlightAnalysis:
    """The plan as flown: with so many times the forecast's power and rotor speed, until so many
    s."""
    limits = flight_limits(PARAMETERS)
    way = course(plan_legs(PLAN, plan_steps(PLAN), limits), limits)
    pump = known_pump(PARAMETERS, MODEL.airframe).most  # sprays as fast as the forecast assumes
    given = PlanConditions(fill_kg=8.0, density=1.2, flow=pump, most_flow=pump, battery=BATTERY)
    made = fly_plan("made", way, MODEL, given)
    latitude, longitude, altitude = HOME
    track = replace(
        made.track,
        rotor_speed_rpm=speed * made.rotor_speed_rpm,
        current=power * made.power / made.track.voltage,
        origin=Origin(latitude_deg=latitude, longitude_deg=longitude, altitude=altitude),
    ).rows(made.track.time_s < seconds)
    density = made.density[: track.time_s.size]
    return analyse(track, MODEL, density, airframe_match=AirframeMatch())


def test_a_mission_flown_as_forecast_differs_in_nothing():
    made = flown_mission(PLAN, PARAMETERS, MODEL, flown(), BATTERY)
    assert made is not None
    assert made.complete
    assert made.stretches > 5
    assert made.seconds.flown == pytest.approx(made.seconds.said, rel=0.02)
    assert made.energy_wh.flown == pytest.approx(made.energy_wh.said, rel=0.02)
    assert made.leg_use.flown == pytest.approx(made.leg_use.said, abs=0.01)
    assert made.peak_use.flown == pytest.approx(made.peak_use.said, abs=0.03)


def test_energy_and_use_are_those_of_the_flight():
    made = flown_mission(PLAN, PARAMETERS, MODEL, flown(power=1.4, speed=1.1), BATTERY)
    assert made is not None
    assert made.energy_wh.flown == pytest.approx(1.4 * made.energy_wh.said, rel=0.02)
    assert made.leg_use.flown == pytest.approx(1.21 * made.leg_use.said, rel=0.02)


def test_a_plan_that_was_left_is_compared_as_far_as_it_was_flown():
    """On the way home, and 2.7 s before its end: then it did not wait over home either."""
    half = flown(seconds=95.0)
    made = flown_mission(PLAN, PARAMETERS, MODEL, half, BATTERY)
    assert made is not None
    assert not made.complete
    assert made.seconds.said < 95.0
    nearly = flown_mission(PLAN, PARAMETERS, MODEL, flown(seconds=100.0), BATTERY)
    assert nearly is not None
    assert nearly.seconds.said < 103.0  # without the 5 s over home
    assert made.energy_wh.flown == pytest.approx(made.energy_wh.said, rel=0.03)


def test_a_flight_elsewhere_is_no_mission():
    analysis = flown()
    track = analysis.track
    away = replace(track, position_ned=track.position_ned + np.array([5000.0, 0.0, 0.0]))
    assert flown_mission(PLAN, PARAMETERS, MODEL, replace(analysis, track=away), BATTERY) is None


def test_the_forecast_turns_the_nose_from_where_it_was_before_take_off():
    """Out along one line, and back without turning: the one turn is that of the take-off's
    heading, by 150°. Without it the largest use is that of the climb."""
    parameters = PARAMETERS | {"ATC_RAT_YAW_P": 1.0, "ATC_ACCEL_Y_MAX": 9000.0}
    plan, model = plan_of((22, spot(*HOME[:2])), (16, spot(SECOND, 11.0)), (20,)), shipped_model()
    limits = flight_limits(parameters, model=model)
    legs = plan_legs(plan, plan_steps(plan), limits)
    way = course(legs, limits, start_yaw=np.radians(150.0))
    pump = known_pump(parameters, model.airframe).most
    given = PlanConditions(fill_kg=2.0, density=1.2, flow=pump, most_flow=pump, battery=BATTERY)
    made = fly_plan("made", way, model, given)
    latitude, longitude, altitude = HOME
    track = replace(
        made.track,
        rotor_speed_rpm=made.rotor_speed_rpm,
        origin=Origin(latitude_deg=latitude, longitude_deg=longitude, altitude=altitude),
    )
    analysis = analyse(track, model, made.density, airframe_match=AirframeMatch())
    found = flown_mission(plan, parameters, model, analysis, BATTERY)
    assert found is not None
    assert found.peak_use.flown > 0.4
    assert found.peak_use.said == pytest.approx(found.peak_use.flown, abs=0.02)
