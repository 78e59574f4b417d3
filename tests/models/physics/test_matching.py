"""Load matching and Figure 10: the paper's printed results, and the same for any airframe."""

from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.models.physics.airframe import airframe_names, load_airframe
from thrustmargin.models.physics.matching import match_airframe, same_aircraft

G0 = 9.80665  # m/s²


SHIPPED = airframe_names()
F16 = load_airframe("topxgun-f16")


def test_f16_is_the_papers_matching():
    matching = match_airframe(F16)
    nameplate, curve = matching.ceilings
    assert f"{matching.load.full_load:.2f}" == "9.28"
    assert f"{matching.load.empty_load:.2f}" == "5.28"
    assert f"{matching.load.load_increase:.2%}" == "75.83%"
    assert f"{nameplate.use_full:.1%}" == "54.6%"
    assert curve.use_full == pytest.approx(0.50, abs=0.005)


def test_f16_survives_a_lost_rotor_when_empty_and_not_when_full():
    nameplate = match_airframe(F16).ceilings[0]
    assert nameplate.redundancy_yaw_uncontrolled_full == pytest.approx(1 / (2 * 0.54559), rel=1e-4)
    assert (
        nameplate.redundancy_yaw_uncontrolled_empty
        > 1.0
        > nameplate.redundancy_yaw_uncontrolled_full
    )
    assert nameplate.redundancy_yaw_kept_empty == pytest.approx(0.0, abs=1e-12)


def test_f16_coefficient_lies_in_the_range_of_equation_3():
    matching = match_airframe(F16)
    low, high = matching.thrust_coefficient_range
    assert low < matching.thrust_coefficient < high
    assert (low, matching.thrust_coefficient, high) == pytest.approx(
        (0.0293, 0.0869, 0.3514), abs=5e-5
    )


@pytest.mark.parametrize("name", SHIPPED)
def test_hover_speeds_carry_the_weight(name):
    airframe = load_airframe(name)
    matching = match_airframe(airframe)
    share = airframe.rotor_effectiveness.sum() * airframe.thrust_coefficient / G0
    full = airframe.empty_mass + airframe.tank_capacity_kg
    assert share * matching.rotor_speed_full_rpm**2 == pytest.approx(full)
    assert share * matching.rotor_speed_empty_rpm**2 == pytest.approx(airframe.empty_mass)
    curve = matching.ceilings[1]
    square = (matching.rotor_speed_full_rpm / airframe.max_rotor_speed_rpm) ** 2
    assert curve.use_full == pytest.approx(square)


@pytest.mark.parametrize("name", SHIPPED)
def test_use_of_each_ceiling_is_load_over_maximum(name):
    matching = match_airframe(load_airframe(name))
    for limit in matching.ceilings:
        assert limit.use_full == pytest.approx(matching.load.full_load * G0 / limit.max_thrust)
        if load_airframe(name).tank_capacity_kg > 0:
            assert limit.use_empty < limit.use_full


def test_a_battery_below_the_bench_voltage_gets_its_own_ceiling():
    names = [limit.name for limit in match_airframe(load_airframe("topxgun-f16-sitl")).ceilings]
    assert names == [
        "nameplate",
        "curve maximum, 3000 rpm at 58.8 V",
        "curve maximum at the nominal 51.8 V",
    ]
    assert len(match_airframe(F16).ceilings) == 2


def test_a_largest_thrust_that_no_maker_printed_is_not_called_nameplate():
    assert match_airframe(load_airframe("agras-t20")).ceilings[0].name == "nameplate"
    assert match_airframe(load_airframe("agras-t40")).ceilings[0].name == "estimated maximum"


def test_an_aircraft_and_its_simulation_are_one_design_and_others_are_not():
    assert same_aircraft(F16, load_airframe("topxgun-f16-sitl"))
    assert not same_aircraft(F16, load_airframe("agras-t20"))
    assert not same_aircraft(F16, replace(F16, empty_mass=24.0))


def test_an_aircraft_without_a_tank_matches_too():
    matching = match_airframe(replace(F16, tank_volume_l=0.0))
    assert matching.load.load_increase == 0.0
    assert np.isfinite(matching.ceilings[0].use_full)
