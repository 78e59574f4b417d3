"""The .tlog reader against pymavlink's own, on damaged files, and on unusual senders."""

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect
from pymavlink.generator.mavcrc import x25crc

from gcs_plugin.logs import frames, read_log
from gcs_plugin.logs.files import read_bytes
from gcs_plugin.logs.layouts import layouts
from gcs_plugin.logs.tlog import read_tlog
from models.airframe import load_airframe
from models.errors import AirframeError, LogError
from tests.gcs_plugin.log_files import frames_of

ROOT = Path(__file__).resolve().parents[2]
FLIGHT = ROOT / "sitl_logs/campaign/v4_m10_q2.5.tlog"
WHOLE = FLIGHT.read_bytes()
STAMPED = frames_of(FLIGHT)
UNIX = 1_790_000_000_000_000  # µs


def scanned(data: bytes) -> frames.Frames:
    padded = np.frombuffer(data + bytes(frames.PADDING), dtype=np.uint8)
    return frames.scan(padded, len(data))


def written(tmp_path: Path, data: bytes, name: str = "made.tlog") -> Path:
    path = tmp_path / name
    path.write_bytes(data)
    return path


def link(system: int = 1, component: int = 1) -> dialect.MAVLink:
    return dialect.MAVLink(None, srcSystem=system, srcComponent=component)


def stamped(frame: bytes, time_s: float) -> bytes:
    return struct.pack(">Q", UNIX + int(time_s * 1e6)) + frame


def flight_of(
    sender, seconds: int, *, v1: bool = False, rpm: int = 1900, later: float = 0.0
) -> bytes:
    """A short made flight at 10 Hz: attitude, rotor speeds and tank; `sender(message)` packs.

    The vehicle's clock starts at 10 s; the ground's is `later` s on.
    """
    out = []
    for tick in range(seconds * 10):
        t = 10.0 + tick / 10
        boot = int(t * 1000)
        messages = [
            dialect.MAVLink_attitude_message(boot, 0.01, 0.02, 0.03, 0, 0, 0),
            dialect.MAVLink_named_value_float_message(boot, b"TANK", 9.0 - tick / 1000),
        ]
        if not v1:
            four = [rpm + tick, rpm + 1, rpm + 2, rpm + 3]
            esc = dialect.MAVLink_esc_telemetry_1_to_4_message(
                [30] * 4, [5600] * 4, [1500] * 4, [1] * 4, four, [tick + 1] * 4
            )
            messages.append(esc)
        out += [stamped(sender(message), t + 0.05 + later) for message in messages]
    return b"".join(out)


def test_every_field_of_every_message_equals_pymavlinks():
    data, size = read_bytes(FLIGHT, frames.PADDING)
    found = frames.scan(data, size)
    known = layouts()
    tables, order = {}, []
    for number in np.unique(found.id):
        rows = np.flatnonzero(found.id == number)
        tables[int(number)] = iter(frames.columns(found, rows, known[int(number)]))
    log = mavutil.mavlink_connection(str(FLIGHT), dialect="ardupilotmega")
    compared = 0
    while (message := log.recv_match()) is not None:
        row = next(tables[message.get_msgId()])
        order.append(message.get_msgId())
        for name in row.dtype.names:
            ours, theirs = row[name], getattr(message, name)
            if isinstance(theirs, str):
                assert ours.split(b"\0")[0].decode() == theirs
            else:
                np.testing.assert_array_equal(ours, theirs, err_msg=f"{message.get_type()}.{name}")
            compared += 1
    assert order == found.id.tolist()
    assert compared > 100_000
    assert all(next(rest, None) is None for rest in tables.values())


def test_stamps_and_senders_equal_pymavlinks():
    data, size = read_bytes(FLIGHT, frames.PADDING)
    found = frames.scan(data, size)
    log = mavutil.mavlink_connection(str(FLIGHT), dialect="ardupilotmega")
    theirs = []
    while (message := log.recv_match()) is not None:
        theirs.append(
            (
                message._timestamp,
                message.get_srcSystem(),
                message.get_srcComponent(),
                message.get_seq(),
            )
        )
    stamps, systems, components, sequences = (
        np.array(column) for column in zip(*theirs, strict=True)
    )
    np.testing.assert_allclose(found.stamps_s(), stamps, atol=2e-6)
    np.testing.assert_array_equal(found.systems(), systems)
    np.testing.assert_array_equal(found.components(), components)
    np.testing.assert_array_equal(found.sequences(), sequences)


def test_a_whole_log_has_nothing_skipped():
    found = scanned(WHOLE)
    assert found.start.size == len(STAMPED)
    assert (found.skipped, found.bad_checksum, found.unknown_ids) == ((), 0, {})


@settings(max_examples=60, deadline=None)
@given(
    place=st.integers(0, len(STAMPED)),
    garbage=st.binary(min_size=1, max_size=2000),
)
def test_inserted_garbage_costs_no_frame_and_is_counted_to_the_byte(place, garbage):
    data = b"".join([*STAMPED[:place], garbage, *STAMPED[place:]])
    found = scanned(data)
    assert found.start.size >= len(STAMPED)
    assert sum(length for _, length in found.skipped) == len(garbage)
    at = sum(map(len, STAMPED[:place]))
    assert found.skipped[0][0] == at


@settings(max_examples=60, deadline=None)
@given(
    flips=st.lists(
        st.tuples(st.integers(0, len(WHOLE) - 1), st.integers(1, 255)), min_size=1, max_size=40
    )
)
def test_flipped_bytes_cost_only_the_frames_they_touch(flips):
    data = bytearray(WHOLE)
    for place, change in flips:
        data[place] ^= change
    found = scanned(bytes(data))
    assert found.start.size >= len(STAMPED) - len({place for place, _ in flips})


@settings(max_examples=60, deadline=None)
@given(end=st.integers(0, len(WHOLE)))
def test_a_log_cut_at_any_byte_keeps_every_frame_before_the_cut(end):
    lengths = np.cumsum([len(frame) for frame in STAMPED])
    found = scanned(WHOLE[:end])
    assert found.start.size == int(np.searchsorted(lengths, end, side="right"))
    kept = int(lengths[found.start.size - 1]) if found.start.size else 0
    assert sum(length for _, length in found.skipped) == end - kept


def test_more_than_99_percent_survive_a_hundred_wounds(tmp_path):
    rng = np.random.default_rng(7)
    data = bytearray(WHOLE)
    for place in rng.integers(0, len(data), 100):
        data[place : place + 20] = rng.bytes(20)
    log = read_log(written(tmp_path, bytes(data)))
    whole = read_log(FLIGHT)
    assert log.quality.frames >= 0.985 * whole.quality.frames
    assert log.track.time_s.size >= 0.985 * whole.track.time_s.size
    assert 0 < log.quality.bytes_skipped < 0.03 * len(data)
    # What is kept is what was sent: the same rotor speeds at the same times.
    ours, theirs = (
        dict(zip((r.track.time_s + r.clock_start_s).round(2), r.track.rotor_speed_rpm, strict=True))
        for r in (log, whole)
    )
    common = sorted(set(ours) & set(theirs))
    assert len(common) > 0.97 * len(theirs)
    same = [np.array_equal(ours[t], theirs[t]) for t in common]
    assert np.mean(same) > 0.999


def test_a_bad_checksum_is_counted_and_placed(tmp_path):
    data = bytearray(WHOLE)
    place = sum(map(len, STAMPED[:5000])) + 8 + 12
    data[place] ^= 0x55
    log = read_log(written(tmp_path, bytes(data)))
    assert log.quality.bad_checksum == 1
    assert log.quality.damaged_places == 1
    assert log.quality.damage[0].byte == sum(map(len, STAMPED[:5000]))
    assert log.quality.bytes_skipped == len(STAMPED[5000])
    assert log.quality.damage[0].time_s == pytest.approx(
        log.clock_start_s + 0.375 * log.track.duration, abs=15.0
    )


def test_a_damaged_stamp_does_not_move_its_message(tmp_path):
    data = bytearray(WHOLE)
    hud = next(i for i in range(6000, 7000) if STAMPED[i][8 + 7] == 74)
    place = sum(map(len, STAMPED[:hud]))
    data[place + 2] ^= 0x40
    log, whole = read_log(written(tmp_path, bytes(data))), read_log(FLIGHT)
    np.testing.assert_array_equal(log.track.time_s, whole.track.time_s)
    reports = next(c for c in log.channels if c.name == "airspeed")
    assert reports.samples == 1100
    assert reports.longest_gap_s < 0.3  # none is missing from its place


@pytest.mark.parametrize("content", [b"", b"\0", b"\xfd" * 300, b"\xfe\x09" * 200, bytes(9999)])
def test_what_is_no_log_is_one_clear_error(tmp_path, content):
    with pytest.raises(LogError) as error:
        read_log(written(tmp_path, content))
    assert "\n" not in str(error.value)


@settings(max_examples=40, deadline=None)
@given(content=st.binary(max_size=5000))
def test_random_bytes_are_an_error_never_a_traceback(tmp_path_factory, content):
    for name in ("x.tlog", "x.BIN", "x.log", "x.csv", "x.ulg"):
        path = tmp_path_factory.getbasetemp() / name
        path.write_bytes(content)
        with pytest.raises(LogError):
            read_log(path)


def test_a_folder_and_a_missing_file_are_clear_errors(tmp_path):
    with pytest.raises(LogError, match="is a folder"):
        read_log(tmp_path)
    with pytest.raises(LogError, match="no file"):
        read_log(tmp_path / "nothing.tlog")


def test_a_log_with_another_ending_is_read_by_its_content(tmp_path):
    log = read_log(written(tmp_path, WHOLE, "flight.BIN"))
    assert log.format == "tlog"
    assert any("is a tlog file by its content" in note for note in log.track.notes)


def test_mavlink_1_frames_are_read(tmp_path):
    made = link()
    path = written(tmp_path, flight_of(lambda m: m.pack(made, force_mavlink1=True), 5, v1=True))
    assert path.read_bytes()[8] == 0xFE
    log = read_log(path)
    assert log.track.time_s.size == 50
    np.testing.assert_allclose(log.track.tank_kg, 9.0 - np.arange(50) / 1000, atol=1e-6)
    np.testing.assert_allclose(log.track.attitude, np.tile([0.01, 0.02, 0.03], (50, 1)), atol=1e-7)


def test_signed_frames_are_read(tmp_path):
    made = link()
    made.signing.secret_key = bytes(32)
    made.signing.sign_outgoing = True
    made.signing.timestamp = 1
    data = flight_of(lambda m: m.pack(made), 5)
    assert data[8 + 2] == 1  # incompatibility flag: signed
    log = read_log(written(tmp_path, data))
    assert log.quality.bytes_skipped == 0
    np.testing.assert_array_equal(log.track.rotor_speed_rpm[:, 0], 1900 + np.arange(50))


def test_trimmed_zeros_are_put_back(tmp_path):
    made = link()
    short = dialect.MAVLink_esc_telemetry_1_to_4_message(
        [0] * 4, [5600] * 4, [0] * 4, [0] * 4, [1500, 1600, 1700, 1800], [1, 1, 1, 1]
    ).pack(made)
    attitude = dialect.MAVLink_attitude_message(10_000, 0, 0, 0, 0, 0, 0).pack(made)
    assert attitude[1] < 28  # all angles trimmed away
    assert short[1] < 44  # the temperatures trimmed away
    log = read_log(written(tmp_path, stamped(attitude, 10) + stamped(short, 10)))
    np.testing.assert_array_equal(log.track.rotor_speed_rpm, [[1500, 1600, 1700, 1800]])
    np.testing.assert_array_equal(log.track.attitude, np.zeros((1, 3)))


def raw_frame(number: int, payload: bytes, extra: int, sequence: int = 0) -> bytes:
    """A MAVLink 2 frame of a message that pymavlink does not know."""
    head = (
        struct.pack("<BBBBBB", len(payload), 0, 0, sequence, 1, 1) + struct.pack("<I", number)[:3]
    )
    crc = x25crc(head + payload)
    crc.accumulate(bytes([extra]))
    return b"\xfd" + head + payload + struct.pack("<H", crc.crc)


def test_esc_status_and_fuel_status_are_decoded_though_pymavlink_lacks_them(tmp_path):
    made, out = link(), []
    for tick in range(40):
        t = 20 + tick / 10
        attitude = dialect.MAVLink_attitude_message(int(t * 1000), 0, 0, 0, 0, 0, 0).pack(made)
        out.append(stamped(attitude, t))
        for first in (0, 4):
            rpm = [2000 + first + k for k in range(4)]
            payload = struct.pack("<Q4i4f4fB", int(t * 1e6), *rpm, *[50.0] * 4, *[9.0] * 4, first)
            out.append(stamped(raw_frame(291, payload, 10), t))
        fuel = struct.pack(
            "<fffffIBB", 20000, 0, 12000.0 - tick, float("nan"), float("nan"), 1, 0, 60
        )
        out.append(stamped(raw_frame(371, fuel, 10), t))
    log = read_log(written(tmp_path, b"".join(out)))
    assert log.track.rotor_count == 8
    np.testing.assert_array_equal(log.track.rotor_speed_rpm[0], np.arange(8) + 2000.0)
    assert log.track.sources["tank_kg"] == "FUEL_STATUS remaining_fuel of id 0 (ml)"
    np.testing.assert_allclose(log.track.tank_kg, 12.0 - np.arange(40) / 1000, atol=1e-5)
    assert log.track.voltage[5] == pytest.approx(50.0)
    assert log.quality.unknown_ids == {}


def test_unknown_ids_are_skipped_and_counted_between_good_frames(tmp_path):
    unknown = stamped(raw_frame(59_999, b"\1\2\3", 99), 1)
    far = stamped(raw_frame(5_000_000, b"\1\2\3", 99), 1)
    data = b"".join([*STAMPED[:9000], unknown, far, unknown, *STAMPED[9000:]])
    log = read_log(written(tmp_path, data))
    assert log.quality.unknown_ids == {59_999: 2, 5_000_000: 1}
    assert (log.quality.bytes_skipped, log.quality.damaged_places) == (0, 0)
    assert log.quality.frames == len(STAMPED)


def test_two_vehicles_are_told_apart_and_the_choice_is_said(tmp_path):
    one, two = link(1), link(2)
    first = flight_of(lambda m: m.pack(one), 5)
    second = flight_of(lambda m: m.pack(two), 10, rpm=2500)
    path = written(tmp_path, first + second)
    log = read_log(path)
    assert (log.vehicle, log.vehicles) == (2, (1, 2))
    assert any("2 vehicles in the log (1, 2): vehicle 2 is read" in n for n in log.track.notes)
    assert log.track.rotor_speed_rpm[0, 1] == 2501
    assert read_log(path, vehicle=1).track.rotor_speed_rpm[0, 1] == 1901
    with pytest.raises(LogError, match="no vehicle 7; it holds vehicle 1, 2"):
        read_log(path, vehicle=7)


def test_a_vehicle_with_rotor_speeds_goes_before_one_with_more_messages(tmp_path):
    chatty, flyer = link(1), link(2)
    talk = b"".join(
        stamped(dialect.MAVLink_attitude_message(i, 0, 0, 0, 0, 0, 0).pack(chatty), i / 1000)
        for i in range(2000)
    )
    log = read_log(written(tmp_path, talk + flight_of(lambda m: m.pack(flyer), 5)))
    assert log.vehicle == 2


def test_a_ground_station_is_no_vehicle(tmp_path):
    ground = link(250, 190)
    beat = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)
    alone = b"".join(stamped(beat.pack(ground), t) for t in range(5))
    with pytest.raises(LogError, match="only a ground station"):
        read_log(written(tmp_path, alone))
    craft = link()
    log = read_log(written(tmp_path, alone + flight_of(lambda m: m.pack(craft), 3)))
    assert log.vehicles == (1,)


def test_a_restart_keeps_the_longest_stretch_and_says_so(tmp_path):
    craft = link()
    short = flight_of(lambda m: m.pack(craft), 5, rpm=1000)
    long = flight_of(lambda m: m.pack(craft), 20, rpm=2000, later=7.03)
    again = flight_of(lambda m: m.pack(craft), 5, rpm=1000, later=40.07)
    log = read_log(written(tmp_path, short + long + again))
    assert log.track.time_s.size == 200
    assert log.track.rotor_speed_rpm[:, 1].tolist() == [2001.0] * 200
    assert len(log.quality.clock_jumps) == 2
    assert any("time went backwards 2 time(s) (restart)" in note for note in log.track.notes)


def test_two_vehicles_with_one_id_are_refused(tmp_path):
    craft = link()
    early = flight_of(lambda m: m.pack(craft), 30)
    late = []
    for tick in range(300):
        boot = 500_000 + tick * 100
        message = dialect.MAVLink_attitude_message(boot, 0, 0, 0, 0, 0, 0).pack(craft)
        late.append(stamped(message, 10 + tick / 10))
    size = len(early) // 30
    turns = [
        early[i * size : (i + 1) * size] + b"".join(late[i * 10 : i * 10 + 10]) for i in range(30)
    ]
    with pytest.raises(LogError, match="share one system id"):
        read_log(written(tmp_path, b"".join(turns)))


def test_reordered_and_doubled_frames_change_nothing(tmp_path):
    made = link()
    data = flight_of(lambda m: m.pack(made), 20)
    path = written(tmp_path, data)
    pieces = frames_of(path)
    rng = np.random.default_rng(3)
    shuffled = [
        pieces[i] for i in np.argsort(np.arange(len(pieces)) + rng.uniform(0, 6, len(pieces)))
    ]
    doubled = [piece for piece in shuffled for _ in range(1 + (rng.random() < 0.1))]
    straight = read_log(path).track
    crooked = read_log(written(tmp_path, b"".join(doubled), "crooked.tlog")).track
    np.testing.assert_allclose(crooked.tank_kg[:190], straight.tank_kg[:190], atol=0.003)
    assert abs(crooked.time_s.size - straight.time_s.size) < 5


def test_messages_without_a_clock_get_the_vehicles_time_whatever_the_link_does(tmp_path):
    """The ground computer's clock runs 3600 s off after half of the log."""
    pieces = frames_of(FLIGHT)
    half = len(pieces) // 2
    late = [
        struct.pack(">Q", struct.unpack(">Q", piece[:8])[0] + 3_600_000_000) + piece[8:]
        for piece in pieces[half:]
    ]
    log = read_log(written(tmp_path, b"".join([*pieces[:half], *late])))
    whole = read_log(FLIGHT)
    assert log.track.duration == pytest.approx(whole.track.duration, abs=0.01)
    np.testing.assert_allclose(log.track.time_s, whole.track.time_s, atol=0.2)
    np.testing.assert_allclose(log.track.airspeed, whole.track.airspeed, atol=0.3)


def test_a_jittering_link_does_not_move_messages_that_carry_a_clock(tmp_path):
    """Also past 71 minutes, where the 32-bit clock of SERVO_OUTPUT_RAW has begun anew."""
    rng = np.random.default_rng(4)
    made, out = link(), []
    for tick in range(100):
        t = 4290.0 + tick / 10
        messages = [
            dialect.MAVLink_attitude_message(int(t * 1000), tick / 1000, 0, 0, 0, 0, 0),
            dialect.MAVLink_servo_output_raw_message(int(t * 1e6) % 2**32, 0, *[1000 + tick] * 8),
        ]
        out += [stamped(m.pack(made), t + rng.uniform(0, 0.4)) for m in messages]
    track = read_log(written(tmp_path, b"".join(out))).track
    np.testing.assert_allclose(track.time_s, np.arange(100) / 10, atol=1e-6)
    np.testing.assert_allclose(track.attitude[:, 0], np.arange(100) / 1000, atol=1e-6)
    np.testing.assert_allclose(track.throttle[:, 0], np.arange(100) / 1000, atol=1e-6)


def test_motors_are_found_on_the_outputs_that_the_parameters_name(tmp_path):
    """Motors 1 to 4 on outputs 6, 5, 8, 7: ESC telemetry is numbered by output."""
    made, out = link(), []
    for motor, output in enumerate((6, 5, 8, 7)):
        name = f"SERVO{output}_FUNCTION".encode()
        out.append(
            stamped(dialect.MAVLink_param_value_message(name, 33 + motor, 9, 1, 0).pack(made), 9)
        )
    for tick in range(30):
        t = 10 + tick / 10
        speeds = [1005, 1006, 1007, 1008]
        messages = [
            dialect.MAVLink_attitude_message(int(t * 1000), 0, 0, 0, 0, 0, 0),
            dialect.MAVLink_esc_telemetry_5_to_8_message(
                [30] * 4, [5000] * 4, [900] * 4, [1] * 4, speeds, [tick + 1] * 4
            ),
            dialect.MAVLink_servo_output_raw_message(
                int(t * 1e6), 0, 1000, 1000, 1000, 1000, 1150, 1160, 1170, 1180
            ),
        ]
        out += [stamped(m.pack(made), t) for m in messages]
    track = read_log(written(tmp_path, b"".join(out))).track
    np.testing.assert_array_equal(track.rotor_speed_rpm[5], [1006, 1005, 1008, 1007])
    np.testing.assert_allclose(track.throttle[5], [0.16, 0.15, 0.18, 0.17])
    assert "motors on outputs 6, 5, 8, 7 by SERVOn_FUNCTION" in track.sources["rotor_speed_rpm"]


def test_attitude_of_a_gimbal_is_not_the_vehicles(tmp_path):
    craft, gimbal = link(), link(1, 154)
    data = flight_of(lambda m: m.pack(craft), 10)
    tilted = b"".join(
        stamped(
            dialect.MAVLink_attitude_message(10_000 + 200 * i, 1.0, 1.0, 1.0, 0, 0, 0).pack(gimbal),
            10 + 0.2 * i,
        )
        for i in range(40)
    )
    track = read_log(written(tmp_path, data + tilted)).track
    assert np.nanmax(track.attitude) < 0.1


def test_an_esc_that_falls_silent_is_unknown_not_zero(tmp_path):
    made, out = link(), []
    for tick in range(60):
        t = 10 + tick / 10
        heard = tick < 30
        messages = [
            dialect.MAVLink_attitude_message(int(t * 1000), 0, 0, 0, 0, 0, 0),
            dialect.MAVLink_esc_telemetry_1_to_4_message(
                [30] * 4,
                [5000] * 4,
                [900] * 4,
                [1] * 4,
                [1500 if heard else 0, 1501, 1502, 1503],
                [tick if heard else 29, tick, tick, tick],
            ),
        ]
        out += [stamped(m.pack(made), t) for m in messages]
    speeds = read_log(written(tmp_path, b"".join(out))).track.rotor_speed_rpm
    assert np.nanmin(speeds[:, 0]) == 1500
    assert np.isnan(speeds[-20:, 0]).all()
    assert np.isfinite(speeds[:, 1:]).all()


def landed_flight(*, told: bool, height: bool) -> bytes:
    """Idle on the ground for 10 s, 20 s in the air, 10 s on the ground; motors answer."""
    made, out = link(), []
    for tick in range(400):
        t = 10 + tick / 10
        up = 100 <= tick < 300
        boot = int(t * 1000)
        messages = [
            dialect.MAVLink_attitude_message(boot, 0, 0, 0, 0, 0, 0),
            dialect.MAVLink_esc_telemetry_1_to_4_message(
                [30] * 4, [5000] * 4, [900] * 4, [1] * 4, [1900 if up else 450] * 4, [tick + 1] * 4
            ),
        ]
        if height:
            above = min(max(tick - 120, 0), max(280 - tick, 0), 30) * 100
            messages.append(
                dialect.MAVLink_global_position_int_message(
                    boot, 366500000, 1169000000, 5000 + above, above, 0, 0, 0, 0
                )
            )
        if told and tick % 10 == 0:
            messages.append(dialect.MAVLink_extended_sys_state_message(0, 2 if up else 1))
        out += [stamped(m.pack(made), t) for m in messages]
    return b"".join(out)


@pytest.mark.parametrize(
    ("told", "height", "said", "first", "last"),
    [
        (True, False, "EXTENDED_SYS_STATE landed_state", 100, 300),
        (True, True, "0.2 m clear of it", 123, 278),
        (False, False, "rotor speeds above 0.5", 100, 300),
    ],
)
def test_flying_is_told_by_the_best_evidence_there_is(tmp_path, told, height, said, first, last):
    track = read_log(written(tmp_path, landed_flight(told=told, height=height))).track
    rows = np.flatnonzero(track.flying)
    assert rows[0] == pytest.approx(first, abs=2)
    assert rows[-1] == pytest.approx(last, abs=2)
    assert said in track.sources["flying"]


def test_home_moved_while_armed_is_not_the_place_of_zero(tmp_path):
    """Zero is home as it was at take-off, not where it is set later."""
    made = link()
    place = (366500000, 1169000000, 5000)
    before = dialect.MAVLink_home_position_message(*place, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)
    later = dialect.MAVLink_home_position_message(
        366600000, 1169000000, 9000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0
    )
    data = stamped(before.pack(made), 9) + landed_flight(told=True, height=True)
    data += stamped(later.pack(made), 49)
    track = read_log(written(tmp_path, data)).track
    assert track.origin is not None
    assert track.origin.altitude == 5.0
    np.testing.assert_allclose(track.position_ned[200], [0, 0, -3.0], atol=0.01)


def test_an_airframe_with_another_number_of_rotors_is_refused(tmp_path):
    agras = next(a for a in ("agras-t20", "agras-t40") if load_airframe(a).rotor_count != 4)
    with pytest.raises(AirframeError, match="4 rotors by FRAME_CLASS, but airframe"):
        read_log(FLIGHT, airframe=load_airframe(agras))
    no_parameters = [p for p in STAMPED if p[15] != 22 or p[16]]
    with pytest.raises(AirframeError, match="4 rotors by the vehicle type"):
        read_log(written(tmp_path, b"".join(no_parameters)), airframe=load_airframe(agras))


def test_sequence_numbers_tell_what_was_not_received(tmp_path):
    craft = link()

    def pack(message):
        frame = message.pack(craft)
        craft.seq = (craft.seq + 1) % 256
        return frame

    data = flight_of(pack, 10)
    path = written(tmp_path, data)
    assert read_tlog(path).quality.frames_missing == 0
    pieces = frames_of(path)
    holed = written(tmp_path, b"".join(p for i, p in enumerate(pieces) if i % 10 != 5), "h.tlog")
    assert read_tlog(holed).quality.frames_missing == pytest.approx(len(pieces) / 10, abs=1)


def test_a_raw_link_recording_without_stamps_is_refused(tmp_path):
    raw = b"".join(piece[8:] for piece in STAMPED)
    with pytest.raises(LogError, match="have no time stamps between them"):
        read_log(written(tmp_path, raw))


def test_mission_texts_and_parameters_come_with_the_flight():
    log = read_log(FLIGHT)
    assert [w.number for w in log.waypoints] == list(range(29))
    assert log.waypoints[5].latitude_deg == pytest.approx(36.6509881)
    assert np.isnan(log.waypoints[2].latitude_deg)  # a speed change has no place
    assert log.parameters["BATT2_CAPACITY"] == 16000
    texts = {text: time for time, text in log.messages}
    # Takeoff begins 8 s after the motors arm.
    assert texts["Mission: 3 WP"] - texts["Arming motors"] == pytest.approx(8.1, abs=0.2)


def test_a_long_text_in_pieces_is_one_line(tmp_path):
    craft = link()
    text = b"Battery 1 is below the level that was set for the return to launch, landing now"
    pieces = [
        dialect.MAVLink_statustext_message(4, text[i * 50 : i * 50 + 50], 77, i).pack(craft)
        for i in range(2)
    ]
    data = flight_of(lambda m: m.pack(craft), 2) + b"".join(stamped(p, 12) for p in pieces)
    assert read_log(written(tmp_path, data)).messages[0][1] == text.decode()


def test_sources_say_which_message_each_channel_came_from():
    log = read_log(FLIGHT)
    assert log.track.sources["tank_kg"] == "NAMED_VALUE_FLOAT TANK"
    assert log.track.sources["airspeed"].startswith("VFR_HUD airspeed (EKF estimate")
    assert "home (HOME_POSITION)" in log.track.sources["position_ned"]
    assert "not above the crop" in log.track.sources["height_agl"]
    reports = {report.name: report for report in log.channels}
    assert reports["rotor_speed_rpm"].rate_hz == pytest.approx(10.0, rel=0.05)
    assert reports["tank_kg"].rate_hz == pytest.approx(2.0, rel=0.05)
    assert reports["rotor_speed_rpm"].gaps == 0


@pytest.mark.parametrize("path", sorted((ROOT / "sitl_logs/campaign").glob("*.tlog"))[::9])
def test_the_tank_of_the_manifest_is_the_tank_of_the_log(path):
    import tomllib

    flights = tomllib.loads((ROOT / "sitl_logs/manifest.toml").read_text())["flight"]
    stated = next(f for f in flights if f["file"].endswith(path.name))
    track = read_log(path).track
    assert track.tank_kg[0] == pytest.approx(stated["payload_start_kg"], abs=1e-3)
    assert track.tank_kg[-1] == pytest.approx(stated["tank_end_kg"], abs=1e-3)
    flown = track.time_s[track.flying]
    assert flown[-1] - flown[0] == pytest.approx(stated["flight_s"], abs=12.0)
