"""Voltage of a battery along a flight against sums by hand."""

import math

import numpy as np
import pytest

from thrustmargin.mission.forecast.battery import (
    FlightBattery,
    discharge,
    rotor_power,
    stated_capacity,
)
from thrustmargin.models.physics.airframe import load_airframe

CRAFT = load_airframe("topxgun-f16-sitl")  # 14 cells
NEVER = np.empty(0, dtype=np.intp)


def drained(battery, power=4000.0, seconds=600, changed=NEVER):
    return discharge(battery, CRAFT, np.full(seconds, power), np.ones(seconds), changed)


def test_without_a_capacity_the_voltage_is_held():
    volts, energy = drained(FlightBattery(voltage=55.0))
    assert np.all(volts == 55.0)
    assert energy[-1] == pytest.approx(4000.0 * 600.0 / 3600.0)
    assert np.all(drained(FlightBattery())[0] == 51.8)


def test_under_load_it_falls_by_resistance_times_current():
    volts, _ = drained(FlightBattery(capacity_ah=1e6, resistance=0.02))
    assert volts[0] == pytest.approx(58.8 - 0.02 * 4000.0 / volts[0], abs=1e-3)


def test_charge_is_the_sum_of_current():
    """Half of a charge gone: 3.84 V a cell at rest."""
    volts, _ = drained(
        FlightBattery(capacity_ah=16.0, resistance=0.0), power=16.0 * 55.0, seconds=1800
    )
    assert volts[-1] == pytest.approx(14 * 3.84, abs=0.4)


def test_a_battery_that_is_used_up_has_no_voltage():
    volts, _ = drained(FlightBattery(capacity_ah=10.0), seconds=900)
    assert np.isnan(volts[-1])
    assert np.isfinite(volts[0])


def test_a_fresh_one_is_as_at_the_start():
    changed = np.array([300])
    volts, _ = drained(FlightBattery(capacity_ah=16.0), changed=changed)
    assert volts[300] == pytest.approx(volts[0], abs=0.05)
    assert volts[299] < volts[0] - 1.0


def test_power_is_torque_times_speed_over_efficiency():
    """91 N, 2127 rpm, 0.049 m: 993 W a shaft."""
    power = rotor_power(CRAFT, np.full((1, 4), 91.0), np.full((1, 4), 2127.0))
    assert power[0] == pytest.approx(4 * 91.0 * 0.049 * 2127.0 * 2 * math.pi / 60.0 / 0.85)


def test_a_capacity_that_nobody_has_set_is_none():
    assert stated_capacity({"BATT_CAPACITY": 16000.0}) == 16.0
    assert math.isnan(stated_capacity({"BATT_CAPACITY": 3300.0}))
    assert math.isnan(stated_capacity({}))
