"""Frames are made by pymavlink and by a recorded flight; the splitter must find every one."""

import struct

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v10 import ardupilotmega as dialect1
from pymavlink.dialects.v20 import ardupilotmega as dialect2
from pymavlink.generator import mavparse

from tests.gcs_plugin.live.live_vehicle import Vehicle, log_frames
from thrustmargin.gcs_plugin.mavlink.frame import Frame, FrameSplitter, fields
from thrustmargin.gcs_plugin.mavlink.layouts import layouts
from thrustmargin.gcs_plugin.mavlink.scan import scan

PADDING = 512  # bytes behind the data that a scan may look at


def flight(count: int = 40) -> list[bytes]:
    vehicle = Vehicle()
    return [frame.data for _ in range(count // 5) for frame in vehicle.tick()][:count]


FRAMES = flight()


def data_of(frames: list[Frame]) -> list[bytes]:
    return [frame.data for frame in frames]


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(1, 400), min_size=1, max_size=200))
def test_a_stream_cut_anywhere_gives_the_same_frames(cuts):
    stream = b"".join(FRAMES)
    splitter, found, at, passed = FrameSplitter(), [], 0, b""
    for size in [*cuts, len(stream)]:
        found += splitter.feed(stream[at : at + size], 7)
        passed += splitter.passed
        at += size
    assert data_of(found) == FRAMES
    assert passed == stream
    assert splitter.counts.bytes_skipped == splitter.counts.bad_checksum == 0


@settings(max_examples=300, deadline=None)
@example(number=7, place=27, flip=254)  # a phantom that ends where a frame begins, two inside it
@given(st.integers(0, len(FRAMES) - 1), st.integers(0, 280), st.integers(1, 255))
def test_a_flipped_byte_costs_only_the_frame_that_it_is_in(number, place, flip):
    hurt = bytearray(FRAMES[number])
    hurt[place % len(hurt)] ^= flip
    splitter = FrameSplitter()
    # Frames enough after the damage to fill any length that the damaged header may airframe_match.
    stream = b"".join(FRAMES[:number]) + bytes(hurt) + b"".join(FRAMES[number + 1 :] + FRAMES)
    found = splitter.feed(stream, 0)
    # Damage in the id makes a frame that cannot be checked: kept, but never read.
    checked = [frame.data for frame in found if frame.verified]
    assert checked == FRAMES[:number] + FRAMES[number + 1 :] + FRAMES
    doubtful = sum(len(frame.data) for frame in found if not frame.verified)
    assert splitter.counts.bytes_skipped == len(hurt) - doubtful


def unknown(payload: bytes, number: int = 50_000) -> bytes:
    head = bytes([0xFD, len(payload), 0, 0, 1, 1, 1]) + number.to_bytes(3, "little")
    return head + payload + b"??"


@st.composite
def damaged_streams(draw) -> bytes:
    """Frames of known and unknown ids, with a few bytes changed, lost or put between."""
    parts = draw(
        st.lists(
            st.one_of(
                st.sampled_from(FRAMES),
                st.builds(unknown, st.binary(max_size=60), st.sampled_from([50_000, 9, 1 << 20])),
                st.binary(max_size=40),
                # A header of an unknown id that claims the frames behind it.
                st.builds(lambda claimed: bytes([0xFE, claimed, 0, 0, 0, 9]), st.integers(0, 90)),
            ),
            max_size=12,
        )
    )
    stream = bytearray(b"".join(parts))
    for place, change in draw(st.lists(st.tuples(st.integers(0, 2000), st.integers(1, 255)))):
        if stream:
            stream[place % len(stream)] ^= change
    # Whole frames enough at the end to fill any length that a damaged header may airframe_match.
    return bytes(stream) + b"".join(FRAMES[:12])


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(damaged_streams(), st.lists(st.integers(1, 90), max_size=20))
def test_live_and_file_agree_on_every_frame_whatever_the_damage_and_the_pieces(stream, cuts):
    splitter, found, at = FrameSplitter(), [], 0
    for size in cuts:
        found += splitter.feed(stream[at : at + size], 0)
        at += size
    found += splitter.feed(stream[at:], 0)
    padded = np.frombuffer(stream + bytes(PADDING), dtype=np.uint8)
    scanned = scan(padded, len(stream), stamp=0)
    places = scanned.start.tolist()
    checked = [f for f in found if f.verified]
    assert [f.id for f in checked] == scanned.id.tolist()
    assert data_of(checked) == [
        stream[at : at + len(f.data)] for at, f in zip(places, checked, strict=True)
    ]
    assert [f.id for f in found if not f.verified] == [n for _, n in scanned.unverified]
    assert splitter.counts.bytes_skipped == sum(length for _, length in scanned.skipped)
    assert splitter.counts.bad_checksum == scanned.bad_checksum
    assert splitter.waiting == 0


@settings(max_examples=40, deadline=None)
@given(st.binary(max_size=300), st.integers(0, len(FRAMES)))
def test_noise_between_frames_is_skipped_and_counted(noise, place):
    splitter = FrameSplitter()
    stream = b"".join(FRAMES[:place]) + noise + b"".join(FRAMES[place:] + FRAMES)
    found = data_of(splitter.feed(stream, 0))
    assert [f for f in found if f in FRAMES] == FRAMES + FRAMES
    assert splitter.counts.bytes == len(stream)
    assert splitter.counts.bytes_skipped + len(b"".join(found)) + splitter.waiting == len(stream)


def test_datagrams_of_one_frame_each_are_counted_as_their_stream_is():
    damaged = bytes([*FRAMES[5][:-3], FRAMES[5][-3] ^ 1, *FRAMES[5][-2:]])
    sent = [*FRAMES[:5], damaged, *FRAMES[6:]]
    alone, stream = FrameSplitter(link=2), FrameSplitter(link=2)
    found = []
    for data in sent:
        found += alone.feed_datagram(data, 7)
        assert (alone.passed, alone.waiting) == (data, 0)
    assert found == stream.feed(b"".join(sent), 7, closed=True)
    assert data_of(found) == [*FRAMES[:5], *FRAMES[6:]]
    assert alone.counts == stream.counts


def test_a_datagram_cut_short_does_not_hold_back_the_next():
    splitter = FrameSplitter()
    assert splitter.feed_datagram(FRAMES[0][:-4], 0) == []
    assert data_of(splitter.feed_datagram(FRAMES[1], 0)) == [FRAMES[1]]
    assert splitter.counts.bytes_skipped == len(FRAMES[0]) - 4


def test_a_frame_spread_over_datagrams_is_put_together():
    splitter = FrameSplitter()
    assert splitter.feed_datagram(FRAMES[0][:9], 0) == []
    assert data_of(splitter.feed_datagram(FRAMES[0][9:] + FRAMES[1], 0)) == FRAMES[:2]


def test_header_fields_and_payload_are_those_that_were_packed():
    packer = dialect2.MAVLink(None, srcSystem=42, srcComponent=9)
    packer.seq = 200
    message = dialect2.MAVLink_attitude_message(12345, 0.1, 0.2, 0.3, 0.4, 0.5, 0.0)
    (frame,) = FrameSplitter(link=3).feed(bytes(message.pack(packer)), 99)
    assert (frame.id, frame.system, frame.component, frame.sequence) == (30, 42, 9, 200)
    assert (frame.verified, frame.stamp_us, frame.link) == (True, 99, 3)
    (alone,) = FrameSplitter().feed(bytes(message.pack(packer)), 99)
    assert alone.link == 0
    columns = fields(frame)
    assert columns is not None
    # The last field is 0 and was trimmed on the wire.
    assert len(frame.payload) < layouts()[30].dtype.itemsize
    assert int(columns["time_boot_ms"][0]) == 12345
    assert float(columns["yaw"][0]) == pytest.approx(0.3)
    assert float(columns["yawspeed"][0]) == 0.0


def test_mavlink_1_and_signed_frames_are_found_too():
    old = dialect1.MAVLink(None, srcSystem=5, srcComponent=1)
    first = bytes(dialect1.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3).pack(old))
    signer = dialect2.MAVLink(None, srcSystem=6, srcComponent=1)
    signer.signing.secret_key = bytes(32)
    signer.signing.sign_outgoing = True
    second = bytes(dialect2.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3).pack(signer))
    assert first[0] == 0xFE
    assert second[2] == 1
    found = FrameSplitter().feed(first + second + first, 0)
    assert data_of(found) == [first, second, first]
    assert [f.system for f in found] == [5, 6, 5]


def test_a_frame_of_unknown_id_is_kept_unverified_when_the_next_begins_where_it_ends():
    unknown = bytes([0xFD, 4, 0, 0, 1, 1, 1]) + (50_000).to_bytes(3, "little") + b"abcd" + b"??"
    splitter = FrameSplitter()
    found = splitter.feed(FRAMES[0] + unknown + FRAMES[1], 0)
    assert data_of(found) == [FRAMES[0], unknown, FRAMES[1]]
    assert [f.verified for f in found] == [True, False, True]
    assert splitter.counts.unknown == 1
    assert fields(found[1]) is None


def test_px4_messages_that_pymavlink_lacks_are_checked_and_read():
    # ESC_STATUS, layout of mavlink/common.xml: time, rpm[4], V[4], A[4], index; CRC_EXTRA 10.
    assert 291 not in dialect2.mavlink_map
    payload = struct.pack("<Q4i4f4fB", 7, 1, 2, 3, 4, *([50.0] * 4), *([1.5] * 4), 4)
    body = bytes([len(payload), 0, 0, 0, 1, 1]) + (291).to_bytes(3, "little") + payload
    crc = dialect2.x25crc(body)
    crc.accumulate(bytes([10]))
    (frame,) = FrameSplitter().feed(b"\xfd" + body + struct.pack("<H", crc.crc), 0)
    assert frame.verified
    columns = fields(frame)
    assert columns is not None
    assert columns["rpm"][0].tolist() == [1, 2, 3, 4]
    assert int(columns["index"][0]) == 4
    wrong = bytearray(b"\xfd" + body + struct.pack("<H", crc.crc ^ 1))
    splitter = FrameSplitter()
    assert splitter.feed(bytes(wrong) + FRAMES[0], 0)[0].data == FRAMES[0]
    assert splitter.counts.bad_checksum == 1


XML = """<?xml version="1.0"?><mavlink><messages>
<message id="290" name="ESC_INFO">{index}<field type="uint64_t" name="time_usec"/>
<field type="uint16_t" name="counter"/><field type="uint8_t" name="count"/>
<field type="uint8_t" name="connection_type"/><field type="uint8_t" name="info"/>
<field type="uint16_t[4]" name="failure_flags"/><field type="uint32_t[4]" name="error_count"/>
<field type="int16_t[4]" name="temperature"/></message>
<message id="291" name="ESC_STATUS">{index}<field type="uint64_t" name="time_usec"/>
<field type="int32_t[4]" name="rpm"/><field type="float[4]" name="voltage"/>
<field type="float[4]" name="current"/></message>
<message id="369" name="BATTERY_STATUS_V2"><field type="uint8_t" name="id"/>
<field type="int16_t" name="temperature"/><field type="float" name="voltage"/>
<field type="float" name="current"/><field type="float" name="capacity_consumed"/>
<field type="float" name="capacity_remaining"/><field type="uint8_t" name="percent_remaining"/>
<field type="uint32_t" name="status_flags"/></message>
<message id="372" name="BATTERY_INFO"><field type="uint8_t" name="id"/>
<field type="uint8_t" name="battery_function"/><field type="uint8_t" name="type"/>
<field type="uint8_t" name="state_of_health"/><field type="uint8_t" name="cells_in_series"/>
<field type="uint16_t" name="cycle_count"/><field type="uint16_t" name="weight"/>
<field type="float" name="discharge_minimum_voltage"/>
<field type="float" name="charging_minimum_voltage"/>
<field type="float" name="resting_minimum_voltage"/>
<field type="float" name="charging_maximum_voltage"/>
<field type="float" name="charging_maximum_current"/><field type="float" name="nominal_voltage"/>
<field type="float" name="discharge_maximum_current"/>
<field type="float" name="discharge_maximum_burst_current"/>
<field type="float" name="design_capacity"/><field type="float" name="full_charge_capacity"/>
<field type="char[9]" name="manufacture_date"/><field type="char[32]" name="serial_number"/>
<field type="char[50]" name="name"/></message>
<message id="371" name="FUEL_STATUS"><field type="uint8_t" name="id"/>
<field type="float" name="maximum_fuel"/><field type="float" name="consumed_fuel"/>
<field type="float" name="remaining_fuel"/><field type="uint8_t" name="percent_remaining"/>
<field type="float" name="flow_rate"/><field type="float" name="temperature"/>
<field type="uint32_t" name="fuel_type"/></message>
</messages></mavlink>""".format(index='<field type="uint8_t" name="index"/>')


def test_the_layouts_of_px4s_messages_are_those_of_pymavlinks_generator(tmp_path):
    path = tmp_path / "px4.xml"
    path.write_text(XML)
    made = mavparse.MAVXML(str(path), "2.0")
    assert {message.id for message in made.message} == {290, 291, 369, 371, 372}
    for message in made.message:
        ours = layouts()[message.id]
        assert (ours.name, ours.dtype.itemsize) == (message.name, message.wire_length)
        assert ours.crc_extra == mavparse.message_checksum(message)
        places = ours.dtype.fields
        assert places is not None
        assert [(name, places[name][1]) for name in places] == [
            (field.name, field.wire_offset) for field in message.ordered_fields
        ]


def test_every_frame_of_a_recorded_flight_is_found(sitl_logs):
    path = sitl_logs / "campaign" / "v4_m16_q2.5.tlog"
    frames = log_frames(path)
    # Eight bytes of time before each frame are all that the file holds besides.
    assert sum(len(f.data) + 8 for f in frames) == path.stat().st_size
    assert all(f.verified for f in frames)
    stamps = [f.stamp_us for f in frames]
    assert stamps == sorted(stamps)
