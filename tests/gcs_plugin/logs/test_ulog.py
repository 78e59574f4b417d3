"""The PX4 reader on a log written by the format's definition, and on a recorded one."""

import contextlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.gcs_plugin.logs.log_files import UlogWriter
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.telemetry.recording import channel_source
from thrustmargin.gcs_plugin.wording.check_words import (
    source_words,
    statement_words,
)
from thrustmargin.models.errors import AirframeError, LogError, ThrustMarginError
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.provenance import Meaning

ROTORS = 4


def px4_log(
    *,
    functions: bool = True,
    repeat: bool = False,
    tank: bool = True,
    ticks: int = 60,
    asks: float = 0.5,
) -> bytes:
    """Tenths of a second, two seconds on the ground; ESC places 2 to 5 drive motors 1 to 4."""
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
    step = 0.01 if asks == 0.5 else 0.1
    for tick in range(ticks):
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
        log.row("actuator_motors", t, *[asks + step * k for k in range(4)], *[float("nan")] * 8)
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


def older_log(*banks, **parameters: int) -> bytes:
    """A quadcopter of before PX4 1.13 for six seconds: each bank has the outputs (60, n) of one
    driver and no `actuator_motors`."""
    log = UlogWriter()
    log.parameter("MAV_TYPE", 2)
    for name, value in parameters.items():
        log.parameter(name, value)
    log.topic("vehicle_attitude", [("float[4]", "q")], "4f")
    fields = [("uint32_t", "noutputs"), ("float[16]", "output")]
    log.topic("actuator_outputs", fields, "I16f", instances=len(banks))
    for tick in range(60):
        log.row("vehicle_attitude", 100.0 + tick / 10, 1.0, 0.0, 0.0, 0.0)
        for number, bank in enumerate(banks):
            outputs = [float(v) for v in bank[tick]]
            padded = outputs + [0.0] * (16 - len(outputs))
            log.row(f"actuator_outputs{number or ''}", 100.0 + tick / 10, len(outputs), *padded)
    return log.bytes()


def climbing(low: float, high: float, stopped: float = 900.0, count: int = 4) -> np.ndarray:
    """(60, count) outputs: stopped for a second, then from low to high, each motor its own way."""
    share = np.linspace(0.0, 1.0, 50)[:, None] ** np.arange(1, count + 1)
    return np.concatenate([np.full((10, count), stopped), low + (high - low) * share])


HELD = np.repeat([[900.0] * 6, [1500.0] * 6], [10, 50], axis=0)  # servos at their trim
SHARES = climbing(0.0, 1.0, stopped=0.0)


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


def test_what_px4_asks_beyond_full_output_is_taken_as_full_and_said(tmp_path):
    track = read_log(written(tmp_path, px4_log(asks=0.8))).track
    np.testing.assert_allclose(track.throttle[5], [0.8, 0.9, 1.0, 1.0], atol=1e-6)
    (note,) = (one for one in map(statement_words, track.notes) if "actuator_motors" in one)
    assert note.startswith("actuator_motors asks motor 4 for 1.10 to 1.10 of full output")
    plain = read_log(written(tmp_path, px4_log())).track.notes
    assert not any("actuator_motors" in one for one in map(statement_words, plain))


def test_escs_are_sorted_by_motor_and_the_count_is_held_against_them(tmp_path):
    track = read_log(written(tmp_path, px4_log())).track
    np.testing.assert_array_equal(track.rotor_speed_rpm[0], [1000, 1010, 1020, 1030])
    assert "esc_status says 6 ESCs; 4 of them are motors that report" in list(
        map(statement_words, track.notes)
    )


def test_older_logs_without_functions_take_the_escs_that_turn(tmp_path):
    track = read_log(written(tmp_path, px4_log(functions=False))).track
    np.testing.assert_array_equal(track.rotor_speed_rpm[0], [1000, 1010, 1020, 1030])


def test_escs_repeated_as_5_to_8_are_left_out(tmp_path):
    track = read_log(written(tmp_path, px4_log(functions=False, repeat=True))).track
    assert track.rotor_count == 4
    assert any(
        "repeats motor 1 and is left out" in note for note in map(statement_words, track.notes)
    )


@pytest.mark.parametrize(
    ("banks", "parameters", "said"),
    [
        ([climbing(1000, 2000)], {}, "output (1000 to 2000 µs, assumed; "),
        (
            [climbing(1075, 1950)],
            {"PWM_MIN": 1075, "PWM_MAX": 1950},
            "output (1075 to 1950 µs, PWM_MIN/MAX; ",
        ),
        (
            [climbing(1100, 1900)],
            {"PWM_MAIN_MIN": 1100, "PWM_MAIN_MAX": 1900, "PWM_MAIN_MIN1": -1, "PWM_MIN": 1},
            "output (1100 to 1900 µs, PWM_MAIN_MIN/MAX; ",
        ),
        # Servos on the second driver, then on the first, then on that of the motors.
        ([climbing(1000, 2000), HELD], {}, "output (1000 to 2000 µs, assumed; "),
        (
            [HELD, climbing(1100, 1900)],
            {"PWM_AUX_MIN": 1100, "PWM_AUX_MAX": 1900, "PWM_MAIN_MIN": 1, "PWM_MAIN_MAX": 2},
            "output of id 1 (1100 to 1900 µs, PWM_AUX_MIN/MAX; ",
        ),
        ([np.hstack([climbing(1000, 2000), HELD[:, :2]])], {}, "output (1000 to 2000 µs, "),
        ([HELD[:, :2], climbing(1, 8191, stopped=0.0)], {}, "(0 to 8191 counts, UAVCAN; "),
    ],
)
def test_before_actuator_motors_the_outputs_are_read(tmp_path, banks, parameters, said):
    log = read_log(written(tmp_path, older_log(*banks, **parameters)))
    assert log.track.rotor_count == 4
    np.testing.assert_allclose(log.track.throttle[10:], SHARES[10:], atol=2e-4)
    source = next(channel_source(c) for c in log.channels if c.name == "throttle")
    assert said in source
    assert source.endswith("motor n taken to be on output n)")


def test_outputs_that_parameters_give_to_motors_are_theirs(tmp_path):
    # Outputs 2, 4, 1 and 3 are motors 1 to 4.
    given = {f"PWM_MAIN_FUNC{output}": 101 + k for k, output in enumerate((2, 4, 1, 3))}
    outputs = climbing(1000, 2000)[:, [2, 0, 3, 1]]
    track = read_log(written(tmp_path, older_log(outputs, **given))).track
    np.testing.assert_allclose(track.throttle, SHARES, atol=1e-6)
    # Betaflight's order: rear right, front right, rear left, front left.
    outputs = climbing(1000, 2000)[:, [3, 0, 1, 2]]
    track = read_log(written(tmp_path, older_log(outputs, MOT_ORDERING=1))).track
    np.testing.assert_allclose(track.throttle, SHARES, atol=1e-6)


@pytest.mark.parametrize("bank", [HELD, climbing(-1.0, 1.0), climbing(100.0, 1999.0, stopped=0.0)])
def test_outputs_that_are_not_used_are_not_called_absent(tmp_path, bank):
    # Servos alone, shares, and DShot without the parameter that says where it begins.
    log = read_log(written(tmp_path, older_log(bank)))
    assert not log.track.reports("throttle")
    source = next(channel_source(c) for c in log.channels if c.name == "throttle")
    assert source.startswith("in the log (actuator_outputs), not used: ")


def test_only_a_log_with_actuator_functions_claims_their_order(tmp_path):
    def source(**given) -> str:
        log = read_log(written(tmp_path, px4_log(**given)))
        return next(channel_source(c) for c in log.channels if c.name == "rotor_speed_rpm")

    assert source() == "esc_status esc_rpm (by PX4's actuator functions)"
    assert source(functions=False) == "esc_status esc_rpm (motor n taken to have ESC n)"


def test_the_tank_comes_from_fuel_tank_status_in_ml(tmp_path):
    airframe = load_airframe("topxgun-f16")
    track = read_log(written(tmp_path, px4_log()), airframe=airframe).track
    assert track.tank_kg[0] == pytest.approx(9.0 * airframe.liquid_density)
    assert source_words(track.sources["tank_kg"]).startswith("fuel_tank_status")
    bare = read_log(written(tmp_path, px4_log(tank=False)), airframe=airframe).track
    assert not bare.reports("tank_kg")
    assert any("no tank gauge" in note for note in map(statement_words, bare.notes))


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
    assert any("says 6 ESCs; 4 of them" in note for note in map(statement_words, track.notes))
    assert np.nanmax(track.rotor_speed_rpm) == 3324
    assert track.duration == pytest.approx(31.0, abs=0.2)
    assert not track.reports("tank_kg")
    assert track.source("airspeed").meaning is Meaning.GROUND_SPEED
    felt = np.median(np.linalg.norm(track.specific_force_frd, axis=1)[2:])
    assert felt == pytest.approx(9.8, abs=0.2)


@pytest.mark.parametrize("named", ["q_d", "angles"])
def test_the_attitude_that_was_asked_for_is_read_in_both_forms(tmp_path, named):
    """Older firmware has angles beside a quaternion that may be zero, which asks for nothing."""
    log = UlogWriter()
    log.topic("vehicle_attitude", [("float[4]", "q")], "4f")
    angles = [("float", "roll_body"), ("float", "pitch_body")] if named == "angles" else []
    log.topic("vehicle_attitude_setpoint", [("float[4]", "q_d"), *angles], "4f" + "f" * len(angles))
    for tick in range(60):
        t = 100.0 + tick / 10
        log.row("vehicle_attitude", t, 1.0, 0.0, 0.0, 0.0)
        half = [0.0] * 4 if angles else [np.cos(0.1), 0.0, np.sin(0.1), 0.0]
        log.row("vehicle_attitude_setpoint", t, *half, *([0.0, 0.2] if angles else []))
    track = read_log(written(tmp_path, log.bytes())).track
    np.testing.assert_allclose(track.asked_attitude, [[0.0, 0.2]] * track.time_s.size, atol=1e-6)


def test_without_a_local_position_velocity_is_the_gps_s(tmp_path):
    log = UlogWriter()
    log.topic("vehicle_attitude", [("float[4]", "q")], "4f")
    velocity = [("float", f"vel_{axis}_m_s") for axis in "ned"]
    log.topic("vehicle_gps_position", velocity, "3f")
    for tick in range(60):
        log.row("vehicle_attitude", 100.0 + tick / 10, 1.0, 0.0, 0.0, 0.0)
        log.row("vehicle_gps_position", 100.0 + tick / 10, 3.0, 4.0, -1.0)
    track = read_log(written(tmp_path, log.bytes()), airframe=load_airframe("topxgun-f16")).track
    assert track.velocity_ned[30] == pytest.approx([3.0, 4.0, -1.0])
    assert track.sources["velocity_ned"].name == "vehicle_gps_position"
    assert track.airspeed[30] == pytest.approx(np.sqrt(26.0))  # over ground: no wind is known
