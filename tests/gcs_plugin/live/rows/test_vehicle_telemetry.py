"""Live rows against the rows of the file, and what stale, silent and unknown do to them."""

import math
import struct

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.live.live_vehicle import SECOND, Vehicle, as_frame, live_rows
from thrustmargin.gcs_plugin.live.rows.vehicle_telemetry import LiveRows, VehicleTelemetry
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.gcs_plugin.telemetry.vehicle_events import Options
from thrustmargin.gcs_plugin.wording.check_words import source_words, statement_words, value_words
from thrustmargin.models.physics.airframe import load_airframe

AIRFRAME = load_airframe("topxgun-f16-sitl")


def run(frames, **options) -> tuple[LiveRows, VehicleTelemetry]:
    rows, telemetry = live_rows(frames, AIRFRAME, **options)
    assert rows is not None
    return rows, telemetry


def test_a_channel_older_than_its_limit_is_unknown_and_never_held_on():
    vehicle = Vehicle()
    frames = [f for _ in range(20) for f in vehicle.tick()]
    frames += [f for _ in range(20) for f in vehicle.tick() if f.id not in (32, 33, 74)]
    rows, _ = run(frames)
    # The first row is made by the attitude, before the rotor speeds and the airspeed.
    known = np.isfinite(rows.track.airspeed).tolist()
    assert known == [False] + [True] * 29 + [False] * 10


def test_without_an_airspeed_the_speed_over_ground_less_the_wind_is_it():
    vehicle = Vehicle()
    frames = [f for _ in range(20) for f in vehicle.tick()]
    frames += [f for _ in range(20) for f in vehicle.tick() if f.id != 74]
    track = run(frames)[0].track
    relative = np.linalg.norm(track.velocity_ned - np.nan_to_num(track.wind_ned), axis=1)
    assert track.airspeed[-10:] == pytest.approx(relative[-10:])


def test_one_row_a_report_and_at_most_ten_a_second():
    vehicle = Vehicle()
    fast = [f for _ in range(100) for f in vehicle.tick(0.02)]
    rows, _ = run(fast)
    steps = np.diff(rows.clock_s)
    assert steps.min() >= 0.09
    assert steps.max() < 0.13


def test_without_rotor_speeds_rows_come_with_the_attitude():
    vehicle = Vehicle()
    frames = [f for _ in range(50) for f in vehicle.tick() if f.id != 11030]
    rows, _ = run(frames)
    assert rows.clock_s.size == 50
    assert np.all(np.isnan(rows.track.rotor_speed_rpm))


def test_when_rotor_speeds_fall_silent_rows_go_on_with_the_speeds_unknown():
    vehicle = Vehicle()
    frames = [f for _ in range(20) for f in vehicle.tick()]
    frames += [f for _ in range(50) for f in vehicle.tick() if f.id != 11030]
    rows, _ = run(frames)
    heard = np.all(np.isfinite(rows.track.rotor_speed_rpm), axis=1)
    # For two seconds nothing triggers a row; what follows comes with the attitude.
    assert heard[1:20].all()
    assert not heard[21:].any()
    assert np.diff(rows.clock_s).max() < 2.3
    assert rows.clock_s[-1] == pytest.approx(vehicle.clock_s)


def test_rotor_speeds_of_eight_motors_come_from_two_messages():
    vehicle = Vehicle()
    four, count = [0] * 4, [7] * 4
    first = dialect.MAVLink_esc_telemetry_1_to_4_message(
        four, four, four, four, [1001, 1002, 1003, 1004], count
    )
    second = dialect.MAVLink_esc_telemetry_5_to_8_message(
        four, four, four, four, [1005, 1006, 1007, 1008], count
    )
    octo = load_airframe("agras-t40")
    frames = [as_frame(vehicle.attitude(), vehicle.stamp_us)]
    frames += [vehicle.frame(second), vehicle.frame(first)]
    vehicle.clock_s += 0.1
    frames += [as_frame(vehicle.attitude(), vehicle.stamp_us + SECOND // 10)]
    vehicle.stamp_us += SECOND // 10
    frames += [vehicle.frame(second), vehicle.frame(first)]
    rows, _ = live_rows(frames, octo)
    assert rows is not None
    assert rows.track.rotor_speed_rpm[-1].tolist() == list(range(1001, 1009))


def px4(number: int, extra: int, payload: bytes) -> bytes:
    """A message that pymavlink has no class for, as PX4 sends it."""
    body = bytes([len(payload), 0, 0, 0, 1, 1]) + number.to_bytes(3, "little") + payload
    crc = dialect.x25crc(body)
    crc.accumulate(bytes([extra]))
    return b"\xfd" + body + struct.pack("<H", crc.crc)


def test_a_px4_vehicle_gives_rows_from_its_own_messages():
    vehicle = Vehicle(clock_s=20.0)
    fuel = struct.pack("<5fI2B", 16e3, math.nan, 9000.0, math.nan, math.nan, 1, 0, 255)
    frames: list[Frame] = []
    for number in range(30):
        vehicle.clock_s += 0.1
        vehicle.stamp_us += SECOND // 10
        micros = round(vehicle.clock_s * 1e6)
        rpm = struct.pack("<Q4i4f4fB", micros, 2001, 2002, 2003, 2004, *[48.5] * 4, *[10.0] * 4, 0)
        wind = dialect.MAVLink_wind_cov_message(micros, 1.0, -2.0, 0.0, 0, 0, 0, 0, 0)
        heart = dialect.MAVLink_heartbeat_message(2, 12, 0x80, 0, 4, 3)
        parts = [vehicle.pack(heart), vehicle.attitude(), vehicle.place(3.0 + number / 10)]
        parts += [vehicle.speed(5.0), vehicle.pack(wind), vehicle.landed()]
        parts += [px4(371, 10, fuel), px4(291, 10, rpm)]
        frames += [as_frame(part, vehicle.stamp_us) for part in parts]
    live = run(frames)[0].track
    assert live.time_s.size == 30
    assert live.rotor_speed_rpm[-1].tolist() == [2001.0, 2002.0, 2003.0, 2004.0]
    assert live.voltage[-1] == pytest.approx(48.5)
    assert live.current[-1] == pytest.approx(40.0)
    # WIND_COV is a vector of the moving air; WIND would be a direction that it comes from.
    assert live.wind_ned[-1].tolist() == [1.0, -2.0, 0.0]
    assert live.tank_kg[-1] == pytest.approx(9.0)
    assert source_words(live.sources["rotor_speed_rpm"]).startswith("ESC_STATUS")
    assert live.flying[-1]


def test_until_the_vehicle_says_which_output_is_which_motor_the_order_is_reported_as_assumed():
    vehicle = Vehicle()
    rows, _ = run(vehicle.tick())
    assert "taken to be" in " ".join(map(statement_words, rows.notes))
    reported = [
        vehicle.frame(
            dialect.MAVLink_param_value_message(f"SERVO{n}_FUNCTION".encode(), 32 + n, 9, 4, n)
        )
        for n in (1, 2, 3, 4)
    ]
    rows, _ = run([*vehicle.tick(), *reported, *vehicle.tick()])
    assert "taken to be" not in " ".join(map(statement_words, rows.notes))


def test_a_failure_that_an_esc_reports_is_that_rotors():
    vehicle = Vehicle()
    frames = vehicle.tick()
    info = (7, *[0] * 4, 1, 0, 0, 32, 0, *[3000] * 4, 0, 4, 0, 15)
    frames.append(as_frame(px4(290, 251, struct.pack("<Q4IH4H4h4B", *info)), vehicle.stamp_us))
    frames += [f for _ in range(20) for f in vehicle.tick()]
    rows, _ = run(frames)
    assert np.isnan(rows.esc_failures[0]).all()
    assert rows.esc_failures[-1].tolist() == [0, 0, 32, 0]
    # A report that is not repeated does not hold for ever.
    rows, _ = run([*frames, *[f for _ in range(50) for f in vehicle.tick()]])
    assert np.isnan(rows.esc_failures[-1]).all()


def test_an_aircraft_with_another_number_of_rotors_gives_rows_without_the_airframe():
    vehicle = Vehicle()
    hexa = vehicle.frame(dialect.MAVLink_heartbeat_message(13, 3, 0, 0, 4, 3))
    frames = [hexa, as_frame(vehicle.attitude()), as_frame(vehicle.escs())]
    rows, telemetry = live_rows(frames, AIRFRAME)
    assert rows is not None
    assert rows.track.rotor_count == telemetry.facts.rotor_count == 6


def test_rotors_that_turn_only_later_are_counted_where_nothing_else_says_how_many():
    """A hexacopter of no reported kind, with a quad's airframe: no quad once all six turn."""
    vehicle = Vehicle()
    unnamed = vehicle.frame(dialect.MAVLink_heartbeat_message(0, 3, 0x80, 0, 4, 3))
    frames = [unnamed]
    for rpm in (0, 2000, 0):
        for _ in range(30):
            frames += [f for f in vehicle.tick(rpm=(rpm,) * 4) if f.id != unnamed.id]
            five_on = dialect.MAVLink_esc_telemetry_5_to_8_message(
                *([0] * 4, [5000] * 4, [0] * 4, [0] * 4),
                [rpm, rpm, 0, 0],
                [len(frames) % 65536] * 4,
            )
            frames.append(vehicle.frame(five_on))
    _, telemetry = live_rows(frames[:100], AIRFRAME)
    assert telemetry.facts.rotor_count == 0
    telemetry = VehicleTelemetry(1, Options(airframe=AIRFRAME, sampling="hold"))
    counts = []
    for frame in frames:
        telemetry.take(frame)
        counts += [part.track.rotor_count for part in telemetry.rows()]
    assert counts[0] == 4
    assert counts[-1] == 6  # on the ground again, too
    assert value_words(telemetry.facts.rotor_evidence) == "the ESCs that report"


def test_flying_is_off_the_ground_and_not_only_said_so():
    vehicle = Vehicle()
    frames = [as_frame(vehicle.landed(1), vehicle.stamp_us), *vehicle.tick()]
    for state, height in ((2, 0.0), (2, 1.0)):
        parts = [vehicle.landed(state), vehicle.place(height)]
        frames += [as_frame(part, vehicle.stamp_us) for part in parts]
        frames += [f for f in vehicle.tick() if f.id != 33]
    rows, _ = run(frames)
    assert rows.track.flying.tolist() == [False, False, True]


def with_type(frames: list[Frame], mav_type: int) -> list[Frame]:
    vehicle = Vehicle()
    vehicle.stamp_us = frames[0].stamp_us
    heartbeat = dialect.MAVLink_heartbeat_message(mav_type, 3, 0x80, 0, 4, 3)
    return [vehicle.frame(heartbeat), *(f for f in frames if f.id != 0)]


@pytest.mark.parametrize(("mav_type", "kind"), [(1, "plane"), (10, "rover"), (12, "submarine")])
def test_another_vehicle_has_no_rows_and_says_what_it_is(mav_type, kind):
    vehicle = Vehicle()
    frames = with_type([f for _ in range(30) for f in vehicle.tick()], mav_type)
    rows, telemetry = live_rows(frames, AIRFRAME)
    assert rows is None
    assert telemetry.problem == (
        f"vehicle 1: this is a {kind} (by MAV_TYPE {mav_type}), and thrustmargin is for multirotors"
    )
    assert telemetry.state.facts.kind == kind


def test_zero_speeds_in_flight_are_unknown_and_said_so():
    vehicle = Vehicle()
    frames = [f for _ in range(30) for f in vehicle.tick()]
    frames += [f for _ in range(30) for f in vehicle.tick(rpm=(2000, 0, 2000, 2000))]
    rows, _ = run(frames)
    speeds = rows.track.rotor_speed_rpm
    assert np.isnan(speeds[32:, 1]).all()
    assert np.isfinite(speeds[1:, [0, 2, 3]]).all()
    assert any(
        note.startswith("rotor 2: no measurement: zero speed")
        for note in map(statement_words, rows.notes)
    )


def timed(vehicle: Vehicle, seconds: int, unix_s: float) -> list[Frame]:
    """So many s of flight with a SYSTEM_TIME each, whose Unix time began at `unix_s`; 0: none."""
    frames = []
    for second in range(seconds):
        unix_us = int((unix_s + second) * SECOND) if unix_s else 0
        frames.append(vehicle.frame(dialect.MAVLink_system_time_message(unix_us, vehicle.boot_ms)))
        frames += [frame for _ in range(10) for frame in vehicle.tick()]
    return frames


@pytest.mark.slow
@pytest.mark.parametrize("piece", [7, 10_000])
def test_a_new_part_begins_with_the_first_gps_time_of_a_start_and_with_no_other(piece):
    vehicle = Vehicle(clock_s=500.0)
    frames = [as_frame(vehicle.heartbeat(), vehicle.stamp_us)]
    frames += timed(vehicle, 30, 0.0) + timed(vehicle, 30, 1.6e9)
    vehicle.clock_s = 5.0  # it restarts
    frames += timed(vehicle, 30, 0.0) + timed(vehicle, 30, 1.65e9)
    telemetry = VehicleTelemetry(1, Options(airframe=AIRFRAME, sampling="hold"))
    parts: list[LiveRows] = []
    for first in range(0, len(frames), piece):
        for frame in frames[first : first + piece]:
            telemetry.take(frame)
        parts += telemetry.rows()
    if piece > len(frames):  # however many messages wait
        begins = [(p.boot, round(p.clock_s[0])) for p in parts]
        assert begins == [(0, 500), (0, 530), (1, 5), (1, 35)]
    ground, gps = [1.7e9 - 500.0, 1.7e9 + 60.0 - 5.0], [1.6e9 - 530.0, 1.65e9 - 35.0]
    for part in parts:
        unix_s = part.track.start_unix_s or 0.0
        booted = unix_s + part.track.time_s[0] - part.clock_s[0]
        late = part.clock_s[0] > (530.05, 35.05)[part.boot]
        assert booted == pytest.approx((gps if late else ground)[part.boot], abs=0.2)


def test_a_parameter_that_numbers_rest_on_is_noted_when_it_changes_and_not_as_it_comes_in():
    vehicle = Vehicle()
    telemetry = VehicleTelemetry(1, Options(airframe=AIRFRAME, sampling="hold"))
    for name, value in (
        *((b"MOT_SPIN_MIN", 0.15), (b"WP_SPD", 5.0), (b"MOT_SPIN_MIN", 0.15)),
        *((b"WP_SPD", 9.0), (b"MOT_SPIN_MIN", 0.5)),
    ):
        telemetry.take(vehicle.frame(dialect.MAVLink_param_value_message(name, value, 9, 2, 0)))
        telemetry.take(as_frame(vehicle.heartbeat()))
    (_, words), *others = telemetry.events
    assert words == "parameter changed (MOT_SPIN_MIN: 0.15 to 0.5)"
    assert not others
