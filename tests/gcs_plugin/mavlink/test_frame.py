"""The rule of a frame, byte by byte: headers, checksums, and frames of unknown id."""

import numpy as np
import pytest

from thrustmargin.gcs_plugin.mavlink.frame import (
    FrameKind,
    FrameSplitter,
    Header,
    checksum,
    checksum_rows,
    examine,
    fields,
    frame_of,
    header,
)
from thrustmargin.gcs_plugin.mavlink.layouts import layout_table, layouts
from thrustmargin.gcs_plugin.mavlink.scan import columns, scan

ID_LIMIT = 65536  # of message ids that can have a layout
PADDING = 512  # bytes behind the data that a scan may look at
STAMP = 8  # bytes of time before each frame of a .tlog
HEADER_PADDING = 10  # bytes behind the data that a header may reach into
HEARTBEAT_EXTRA = 50
BODY = bytes([1, 2, 3, 4, 5, 6, 7, 8, 9])


def sealed(head: bytes, payload: bytes, extra: int, signature: bytes = b"") -> bytes:
    body = head[1:] + payload
    return head[:1] + body + checksum(body, extra).to_bytes(2, "little") + signature


def v1(number=0, payload=BODY, extra=HEARTBEAT_EXTRA, sequence=7) -> bytes:
    return sealed(bytes([0xFE, len(payload), sequence, 11, 12, number]), payload, extra)


def v2(number=0, payload=BODY, extra=HEARTBEAT_EXTRA, flags=0, sequence=7) -> bytes:
    head = bytes([0xFD, len(payload), flags, 0, sequence, 11, 12]) + number.to_bytes(3, "little")
    return sealed(head, payload, extra, bytes(13 * (flags & 1)))


def read(data: bytes, at: int = 0) -> Header:
    return header(data + bytes(HEADER_PADDING), at, layout_table().size)


def verdict(data: bytes, *, gap: int = 0, closed: bool = False) -> FrameKind:
    return examine(data + bytes(HEADER_PADDING), 0, len(data), gap=gap, closed=closed)[0]


def raw_scan(data: bytes, stamp: int = 0):
    return scan(np.frombuffer(data + bytes(PADDING), dtype=np.uint8), len(data), stamp=stamp)


def test_the_checksum_has_its_published_check_value():
    # CRC-16/MCRF4XX of "123456789" is 0x6F91 (reveng catalogue).
    assert checksum(b"12345678", ord("9")) == 0x6F91
    rows = np.frombuffer(b"12345678" * 2, dtype=np.uint8).reshape(2, 8)
    assert checksum_rows(rows, np.full(2, ord("9"), np.uint8)).tolist() == [0x6F91, 0x6F91]
    odd = np.frombuffer(b"12345678", dtype=np.uint8)[None, :7]
    # The ninth byte makes no difference to what the first eight gave: 0x6F91 needs all nine.
    assert checksum_rows(odd, odd[:, 6]).tolist() == [checksum(b"1234567", ord("7"))]


def test_headers_of_both_versions_are_read_alike():
    assert read(v1()) == (0, 5 + 9, 6 + 9 + 2, 9, True)
    assert read(v2()) == (0, 9 + 9, 10 + 9 + 2, 9, True)
    assert read(v2(flags=1)) == (0, 9 + 9, 10 + 9 + 2 + 13, 9, True)
    assert read(v1(number=30, payload=b"")) == (30, 5, 8, 28, True)
    assert read(v2(number=0x010203))[0] == 0x010203
    # In version 1 the flags of version 2 are a sequence number.
    assert read(v1(sequence=255)).possible
    assert read(v1(sequence=1)).length == 17


def test_a_header_is_impossible_with_unknown_flags_or_a_payload_too_long():
    assert not read(v2(flags=2)).possible
    assert not read(v2(flags=0x81)).possible
    assert not read(v1(payload=bytes(10))).possible
    assert not read(v2(payload=bytes(10))).possible
    assert read(v2(number=50_000, payload=bytes(255))).possible
    assert read(v2(number=50_000)).largest == -1
    for number in (ID_LIMIT - 1, ID_LIMIT, 2**24 - 1):
        assert read(v2(number=number)).largest == -1


def test_many_headers_are_read_as_each_alone():
    frames = [v1(), v2(), v2(flags=1), v2(number=2**24 - 1), v1(number=9), v2(flags=3)]
    data = np.frombuffer(b"".join(frames) + bytes(HEADER_PADDING), dtype=np.uint8)
    at = np.cumsum([0, *map(len, frames[:-1])])
    together = header(data, at, layout_table().size)
    for row, frame in enumerate(frames):
        assert [int(column[row]) for column in together] == [int(x) for x in read(frame)]


@pytest.mark.parametrize("frame", [v1(), v2(), v2(flags=1)], ids=["v1", "v2", "signed"])
def test_a_frame_is_unfinished_until_its_last_byte_and_good_from_then(frame):
    for size in range(1, len(frame)):
        assert verdict(frame[:size]) is FrameKind.UNFINISHED
        assert verdict(frame[:size], closed=True) is FrameKind.UNFINISHED
    assert verdict(frame) is FrameKind.GOOD
    assert verdict(frame + b"\0") is FrameKind.GOOD
    good = frame_of(frame, stamp_us=5, link=3)
    assert good is not None
    assert good == (frame, 0, 11, 12, 7, True, 5, 3)
    assert good.payload == BODY
    assert frame_of(frame) == (frame, 0, 11, 12, 7, True, 0, 0)
    assert frame_of(frame + b"\0") is None
    assert frame_of(frame[:-1]) is None


def test_each_byte_that_the_checksum_covers_counts():
    for frame, covered in ((v1(), 17), (v2(), 21), (v2(flags=1), 21)):
        for place in range(len(frame)):
            damaged = bytearray(frame)
            damaged[place] ^= 0x10
            found = frame_of(bytes(damaged))
            # The signature is another's to check; a changed id may be that of no message.
            assert (found is not None and found.verified) == (place >= covered), place


def test_a_wrong_checksum_is_told_from_no_frame():
    damaged = v2()[:-1] + bytes([v2()[-1] ^ 1])
    assert verdict(damaged) is FrameKind.BAD_CHECKSUM
    assert frame_of(damaged) is None
    assert verdict(b"\x00" + v2()) is FrameKind.NOTHING
    assert verdict(v2(flags=2)) is FrameKind.NOTHING


def test_an_unknown_frame_waits_for_the_next_header_in_a_stream():
    unknown = v2(number=50_000)
    assert verdict(unknown) is FrameKind.UNFINISHED
    assert verdict(unknown, closed=True) is FrameKind.UNVERIFIED
    assert verdict(unknown + v2()[:9]) is FrameKind.UNFINISHED
    assert verdict(unknown + v2()[:10]) is FrameKind.UNVERIFIED
    assert verdict(unknown + v1()[:5]) is FrameKind.UNFINISHED
    assert verdict(unknown + v1()[:6]) is FrameKind.UNVERIFIED
    assert verdict(unknown + b"\0") is FrameKind.NOTHING
    assert verdict(unknown + v2(flags=2)) is FrameKind.NOTHING
    assert verdict(unknown + v2()[:3], closed=True) is FrameKind.UNVERIFIED


def test_an_unknown_frame_in_a_file_is_followed_after_the_stamp():
    unknown = v2(number=50_000)
    assert verdict(unknown + bytes(8) + v2(), gap=8) is FrameKind.UNVERIFIED
    assert verdict(unknown + bytes(7) + v2(), gap=8) is FrameKind.NOTHING
    assert verdict(unknown + v2(), gap=8) is FrameKind.NOTHING


def test_a_good_frame_inside_an_unknown_one_is_the_one_that_counts():
    claimed = v2(number=50_000, payload=b"ab" + v1() + b"cd")
    assert verdict(claimed + v2()) is FrameKind.NOTHING
    assert verdict(claimed, closed=True) is FrameKind.NOTHING
    harmless = v2(number=50_000, payload=b"ab\xfd\x09\xfe" + bytes(20))
    assert verdict(harmless + v2()) is FrameKind.UNVERIFIED
    # FE, a length of 253, and the id 9, which is no message: a good frame from its second byte on.
    shifted = b"\xfe" + v2(sequence=9)
    assert verdict(shifted.ljust(261, b"\0") + v2()) is FrameKind.NOTHING
    # A frame that begins inside and ends behind must be waited for.
    overlapped = bytes([0xFD, 12, 0, 0, 0, 1, 1]) + (50_000).to_bytes(3, "little") + b"ab" + v1()
    assert verdict(overlapped[:-1]) is FrameKind.UNFINISHED
    assert verdict(overlapped) is FrameKind.NOTHING


def test_a_frame_too_short_for_its_message_has_its_zeros_put_back():
    frame = frame_of(v2(payload=b"\x05\x06"))
    assert frame is not None
    row = fields(frame)
    assert row is not None
    assert int(row["custom_mode"][0]) == 0x0605
    assert int(row["mavlink_version"][0]) == 0
    data = bytes(STAMP) + frame.data + bytes(STAMP) + v1(sequence=8)
    found = raw_scan(data, STAMP)
    table = columns(found, np.arange(2), layouts()[0])
    assert table["custom_mode"].tolist() == [0x0605, 0x04030201]
    assert table["mavlink_version"].tolist() == [0, 9]
    assert found.system.tolist() == [11, 11]
    assert found.component.tolist() == [12, 12]
    assert found.sequence.tolist() == [7, 8]


def test_fields_of_a_frame_that_could_not_be_checked_are_not_read():
    unknown = frame_of(v2(number=50_000))
    assert unknown is not None
    assert fields(unknown) is None
    known = frame_of(v2())
    assert known is not None
    assert fields(known._replace(verified=False)) is None


def test_two_damaged_frames_in_a_row_are_counted_as_two_in_stream_and_file():
    damaged = [frame[:-1] + bytes([frame[-1] ^ 1]) for frame in (v2(), v1())]
    stream = v2() + b"".join(damaged) + v2() + b"\1\2\3" + v1() + damaged[0] + v2()
    splitter = FrameSplitter()
    assert len(splitter.feed(stream, 0)) == 4
    found = raw_scan(stream)
    assert splitter.counts.bad_checksum == found.bad_checksum == 3
    assert splitter.counts.frames == found.start.size == 4
    lost = 2 * len(v2()) + len(v1()) + 3
    assert splitter.counts.bytes_skipped == lost
    assert found.skipped == (
        (len(v2()), len(v2()) + len(v1())),
        (2 * len(v2()) + len(v2()) + len(v1()), 3),
        (3 * len(v2()) + 2 * len(v1()) + 3, len(v2())),
    )


def test_a_damaged_frame_is_counted_once_when_the_stream_comes_in_pieces():
    damaged = v2()[:-1] + bytes([v2()[-1] ^ 1])
    stream = v2() + damaged + v1() + damaged + v2()
    for size in range(1, 40):
        splitter = FrameSplitter()
        for at in range(0, len(stream), size):
            splitter.feed(stream[at : at + size], 0)
        assert (splitter.counts.bad_checksum, splitter.counts.frames) == (2, 3), size
        assert splitter.counts.bytes == len(stream)
        assert splitter.counts.bytes_skipped == 2 * len(damaged)


def test_unknown_frames_in_a_file_have_their_place_and_are_counted_by_id():
    unknown, far = v2(number=50_000), v2(number=2**20)
    stamp = (10**15).to_bytes(8, "big")
    data = b"".join(stamp + part for part in (v2(), unknown, far, unknown, v1()))
    found = raw_scan(data, STAMP)
    step = STAMP + len(unknown)
    assert found.unverified == (
        (step + STAMP, 50_000),
        (2 * step + STAMP, 2**20),
        (3 * step + STAMP, 50_000),
    )
    assert found.unknown_ids == {50_000: 2, 2**20: 1}
    assert found.skipped == ()
    assert found.start.tolist() == [STAMP, 4 * step + STAMP]
    assert found.stamps_s().tolist() == [1e9, 1e9]
    assert not found.unstamped()
    assert raw_scan(v2() * 5, STAMP).unstamped()
    # The end of the file is as good as another frame.
    assert raw_scan(data[: 2 * step], STAMP).unknown_ids == {50_000: 1}


def test_of_frames_within_frames_the_earlier_counts():
    inner = v1()
    outer = v2(number=253, payload=b"\x06" + inner + b"x" * 20, extra=layouts()[253].crc_extra)
    splitter = FrameSplitter()
    assert [f.id for f in splitter.feed(outer + v2(), 0)] == [253, 0]
    assert raw_scan(outer + v2()).id.tolist() == [253, 0]
