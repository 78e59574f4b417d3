"""Find every frame of a telemetry log, and return messages of a type as columns.

A .tlog is a sequence of frames, each after eight bytes of big-endian Unix microseconds. Frames of
known id and good checksum are found all at once. The bytes between are then searched for frames of
unknown id, frames with a wrong checksum, and damage. `mavlink.frame` defines both.

Stamps of a recording are corrected where its computer's clock was set. A listener stamps by a clock
that nobody sets; other programs write the computer's own. There a jump of an hour looks like a
pause of an hour, and a jump back like a recording out of order. The vehicle's clock shows the true
interval.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.mavlink.frame import (
    HEADER_PADDING,
    V1,
    V2,
    Bytes,
    FrameKind,
    Walk,
    checksum_rows,
    header,
)
from thrustmargin.gcs_plugin.mavlink.layouts import Layout, layout_table, layouts, message_ids
from thrustmargin.models.errors import LogError
from thrustmargin.models.flight import Bools, Floats

Index = NDArray[np.int64]

#: ATTITUDE, ATTITUDE_QUATERNION, LOCAL_POSITION_NED, GLOBAL_POSITION_INT: begin with time_boot_ms.
BOOT_CLOCKS = (30, 31, 32, 33)

STAMP = 8  # bytes of time before each frame
#: Bytes appended to the file's own so that a gather near the end stays inside the buffer.
PADDING = 512
_CHUNK = 1 << 21
_AHEAD = 1024
_ROWS = 1 << 13  # checksummed at once: keeps the working set in the processor's cache


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Frames:
    """The frames of known id and good checksum, in file order, and the byte ranges between them."""

    data: Bytes  # the file followed by PADDING zeros
    start: Index  # (n,) offset of the magic byte
    id: NDArray[np.uint16]  # (n,)
    length: NDArray[np.uint16]  # (n,) bytes of the whole frame
    sequence: Bytes  # (n,) numbers; and the ids of who sends
    system: Bytes
    component: Bytes
    skipped: tuple[tuple[int, int], ...]  # (offset, length) of stretches with no frame kept
    bad_checksum: int
    unverified: tuple[tuple[int, int], ...]  # (offset of the magic byte, unknown id)

    @property
    def unknown_ids(self) -> dict[int, int]:
        """Return the number of frames of each unknown id."""
        return dict(Counter(number for _, number in self.unverified))

    def select(self, kept: Bools) -> Frames:
        """Return only the frames flagged in `kept` (n,)."""
        names = ("start", "id", "length", "sequence", "system", "component")
        return replace(self, **{name: getattr(self, name)[kept] for name in names})

    def unstamped(self) -> bool:
        """Return True if most frames begin right where the one before ends, without room for a
        stamp.
        """
        if self.start.size < 2:
            return False
        room = np.diff(self.start) - self.length[:-1]
        return bool(np.mean(room < STAMP) > 0.5)

    def stamps_s(self) -> NDArray[np.float64]:
        """Return the Unix times (n,), s, written before each frame."""
        return gather(self.data, self.start - STAMP, STAMP).view(">u8").ravel() * 1e-6


def gather(data: Bytes, start: Index, width: int) -> Bytes:
    """Return the `width` bytes from each offset in `start`, as (n, width)."""
    window = np.ndarray((data.size - width + 1,), f"V{width}", data, strides=(1,))
    return window[start].view(np.uint8).reshape(start.size, width)


def columns(frames: Frames, rows: Index, layout: Layout) -> NDArray[np.void]:
    """Return the fields of the frames `rows`, all of `layout`, as a structured array (n,).

    Trailing zeros that MAVLink 2 trims are restored.
    """
    width = layout.dtype.itemsize
    start = frames.start[rows]
    header = np.where(frames.data[start] == V2, 10, 6)
    payload = gather(frames.data, start + header, width)
    length = frames.data[start + 1]
    short = np.flatnonzero(length < width)
    if short.size:
        payload[short] *= np.arange(width) < length[short, None]
    return payload.view(layout.dtype).reshape(rows.size)


def named(frames: Frames, name: str, where: Bools | bool = True) -> tuple[Index, NDArray[np.void]]:
    """Return the row numbers (n,) of the messages called `name`, and their fields (n,).

    Only frames flagged in `where` count.
    """
    number = message_ids()[name]
    rows = np.flatnonzero(where & (frames.id == number))
    return rows, columns(frames, rows, layouts()[number])


def read_bytes(path: Path, padding: int = PADDING) -> tuple[Bytes, int]:
    """Read a file; return its bytes followed by `padding` zeros, and its own size.

    It is not memory-mapped: a file that another program truncates must not crash this one.
    """
    size = path.stat().st_size
    data = np.empty(size + padding, dtype=np.uint8)
    with path.open("rb") as file:
        got = file.readinto(data[:size].data)
    data[got:] = 0
    return data, got


def stamped_frames(path: Path) -> Generator[tuple[int, bytes]]:
    """Yield (stamp, Unix µs; bytes) of each frame of a .tlog in file order, unknown ids included.

    Stamps are corrected where the clock was set during recording. Raise LogError if the file has no
    frame.
    """
    data, size = read_bytes(path)
    frames = scan(data, size)
    if not frames.start.size:
        raise LogError(f"{path.name}: no MAVLink frame in it; is it a telemetry log (.tlog)?")
    start = np.concatenate([frames.start, [offset for offset, _ in frames.unverified]]).astype(
        np.int64
    )
    start.sort()
    end = start + header(data, start, layout_table().size).length
    boot_ms, system = np.full(start.size, np.nan), np.zeros(start.size, dtype=np.uint8)
    place = np.searchsorted(start, frames.start)
    system[place] = frames.system
    for number in BOOT_CLOCKS:
        rows, fields = named(frames, layouts()[number].name)
        boot_ms[place[rows]] = fields["time_boot_ms"]
    stamps = gather(data, start - STAMP, STAMP).view(">u8").ravel().astype(np.int64)
    stamps = steadied(stamps, boot_ms, system)
    raw = data.data
    for stamp_us, low, high in zip(stamps.tolist(), start.tolist(), end.tolist(), strict=True):
        yield stamp_us, bytes(raw[low:high])


def scan(data: Bytes, size: int, *, stamp: int = STAMP) -> Frames:
    """Return all frames in the first `size` bytes of `data`, which must be followed by PADDING
    more.

    `stamp` is the number of bytes of a time stamp before each frame: 0 for the bytes of a raw link.
    """
    parts = [_good_in_chunk(data, size, low, stamp) for low in range(0, size, _CHUNK)]
    parts = parts or [_good_in_chunk(data, 0, 0, stamp)]
    start, ids, length = (np.concatenate(one) for one in zip(*parts, strict=True))
    del parts
    end = start + length
    keep = _without_overlap(start, end)
    if keep is not None:
        start, ids, length, end = start[keep], ids[keep], length[keep], end[keep]
    sender = gather(data, start + np.where(data[start] == V2, 4, 2), 3)
    gaps = gaps_between(start, end, size, stamp)
    skipped, bad, unverified = _explain_gaps(data, gaps, size, stamp) if gaps else ([], 0, [])
    who = sender.T  # sequence number, system, component
    lost = tuple(skipped), bad, tuple(unverified)
    return Frames(data, start, ids, length, who[0], who[1], who[2], *lost)


def _good_in_chunk(
    data: Bytes, size: int, low: int, stamp: int
) -> tuple[Index, NDArray[np.uint16], NDArray[np.uint16]]:
    """Return offsets, message ids and lengths (n,) of the frames with a good checksum that begin
    in the chunk at offset `low`. `stamp` is the length of the time stamp before a frame, bytes."""
    part = data[low : min(low + _CHUNK, size)]
    start = np.flatnonzero((part == V1) | (part == V2)).astype(np.int64) + low
    start = start[start >= stamp]
    head = header(data, start, layout_table().size)
    possible = head.possible & (head.largest >= 0) & (start + head.length <= size)
    start, ids = start[possible], head.id[possible].astype(np.uint16)
    good = _checked(data, start, head.covered[possible], layout_table().crc_extra[ids])
    return start[good], ids[good], head.length[possible][good].astype(np.uint16)


def _checked(data: Bytes, start: Index, covered: Index, extra: Bytes) -> NDArray[np.bool_]:
    """Flag frames (n,) whose checksum is correct.

    `start` (n,) are the offsets of their first bytes in `data`; `covered` (n,) how many bytes after
    the first one the checksum covers; `extra` (n,) the CRC_EXTRA of their messages. Frames with
    equal `covered` are computed together.
    """
    good = np.zeros(start.size, dtype=np.bool_)
    order = np.argsort(covered.astype(np.int16), kind="stable")
    edges = np.flatnonzero(np.diff(covered[order])) + 1
    for group in np.split(order, edges):
        if group.size == 0:
            continue
        width = int(covered[group[0]])
        for first in range(0, group.size, _ROWS):
            rows = group[first : first + _ROWS]
            block = gather(data, start[rows] + 1, width + 2)
            stated = block[:, width] | (block[:, width + 1].astype(np.uint16) << 8)
            good[rows] = checksum_rows(block[:, :width], extra[rows]) == stated
    return good


def _without_overlap(start: Index, end: Index) -> NDArray[np.bool_] | None:
    """Return a mask (n,) that drops frames which begin inside another, as chance matches do.

    None if no frames overlap. `start` and `end` (n,) are offsets, ascending.
    """
    clash = start[1:] < end[:-1]
    if not clash.any():
        return None
    keep = np.ones(start.size, dtype=np.bool_)
    last = 0
    for row in range(start.size):
        if start[row] < last:
            keep[row] = False
        else:
            last = int(end[row])
    return keep


def gaps_between(start: Index, end: Index, size: int, stamp: int = 0) -> list[tuple[int, int]]:
    """Return (start, end) offsets of every stretch of a file outside the frames and their stamps.

    Frames are from `start` to `end` (n,), each after `stamp` bytes; the file has `size` bytes.
    """
    edges = np.concatenate([[0], end]), np.concatenate([start - stamp, [size]])
    return [(int(edges[0][i]), int(edges[1][i])) for i in np.flatnonzero(edges[1] > edges[0])]


def _explain_gaps(
    data: Bytes, gaps: list[tuple[int, int]], size: int, stamp: int
) -> tuple[list[tuple[int, int]], int, list[tuple[int, int]]]:
    """Search the `gaps` (start, end) between good frames for frames with unknown id or wrong
    checksum.

    Return the stretches without a frame kept, (offset, length); the count of wrong checksums; and
    (offset, id) of each frame of unknown id. The offset is that of the frame's first byte.
    """
    skipped: list[tuple[int, int]] = []
    unverified: list[tuple[int, int]] = []
    bad = 0
    for low, high in gaps:
        lost_from = low
        # Two of the longest frames may have to be read behind the gap to know what is in it.
        end = min(high + _AHEAD, size)
        raw = data[low : end + HEADER_PADDING].tobytes()
        walk = Walk().frames(raw, high - low, end - low, gap=stamp, closed=True, wait=False)
        for verdict, place, head in walk:
            start = low + place
            if verdict is FrameKind.BAD_CHECKSUM:
                bad += 1
                continue
            unverified.append((start + stamp, head.id))
            if start > lost_from:
                skipped.append((lost_from, start - lost_from))
            lost_from = start + stamp + head.length
        if lost_from < high:
            skipped.append((lost_from, high - lost_from))
    return skipped, bad, unverified


LEAP_US = 2_000_000  # by which stamps may part from the vehicle's clock: a slow link, two links


def steadied(
    stamps_us: NDArray[np.int64], boot_ms: Floats, system: NDArray[np.uint8]
) -> NDArray[np.int64]:
    """Return stamps (n,), µs, corrected where the computer's clock was set during recording.

    `boot_ms` (n,) is the clock since boot, ms, in a message of `system` (n,), NaN without one. A
    step of more than LEAP_US is replaced by the vehicle's time between. Where that is unknown only
    a step back is corrected, to 0.
    """
    steps = np.diff(stamps_us)
    clocked = np.flatnonzero(np.isfinite(boot_ms))
    for row in np.flatnonzero((steps < -LEAP_US) | (steps > LEAP_US)).tolist():
        went = _went_by(stamps_us, boot_ms, system, clocked, row)
        if went is None or went < 0:  # not known, or the vehicle was started again
            steps[row] = max(int(steps[row]), 0)
        elif abs(int(steps[row]) - went) > LEAP_US:
            steps[row] = went
    return stamps_us[:1] + np.concatenate([[0], np.cumsum(steps)])[: stamps_us.size]


def _went_by(
    stamps_us: NDArray[np.int64],
    boot_ms: Floats,
    system: NDArray[np.uint8],
    clocked: NDArray[np.intp],
    row: int,
) -> int | None:
    """Return the time, µs, from row `row` to the next by the clock of a vehicle; None if unknown.

    `boot_ms` (n,), ms, is the clock since boot in a message of `system` (n,); `clocked` are its
    rows that are not NaN, ascending. The vehicle of the last such row up to `row` must be received
    after it.
    """
    place = int(np.searchsorted(clocked, row, side="right"))
    if place == 0:
        return None
    before = int(clocked[place - 1])
    later = clocked[place:]
    repeated = later[system[later] == system[before]]
    if not repeated.size:
        return None
    after = int(repeated[0])
    around = (stamps_us[row] - stamps_us[before]) + (stamps_us[after] - stamps_us[row + 1])
    return round(1000.0 * (boot_ms[after] - boot_ms[before])) - int(around)
