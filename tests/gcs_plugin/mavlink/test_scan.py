"""Frames out of a .tlog: against pymavlink's own, damaged, and of every kind that is sent."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect
from pymavlink.generator.mavcrc import x25crc

from tests.gcs_plugin.logs.tlog_files import (
    FLIGHT,
    STAMPED,
    WHOLE,
    flight_of,
    link,
    stamped,
    written,
)
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.mavlink import scan as frames
from thrustmargin.gcs_plugin.mavlink.layouts import layouts
from thrustmargin.gcs_plugin.mavlink.scan import read_bytes
from thrustmargin.gcs_plugin.wording.check_words import source_words, statement_words
from thrustmargin.models.errors import LogError

PADDING = 512  # bytes behind the data that a scan may look at


def scanned(data: bytes) -> frames.Frames:
    padded = np.frombuffer(data + bytes(PADDING), dtype=np.uint8)
    return frames.scan(padded, len(data))


@pytest.mark.slow
def test_every_field_of_every_message_equals_pymavlinks():
    data, size = read_bytes(FLIGHT, PADDING)
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
        for name in message.get_fieldnames():
            ours, theirs = row[name], getattr(message, name)
            if isinstance(theirs, str):
                assert ours.split(b"\0")[0].decode() == theirs
            else:
                assert np.array_equal(ours, theirs, equal_nan=True), (message.get_type(), name)
            compared += 1
    assert order == found.id.tolist()
    assert compared > 100_000
    assert all(next(rest, None) is None for rest in tables.values())


def test_stamps_and_senders_equal_pymavlinks():
    data, size = read_bytes(FLIGHT, PADDING)
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
    np.testing.assert_array_equal(found.system, systems)
    np.testing.assert_array_equal(found.component, components)
    np.testing.assert_array_equal(found.sequence, sequences)


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
    skipped = sum(length for _, length in found.skipped)
    # What looks like a frame of unknown id up to the very cut cannot be known from one.
    assert skipped == end - kept or found.unverified


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
    with pytest.raises(LogError, match="no such file"):
        read_log(tmp_path / "nothing.tlog")


def test_a_log_with_another_ending_is_read_by_its_content(tmp_path):
    log = read_log(written(tmp_path, WHOLE, "flight.BIN"))
    assert log.format == "tlog"
    assert any(
        "is a tlog file by its content" in note for note in map(statement_words, log.track.notes)
    )


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
    assert source_words(log.track.sources["tank_kg"]) == "FUEL_STATUS remaining_fuel of id 0 (ml)"
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


def test_a_raw_link_recording_without_stamps_is_refused(tmp_path):
    raw = b"".join(piece[8:] for piece in STAMPED)
    with pytest.raises(LogError, match="have no time stamps between them"):
        read_log(written(tmp_path, raw))


def test_a_frame_within_another_is_part_of_its_payload_and_none_of_its_own():
    packer = link(1)
    inner = dialect.MAVLink_system_time_message(7, 1000).pack(packer)
    text = b"a log of somebody else: " + inner
    outer = dialect.MAVLink_log_data_message(1, 0, len(text), [*text.ljust(90, b"\0")])
    first, last = outer.pack(packer), dialect.MAVLink_system_time_message(8, 2000).pack(packer)
    assert inner in first
    found = scanned(stamped(first, 0.0) + stamped(last, 1.0))
    assert found.id.tolist() == [120, 2]
    assert found.start.tolist() == [8, 8 + len(first) + 8]
    assert scanned(first[5:] + stamped(last, 1.0)).id.tolist() == [
        2,
        2,
    ]  # of a torn one it is all there is
