"""A plan beside its flight is flown as before take-off, and so is the rest of one in flight."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.mission.plans_made import TWO_LINES, plan_of
from thrustmargin.mission.forecast.battery import FlightBattery
from thrustmargin.mission.forecast.limits import flight_limits
from thrustmargin.mission.forecast.plan_flight import PlanConditions
from thrustmargin.mission.forecast.plan_forecast import TakeOff
from thrustmargin.mission.forecast.plan_forecast import forecast as before_take_off
from thrustmargin.mission.forecast.way import plan_legs
from thrustmargin.mission.plan_tracking.stretches import PlanToFly, conditions_before_take_off
from thrustmargin.mission.route import forecast
from thrustmargin.mission.steps import plan_steps
from thrustmargin.models.model.model_file import shipped_model

MODEL = shipped_model()
PLAN = plan_of(*TWO_LINES)
SHARP = {"ATC_ACCEL_Y_MAX": 2500.0, "ATC_RATE_Y_MAX": 45.0, "ATC_RAT_YAW_P": 1.5}


def test_where_the_rotors_have_no_moment_left_every_forecast_gives_up_yaw_alike():
    """16 kg at 4,000 m: turns ask more than a rotor has, and the nose turns slower."""
    made = before_take_off(PLAN, MODEL, TakeOff(fill_kg=16.0, altitude=4000.0), parameters=SHARP)
    assert "nose gives way" in made.assumed
    given = conditions_before_take_off(SHARP, MODEL.airframe, fill_kg=16.0, altitude=4000.0)
    flight, _ = PlanToFly.from_plan(PLAN, SHARP, MODEL).fly(given)
    assert flight.course.limits.yaw_acceleration == made.limits.yaw_acceleration
    limits = flight_limits(SHARP)
    legs = plan_legs(PLAN, plan_steps(PLAN), limits)
    now = PlanConditions(fill_kg=16.0, density=given.density, battery=FlightBattery(voltage=54.0))
    ahead = forecast(legs, limits, MODEL, now)
    assert ahead is not None
    slow, fast = (np.abs(a.track.angular_rate_frd[:, 2]).max() for a in (ahead.analysis, still()))
    assert slow < 0.95 * fast


def still():
    """The same rest at sea level with an empty tank, where the nose has all it asks for."""
    limits = flight_limits(SHARP)
    now = PlanConditions(fill_kg=0.0, density=1.225, battery=FlightBattery(voltage=54.0))
    made = forecast(plan_legs(PLAN, plan_steps(PLAN), limits), limits, MODEL, now)
    assert made is not None
    return made.analysis


def test_what_is_known_before_is_still_default_air_and_the_battery_of_the_parameters():
    given = conditions_before_take_off(
        {"BATT_CAPACITY": 16000.0}, MODEL.airframe, fill_kg=8.0, altitude=1000.0
    )
    assert given.wind_ned == (0.0, 0.0, 0.0)
    assert given.density == pytest.approx(1.033, abs=0.001)  # 898.75 hPa at 1000 m, and 30 °C
    assert given.battery.capacity_ah == 16.0


def test_the_air_and_the_rest_voltage_that_a_log_shows_are_taken():
    known = {"fill_kg": 8.0, "altitude": 1000.0, "density": 1.2, "rest_voltage": 57.0}
    given = conditions_before_take_off({"BATT_CAPACITY": 16000.0}, MODEL.airframe, **known)
    assert (given.density, given.battery.voltage) == (1.2, 57.0)
    # Without a capacity the voltage is held, and that at rest is more than that under load.
    held = conditions_before_take_off({}, MODEL.airframe, **known)
    assert math.isnan(held.battery.voltage)


def test_a_plan_that_does_not_switch_the_pump_is_compared_by_the_airframes_rule():
    dry = plan_of(*(row for row in TWO_LINES if row[0] != 216))
    ruled = replace(MODEL, airframe=replace(MODEL.airframe, pump_on="lines"))
    flown = [
        {t.leg.item for t in PlanToFly.from_plan(plan, {}, model).course.legs if t.leg.pump}
        for plan, model in ((dry, MODEL), (dry, ruled), (PLAN, ruled))
    ]
    assert flown == [set(), {4, 6}, {5, 9}]  # the last by its own orders
