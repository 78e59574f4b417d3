"""MAVLink frames out of a stream of bytes, as they arrive; `mavlink.frame` has the rule."""

from __future__ import annotations

from dataclasses import dataclass

from thrustmargin.gcs_plugin.mavlink.frame import (
    HEADER_PADDING,
    V1,
    V2,
    Frame,
    FrameKind,
    Walk,
    examine,
    frame_of,
    made,
)

_PADDING = bytes(HEADER_PADDING)


@dataclass(slots=True)
class FrameCounts:
    """What became of the bytes of one link."""

    bytes: int = 0
    frames: int = 0
    unknown: int = 0  # among `frames`: of an id that is not known, unchecked
    bad_checksum: int = 0  # whole frames whose checksum is wrong
    bytes_skipped: int = 0  # bytes that belong to no frame kept


class FrameSplitter:
    """Cuts the bytes of one sender into frames; keeps an unfinished frame for the next call.

    `feed` returns frames in order; `passed` then holds every byte that this call is done with
    (frames and what lies between), unchanged, for passing on in whole frames. A frame of unknown
    id in a stream is given when the header of the next one has come.
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
        """Bytes kept of a frame that is not whole yet."""
        return len(self._rest)

    def feed_datagram(self, data: bytes, stamp_us: int) -> list[Frame]:
        """The same for one datagram, which starts a new frame unless it can only be a sequel.

        A frame cut short in the datagram before must not hold back a good one in this.
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
            verdict, _ = examine(data + _PADDING, 0, len(data), closed=True)
            if verdict in (FrameKind.GOOD, FrameKind.UNVERIFIED):
                self.counts.bytes_skipped += len(self._rest)
                self._rest, self._expected, self._cleared = b"", 0, 0
        return self.feed(data, stamp_us, closed=True)

    def feed(self, data: bytes, stamp_us: int, *, closed: bool = False) -> list[Frame]:
        """Frames that are whole with these bytes of a stream (TCP, serial).

        `closed`: the next bytes begin a new frame.
        """
        counts, link = self.counts, self.link
        counts.bytes += len(data)
        buffer = self._rest + data
        size = len(buffer)
        frames: list[Frame] = []
        kept = 0
        walk = Walk(0, self._expected, self._cleared)
        padded = buffer + _PADDING
        for verdict, at, head in walk.over(padded, size, size, closed=closed, wait=True):
            if verdict is FrameKind.BAD_CHECKSUM:
                counts.bad_checksum += 1
                continue
            end = at + head.length
            frames.append(made(buffer[at:end], verdict, head, stamp_us, link))
            kept += head.length
            counts.unknown += verdict is FrameKind.UNVERIFIED
        counts.frames += len(frames)
        counts.bytes_skipped += walk.at - kept
        self.passed, self._rest = buffer[: walk.at], buffer[walk.at :]
        self._expected = walk.expected - walk.at
        # Where the bytes were closed, frames that were cut short are not looked for behind them.
        self._cleared = 0 if closed else max(walk.cleared.to - walk.at, 0)
        return frames
