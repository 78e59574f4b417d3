"""What sequence numbers and repeated bytes show about the senders of frames.

One watch a sender (system and component id): doubled frames, frames that come late, frames that
are missing, and two vehicles that were given one id.
"""

from __future__ import annotations

from enum import Enum

#: A frame so many numbers behind the last was overtaken on the way; further behind is a restart.
LATE = 32
#: The same bytes under the same number within so many frames of a sender are one frame, doubled.
TWICE_WITHIN = 128
#: Two senders take turns: so many returns to an unbroken count within so many frames.
RETURNS, RETURNS_WITHIN = 12, 128


class Verdict(Enum):
    """What to do with a frame."""

    NEW = "new"
    DOUBLED = "doubled"  # the same frame again, over another link or by the network
    LATE = "late"  # overtaken by newer frames: recorded, but not the vehicle's state any more


class SenderWatch:
    """Follows the sequence numbers of one sender."""

    def __init__(self) -> None:
        self.frames = 0
        self.doubled = 0
        self.late = 0
        self.missing = 0
        self._last: int | None = None
        self._seen: dict[int, tuple[bytes, int]] = {}  # number -> its bytes, and when in frames
        # Two counts that frames may continue; one vehicle leaves a count for good after a loss,
        # two vehicles come back to each other's.
        self._tracks: list[int] = []
        self._touched: list[int] = []
        self._running = 0
        self._returns: list[int] = []

    @property
    def shared(self) -> bool:
        """True while two vehicles send under this id."""
        recent = [at for at in self._returns if self.frames - at < RETURNS_WITHIN]
        self._returns = recent
        return len(recent) >= RETURNS

    def look(self, sequence: int, data: bytes) -> Verdict:
        """Count one frame and say what it is."""
        before = self._seen.get(sequence)
        if before is not None and before[0] == data and self.frames - before[1] < TWICE_WITHIN:
            self.doubled += 1
            return Verdict.DOUBLED
        self.frames += 1
        self._seen[sequence] = (data, self.frames)
        self._follow(sequence)
        last, self._last = self._last, sequence
        if last is None or self.shared:
            return Verdict.NEW
        step = (sequence - last) % 256
        if step >= 256 - LATE:
            self.late += 1
            self.missing = max(self.missing - 1, 0)
            self._last = last
            return Verdict.LATE
        if step < 128:
            self.missing += step - 1
        return Verdict.NEW

    def _follow(self, sequence: int) -> None:
        for number, track in enumerate(self._tracks):
            if sequence == (track + 1) % 256:
                if number != self._running and self._touched[number] < 0:
                    self._returns.append(self.frames)
                # Below zero: this count has gone on, and is not just a first frame.
                self._touched[number] = -self.frames
                self._tracks[number] = sequence
                self._running = number
                return
        if len(self._tracks) < 2:
            self._tracks.append(sequence)
            self._touched.append(self.frames)
            return
        older = 0 if abs(self._touched[0]) < abs(self._touched[1]) else 1
        self._tracks[older], self._touched[older] = sequence, self.frames
