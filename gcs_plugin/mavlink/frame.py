"""Recognise MAVLink frames, by one rule for bytes as they arrive and for whole files.

`FrameSplitter` cuts bytes into frames as they arrive; `scan.py` finds those of whole files.

A frame of a known id is good if its checksum is correct. Of two that overlap, the first is kept. A
frame of an id in no dialect here cannot be checked. It is kept, marked as unverified, only if no
frame with a good checksum begins inside it and another frame can begin where it ends. After damage
the search continues one byte further. So damage costs only the frames that it touches.

| offset | MAVLink 1 (FE) | MAVLink 2 (FD) |
|---|---|---|
| 1 | payload length | payload length |
| 2 | sequence number | incompatibility flags; 1: signed |
| 3 | system id | compatibility flags |
| 4 | component id | sequence number |
| 5, 6 | message id (1 byte), payload | system id, component id |
| 7 | | message id (3 bytes, little-endian), then payload |

Then two bytes of checksum, and 13 of signature where a frame is signed.
The checksum is CRC-16/MCRF4XX: the reflected polynomial 0x1021 with start value 0xFFFF. A 16-bit
register forgets its past within 16 bits, so that one table of 65536 entries takes two bytes a step.
Source: MAVLink developer guide, "Packet Serialization".
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np
from fastcrc import crc16
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.mavlink.layouts import ID_LIMIT, layout_table, layouts

V1, V2 = 0xFE, 0xFD
SIGNED = 0x01  # the one incompatibility flag that MAVLink 2 defines
SIGNATURE = 13  # bytes: link id, 48-bit timestamp, 48-bit digest
#: Bytes that must follow the data wherever a header is looked at, so that it can be read whole.
HEADER_PADDING = 10


class Frame(NamedTuple):
    """A frame as sent, with its arrival time and link."""

    data: bytes  # magic byte to checksum or signature
    id: int
    system: int
    component: int
    sequence: int
    verified: bool  # False: unknown id, so that the checksum could not be tried
    stamp_us: int  # ground computer's clock on arrival, Unix µs
    link: int  # number of the link it came over

    @property
    def payload(self) -> bytes:
        """Return the payload as sent; MAVLink 2 trims its trailing zeros."""
        start = 10 if self.data[0] == V2 else 6
        return self.data[start : start + self.data[1]]


class Header(NamedTuple):
    """The header of one frame, or of n frames: then each field is an array (n,)."""

    id: Any
    covered: Any  # bytes after the magic byte that the checksum covers
    length: Any  # bytes of the whole frame
    largest: Any  # bytes of the payload with no zero trimmed; -1 for an unknown id
    possible: Any  # False: no frame has such a header


def header(data: Any, start: Any, sizes: Any) -> Header:
    """Return the header at offset `start` of bytes, or at each offset (n,) of a uint8 array.

    `data` must extend HEADER_PADDING bytes beyond; `sizes` is the payload size by message id, -1
    for an unknown id.
    """
    version2 = data[start] == V2
    payload = data[start + 1]
    flags = version2 * data[start + 2]
    number = data[start + 5 + 2 * version2] + version2 * 256 * data[start + 8]
    number = number + version2 * 65536 * data[start + 9]
    covered = 5 + 4 * version2 + payload
    largest = sizes[number - (number >= ID_LIMIT) * (number - ID_LIMIT + 1)]
    possible = (flags <= SIGNED) & ((largest < 0) | (payload <= largest))
    return Header(number, covered, covered + 3 + SIGNATURE * (flags & SIGNED), largest, possible)


class FrameKind(Enum):
    """The classification of the bytes at one offset."""

    GOOD = "a frame whose checksum agrees"
    UNVERIFIED = "a frame of unknown id"
    BAD_CHECKSUM = "a whole frame whose checksum is wrong"
    NOTHING = "no frame"
    UNFINISHED = "too few bytes to know"


_MAGIC = re.compile(b"[\xfd\xfe]")


@dataclass(slots=True)
class Cleared:
    """The `end` of a range known to contain no start of a good frame.

    With it, overlapping frames of unknown id, as an attacker can send them, are not searched
    repeatedly: the time stays linear in the bytes.
    """

    end: int = 0


@lru_cache(maxsize=4096)
def _header1(first: bytes, number: int) -> Header:
    """Return a MAVLink 1 header from bytes 0, 1 and 5, the only ones that it depends on; cached."""
    return header(first + bytes(3) + bytes((number,)) + bytes(4), 0, _tables()[0])


@lru_cache(maxsize=4096)
def _header2(flags: bytes, number: bytes) -> Header:
    """Return a MAVLink 2 header from bytes 0 to 2 and 7 to 9, the only ones that it depends on;
    cached.
    """
    return header(flags + bytes(4) + number, 0, _tables()[0])


@cache
def _tables() -> tuple[memoryview, memoryview]:
    table = layout_table()
    return table.size.data, table.crc_extra.data


def examine(
    data: bytes,
    start: int,
    size: int,
    *,
    gap: int = 0,
    closed: bool = False,
    cleared: Cleared | None = None,
) -> tuple[FrameKind, Header | None]:
    """Return the class of the bytes from `start`, of the first `size`, and the header there.

    `data` must have HEADER_PADDING more bytes. `gap` is the number of bytes between two frames (the
    time stamp in a .tlog). `closed`: another frame may begin after the last byte, as after a
    datagram or a file. `cleared` is the state from examining the bytes before `start`, and is
    updated. The header is None if it is incomplete or there is none.
    """
    verdict, head = _checked(data, start, size)
    if verdict is not FrameKind.UNVERIFIED or head is None:
        return verdict, head
    end = start + head.length
    inner = _inner_frame(
        data, start + 1, end, size, closed, Cleared() if cleared is None else cleared
    )
    if inner is not FrameKind.NOTHING:
        return (FrameKind.NOTHING if inner is FrameKind.GOOD else inner), head
    following = end + gap
    if following >= size and not closed:
        return FrameKind.UNFINISHED, head
    if following >= size:
        return (FrameKind.UNVERIFIED if size in (end, following) else FrameKind.NOTHING), head
    after, header_after = _checked(data, following, size)
    if after is FrameKind.UNFINISHED and header_after is None and not closed:
        return FrameKind.UNFINISHED, head
    return (FrameKind.NOTHING if after is FrameKind.NOTHING else FrameKind.UNVERIFIED), head


def _inner_frame(
    data: bytes, low: int, high: int, size: int, closed: bool, cleared: Cleared
) -> FrameKind:
    """Return GOOD or UNFINISHED for the first such frame that begins from `low` to before `high`.

    Else NOTHING. Both are offsets of `data`, of which `size` bytes count. With `closed` an
    unfinished frame does not count. `cleared` keeps the offset up to which none begins.
    """
    inner = max(low, cleared.end)
    while inner < high and (magic := _MAGIC.search(data, inner, high)):
        inner = magic.start()
        verdict, _ = _checked(data, inner, size)
        if verdict is FrameKind.GOOD or (verdict is FrameKind.UNFINISHED and not closed):
            cleared.end = inner
            return verdict
        inner += 1
    cleared.end = max(cleared.end, high)
    return FrameKind.NOTHING


def _checked(data: bytes, start: int, size: int) -> tuple[FrameKind, Header | None]:
    """Return the class of the bytes from `start`, by header and checksum alone, and the header.

    Any frame of unknown id is UNVERIFIED, since the frame after it is not looked at. `size` bytes
    count. The header is None if it is incomplete or has no magic byte.
    """
    magic = data[start]
    if magic not in (V1, V2):
        return FrameKind.NOTHING, None
    if start + (10 if magic == V2 else 6) > size:
        return FrameKind.UNFINISHED, None
    if magic == V2:
        head = _header2(data[start : start + 3], data[start + 7 : start + 10])
    else:
        head = _header1(data[start : start + 2], data[start + 5])
    if not head.possible:
        return FrameKind.NOTHING, head
    if start + head.length > size:
        return FrameKind.UNFINISHED, head
    if head.largest < 0:
        return FrameKind.UNVERIFIED, head
    end = start + 1 + head.covered
    stated = data[end] | data[end + 1] << 8
    if checksum(data[start + 1 : end], _tables()[1][head.id]) == stated:
        return FrameKind.GOOD, head
    return FrameKind.BAD_CHECKSUM, head


class Walk:
    """A pass through bytes from frame to frame.

    `position` is the present offset, before the stamp if any; `expected` is where a frame should
    begin: after the last one, good or damaged.
    """

    def __init__(self, at: int = 0, expected: int | None = None, cleared: int = 0) -> None:
        self.position = at
        self.expected = at if expected is None else expected
        self.cleared = Cleared(cleared)

    def frames(
        self, data: bytes, stop: int, size: int, *, gap: int = 0, closed: bool, wait: bool
    ) -> Iterator[tuple[FrameKind, int, Header]]:
        """Yield class, offset and header of frames from before `stop`, of `size` bytes.

        The offset is that of the stamp of `gap` bytes, if any. Yielded are good and unverified
        frames, and frames with a wrong checksum where a frame was expected. `closed`: another frame
        may begin after the last byte. With `wait`, stop at the first frame that more bytes may
        complete.
        """
        while self.position + gap < stop:
            start = self.position + gap
            if data[start] not in (V1, V2):
                magic = _MAGIC.search(data, start, stop)
                self.position = (magic.start() if magic else stop) - gap
                continue
            verdict, head = examine(data, start, size, gap=gap, closed=closed, cleared=self.cleared)
            if verdict is FrameKind.UNFINISHED and wait:
                return
            step = 1
            if head is not None and verdict in (FrameKind.GOOD, FrameKind.UNVERIFIED):
                step = gap + head.length
                self.expected = self.position + step
                yield verdict, self.position, head
            elif (
                head is not None
                and verdict is FrameKind.BAD_CHECKSUM
                and self.position == self.expected
            ):
                self.expected = start + head.length
                yield verdict, self.position, head
            self.position += step


def frame_of(data: bytes, *, stamp_us: int = 0, link: int = 0) -> Frame | None:
    """Return the Frame of these bytes, with its arrival `stamp_us`, µs, and its `link` number.

    None unless they are exactly one frame, with a correct checksum or an unknown id.
    """
    verdict, head = examine(data + bytes(HEADER_PADDING), 0, len(data), closed=True)
    if verdict not in (FrameKind.GOOD, FrameKind.UNVERIFIED) or head is None:
        return None
    if head.length != len(data):
        return None
    return build_frame(data, verdict, head, stamp_us, link)


def build_frame(data: bytes, verdict: FrameKind, head: Header, stamp_us: int, link: int) -> Frame:
    """Return the Frame of exactly these bytes, from their class and header."""
    place = 4 if data[0] == V2 else 2
    sequence, system, component = data[place : place + 3]
    good = verdict is FrameKind.GOOD
    return Frame(data, head.id, system, component, sequence, good, stamp_us, link)


@dataclass(slots=True)
class FrameCounts:
    """The counts of frames and bytes of one link, by result."""

    bytes: int = 0
    frames: int = 0
    unknown: int = 0  # among `frames`: of an id that is not known, unchecked
    bad_checksum: int = 0  # whole frames whose checksum is wrong
    bytes_skipped: int = 0  # bytes that belong to no frame kept


class FrameSplitter:
    """A splitter of one sender's bytes into frames; it buffers an unfinished frame for the next
    call.

    `feed` returns frames in order. `passed` is then every byte that this call has finished with
    (frames and bytes between), unchanged, to be forwarded in whole frames. A frame of unknown id in
    a stream is returned once the header of the next one has arrived.
    """

    def __init__(self, link: int = 0, counts: FrameCounts | None = None) -> None:
        self.link = link
        self.counts = FrameCounts() if counts is None else counts
        self.passed = b""
        self._rest = b""
        self._expected = 0  # where in `_rest` a frame should begin
        self._cleared = 0  # before which place in `_rest` no good frame begins

    @property
    def waiting(self) -> int:
        """Return the number of buffered bytes of an unfinished frame."""
        return len(self._rest)

    def feed_datagram(self, data: bytes, stamp_us: int) -> list[Frame]:
        """Return the frames of one datagram, received at `stamp_us` of the ground's clock, µs.

        It begins a new frame, unless it can only continue an unfinished one: a frame cut short in
        the datagram before must not delay a good one in this.
        """
        if not self._rest and (frame := frame_of(data, stamp_us=stamp_us, link=self.link)):
            # As almost every datagram: nothing to search, and nothing left over.
            counts = self.counts
            counts.bytes += len(data)
            counts.frames += 1
            counts.unknown += not frame.verified
            self.passed, self._expected, self._cleared = data, 0, 0
            return [frame]
        if self._rest and data and data[0] in (V1, V2):
            verdict, _ = examine(data + bytes(HEADER_PADDING), 0, len(data), closed=True)
            if verdict in (FrameKind.GOOD, FrameKind.UNVERIFIED):
                self.counts.bytes_skipped += len(self._rest)
                self._rest, self._expected, self._cleared = b"", 0, 0
        return self.feed(data, stamp_us, closed=True)

    def feed(self, data: bytes, stamp_us: int, *, closed: bool = False) -> list[Frame]:
        """Return the frames completed by the next bytes of a stream (TCP, serial), and add to the
        counts of the link.

        `stamp_us` is their arrival by the ground's clock, µs. The bytes passed by are in `passed`;
        an unfinished frame waits for the next call. `closed`: the bytes after these begin a new
        frame, so that an unfinished one will never be completed.
        """
        counts, link = self.counts, self.link
        counts.bytes += len(data)
        buffer = self._rest + data
        size = len(buffer)
        frames: list[Frame] = []
        kept = 0
        walk = Walk(0, self._expected, self._cleared)
        padded = buffer + bytes(HEADER_PADDING)
        for verdict, start, head in walk.frames(padded, size, size, closed=closed, wait=True):
            if verdict is FrameKind.BAD_CHECKSUM:
                counts.bad_checksum += 1
                continue
            end = start + head.length
            frames.append(build_frame(buffer[start:end], verdict, head, stamp_us, link))
            kept += head.length
            counts.unknown += verdict is FrameKind.UNVERIFIED
        counts.frames += len(frames)
        counts.bytes_skipped += walk.position - kept
        self.passed, self._rest = buffer[: walk.position], buffer[walk.position :]
        self._expected = walk.expected - walk.position
        # Where the bytes were closed, frames that were cut short are not looked for behind them.
        self._cleared = 0 if closed else max(walk.cleared.end - walk.position, 0)
        return frames


def fields(frame: Frame) -> NDArray[np.void] | None:
    """Return the fields of a frame as a structured array (1,) in wire units.

    None for a frame of unknown id, or that is not verified.
    """
    layout = layouts().get(frame.id)
    if layout is None or not frame.verified:
        return None
    kind = layout.dtype
    return np.frombuffer(frame.payload.ljust(kind.itemsize, b"\0"), kind)


Bytes = NDArray[np.uint8]
Words = NDArray[np.uint16]


def _table(bits: int) -> Words:
    """Return the CRC register after `bits` more bits, by the XOR of its low bits with them."""
    register = np.arange(1 << bits, dtype=np.uint32)
    for _ in range(bits):
        register = (register >> 1) ^ np.where(register & 1, np.uint32(0x8408), np.uint32(0))
    return register.astype(np.uint16)


_PAIR, _SINGLE = _table(16), _table(8)


def checksum(covered: bytes, extra: int) -> int:
    """Return the checksum of one frame's bytes after the magic byte, followed by its `extra`
    byte.
    """
    return crc16.mcrf4xx(bytes((extra,)), crc16.mcrf4xx(covered))


def checksum_rows(rows: Bytes, extra: Bytes) -> Words:
    """Return the checksums (n,) of n frames with an equal number L of covered bytes, `rows` (n, L).

    `extra` (n,) is each message's CRC_EXTRA byte, which is added at the end and ties the checksum
    to the field layout.
    """
    count, length = rows.shape
    register = np.full(count, 0xFFFF, dtype=np.uint16)
    if length >= 2:
        # Transposed so that each step reads one contiguous run of words.
        pairs = np.ascontiguousarray(np.ascontiguousarray(rows[:, : length // 2 * 2]).view("<u2").T)
        for pair in pairs:
            register = _PAIR.take(register ^ pair)
    singles = (rows[:, -1], extra) if length % 2 else (extra,)
    for single in singles:
        low = (register ^ single).astype(np.uint8)
        register = np.right_shift(register, 8, dtype=np.uint16) ^ _SINGLE[low]
    return register
