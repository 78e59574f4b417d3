"""Find every whole MAVLink frame in a telemetry log, and gather one message type as columns.

A .tlog is a row of frames, each after eight bytes of big-endian Unix microseconds. Every byte that
looks like the start of a frame of known id and possible length is tried against its checksum, so
damage costs only the frames it touches; what lies between good frames is then explained as frames
of unknown id, frames with a wrong checksum, or plain damage.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.mavlink.checksum import Bytes, checksum_rows
from thrustmargin.gcs_plugin.mavlink.layouts import ID_LIMIT, Layout, layout_table

Index = NDArray[np.int64]

STAMP = 8  # bytes of time before each frame
V1, V2 = 0xFE, 0xFD
#: Bytes appended to the file's own so that a gather near the end stays inside the buffer.
PADDING = 512
_CHUNK = 1 << 21
_ROWS = 1 << 13  # checksummed at once: keeps the working set in the processor's cache


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Whole frames of known id and good checksum, in file order."""

    data: Bytes  # the file followed by PADDING zeros
    start: Index  # (n,) offset of the magic byte
    id: NDArray[np.uint16]  # (n,)
    skipped: tuple[tuple[int, int], ...]  # (offset, length) of stretches with no frame kept
    bad_checksum: int
    unknown_ids: dict[int, int]

    def byte(self, version1: int, version2: int, rows: Index | slice = slice(None)) -> Bytes:
        """(n,) one byte of the frames' headers: its offset in MAVLink 1 and in MAVLink 2."""
        start = self.start[rows]
        return self.data[start + np.where(self.data[start] == V2, version2, version1)]

    def unstamped(self) -> bool:
        """True when most frames begin where the one before ends, with no room for a stamp."""
        if self.start.size < 2:
            return False
        room = self.start[1:] - _ends(self.data, self.start[:-1])
        return bool(np.mean(room < STAMP) > 0.5)

    def systems(self) -> Bytes:
        """(n,) system id of each frame."""
        return self.byte(3, 5)

    def components(self) -> Bytes:
        """(n,) component id of each frame."""
        return self.byte(4, 6)

    def sequences(self) -> Bytes:
        """(n,) sequence number of each frame."""
        return self.byte(2, 4)

    def stamps_s(self) -> NDArray[np.float64]:
        """(n,) Unix seconds written before each frame."""
        return gather(self.data, self.start - STAMP, STAMP).view(">u8").ravel() * 1e-6


def gather(data: Bytes, at: Index, width: int) -> Bytes:
    """(n, width) bytes from each offset in `at`."""
    window = np.ndarray((data.size - width + 1,), f"V{width}", data, strides=(1,))
    return window[at].view(np.uint8).reshape(at.size, width)


def columns(frames: Frames, rows: Index, layout: Layout) -> NDArray[np.void]:
    """(n,) structured array of the frames `rows`, all of `layout`; trimmed zeros are put back."""
    width = layout.dtype.itemsize
    start = frames.start[rows]
    header = np.where(frames.data[start] == V2, 10, 6)
    payload = gather(frames.data, start + header, width)
    length = frames.data[start + 1]
    short = np.flatnonzero(length < width)
    if short.size:
        payload[short] *= np.arange(width) < length[short, None]
    return payload.view(layout.dtype).reshape(rows.size)


def scan(data: Bytes, size: int) -> Frames:
    """All frames in the first `size` bytes of `data`, which ends with PADDING more."""
    parts = [_good_in_chunk(data, size, low) for low in range(0, size, _CHUNK)]
    start = np.concatenate([p[0] for p in parts]) if parts else np.empty(0, np.int64)
    ids = np.concatenate([p[1] for p in parts]) if parts else np.empty(0, np.uint16)
    del parts
    end = _ends(data, start)
    keep = _without_overlap(start, end)
    if keep is not None:
        start, ids, end = start[keep], ids[keep], end[keep]
    skipped, bad, unknown = _explain_gaps(data, _gaps(start, end, size))
    return Frames(data, start, ids, tuple(skipped), bad, dict(unknown))


def _ends(data: Bytes, start: Index) -> Index:
    """(n,) offset behind each frame: header, payload, checksum, and signature where it has one."""
    version2 = data[start] == V2
    signed = version2 & ((data[start + 2] & 1) == 1)
    return start + np.where(version2, 12, 8) + data[start + 1] + 13 * signed


def _good_in_chunk(data: Bytes, size: int, low: int) -> tuple[Index, NDArray[np.uint16]]:
    table = layout_table()
    part = data[low : min(low + _CHUNK, size)]
    start = np.flatnonzero((part == V1) | (part == V2)).astype(np.int64) + low
    start = start[start >= STAMP]
    version2 = data[start] == V2
    length = data[start + 1]
    ids = data[start + np.where(version2, 7, 5)].astype(np.int32)
    ids += np.where(version2, data[start + 8].astype(np.int32) << 8, 0)
    ids += np.where(version2, data[start + 9].astype(np.int32) << 16, 0)
    size_of = table.size[np.minimum(ids, ID_LIMIT - 1)]
    possible = (ids < ID_LIMIT) & (length.astype(np.int16) <= size_of)
    possible &= ~version2 | (data[start + 2] <= 1)
    possible &= _ends(data, start) <= size
    start, ids = start[possible], ids[possible]
    good = _checked(data, start, length[possible], version2[possible], table.crc_extra[ids])
    return start[good], ids[good].astype(np.uint16)


def _checked(
    data: Bytes, start: Index, length: Bytes, version2: NDArray[np.bool_], extra: Bytes
) -> NDArray[np.bool_]:
    """(n,) True where the checksum agrees. Frames are taken together by equal length."""
    good = np.zeros(start.size, dtype=np.bool_)
    covered = length.astype(np.int16) + np.where(version2, 9, 5)
    order = np.argsort(covered, kind="stable")
    edges = np.flatnonzero(np.diff(covered[order])) + 1
    for group in np.split(order, edges):
        if group.size == 0:
            continue
        width = int(covered[group[0]])
        for at in range(0, group.size, _ROWS):
            rows = group[at : at + _ROWS]
            block = gather(data, start[rows] + 1, width + 2)
            told = block[:, width] | (block[:, width + 1].astype(np.uint16) << 8)
            good[rows] = checksum_rows(block[:, :width], extra[rows]) == told
    return good


def _without_overlap(start: Index, end: Index) -> NDArray[np.bool_] | None:
    """Mask that drops a frame found inside another (a chance match); None when there is none."""
    clash = start[1:] < end[:-1]
    if not clash.any():
        return None
    keep = np.ones(start.size, dtype=np.bool_)
    last = -1
    for row in range(start.size):
        if start[row] < last:
            keep[row] = False
        else:
            last = int(end[row])
    return keep


def _gaps(start: Index, end: Index, size: int) -> list[tuple[int, int]]:
    """(from, to) of every stretch outside the frames and their stamps."""
    if start.size == 0:
        return [(0, size)] if size else []
    gaps = [(0, int(start[0]) - STAMP)]
    between = np.flatnonzero(start[1:] - STAMP > end[:-1])
    gaps += [(int(end[i]), int(start[i + 1]) - STAMP) for i in between]
    gaps.append((int(end[-1]), size))
    return [(low, high) for low, high in gaps if high > low]


def _explain_gaps(
    data: Bytes, gaps: list[tuple[int, int]]
) -> tuple[list[tuple[int, int]], int, Counter[int]]:
    """What lies between good frames: (offset, length) skipped, bad checksums, unknown ids."""
    skipped: list[tuple[int, int]] = []
    unknown: Counter[int] = Counter()
    bad = 0
    for low, high in gaps:
        lost_from = low
        for begin, finish, number in _walk(data, low, high):
            if number is None:
                bad += 1
                continue
            unknown[number] += 1
            if begin > lost_from:
                skipped.append((lost_from, begin - lost_from))
            lost_from = finish
        if lost_from < high:
            skipped.append((lost_from, high - lost_from))
    return skipped, bad, unknown


def _walk(data: Bytes, low: int, high: int) -> Iterator[tuple[int, int, int | None]]:
    """Frames that chain from `low`: (begin, end, unknown id or None for a wrong checksum)."""
    table = layout_table()
    at = low
    while at + STAMP + 8 <= high:
        magic = int(data[at + STAMP])
        if magic not in (V1, V2):
            return
        head = at + STAMP
        length = int(data[head + 1])
        if magic == V2:
            number = int(data[head + 7]) | int(data[head + 8]) << 8 | int(data[head + 9]) << 16
            finish = head + 12 + length + 13 * (int(data[head + 2]) & 1)
        else:
            number = int(data[head + 5])
            finish = head + 8 + length
        if finish > high:
            return
        known = number < ID_LIMIT and table.size[number] >= 0
        yield at, finish, None if known else number
        at = finish
