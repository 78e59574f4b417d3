"""Voltage of a battery along a flight against sums by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.mission.forecast.battery import (
    FlightBattery,
    discharge,
    electric_power,
    power_error,
    rotor_power,
    stated_capacity,
    usable_energy,
    usable_error,
    voltage_ends,
)
from thrustmargin.models.model.fill_limits import steady_flight
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.physics.electric_power import FlightPower, PowerLaw

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


def law(coefficient: float) -> PowerLaw:
    return PowerLaw(flights=(FlightPower(flight="a", day=1, coefficient=coefficient),))


def test_measured_power_is_its_coefficient_times_density_and_cubes_of_speed():
    model = replace(physics_model(CRAFT), power=law(1.5e-7))
    thin = 0.9 * model.reference_density
    made = steady_flight(model, thin, math.nan, 0.0, np.array([8.0])).prediction
    by_hand = 1.5e-7 * 0.9 * np.sum(made.rotor_speed_rpm[0] ** 3)
    assert electric_power(model, made)[0] == pytest.approx(by_hand)
    bare = replace(model, power=None)
    formula = rotor_power(CRAFT, made.thrust, made.rotor_speed_rpm)
    assert electric_power(bare, made) == pytest.approx(formula)


def test_power_is_as_unsure_as_its_law_and_three_times_the_common_speed():
    model = shipped_model()
    made = steady_flight(model, 1.225, math.nan, 0.0, np.array([8.0])).prediction
    reach = (made.upper_rpm / made.rotor_speed_rpm - 1.0)[0]
    # Of four rotors with equal errors half of one's is common to all.
    common = math.sqrt(np.mean(reach**2)) / 1.645 / 2.0
    assert power_error(model, made) == pytest.approx(math.hypot(0.25, 3.0 * common), rel=1e-3)
    taught = replace(model, power=law(1.5e-7))
    by_law = math.hypot(0.03 * math.sqrt(2.0), 3.0 * common)
    assert power_error(taught, made) == pytest.approx(by_law, rel=1e-3)
    bare = physics_model(CRAFT)  # no interval: its speed changes by 2.9 % from day to day
    made = steady_flight(bare, 1.225, math.nan, 0.0, np.array([8.0])).prediction
    assert power_error(bare, made) == pytest.approx(math.hypot(0.25, 3 * 0.0292), rel=1e-2)


def test_a_battery_that_is_not_full_gives_less():
    full = FlightBattery(capacity_ah=10.0)
    assert usable_energy(full, CRAFT, 0.25) == pytest.approx(0.75 * 10.0 * 51.8)
    half = FlightBattery(capacity_ah=10.0, voltage=14 * 3.84)
    assert usable_energy(half, CRAFT, 0.25) == pytest.approx(0.25 * 10.0 * 51.8)
    assert usable_energy(FlightBattery(capacity_ah=10.0, voltage=49.0), CRAFT, 0.25) == 0.0
    assert math.isnan(usable_energy(FlightBattery(voltage=55.0), CRAFT, 0.25))
    # From half full down to 0.3 at the lower end, 3.77 V a cell: a fifth of what was usable.
    unsure = FlightBattery(capacity_ah=10.0, voltage=14 * 3.84, voltage_error=14 * 0.07 / 1.645)
    assert usable_error(unsure, CRAFT, 0.25) == pytest.approx(math.log(5.0) / 1.645, rel=0.01)
    assert usable_error(half, CRAFT, 0.25) == 0.0


def test_the_ends_of_the_voltage_hold_its_three_causes():
    known = FlightBattery(capacity_ah=1e6, voltage=56.0, resistance=0.02)
    power, seconds = np.full(60, 4000.0), np.ones(60)

    def ends(battery: FlightBattery, error: float) -> tuple[float, float, float]:
        low, high = voltage_ends(battery, CRAFT, power, error, seconds, NEVER)
        return float(drained(battery, seconds=60)[0][-1]), float(low[-1]), float(high[-1])

    middle, low, high = ends(known, 0.0)
    assert (low, high) == (middle, middle)
    # By 1.645 standard errors of each alone: 1 V at rest; 5 mOhm of 73 A; half the power more.
    middle, low, _ = ends(replace(known, voltage_error=1.0 / 1.645), 0.0)
    assert middle - low == pytest.approx(1.0, abs=0.05)
    middle, low, _ = ends(replace(known, resistance_error=0.005 / 1.645), 0.0)
    assert middle - low == pytest.approx(0.005 * 73.0, abs=0.03)
    middle, low, high = ends(known, math.log(1.5) / 1.645)
    assert middle - low == pytest.approx(0.5 * 0.02 * 73.0, abs=0.05)
    assert high - middle == pytest.approx(0.02 * 73.0 / 3.0, abs=0.03)


def test_a_battery_that_may_be_used_up_has_no_lower_end():
    low, high = voltage_ends(
        FlightBattery(capacity_ah=16.0), CRAFT, np.full(600, 4000.0), 0.25, np.ones(600), NEVER
    )
    assert np.isnan(low[-1])
    assert np.isfinite(high[-1])
    nothing = voltage_ends(FlightBattery(voltage=55.0), CRAFT, np.ones(3), 0.2, np.ones(3), NEVER)
    assert np.isnan(nothing).all()
