"""A mission that was flown as its plan, and one that differs by what the test made it."""

from dataclasses import replace

import numpy as np
import pytest

from tests.mission.plans_made import HOME, TWO_LINES, plan_of
from thrustmargin.mission.forecast.battery import FlightBattery
from thrustmargin.mission.forecast.limits import flight_limits
from thrustmargin.mission.forecast.plan_flight import PlanConditions, fly_plan, known_pump
from thrustmargin.mission.forecast.way import course, plan_legs
from thrustmargin.mission.plan_tracking.flown_mission import flown_mission
from thrustmargin.mission.steps import plan_steps
from thrustmargin.models.flight import Origin
from thrustmargin.models.model.airframe_claim import AirframeClaim
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
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
    return analyse(track, MODEL, density, claim=AirframeClaim())


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
    half = flown(seconds=100.0)
    made = flown_mission(PLAN, PARAMETERS, MODEL, half, BATTERY)
    assert made is not None
    assert not made.complete
    assert made.seconds.said < 100.0
    assert made.energy_wh.flown == pytest.approx(made.energy_wh.said, rel=0.03)


def test_a_flight_elsewhere_is_no_mission():
    analysis = flown()
    track = analysis.track
    away = replace(track, position_ned=track.position_ned + np.array([5000.0, 0.0, 0.0]))
    assert flown_mission(PLAN, PARAMETERS, MODEL, replace(analysis, track=away), BATTERY) is None
