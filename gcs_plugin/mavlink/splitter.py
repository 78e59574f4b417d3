"""MAVLink frames out of a stream of bytes, as they arrive.

A frame counts when its checksum agrees; after damage the search goes on one byte further, so that
damage costs only the frames it touches. A frame of an id that no dialect here knows cannot be
checked: it is kept, marked as unverified, when the next frame begins where it ends.
Field layouts and CRC_EXTRA are those of `mavlink.layouts`, the same as for files.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from fastcrc import crc16
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.mavlink.layouts import layouts

V1, V2 = 0xFE, 0xFD
SIGNED = 0x01  # the one incompatibility flag that MAVLink 2 defines
SIGNATURE = 13  # bytes: link id, 48-bit timestamp, 48-bit digest
LONGEST = 12 + 255 + SIGNATURE


class Frame(NamedTuple):
    """One frame as it was sent, and when and over which link it came."""

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
        """The payload as sent; MAVLink 2 trims its trailing zeros."""
        start = 10 if self.data[0] == V2 else 6
        return self.data[start : start + self.data[1]]


@dataclass(slots=True)
class FrameCounts:
    """What became of the bytes of one link."""

    bytes: int = 0
    frames: int = 0
    unknown: int = 0  # among `frames`: of an id that is not known, unchecked
    bad_checksum: int = 0  # whole frames whose checksum is wrong
    bytes_skipped: int = 0  # bytes that belong to no frame kept


@cache
def _checks() -> dict[int, tuple[int, bytes]]:
    """Message id -> longest payload and CRC_EXTRA as a byte."""
    return {n: (known.dtype.itemsize, bytes([known.crc_extra])) for n, known in layouts().items()}


class FrameSplitter:
    """Cuts the bytes of one sender into frames; keeps an unfinished frame for the next call.

    `feed` returns frames in order; `passed` then holds every byte that this call is done with
    (frames and what lies between), unchanged, for passing on in whole frames.
    """

    def __init__(self, link: int = 0, counts: FrameCounts | None = None) -> None:
        self.link = link
        self.counts = FrameCounts() if counts is None else counts
        self.passed = b""
        self._rest = b""

    @property
    def waiting(self) -> int:
        """Bytes kept of a frame that is not whole yet."""
        return len(self._rest)

    def feed(self, data: bytes, stamp_us: int) -> list[Frame]:
        """Frames that are whole with these bytes of a stream (TCP, serial)."""
        self.counts.bytes += len(data)
        return self._split(self._rest + data, stamp_us)

    def feed_datagram(self, data: bytes, stamp_us: int) -> list[Frame]:
        """The same for one datagram, which starts a new frame unless it can only be a sequel.

        A frame cut short in the datagram before must not hold back a good one in this.
        """
        self.counts.bytes += len(data)
        if self._rest and data and data[0] in (V1, V2):
            verdict, _, _ = frame_at(data, 0)
            if isinstance(verdict, Frame):
                self.counts.bytes_skipped += len(self._rest)
                self._rest = b""
        return self._split(self._rest + data, stamp_us)

    def _split(self, buffer: bytes, stamp_us: int) -> list[Frame]:
        frames: list[Frame] = []
        counts = self.counts
        at = 0
        boundary = True  # the byte before `at` ended a frame or the data: a chained start
        while at < len(buffer):
            if buffer[at] not in (V1, V2):
                found = [f for m in (b"\xfd", b"\xfe") if (f := buffer.find(m, at)) >= 0]
                following = min(found, default=len(buffer))
                counts.bytes_skipped += following - at
                at, boundary = following, False
                continue
            verdict, length, whole = frame_at(buffer, at, stamp_us=stamp_us, link=self.link)
            if verdict is None:
                break
            if isinstance(verdict, Frame):
                frames.append(verdict)
                counts.frames += 1
                counts.unknown += not verdict.verified
                at, boundary = at + length, True
                continue
            if boundary and whole:
                counts.bad_checksum += 1
            counts.bytes_skipped += 1
            at, boundary = at + 1, False
        self.passed, self._rest = buffer[:at], buffer[at:]
        return frames


def frame_at(
    buffer: bytes, at: int, *, stamp_us: int = 0, link: int = 0, gap: int = 0
) -> tuple[Frame | bool | None, int, bool]:
    """Try the bytes from `at`: (frame, its length, whether its checksum was tried).

    False in place of the frame: none begins here. None: there are too few bytes to tell.
    `gap` is how many bytes lie between two frames (the time stamps of a .tlog).
    """
    there = len(buffer) - at
    if there < 3:
        return None, 0, False
    magic, size = buffer[at], buffer[at + 1]
    signed = False
    if magic == V2:
        if buffer[at + 2] & ~SIGNED:
            return False, 0, False
        signed = bool(buffer[at + 2] & SIGNED)
        header = 10
    elif magic == V1:
        header = 6
    else:
        return False, 0, False
    if there < header:
        return None, 0, False
    if magic == V2:
        number = int.from_bytes(buffer[at + 7 : at + 10], "little")
        sequence, system, component = buffer[at + 4 : at + 7]
    else:
        sequence, system, component, number = buffer[at + 2 : at + 6]
    check = _checks().get(number)
    if check is not None and size > check[0]:
        return False, 0, False
    length = header + size + 2 + SIGNATURE * signed
    if there < length:
        return None, 0, False
    if check is None:
        after = at + length + gap
        if after < len(buffer) and buffer[after] not in (V1, V2):
            return False, 0, True
    else:
        end = at + header + size
        told = buffer[end] | buffer[end + 1] << 8
        if crc16.mcrf4xx(check[1], crc16.mcrf4xx(buffer[at + 1 : end])) != told:
            return False, 0, True
    data = buffer[at : at + length]
    return (
        Frame(data, number, system, component, sequence, check is not None, stamp_us, link),
        length,
        True,
    )


def fields(frame: Frame) -> NDArray[np.void] | None:
    """(1,) structured array of the frame's fields in wire units; None for an unknown id."""
    layout = layouts().get(frame.id)
    if layout is None or not frame.verified:
        return None
    return np.frombuffer(frame.payload.ljust(layout.dtype.itemsize, b"\0"), dtype=layout.dtype)
