"""The PX4 reader on a log written by the format's definition, and on a recorded one."""

import contextlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.gcs_plugin.logs.log_files import UlogWriter
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.errors import AirframeError, LogError, ThrustMarginError
from thrustmargin.models.physics.airframe import load_airframe

ROTORS = 4


def px4_log(*, functions: bool = True, repeat: bool = False, tank: bool = True) -> bytes:
    """Six seconds: two on the ground, four in the air; ESC places 2 to 5 drive motors 1 to 4."""
    log = UlogWriter()
    log.parameter("CA_ROTOR_COUNT", ROTORS)
    log.parameter("MAV_SYS_ID", 3)
    log.topic("vehicle_attitude", [("float[4]", "q")], "4f")
    log.topic("vehicle_angular_velocity", [("float[3]", "xyz")], "3f")
    log.topic("vehicle_acceleration", [("float[3]", "xyz")], "3f")
    log.topic(
        "vehicle_local_position",
        [
            *[("float", n) for n in ("x", "y", "z", "vx", "vy", "vz")],
            *[("double", n) for n in ("ref_lat", "ref_lon")],
            ("float", "ref_alt"),
            ("uint8_t", "z_global"),
        ],
        "6f2dfB",
    )
    log.topic("vehicle_land_detected", [("uint8_t", "landed")], "B")
    log.topic("battery_status", [("float", "voltage_v"), ("float", "current_a")], "2f")
    log.topic("vehicle_air_data", [("float", "baro_pressure_pa"), ("float", "rho")], "2f")
    log.topic("wind", [("float", "windspeed_north"), ("float", "windspeed_east")], "2f")
    log.topic("actuator_motors", [("float[12]", "control")], "12f")
    if tank:
        fields = [("float", "remaining_fuel"), ("uint8_t", "percent_remaining")]
        log.topic("fuel_tank_status", fields, "fB")
    log.topic(
        "esc_status",
        [("uint8_t", "esc_count"), ("uint8_t", "esc_online_flags"), ("esc_report[8]", "esc")],
        "BB" + "ifB" * 8,
    )
    log.part("esc_report:int32_t esc_rpm;float esc_voltage;uint8_t actuator_function;")
    for tick in range(60):
        t = 100.0 + tick / 10
        log.row("vehicle_attitude", t, 1.0, 0.0, 0.0, 0.0)
        log.row("vehicle_angular_velocity", t, 0.1, 0.2, 0.3)
        log.row("vehicle_acceleration", t, 0.0, 0.0, -9.81)
        up = max(tick - 20, 0) * 0.1
        place = (47.4, 8.5, 488.0, 1)
        log.row("vehicle_local_position", t, 1.0, 2.0, -up, 3.0, 0.0, 0.0, *place)
        log.row("battery_status", t, 50.0, -1.0)
        log.row("vehicle_air_data", t, 95_600.0, 1.1)
        log.row("wind", t, -1.0, 0.0)
        log.row("actuator_motors", t, *[0.5 + 0.01 * k for k in range(4)], *[float("nan")] * 8)
        if tank:
            log.row("fuel_tank_status", t, 9000.0 - tick, 60)
        reports = []
        for place_number in range(8):
            motor = place_number - 1 if functions else place_number
            if repeat and place_number >= 4:
                motor = place_number - 4
            works = 0 <= motor < ROTORS
            rpm = 1000 + 10 * motor + tick if works else 0
            function = 101 + motor if functions and works else 0
            reports += [rpm, 50.0, function]
        log.row("esc_status", t, 6, 0xFF, *reports)
        log.row("vehicle_land_detected", t, tick < 20)
    log.text(101.0, "Takeoff detected")
    return log.bytes()


def written(tmp_path: Path, data: bytes) -> Path:
    path = tmp_path / "made.ulg"
    path.write_bytes(data)
    return path


def test_a_px4_log_becomes_a_flight_in_si(tmp_path):
    log = read_log(written(tmp_path, px4_log()))
    track = log.track
    assert (log.format, log.autopilot, log.vehicle) == ("ULog", "PX4", 3)
    assert log.clock_start_s == pytest.approx(100.0)
    np.testing.assert_allclose(track.velocity_ned[5], [3.0, 0.0, 0.0])
    np.testing.assert_allclose(track.specific_force_frd[5], [0.0, 0.0, -9.81], rtol=1e-6)
    np.testing.assert_allclose(track.altitude[-1], 488.0 + 3.9, atol=1e-3)
    np.testing.assert_allclose(track.pressure, 95_600.0)
    np.testing.assert_allclose(track.throttle[5], [0.5, 0.51, 0.52, 0.53], atol=1e-6)
    assert track.origin is not None
    assert track.origin.latitude_deg == pytest.approx(47.4)
    # No pitot: ground velocity (3, 0, 0) less wind (-1, 0).
    np.testing.assert_allclose(track.airspeed, 4.0)
    assert not track.reports("current")
    assert not track.flying[:20].any()
    assert track.flying[-30:].all()
    assert log.messages[0][1] == "Takeoff detected"


def test_escs_are_sorted_by_motor_and_the_count_is_held_against_them(tmp_path):
    track = read_log(written(tmp_path, px4_log())).track
    np.testing.assert_array_equal(track.rotor_speed_rpm[0], [1000, 1010, 1020, 1030])
    assert "esc_status says 6 ESCs; 4 of them are motors that report" in track.notes


def test_older_logs_without_functions_take_the_escs_that_turn(tmp_path):
    track = read_log(written(tmp_path, px4_log(functions=False))).track
    np.testing.assert_array_equal(track.rotor_speed_rpm[0], [1000, 1010, 1020, 1030])


def test_escs_repeated_as_5_to_8_are_left_out(tmp_path):
    track = read_log(written(tmp_path, px4_log(functions=False, repeat=True))).track
    assert track.rotor_count == 4
    assert any("repeats motor 1 and is left out" in note for note in track.notes)


def test_the_tank_comes_from_fuel_tank_status_in_ml(tmp_path):
    airframe = load_airframe("topxgun-f16")
    track = read_log(written(tmp_path, px4_log()), airframe=airframe).track
    assert track.tank_kg[0] == pytest.approx(9.0 * airframe.liquid_density)
    assert track.sources["tank_kg"].words.startswith("fuel_tank_status")
    bare = read_log(written(tmp_path, px4_log(tank=False)), airframe=airframe).track
    assert not bare.reports("tank_kg")
    assert any("no tank gauge" in note for note in bare.notes)


def test_another_vehicle_or_rotor_count_is_refused(tmp_path):
    path = written(tmp_path, px4_log())
    with pytest.raises(LogError, match="no vehicle 1; it is the log of vehicle 3"):
        read_log(path, vehicle=1)
    other = next(a for a in ("agras-t20", "agras-t40") if load_airframe(a).rotor_count != 4)
    with pytest.raises(AirframeError, match="4 rotors"):
        read_log(path, airframe=load_airframe(other))


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_damage_is_a_shorter_flight_or_one_clear_error(tmp_path_factory, data):
    whole = bytearray(px4_log())
    for place in data.draw(st.lists(st.integers(0, len(whole) - 1), max_size=20)):
        whole[place] ^= 0xA5
    end = data.draw(st.integers(0, len(whole)))
    path = tmp_path_factory.getbasetemp() / "hurt.ulg"
    path.write_bytes(bytes(whole[:end]))
    with contextlib.suppress(ThrustMarginError):
        assert read_log(path).track.time_s.size <= 60


@pytest.mark.measured
def test_the_recorded_px4_flight_reads(measured_folder):
    log = read_log(measured_folder / "px4_ulog/sample_px4_events.ulg")
    track = log.track
    assert track.rotor_count == 4
    assert any("says 6 ESCs; 4 of them" in note for note in track.notes)
    assert np.nanmax(track.rotor_speed_rpm) == 3324
    assert track.duration == pytest.approx(31.0, abs=0.2)
    assert not track.reports("tank_kg")
    assert not track.reports("airspeed")
    felt = np.median(np.linalg.norm(track.specific_force_frd, axis=1)[2:])
    assert felt == pytest.approx(9.8, abs=0.2)
