"""Live rows against the rows of the file, and what stale, silent and unknown do to them."""

import math
import struct

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.live.live_vehicle import SECOND, Vehicle, as_frame, live_rows, log_frames
from thrustmargin.gcs_plugin.live.live_rows import COLUMNS, FIXED, Sample, track_of
from thrustmargin.gcs_plugin.live.sampler import Sampler
from thrustmargin.gcs_plugin.live.vehicle_state import VehicleState, fold
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.models.flight import TRACK_CHANNELS, FlightTrack
from thrustmargin.models.physics.airframe import load_airframe

AIRFRAME = load_airframe("topxgun-f16-sitl")


def run(frames, **options) -> tuple[list[Sample], Sampler]:
    return live_rows(frames, AIRFRAME, **options)


def track(rows: list[Sample], sampler: Sampler) -> FlightTrack:
    return track_of(
        rows, name="live", rotor_count=4, origin=sampler.origin, start_s=rows[0].clock_s
    )


@pytest.mark.parametrize(
    "name", ["campaign/v4_m16_q2.5", "campaign/v2_m4_q3.5", "onset/worn_prop_onset", "dev/climb_1"]
)
def test_live_rows_are_the_rows_that_the_file_gives(sitl_logs, name):
    path = sitl_logs / f"{name}.tlog"
    live = track(*run(log_frames(path)))
    read = read_log(path, airframe=AIRFRAME, sampling="hold").track
    # The file's times carry a nanosecond a frame that keeps their order.
    assert np.allclose(live.time_s, read.time_s, rtol=0, atol=1e-4)
    assert live.origin == read.origin
    # A file knows from the start which message will report; in the first moments another stands in.
    settled = live.time_s > 1.0
    for channel in TRACK_CHANNELS:
        ours, theirs = getattr(live, channel)[settled], getattr(read, channel)[settled]
        assert np.array_equal(ours, theirs, equal_nan=True), channel
    # Only a landing can be known earlier from the file.
    apart = np.flatnonzero(live.flying != read.flying)
    assert apart.size < 60
    assert np.all(live.flying[apart])


def test_a_channel_older_than_its_limit_is_unknown_and_never_held_on():
    vehicle = Vehicle()
    frames = [f for _ in range(20) for f in vehicle.tick()]
    frames += [f for _ in range(20) for f in vehicle.tick() if f.id != 74]
    rows, _ = run(frames)
    known = [math.isfinite(row.values[COLUMNS["airspeed"]]) for row in rows]
    # A row is made by the rotor speeds, before the airspeed of the same moment; the limit is 1 s.
    assert known == [False] + [True] * 29 + [False] * 10
    assert "airspeed" in rows[20].sources
    assert "airspeed" not in rows[-1].sources


def test_one_row_a_report_and_at_most_ten_a_second():
    vehicle = Vehicle()
    fast = [f for _ in range(100) for f in vehicle.tick(0.02)]
    rows, _ = run(fast)
    steps = np.diff([row.clock_s for row in rows])
    assert steps.min() >= 0.09
    assert steps.max() < 0.13


def test_without_rotor_speeds_rows_come_with_the_attitude():
    vehicle = Vehicle()
    frames = [f for _ in range(50) for f in vehicle.tick() if f.id != 11030]
    rows, _ = run(frames)
    assert 25 < len(rows) < 31  # the first two seconds wait for rotor speeds
    assert np.all(np.isnan(rows[-1].values[FIXED : FIXED + 4]))
    assert not rows[-1].rotors_heard


def test_when_rotor_speeds_fall_silent_rows_go_on_with_the_speeds_unknown():
    vehicle = Vehicle()
    frames = [f for _ in range(20) for f in vehicle.tick()]
    frames += [f for _ in range(50) for f in vehicle.tick() if f.id != 11030]
    rows, _ = run(frames)
    assert rows[19].rotors_heard
    assert not rows[-1].rotors_heard
    assert rows[-1].clock_s == pytest.approx(vehicle.clock_s)


def test_rotor_speeds_of_eight_motors_come_from_two_messages():
    vehicle = Vehicle()
    four, count = [0] * 4, [7] * 4
    first = dialect.MAVLink_esc_telemetry_1_to_4_message(
        four, four, four, four, [1001, 1002, 1003, 1004], count
    )
    second = dialect.MAVLink_esc_telemetry_5_to_8_message(
        four, four, four, four, [1005, 1006, 1007, 1008], count
    )
    state = VehicleState(system=1)
    for frame in [*vehicle.tick(), vehicle.frame(first), vehicle.frame(second)]:
        state = fold(state, frame)
    assert [state.by_index("esc_rpm")[k].value for k in range(8)] == list(range(1001, 1009))


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
    rows, sampler = run(frames)
    live = track(rows, sampler)
    assert live.time_s.size == 30
    assert live.rotor_speed_rpm[-1].tolist() == [2001.0, 2002.0, 2003.0, 2004.0]
    assert live.voltage[-1] == pytest.approx(48.5)
    assert live.current[-1] == pytest.approx(40.0)
    # WIND_COV is a vector of the moving air; WIND would be a direction that it comes from.
    assert live.wind_ned[-1].tolist() == [1.0, -2.0, 0.0]
    assert live.tank_kg[-1] == pytest.approx(9.0)
    assert live.sources["rotor_speed_rpm"].startswith("ESC_STATUS")
    assert live.flying[-1]


def test_until_the_vehicle_says_which_output_is_which_motor_the_order_is_told_as_assumed():
    vehicle = Vehicle()
    _, sampler = run(vehicle.tick())
    assert "taken to be" in " ".join(sampler.notes)
    told = [
        vehicle.frame(
            dialect.MAVLink_param_value_message(f"SERVO{n}_FUNCTION".encode(), 32 + n, 9, 4, n)
        )
        for n in (1, 2, 3, 4)
    ]
    _, sampler = run([*vehicle.tick(), *told, *vehicle.tick()])
    assert sampler.notes == ()


def test_a_failure_that_an_esc_reports_is_that_rotors():
    vehicle = Vehicle()
    frames = vehicle.tick()
    info = (7, *[0] * 4, 1, 0, 0, 32, 0, *[3000] * 4, 0, 4, 0, 15)
    frames.append(as_frame(px4(290, 251, struct.pack("<Q4IH4H4h4B", *info)), vehicle.stamp_us))
    frames += [f for _ in range(20) for f in vehicle.tick()]
    rows, _ = run(frames)
    assert rows[0].esc_failures == ()
    assert rows[-1].esc_failures == (0, 0, 32, 0)
    # A report that is not repeated does not hold for ever.
    rows, _ = run([*frames, *[f for _ in range(50) for f in vehicle.tick()]])
    assert rows[-1].esc_failures == ()


def test_an_aircraft_with_another_number_of_rotors_gives_no_rows_but_a_reason():
    vehicle = Vehicle()
    hexa = vehicle.frame(dialect.MAVLink_heartbeat_message(13, 3, 0, 0, 4, 3))
    rows, sampler = run([hexa, as_frame(vehicle.attitude()), as_frame(vehicle.escs())])
    assert rows == []
    assert "6 rotors" in sampler.problem
    assert "--airframe" in sampler.problem


def test_flying_is_off_the_ground_and_not_only_said_so():
    vehicle = Vehicle()
    frames = [as_frame(vehicle.landed(1)), *vehicle.tick()]
    on_ground = len(frames)
    frames += [as_frame(vehicle.landed(2)), as_frame(vehicle.place(0.0))]
    frames += [f for f in vehicle.tick() if f.id != 33]
    frames += [as_frame(vehicle.place(1.0)), *[f for f in vehicle.tick() if f.id != 33]]
    rows, _ = run(frames)
    assert on_ground
    assert [row.flying for row in rows] == [False, False, True]
