"""Verdicts on bytes that are put together by hand, good, damaged, unknown or cut; and walks."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from thrustmargin.gcs_plugin.mavlink.frame import (
    FrameKind,
    FrameSplitter,
    Walk,
    examine,
    fields,
    frame_of,
    header,
)
from thrustmargin.gcs_plugin.mavlink.layouts import layout_table
from thrustmargin.gcs_plugin.mavlink.scan import scan

ID_LIMIT = 65536  # of message ids that can have a layout
PADDING = 512  # bytes behind the data that a scan may look at
HEADER_PADDING = 10  # bytes behind the data that a header may reach into
#: HEARTBEAT: id 0, nine bytes, CRC_EXTRA 50 (MAVLink definition).
BEAT = bytes([1, 2, 3, 4, 5, 6, 7, 8, 3])
UNKNOWN = 9  # an id that no dialect defines


def sealed(head: bytes, extra: int) -> bytes:
    crc = dialect.x25crc(head[1:])
    crc.accumulate(bytes([extra]))
    return head + crc.crc.to_bytes(2, "little")


def first(payload: bytes = BEAT, *, number: int = 0, sequence: int = 7, extra: int = 50) -> bytes:
    """MAVLink 1 of system 11, component 12."""
    return sealed(bytes([0xFE, len(payload), sequence, 11, 12, number]) + payload, extra)


def second(
    payload: bytes = BEAT, *, number: int = 0, sequence: int = 7, extra: int = 50, flags: int = 0
) -> bytes:
    """MAVLink 2 of system 11, component 12."""
    head = bytes([0xFD, len(payload), flags, 0, sequence, 11, 12])
    return sealed(head + number.to_bytes(3, "little") + payload, extra)


def verdict(data: bytes, at: int = 0, **given) -> FrameKind:
    return examine(data + bytes(HEADER_PADDING), at, len(data), **given)[0]


@pytest.mark.parametrize(("frame", "length"), [(first(), 17), (second(), 21)])
def test_a_frame_of_each_version(frame, length):
    assert len(frame) == length  # 6 or 10 of header, 9 of payload, 2 of checksum
    assert verdict(frame) is FrameKind.GOOD
    found = frame_of(frame)
    assert found is not None
    assert (found.id, found.system, found.component, found.sequence) == (0, 11, 12, 7)
    assert (found.verified, found.stamp_us, found.link) == (True, 0, 0)
    assert found.data == frame
    assert found.payload == BEAT
    stamped = frame_of(frame, stamp_us=5, link=2)
    assert stamped is not None
    assert (stamped.stamp_us, stamped.link) == (5, 2)
    read = fields(found)
    assert read is not None
    assert int(read["custom_mode"][0]) == 0x04030201
    assert int(read["mavlink_version"][0]) == 3


def test_trimmed_zeros_come_back_as_zeros():
    found = frame_of(second(BEAT[:4]))
    assert found is not None
    assert found.payload == BEAT[:4]
    read = fields(found)
    assert read is not None
    assert int(read["custom_mode"][0]) == 0x04030201
    assert int(read["type"][0]) == int(read["mavlink_version"][0]) == 0


def test_a_signature_is_thirteen_bytes_after_the_checksum():
    signed = second(flags=1) + bytes(range(13))
    assert verdict(signed) is FrameKind.GOOD
    assert frame_of(signed) is not None
    assert frame_of(signed[:-1]) is None
    assert frame_of(signed + b"\0") is None
    assert verdict(second(flags=2)) is FrameKind.NOTHING  # a flag that MAVLink does not define


def test_headers_by_hand_one_by_one_and_all_at_once():
    sizes = layout_table().size
    data = first() + second(number=0) + second(BEAT, number=0x030201, flags=1) + bytes(20)
    places = np.array([0, 17, 38])
    many = header(np.frombuffer(data, np.uint8).astype(np.int64), places, sizes)
    # ids; bytes under the checksum: 5 + 9 and 9 + 9; whole: those + magic, checksum, signature
    assert many.id.tolist() == [0, 0, 0x030201]
    assert many.covered.tolist() == [14, 18, 18]
    assert many.length.tolist() == [17, 21, 34]
    assert many.largest.tolist() == [9, 9, -1]
    assert many.possible.tolist() == [True, True, True]
    for k, place in enumerate(places.tolist()):
        assert tuple(header(data, place, sizes)) == tuple(column[k] for column in many)


def test_a_payload_longer_than_its_message_is_no_frame():
    for frame in (second(BEAT + b"\1"), first(BEAT + b"\1")):
        assert verdict(frame) is FrameKind.NOTHING
        assert frame_of(frame) is None


@pytest.mark.parametrize("number", [ID_LIMIT - 1, ID_LIMIT, ID_LIMIT + 1, 0xFFFFFF])
def test_ids_beyond_the_table_are_unknown(number):
    frame = second(number=number)
    assert verdict(frame, closed=True) is FrameKind.UNVERIFIED
    found = frame_of(frame)
    assert found is not None
    assert (found.id, found.verified) == (number, False)
    assert fields(found) is None


@pytest.mark.parametrize("frame", [first(), second()])
def test_damage_and_cuts(frame):
    hurt = frame[:-3] + bytes([frame[-3] ^ 1]) + frame[-2:]
    assert verdict(hurt) is FrameKind.BAD_CHECKSUM
    assert frame_of(hurt) is None
    for byte in (-1, -2):  # either byte of the checksum
        wrong = bytearray(frame)
        wrong[byte] ^= 0x80
        assert verdict(bytes(wrong)) is FrameKind.BAD_CHECKSUM
    for size in range(1, len(frame)):
        assert verdict(frame[:size]) is FrameKind.UNFINISHED
    assert verdict(b"\x00" + frame) is FrameKind.NOTHING
    assert verdict(b"\x00" + frame, 1) is FrameKind.GOOD


def test_an_unknown_frame_counts_only_when_another_frame_can_follow():
    strange = first(b"abc", number=UNKNOWN)
    assert verdict(strange + first()) is FrameKind.UNVERIFIED
    assert verdict(strange + b"\x00" * 20) is FrameKind.NOTHING
    # The next one may be of unknown id too, damaged, or cut: its header is enough.
    assert verdict(strange + strange) is FrameKind.UNVERIFIED
    assert verdict(strange + first()[:6]) is FrameKind.UNVERIFIED
    assert verdict(strange + first()[:-1] + b"\x00") is FrameKind.UNVERIFIED
    # Too little of it to be read: wait, or, where nothing more comes, believe it.
    for next_bytes in (b"", first()[:1], first()[:5], second()[:9]):
        assert verdict(strange + next_bytes) is FrameKind.UNFINISHED
        assert verdict(strange + next_bytes, closed=True) is FrameKind.UNVERIFIED


def test_a_gap_of_time_stamps_lies_between_two_frames():
    strange = first(b"abc", number=UNKNOWN)
    stamp = b"\x00" * 8
    assert verdict(strange + stamp + first(), gap=8) is FrameKind.UNVERIFIED
    assert verdict(strange + first() + stamp, gap=8) is FrameKind.NOTHING
    assert verdict(strange + stamp, gap=8) is FrameKind.UNFINISHED
    assert verdict(strange + stamp, gap=8, closed=True) is FrameKind.UNVERIFIED
    assert verdict(strange + stamp[:7], gap=8, closed=True) is FrameKind.NOTHING


@pytest.mark.parametrize("before", [0, 1, 30])
def test_an_unknown_frame_with_a_good_one_inside_is_none(before):
    inside = bytes(before) + second()
    phantom = first(inside + bytes(60 - len(inside)), number=UNKNOWN)
    assert verdict(phantom + first()) is FrameKind.NOTHING
    cut = phantom[: 6 + before + 15]  # of the outer frame and of the inner one
    assert verdict(cut) is FrameKind.UNFINISHED


def test_a_good_frame_may_begin_at_the_second_byte_of_a_phantom():
    # FE FD ...: as MAVLink 1 a frame of 253 bytes and id = the sequence number of the frame inside.
    inner = second(sequence=UNKNOWN)
    stream = b"\xfe" + inner
    stream += bytes(261 - len(stream))  # 6 + 253 + 2
    assert verdict(stream + first()) is FrameKind.NOTHING
    found = FrameSplitter().feed(stream + first(), 0)
    assert [frame.data for frame in found] == [inner, first()]


def test_an_inner_frame_that_is_cut_by_the_end_of_the_bytes_is_waited_for():
    # The outer one of unknown id is whole, a frame inside it would end beyond it.
    inner = second()
    outer = first(bytes(20) + inner[:12], number=UNKNOWN)
    assert verdict(outer) is FrameKind.UNFINISHED
    assert verdict(outer, closed=True) is FrameKind.UNVERIFIED
    good = outer[:-2] + inner[12:] + first()
    assert verdict(good) is FrameKind.NOTHING


def walked(data: bytes, **given) -> list[tuple[FrameKind, int]]:
    options = {"closed": True, "wait": False, **given}
    walk = Walk()
    found = walk.frames(data + bytes(HEADER_PADDING), len(data), len(data), **options)
    return [(kind, at) for kind, at, _ in found]


def test_a_walk_reports_frames_and_one_bad_checksum_where_a_frame_was_due():
    hurt = bytearray(second())
    hurt[12] ^= 1
    stream = first() + bytes(hurt) + first() + b"\0\0" + bytes(hurt) + second()
    assert walked(stream) == [
        (FrameKind.GOOD, 0),
        (FrameKind.BAD_CHECKSUM, 17),
        (FrameKind.GOOD, 38),
        (FrameKind.GOOD, 78),  # the second damaged one stood where none was due
    ]
    # Two damaged ones in a row are both counted.
    assert walked(bytes(hurt) * 2 + first()) == [
        (FrameKind.BAD_CHECKSUM, 0),
        (FrameKind.BAD_CHECKSUM, 21),
        (FrameKind.GOOD, 42),
    ]


def test_a_walk_over_time_stamps_tells_where_the_stamp_is():
    stamp = b"\x00" * 8
    data = stamp + first() + b"\x01" * 3 + stamp + second()
    assert walked(data, gap=8) == [(FrameKind.GOOD, 0), (FrameKind.GOOD, 28)]


def test_a_walk_waits_at_what_may_become_a_frame():
    data = first() + second()[:15]
    walk = Walk()
    found = list(
        walk.frames(data + bytes(HEADER_PADDING), len(data), len(data), closed=False, wait=True)
    )
    assert [at for _, at, _ in found] == [0]
    assert walk.position == walk.expected == 17
    assert walked(data) == [(FrameKind.GOOD, 0)]


def test_counts_of_a_stream_by_hand():
    hurt = bytearray(first())
    hurt[8] ^= 1
    strange = first(b"abc", number=UNKNOWN)  # 11 bytes
    splitter = FrameSplitter(link=3)
    found = splitter.feed(b"\0\0" + first() + bytes(hurt) + strange + second() + b"\xfd", 9)
    assert [(f.verified, f.link, f.stamp_us) for f in found] == [
        (True, 3, 9),
        (False, 3, 9),
        (True, 3, 9),
    ]
    counts = splitter.counts
    assert counts.bytes == 2 + 17 + 17 + 11 + 21 + 1
    assert (counts.frames, counts.unknown) == (3, 1)
    # Two bytes of noise; the damaged frame was due a byte earlier had there been no noise.
    assert (counts.bytes_skipped, counts.bad_checksum) == (2 + 17, 1)
    assert splitter.waiting == 1
    assert len(splitter.passed) == 68


def test_a_datagram_with_a_whole_frame_ends_the_wait_for_the_one_before():
    splitter = FrameSplitter()
    assert splitter.feed_datagram(second()[:12], 0) == []
    assert splitter.waiting == 12
    assert [f.data for f in splitter.feed_datagram(first(), 0)] == [first()]
    assert (splitter.waiting, splitter.counts.bytes_skipped) == (0, 12)
    # A sequel is joined, even though its first byte may look like a beginning.
    head, tail = (
        second(bytes([1, 2, 0xFE]) + BEAT[3:])[:12],
        second(bytes([1, 2, 0xFE]) + BEAT[3:])[12:],
    )
    assert tail[0] == 0xFE
    assert splitter.feed_datagram(head, 0) == []
    assert len(splitter.feed_datagram(tail, 0)) == 1
    assert splitter.counts.bytes_skipped == 12


@pytest.mark.parametrize("last", [b"", first()[:4], first(number=UNKNOWN)[:3]])
def test_an_unknown_frame_at_the_end_of_a_file_is_believed(last):
    data = first() + first(b"abc", number=UNKNOWN) + last
    found = scan(np.frombuffer(data + bytes(PADDING), dtype=np.uint8), len(data), stamp=0)
    assert found.start.tolist() == [0]
    assert found.unverified == ((17, UNKNOWN),)
    assert found.skipped == (((28, len(last)),) if last else ())


def test_a_datagram_that_is_an_unknown_frame_is_believed_at_once_and_a_stream_waits():
    strange = first(b"abc", number=UNKNOWN)
    assert [f.verified for f in FrameSplitter().feed_datagram(strange, 0)] == [False]
    stream = FrameSplitter()
    assert stream.feed(strange, 0) == []
    assert [f.data for f in stream.feed(first(), 0)] == [strange, first()]
