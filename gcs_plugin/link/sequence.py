"""Detect copied, late and missing frames, and two vehicles with one id, from sequence numbers and
clocks.

One watch follows each sender (system and component id).
"""

from __future__ import annotations

from enum import Enum

#: Sequence numbers behind the last one, up to which a frame is late; further behind is a restart.
LATE = 32
#: Frames of a sender within which equal bytes with an equal number are a copy of one frame.
TWICE_WITHIN = 128
#: Returns to an unbroken count, within a number of frames, that show two alternating senders.
RETURNS, RETURNS_WITHIN = 12, 128
#: A link that drops messages breaks every count, so boot clocks are compared too: boot times that
#: differ by less than SAME_CLOCK s, link delays included, are equal; CLOCKED messages confirm one.
SAME_CLOCK, CLOCKED = 2.0, 3
#: A clock that never returns is a restart; one that returns so often within s is another vehicle.
CLOCK_RETURNS, CLOCK_RETURNS_WITHIN = 2, 60.0
#: Consecutive messages that each change the clock: two vehicles at one rate, not a late message.
TURNS = 8


class BootClocks:
    """Boot times that one message type of a sender implies: one, or those of two vehicles
    alternately."""

    def __init__(self) -> None:
        # (s of the ground's clock at its boot, messages), the one that was heard last at the end.
        self._lines: list[tuple[float, int]] = []
        self._run, self._left = 0, 0  # messages on end of that one, and of the other before
        self._turns = 0  # messages on end that each changed it
        self._returns: list[float] = []

    def add(self, stamp_s: float, clock_s: float) -> None:
        """Add one message: the ground's clock at its arrival and the sender's clock in it, s.

        The latter counts from the sender's boot.
        """
        booted = stamp_s - clock_s
        same = [
            n for n, (line_s, _) in enumerate(self._lines) if abs(booted - line_s) <= SAME_CLOCK
        ]
        if not same:
            self._lines, self._left, self._run = [*self._lines[-1:], (booted, 1)], self._run, 1
            return
        count = self._lines.pop(same[-1])[1] + 1
        if same[-1] == len(self._lines):
            self._run, self._turns = self._run + 1, 0
        else:
            self._left, self._run, self._turns = self._run, 1, self._turns + 1
        # A single message with the other clock is only late.
        back = (self._run == 2 and self._left > 1) or self._turns >= TURNS
        if back and min(count, self._lines[-1][1]) > CLOCKED:
            self._returns.append(stamp_s)
        self._lines.append((booted, count))

    def shared(self, stamp_s: float) -> bool:
        """Return True if boot times of two vehicles alternated in the 60 s up to `stamp_s`."""
        if not self._returns:
            return False
        recent = [
            return_s for return_s in self._returns if stamp_s - return_s < CLOCK_RETURNS_WITHIN
        ]
        self._returns = recent
        return len(recent) >= CLOCK_RETURNS


class Verdict(Enum):
    """The classification of a frame by its sequence number."""

    NEW = "new"
    DOUBLED = "doubled"  # the same frame again, over another link or by the network
    LATE = "late"  # overtaken by newer frames: recorded, but not the vehicle's state any more


class SenderWatch:
    """A watch of the sequence numbers of one sender."""

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
        self._clocks: dict[int, BootClocks] = {}  # by message, each may count from its own start
        self._by_clocks = False

    @property
    def shared(self) -> bool:
        """Return True if two vehicles currently send under this id."""
        if self._by_clocks or not self._returns:
            return self._by_clocks
        recent = [frame for frame in self._returns if self.frames - frame < RETURNS_WITHIN]
        self._returns = recent
        return len(recent) >= RETURNS

    def clocked(self, message: int, stamp_s: float, clock_s: float) -> None:
        """Record one message's clock since boot, `clock_s`, s, by its id `message`.

        `stamp_s`, s, is its arrival by the ground's clock.
        """
        clocks = self._clocks.setdefault(message, BootClocks())
        clocks.add(stamp_s, clock_s)
        self._by_clocks = any(clock.shared(stamp_s) for clock in self._clocks.values())

    def look(self, sequence: int, data: bytes) -> Verdict:
        """Count one frame; return NEW, DOUBLED (a copy) or LATE (overtaken by newer ones).

        `sequence` is its MAVLink sequence number, 0 to 255, `data` its bytes. Equal bytes within
        the last 128 frames are a copy; a number up to 32 behind the last is late. While two
        vehicles share the id, every frame that is no copy is NEW.
        """
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
