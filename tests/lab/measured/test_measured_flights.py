"""Flights of the small quad, made up: the reader, its checks, and errors of thrust."""

from pathlib import Path

import numpy as np
import pytest

from tests.lab.measured.crazyflie import FREE_FLIGHTS, MeasuredFlight, read_flights
from tests.lab.measured.crazyflie_find import sound, split, written
from tests.lab.measured.measured_files import flight_columns, write_flights
from tests.lab.measured.speed_regression import regression_rmse_rpm
from tests.lab.measured.swing_check import check_swing
from tests.lab.measured.test_measured_commands import run
from tests.lab.measured.thrust_check import command_check, plain_check
from tests.models.effects.test_slung_load import flown_with_load
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.effects.demand_effects import swing
from thrustmargin.models.errors import DataError
from thrustmargin.models.physics.airframe import load_airframe

G0 = 9.80665  # m/s²

SMALL = load_airframe("crazyflie-rpm")


def read_back(folder: Path, flights: list, **given) -> list[MeasuredFlight]:
    write_flights(folder / FREE_FLIGHTS, flights)
    return read_flights(folder, FREE_FLIGHTS, **given)


@pytest.fixture(scope="module")
def inflow_flights(tmp_path_factory) -> list[MeasuredFlight]:
    """Six flights whose thrust falls with the climb and rises with speed, motors 30 ms behind."""
    flights = [
        flight_columns(f"made{k}", seed=k, inflow=0.6, lift=0.005, delay=0.03) for k in range(6)
    ]
    return read_back(tmp_path_factory.mktemp("flights"), flights, mean_over=0.1)


def test_frames_and_units_are_those_of_a_flight_track(tmp_path: Path):
    columns = flight_columns("one")
    columns["qw"], columns["qy"] = np.cos(0.1) * columns["qw"], np.sin(0.1) * columns["qw"]
    columns["ax_g"] = 0.2 * columns["az_g"] ** 0
    flight = read_back(tmp_path, [columns])[0]
    track = flight.track
    assert track.name == "one"
    assert flight.mass == pytest.approx(0.037)
    assert flight.faults == ()
    middle = track.time_s.size // 2
    at = track.time_s[middle] + track.time_s[0] + 0.1  # rows begin half a mean into the flight
    raw = round(at / 0.002)
    assert track.position_ned[middle, 2] == pytest.approx(-columns["z_m"][raw], abs=5e-3)
    assert track.velocity_ned[middle, 2] == pytest.approx(-columns["vz_mps"][raw], abs=0.02)
    assert track.velocity_ned[middle, 0] == pytest.approx(columns["vx_mps"][raw], abs=0.05)
    # A turn about the axis to the left by +0.2 rad puts the nose down where z is up: pitch -0.2.
    assert track.attitude[middle] == pytest.approx([0.0, -0.2, 0.0], abs=1e-6)
    assert track.specific_force_frd[middle, 0] == pytest.approx(0.2 * G0)
    assert np.median(track.specific_force_frd[:, 2]) == pytest.approx(-G0, rel=0.05)
    assert track.angular_rate_frd[middle, 2] == pytest.approx(-np.radians(10.0))
    assert np.all((track.voltage > 3.7) & (track.voltage < 3.9))


def test_a_row_is_the_mean_over_its_span_and_of_rotor_speed_the_root_mean_square(tmp_path: Path):
    columns = flight_columns("one")
    ripple = np.where(np.arange(columns["t_s"].size) % 2, 1.1, 0.9)
    columns["rpm2"] = 15000.0 * ripple
    columns["vbat_mV"] = 3700.0 * ripple
    track = read_back(tmp_path, [columns])[0].track
    assert track.rotor_speed_rpm[:, 1] == pytest.approx(15000.0 * np.sqrt(1.01), rel=2e-3)
    assert track.voltage == pytest.approx(3.7, rel=2e-3)


def test_a_gap_in_the_log_leaves_rows_out_and_invents_none(tmp_path: Path):
    columns = flight_columns("one")
    kept = (columns["t_s"] < 5.0) | (columns["t_s"] > 6.0)
    track = read_back(tmp_path, [{k: v[kept] for k, v in columns.items()}])[0].track
    assert np.diff(track.time_s).max() == pytest.approx(1.0, abs=0.06)


def test_a_rotor_that_reports_half_its_speed_is_put_aside_by_name(tmp_path: Path):
    columns = flight_columns("bad")
    columns["rpm3"] = 0.55 * columns["rpm3"]
    flights = read_back(tmp_path, [flight_columns("good", seconds=9.0), columns])
    assert len(flights[1].faults) == 1
    assert flights[1].faults[0].startswith("rotor 3 reports 0.5")
    assert flights[1].faults[0].endswith("of the rotors' usual speed: a wrong sensor, put aside")
    assert np.isnan(flights[1].track.rotor_speed_rpm[:, 2]).all()
    assert [f.track.name for f in sound(flights)] == ["good"]


def test_a_velocity_that_is_not_the_change_of_position_puts_the_flight_aside(tmp_path: Path):
    flights = read_back(tmp_path, [flight_columns("good"), flight_columns("bad", velocity_gain=2)])
    assert flights[0].faults == ()
    assert len(flights[1].faults) == 1
    assert "off the change of position" in flights[1].faults[0]


def test_the_curve_alone_leaves_inflow_and_a_regression_on_it_takes_it_away(inflow_flights):
    check = plain_check(inflow_flights)
    assert check.coefficient == pytest.approx(4e-10, rel=5e-3)
    assert check.before > 1.0
    assert check.after < 0.2 * check.before
    assert check.after_fast < 0.2 * check.before_fast


def test_without_inflow_the_curve_alone_leaves_nothing(tmp_path: Path):
    flights = read_back(tmp_path, [flight_columns(f"f{k}", seed=k) for k in range(3)])
    assert plain_check(flights).before < 0.02


def test_the_delay_of_the_motors_and_the_voltage_are_found_in_rotor_speed(inflow_flights):
    check = command_check(inflow_flights)
    assert check.delay == pytest.approx(0.03)
    assert check.delayed < 0.2 * check.voltage < check.command


def test_a_regression_of_rotor_speed_takes_inflow_away_on_flights_that_it_has_not_seen(
    inflow_flights,
):
    fit, held = split(inflow_flights)
    assert [f.track.name for f in held] == ["made0", "made3"]
    scatter = np.concatenate([np.ravel(f.track.rotor_speed_rpm) for f in held]).std()
    assert regression_rmse_rpm(fit, held) < 0.1 * scatter


def test_a_regression_on_flights_on_the_ground_says_so(tmp_path: Path):
    short = read_back(tmp_path, [flight_columns("short", seconds=0.5)])
    with pytest.raises(DataError, match="no row in flight"):
        regression_rmse_rpm(short, short)


def test_flights_reach_the_command_as_csv_that_reads_back(inflow_flights, tmp_path: Path):
    paths = written(inflow_flights[:2], tmp_path / "csv")
    assert [p.name for p in paths] == ["made0.csv", "made1.csv"]
    back = read_log(paths[1]).track
    track = inflow_flights[1].track
    np.testing.assert_array_equal(back.rotor_speed_rpm, track.rotor_speed_rpm)
    np.testing.assert_array_equal(back.specific_force_frd, track.specific_force_frd)


def test_the_mass_of_a_swinging_load_follows_from_its_direction_and_from_the_worked_out_swing():
    load, cable = 0.006, 0.5
    track = flown_with_load(1, mass=SMALL.empty_mass, load=load, cable=cable)
    flight = MeasuredFlight(
        track=track,
        mass=SMALL.empty_mass,
        payload=load,
        faults=(),
        load_ned=cable * swing(track, np.array([cable])).direction_ned[:, 0],
        earlier_command=np.empty((track.time_s.size, 0)),
    )
    check = check_swing([flight], cable, SMALL.thrust_coefficient)
    assert check.mass == pytest.approx(load, rel=0.03)
    assert check.mass_by_capture == pytest.approx(load, rel=0.03)
    assert check.apart < 1e-3 < 1.0 < check.apart_if_hanging
    assert check.distance == pytest.approx(cable)


@pytest.mark.parametrize("damage", ["truncated", "no rpm3"])
def test_damaged_flights_are_one_line_and_exit_code_1(damage, tmp_path: Path, capsys):
    path = tmp_path / "imrc_crazyflie_rpm" / FREE_FLIGHTS
    columns = flight_columns("one")
    if damage == "no rpm3":
        del columns["rpm3"]
    write_flights(path, [columns])
    if damage == "truncated":
        path.write_bytes(path.read_bytes()[:2000])
    assert run(str(tmp_path), "--only", "imrc_crazyflie_rpm") == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.strip().splitlines()) == 1
    assert ("no column 'rpm3'" if damage == "no rpm3" else f"cannot read {path}") in err


def test_flights_of_the_free_file_alone_name_the_file_that_is_missing(tmp_path: Path, capsys):
    write_flights(tmp_path / "imrc_crazyflie_rpm" / FREE_FLIGHTS, [flight_columns("one")])
    assert run(str(tmp_path), "--only", "imrc_crazyflie_rpm") == 1
    assert "no file" in capsys.readouterr().err


def test_a_file_of_another_kind_is_refused(tmp_path: Path):
    (tmp_path / FREE_FLIGHTS).write_bytes(b"time,rpm\n1,2\n")
    with pytest.raises(DataError, match="cannot read"):
        read_flights(tmp_path, FREE_FLIGHTS)
