"""Ceiling, utilisation, redundancy, trimmable loss and largest fill: the paper's and the laws."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.physics.airframe import airframe_names, load_airframe
from thrustmargin.models.physics.atmosphere import air_density, isa_pressure, isa_temperature
from thrustmargin.models.physics.margin import (
    ceiling,
    holdable,
    hover_use,
    largest_fill,
    nameplate_ceiling,
    redundancy,
    rotor_thrust,
    trimmable_loss,
    utilisation,
    weight,
)

G0 = 9.80665  # m/s²


SHIPPED = airframe_names()
F16 = load_airframe("topxgun-f16")
SITL = load_airframe("topxgun-f16-sitl")


def at_reference(airframe):
    return ceiling(airframe, airframe.reference_density, airframe.ceiling_voltage)


def test_f16_full_tank_is_54_6_percent_of_the_nameplate_and_about_half_of_the_bench():
    full = weight(F16, 16.0)
    assert f"{hover_use(F16, nameplate_ceiling(F16), full).item():.1%}" == "54.6%"
    assert hover_use(F16, at_reference(F16), full).item() == pytest.approx(0.5025, abs=5e-4)


def test_f16_at_17_kgf_keeps_the_one_rotor_out_line_up_to_12_9_kg():
    limits = nameplate_ceiling(F16)
    half = largest_fill(F16, limits).item()
    survives = largest_fill(F16, limits, criterion="yaw uncontrolled").item()
    assert half == pytest.approx(0.5 * 4 * 17.0 - 21.1, abs=1e-4)  # 12.9 kg
    assert survives == pytest.approx(half)


def test_simulated_f16_makes_181_newtons_at_58_8_volts():
    limits = ceiling(SITL, 1.225, 58.8)
    np.testing.assert_allclose(limits.max_thrust, [[180.99] * 4])
    assert limits.max_rotor_speed_rpm.item() == 3000.0


def test_ceiling_falls_with_voltage_and_does_not_rise_above_the_bench():
    speed = ceiling(SITL, 1.225, np.array([60.4, 58.8, 52.92, 47.04])).max_rotor_speed_rpm
    np.testing.assert_allclose(speed, [3000.0, 3000.0, 2700.0, 2400.0])


def test_ceiling_thrust_goes_with_density():
    thin, thick = ceiling(SITL, np.array([0.9, 1.2]), 58.8).free_thrust
    assert thin / thick == pytest.approx(0.75)


@pytest.mark.parametrize(
    ("voltage", "basis"),
    [
        (None, "nominal voltage 51.8 V: battery voltage not reported"),
        (np.array([np.nan, 0.0]), "nominal voltage 51.8 V: battery voltage not reported"),
        (np.array([58.8, np.nan]), "measured battery voltage; nominal voltage 51.8 V in 1 row"),
        (np.array([58.8, 50.0]), "measured battery voltage"),
    ],
)
def test_an_unknown_voltage_is_nominal_and_said(voltage, basis):
    limits = ceiling(SITL, np.full(2, 1.225), voltage)
    assert statement_words(limits.voltage_basis).startswith(basis)
    known = np.zeros(2, bool) if voltage is None else np.isfinite(voltage) & (voltage > 0)
    nominal = 3000.0 * 51.8 / 58.8
    np.testing.assert_allclose(limits.max_rotor_speed_rpm[~known], nominal)


def test_utilisation_is_thrust_over_largest_thrust_in_any_air_and_for_any_worn_rotor():
    rng = np.random.default_rng(3)
    rpm = rng.uniform(500, 2900, (20, 8))
    rho, volts = rng.uniform(0.8, 1.3, 20), rng.uniform(44, 58, 20)
    for wear in (1.0, 0.85):
        base = load_airframe("agras-t40")
        airframe = replace(base, thrust_coefficient=base.thrust_coefficient * wear)
        limits = ceiling(airframe, rho, volts)
        by_thrust = rotor_thrust(airframe, rpm, rho) / limits.max_thrust
        np.testing.assert_allclose(utilisation(rpm, limits.max_rotor_speed_rpm), by_thrust)


def test_unknown_in_unknown_out():
    limits = ceiling(F16, np.array([1.2, np.nan, 1.2]), 51.8)
    load = np.array([300.0, 300.0, np.nan])
    for value in (
        redundancy(F16, limits, load, yaw_kept=False),
        trimmable_loss(F16, limits, load),
    ):
        np.testing.assert_array_equal(np.isnan(value), [False, True, True])
    use = utilisation(np.array([[np.nan, 1000.0, 1.0, 1.0]]), np.array([3000.0]))
    np.testing.assert_array_equal(np.isnan(use), [[True, False, False, False]])


@pytest.mark.parametrize("name", SHIPPED)
def test_batch_is_the_loop(name):
    airframe = load_airframe(name)
    rng = np.random.default_rng(5)
    rho, volts = rng.uniform(0.9, 1.25, 12), rng.uniform(44, 58, 12)
    tank = rng.uniform(0, airframe.tank_capacity_kg, 12)
    batch = ceiling(airframe, rho, volts)
    load = weight(airframe, tank)
    for row in range(12):
        one = ceiling(airframe, rho[row], volts[row])
        alone = load[row : row + 1]
        np.testing.assert_array_equal(one.max_thrust[0], batch.max_thrust[row])
        for kept in (True, False):
            for function in (redundancy, trimmable_loss):
                np.testing.assert_allclose(
                    function(airframe, one, alone, yaw_kept=kept)[0],
                    function(airframe, batch, load, yaw_kept=kept)[row],
                )


masses = st.floats(1.0, 60.0)


@settings(max_examples=40, deadline=None)
@given(masses, st.floats(0.1, 20.0), st.floats(0.0, 3000.0), st.floats(1.0, 2000.0))
def test_margin_falls_with_mass_and_with_altitude(tank, more, altitude, climb):
    low, high = (
        ceiling(F16, air_density(isa_pressure(height), isa_temperature(height)), 51.8)
        for height in (altitude, altitude + climb)
    )
    load, heavier = weight(F16, tank), weight(F16, tank + more)
    margin = 1.0 - hover_use(F16, low, load)
    assert 1.0 - hover_use(F16, low, heavier) < margin
    assert 1.0 - hover_use(F16, high, load) < margin
    for yaw_kept in (True, False):
        here = redundancy(F16, low, load, yaw_kept=yaw_kept)
        assert redundancy(F16, low, heavier, yaw_kept=yaw_kept) <= here
        assert redundancy(F16, high, load, yaw_kept=yaw_kept) <= here


@settings(max_examples=60, deadline=None)
@given(st.floats(0.02, 1.2))
def test_quad_redundancy_is_one_over_twice_the_use_and_nothing_with_heading_kept(use):
    limits = at_reference(F16)
    load = use * 4 * limits.free_thrust
    assert hover_use(F16, limits, load).item() == pytest.approx(use)
    free = redundancy(F16, limits, load, yaw_kept=False).item()
    assert free == pytest.approx(1.0 / (2.0 * use))
    assert redundancy(F16, limits, load, yaw_kept=True).item() == pytest.approx(0.0, abs=1e-12)


def test_quad_redundancy_crosses_one_at_half_use():
    limits = at_reference(F16)
    just_under, just_over = (
        redundancy(F16, limits, use * 4 * limits.free_thrust, yaw_kept=False).item()
        for use in (0.4999, 0.5001)
    )
    assert just_under > 1.0 > just_over


def test_hexa_crosses_at_two_thirds_and_the_coaxial_octo_at_what_its_pairs_leave():
    hexa, octo = load_airframe("agras-t20"), load_airframe("agras-t40")
    for airframe, crossing in ((hexa, 4 / 6), (octo, 5.2 / 7.2)):
        limits = at_reference(airframe)
        full = float(airframe.rotor_effectiveness.sum()) * limits.free_thrust
        found = redundancy(airframe, limits, crossing * full, yaw_kept=False)
        assert found.item() == pytest.approx(1.0)


@settings(max_examples=60, deadline=None)
@given(st.floats(0.02, 1.0))
def test_quad_trims_a_loss_of_its_margin_or_of_twice_that_with_heading_given_up(use):
    limits = at_reference(F16)
    load = use * 4 * limits.free_thrust
    kept = trimmable_loss(F16, limits, load).item()
    free = trimmable_loss(F16, limits, load, yaw_kept=False).item()
    assert kept == pytest.approx(1.0 - use, abs=1e-7)
    assert free == pytest.approx(min(2.0 * (1.0 - use), 1.0), abs=1e-7)


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(SHIPPED), st.floats(0.05, 0.999), st.booleans())
def test_a_rotor_can_be_lost_altogether_exactly_where_redundancy_is_one(name, use, yaw_kept):
    airframe = load_airframe(name)
    limits = at_reference(airframe)
    load = use * float(airframe.rotor_effectiveness.sum()) * limits.free_thrust
    survives = redundancy(airframe, limits, load, yaw_kept=yaw_kept).item()
    loss = trimmable_loss(airframe, limits, load, yaw_kept=yaw_kept).item()
    if survives > 1.001:
        assert loss == pytest.approx(1.0)
    if survives < 0.999:
        assert loss < 1.0


def test_a_share_lost_is_of_what_that_rotor_can_make():
    # Rotor 1 reaches 0.8 of the others. With yaw kept all four must be equal, so at 0.6 of a
    # free rotor's ceiling it may lose 1 - 0.6/0.8, and the others 1 - 0.6.
    weak = replace(F16, rotor_effectiveness=np.array([0.8, 1.0, 1.0, 1.0]))
    limits = at_reference(weak)
    load = 4 * 0.6 * limits.free_thrust
    assert trimmable_loss(weak, limits, load).item() == pytest.approx(0.25)


def test_nothing_can_be_lost_by_an_aircraft_too_heavy_to_fly():
    limits = at_reference(F16)
    # At the largest collective some rotor is at its ceiling in every trim, or it were not largest.
    for name in SHIPPED:
        airframe = load_airframe(name)
        limits = at_reference(airframe)
        for yaw_kept in (True, False):
            for share in (1.001, 4.1):
                load = share * holdable(airframe).intact * limits.free_thrust
                loss = trimmable_loss(airframe, limits, load, yaw_kept=yaw_kept).item()
                assert loss == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("criterion", ["utilisation", "yaw uncontrolled", "yaw kept"])
@pytest.mark.parametrize("name", SHIPPED)
def test_at_the_largest_fill_the_limit_is_just_met(name, criterion):
    airframe = load_airframe(name)
    limits = ceiling(airframe, np.array([1.0, 1.2]), airframe.ceiling_voltage)
    fill = largest_fill(airframe, limits, criterion=criterion)
    if criterion == "utilisation":
        met = hover_use(airframe, limits, weight(airframe, fill))
        np.testing.assert_allclose(met, 0.5)
    elif airframe.rotor_count == 4 and criterion == "yaw kept":
        np.testing.assert_allclose(fill, -airframe.empty_mass)  # no quad keeps its heading
    else:
        met = redundancy(airframe, limits, weight(airframe, fill), yaw_kept=criterion == "yaw kept")
        np.testing.assert_allclose(met, 1.0)


def test_a_stricter_limit_takes_liquid_off_the_aircraft():
    limits = at_reference(F16)
    assert largest_fill(F16, limits, limit=0.45) < largest_fill(F16, limits)
    with_reserve = largest_fill(F16, limits, criterion="yaw uncontrolled", limit=1.1)
    assert with_reserve < largest_fill(F16, limits, criterion="yaw uncontrolled")


def test_weight_is_mass_under_standard_gravity():
    assert weight(F16, 16.0) == pytest.approx(37.1 * G0)


#: Round numbers: T = 2e-5 N² in air of 1.2 kg/m³, 3000 rpm at 50 V, rotors 3 and 4 at half effect.
ROUND = replace(
    F16,
    empty_mass=20.0,
    thrust_coefficient=2e-5,
    reference_density=1.2,
    max_rotor_speed_rpm=3000.0,
    ceiling_voltage=50.0,
    nominal_voltage=40.0,
    nameplate_max_thrust=180.0,
)
HALVED = replace(ROUND, rotor_effectiveness=np.array([1.0, 1.0, 0.5, 0.5]))


@pytest.mark.parametrize(
    ("voltage", "exponent", "speed"),
    [
        (32.0, 0.5, 2400.0),  # 3000 (32/50)^0.5 = 3000 x 0.8
        (25.0, 1.0, 1500.0),  # 3000 x 0.5
        (25.0, 2.0, 750.0),  # 3000 x 0.25
        (25.0, 0.0, 3000.0),  # voltage has no effect
        (60.0, 2.0, 3000.0),  # never above the bench
        (0.5, 1.0, 30.0),  # low, but a voltage
        (None, 1.0, 2400.0),  # nominal 40 V: 3000 x 0.8
    ],
)
def test_the_ceiling_goes_with_a_power_of_the_voltage(voltage, exponent, speed):
    airframe = replace(ROUND, ceiling_voltage_exponent=exponent)
    limits = ceiling(airframe, 0.9, voltage)
    assert limits.max_rotor_speed_rpm == pytest.approx([speed])
    # Air of 0.9 over 1.2 makes three quarters of the thrust: 2e-5 x 0.75 x N².
    assert limits.free_thrust == pytest.approx([1.5e-5 * speed**2])


def test_largest_thrust_of_each_rotor_by_hand():
    # 2e-5 x (0.9/1.2) x 1500² = 33.75 N; half of it for rotors 3 and 4.
    limits = ceiling(HALVED, 0.9, 25.0)
    np.testing.assert_allclose(limits.max_thrust, [[33.75, 33.75, 16.875, 16.875]])
    named = nameplate_ceiling(HALVED)
    np.testing.assert_allclose(named.max_thrust, [[180.0, 180.0, 90.0, 90.0]])
    assert named.max_rotor_speed_rpm == pytest.approx([3000.0])  # 2e-5 x 3000² = 180 N


def test_thrust_of_rotor_speeds_by_hand():
    # Air of 0.6 over 1.2 halves it: 1e-5 N², and again for rotors 3 and 4.
    speeds = np.array([[1000.0, 2000.0, 1000.0, 2000.0], [0.0, 3000.0, 3000.0, 100.0]])
    thrust = rotor_thrust(HALVED, speeds, np.array([0.6, 1.2]))
    np.testing.assert_allclose(thrust, [[10.0, 40.0, 5.0, 20.0], [0.0, 180.0, 90.0, 0.1]])


def test_use_redundancy_and_fill_of_a_quad_by_hand():
    limits = ceiling(ROUND, 0.9, 25.0)  # 33.75 N a rotor
    # 100 N over 4 x 33.75 = 135 N; a diagonal pair holds 2 x 33.75 = 67.5 N.
    assert hover_use(ROUND, limits, 100.0) == pytest.approx([0.7407407])
    assert redundancy(ROUND, limits, 100.0, yaw_kept=False) == pytest.approx([0.675])
    assert trimmable_loss(ROUND, limits, 100.0) == pytest.approx([0.2592593])
    assert trimmable_loss(ROUND, limits, 100.0, yaw_kept=False) == pytest.approx([0.5185185])
    # Half use: 67.5 N = 6.883084 kg; 30 %: 40.5 N = 4.129850 kg; 67.5 N / 1.25 = 5.506467 kg.
    assert largest_fill(ROUND, limits) == pytest.approx([6.883084 - 20.0], abs=1e-6)
    assert largest_fill(ROUND, limits, limit=0.3) == pytest.approx([4.129850 - 20.0], abs=1e-6)
    free: dict[str, Any] = {"criterion": "yaw uncontrolled"}
    assert largest_fill(ROUND, limits, **free) == pytest.approx([6.883084 - 20.0], abs=1e-6)
    strict = largest_fill(ROUND, limits, **free, limit=1.25)
    assert strict == pytest.approx([5.506467 - 20.0], abs=1e-6)


def test_a_centre_of_gravity_in_front_loads_the_front_pair_by_hand():
    limits = ceiling(ROUND, 0.9, 25.0)
    arm = float(ROUND.rotor_position_frd[:, 0].max())
    ahead = replace(ROUND, rotor_position_frd=ROUND.rotor_position_frd - [0.2 * arm, 0.0, 0.0])
    # The front pair carries 1.2 of its share: 100/4 x 1.2 = 30 N of 33.75, so 1/9 can be lost.
    assert trimmable_loss(ahead, limits, 100.0) == pytest.approx([1.0 / 9.0])
    # A lost front rotor cannot be replaced; with a rear one lost its diagonal pair is level at no
    # thrust, the other holds 2 x 33.75.
    held = holdable(ahead).yaw_uncontrolled * limits.free_thrust[0]
    front = ROUND.rotor_position_frd[:, 0] > 0.0
    np.testing.assert_allclose(held[~front], 67.5)
    np.testing.assert_allclose(held[front], 0.0, atol=1e-7)
    worst = redundancy(ahead, limits, 100.0, yaw_kept=False)
    assert worst == pytest.approx([0.0], abs=1e-9)
    # All at most 33.75 with the front at 1.2 of the mean: 135 N / 1.2 = 112.5 N, half of it 56.25.
    fill = largest_fill(ahead, limits)
    assert fill == pytest.approx([56.25 / G0 - 20.0])


def test_redundancy_of_a_hexa_by_rotor_is_that_of_its_worst():
    hexa = load_airframe("agras-t20")
    limits = at_reference(hexa)
    for kept in (True, False):
        held = holdable(hexa)
        np.testing.assert_allclose(held.yaw_kept if kept else held.yaw_uncontrolled, [4.0] * 6)
        worst = redundancy(hexa, limits, [400.0], yaw_kept=kept)
        np.testing.assert_allclose(worst, 4.0 * limits.free_thrust / 400.0)


def test_fill_with_heading_kept_counts_the_worst_lower_rotor():
    octo = load_airframe("agras-t40")
    limits = at_reference(octo)
    # Of 8 rotors, four at 0.8: 6 x 0.8 = 4.8 free rotors with an upper one lost and yaw kept,
    # 2 + 4 x 0.8 = 5.2 with yaw uncontrolled.
    kept = largest_fill(octo, limits, criterion="yaw kept")
    free = largest_fill(octo, limits, criterion="yaw uncontrolled")
    np.testing.assert_allclose(kept, 4.8 * limits.free_thrust / G0 - octo.empty_mass)
    np.testing.assert_allclose(free, 5.2 * limits.free_thrust / G0 - octo.empty_mass)
