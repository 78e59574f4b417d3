"""MAVLink's CRC-16/MCRF4XX of one frame, and over many frames at once.

The polynomial is the reflected 0x1021 with start value 0xFFFF, as https://mavlink.io/en/guide/
serialization.html defines it. A 16-bit register forgets its whole past within 16 bits, so one
table of 65536 entries takes two bytes a step.
"""

from __future__ import annotations

import numpy as np
from fastcrc import crc16
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Words = NDArray[np.uint16]


def _table(bits: int) -> Words:
    """What a register becomes when so many bits go in, by its own last bits and theirs."""
    register = np.arange(1 << bits, dtype=np.uint32)
    for _ in range(bits):
        register = (register >> 1) ^ np.where(register & 1, np.uint32(0x8408), np.uint32(0))
    return register.astype(np.uint16)


_PAIR, _SINGLE = _table(16), _table(8)


def checksum(covered: bytes, extra: int) -> int:
    """The checksum of one frame's bytes after the magic byte, followed by its `extra` byte."""
    return crc16.mcrf4xx(bytes((extra,)), crc16.mcrf4xx(covered))


def checksum_rows(rows: Bytes, extra: Bytes) -> Words:
    """(n,) checksums of the rows (n, L) of equal length, each followed by its `extra` byte (n,).

    The extra byte is the message's CRC_EXTRA, which ties the checksum to the field layout.
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
