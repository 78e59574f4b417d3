"""The measured data themselves, where THRUSTMARGIN_MEASURED names their folder: what is quoted of
them is reached. What `identify` says of them takes minutes: `make measured` prints it.
"""

from pathlib import Path

import numpy as np
import pytest

from tests.lab.measured import aerostack2, crazypad, px4_log, strawson, uiuc, vendor_bench
from tests.lab.measured.crazyflie import (
    CABLE_FLIGHTS,
    FOLDER,
    FREE_FLIGHTS,
    MeasuredFlight,
    read_flights,
)
from tests.lab.measured.crazyflie_find import (
    AIRFRAME,
    PLAIN_MEAN,
    as_logged,
    sound,
    split,
)
from tests.lab.measured.speed_regression import regression_rmse_rpm
from tests.lab.measured.swing_check import check_swing
from tests.lab.measured.thrust_check import command_check, hover_lift, plain_check
from thrustmargin.models.physics.airframe import load_airframe

pytestmark = [pytest.mark.measured, pytest.mark.slow]
QUAD = load_airframe(AIRFRAME)


def flights_of(folder: Path, file: str, **given) -> list[MeasuredFlight]:
    return sound(read_flights(folder / FOLDER, file, **given))


@pytest.fixture(scope="module")
def free(measured_folder: Path) -> list[MeasuredFlight]:
    return flights_of(measured_folder, FREE_FLIGHTS)


@pytest.fixture(scope="module")
def cable(measured_folder: Path) -> list[MeasuredFlight]:
    return flights_of(measured_folder, CABLE_FLIGHTS)


@pytest.fixture(scope="module")
def finer(measured_folder: Path) -> list[MeasuredFlight]:
    return flights_of(measured_folder, FREE_FLIGHTS, mean_over=PLAIN_MEAN)


def test_flights_are_read_and_the_faulty_ones_put_aside_by_name(measured_folder: Path):
    flights = read_flights(measured_folder / FOLDER, FREE_FLIGHTS)
    loaded = read_flights(measured_folder / FOLDER, CABLE_FLIGHTS)
    assert (len(flights), len(loaded)) == (31, 65)
    assert {f.track.name for f in flights if f.faults} == {"eckart28"}
    assert {f.track.name for f in loaded if f.faults} == {f"eckart{k}" for k in range(51, 55)}
    assert flights[0].mass == pytest.approx(0.037)
    assert loaded[0].mass == pytest.approx(0.0444)


def test_a_plain_regression_reaches_what_is_quoted(finer):
    check = plain_check(finer)
    assert check.before == pytest.approx(1.65, abs=0.02)
    assert check.after <= 1.17
    assert check.before_fast == pytest.approx(3.43, abs=0.2)
    assert check.after_fast <= 1.82
    assert abs(check.voltage_correlation) < 0.06


def test_voltage_and_the_motors_delay_explain_rotor_speed_at_a_command(finer):
    check = command_check(finer)
    assert check.command > 230.0
    assert check.voltage <= 134.0
    assert check.delayed < 60.0
    assert 0.02 <= check.delay <= 0.06


def test_a_hover_with_the_load_asks_less_of_the_rotors_than_its_mass_says(free, cable):
    assert hover_lift(cable) / hover_lift(free) == pytest.approx(1.171, abs=0.005)


def test_a_regression_of_rotor_speed_on_the_same_rows(measured_folder: Path):
    fit, held = split(as_logged(measured_folder / FOLDER, FREE_FLIGHTS))
    assert regression_rmse_rpm(fit, held) < 200.0


def test_the_swing_worked_out_from_the_aircraft_is_the_loads(cable):
    check = check_swing(cable, 0.5, QUAD.thrust_coefficient)
    assert check.swing_largest > 45.0
    assert check.apart < 12.0
    assert check.apart < 0.5 * check.apart_if_hanging
    assert 1e3 * check.mass == pytest.approx(4.7, rel=0.05)
    assert 1e3 * check.mass_by_capture == pytest.approx(4.7, rel=0.07)


@pytest.mark.parametrize("check", [vendor_bench, aerostack2, strawson, crazypad, px4_log, uiuc])
def test_bench_tunnel_and_log_reach_what_is_quoted(check, measured_folder: Path):
    finding = check.find(measured_folder / check.FOLDER)
    asked = {n.name: n.met for n in finding.numbers if n.met is not None}
    assert [name for name, met in asked.items() if not met] == []
    assert asked or check is uiuc


def test_thrust_falls_nearly_in_a_line_with_inflow_on_200_propellers(measured_folder: Path):
    finding = uiuc.find(measured_folder / uiuc.FOLDER)
    assert finding.number("propellers") > 200
    assert finding.number("rmse_linear") < 0.3 * finding.number("rmse_constant")
    assert finding.number("slope_for_f16_pitch") > finding.number("slope_for_55_35") > 0.0


def test_wrong_bench_runs_pull_a_robust_fit_less_than_a_plain_one(measured_folder: Path):
    finding = strawson.find(measured_folder / strawson.FOLDER)
    assert finding.number("wrong_runs") == 6
    assert finding.number("worst_pull_robust") < 0.5 * finding.number("worst_pull_plain")
    assert np.isfinite(finding.number("median_pull_plain"))
