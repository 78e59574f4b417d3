"""Watch the link of one vehicle: who sends under its id, since when it is silent, which rotors are.

`LinkWatch` follows the frames of one system id, before they are decoded. `RotorSilence` follows the
rows made of them. Neither has a clock of its own.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.link.sequence import SenderWatch, Verdict
from thrustmargin.gcs_plugin.live.watch.update import GONE, SHARED_HOLD
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.gcs_plugin.mavlink.scan import BOOT_CLOCKS
from thrustmargin.models.flight import Floats


class LinkWatch:
    """Link state of one system id: duplicate frames, two vehicles with one id, and silence.

    Times are the ground's clock, µs. `heard_us` is the listener's, system id -> time of its last
    message; it may be later than the frames taken so far.
    """

    def __init__(self, system: int, heard_us: Mapping[int, int]) -> None:
        self._system, self._heard_us = system, heard_us
        self.senders: dict[int, SenderWatch] = {}  # by component id
        self.first_us = 0  # when it was first heard
        self.back_us = 0  # when it was heard again after GONE s of silence, the last time
        self.shared_since_us = 0
        self.shared_until_us = 0
        self._taken_us = 0  # when the last frame that is no copy came

    @property
    def shared(self) -> bool:
        """Return True if two vehicles send under this id."""
        return self._taken_us < self.shared_until_us

    @property
    def doubled(self) -> int:
        """Return the number of frames dropped as copies from a second link or router."""
        return sum(sender.doubled for sender in list(self.senders.values()))

    @property
    def last_us(self) -> int:
        """Return the ground's clock, µs, at the vehicle's last frame, analysed or not."""
        return max(self._taken_us, self._heard_us.get(self._system, 0))

    def silent(self, now_us: int) -> float:
        """Return the s since the last message was received, processed or not."""
        return max(now_us - self.last_us, 0) * 1e-6

    def take(self, frame: Frame) -> bool:
        """Process the next frame in order of arrival; return False if the caller must drop it.

        It is dropped if it is a copy of a recent frame, or was overtaken by newer ones.
        """
        sender = self.senders.get(frame.component)
        if sender is None:
            sender = self.senders[frame.component] = SenderWatch()
        verdict = sender.look(frame.sequence, frame.data)
        if frame.id in BOOT_CLOCKS and verdict is Verdict.NEW and frame.verified:
            clock_s = int.from_bytes(frame.payload[:4], "little") * 1e-3
            sender.clocked(frame.id, frame.stamp_us * 1e-6, clock_s)
        if sender.shared:
            if not self.shared:
                self.shared_since_us = frame.stamp_us
            self.shared_until_us = frame.stamp_us + int(SHARED_HOLD * 1e6)
        if verdict is not Verdict.NEW:
            return False
        self.first_us = self.first_us or frame.stamp_us
        if frame.stamp_us - self._taken_us > GONE * 1e6:
            self.back_us = frame.stamp_us
        self._taken_us = frame.stamp_us
        return True


class RotorSilence:
    """The time, s, for which rows have come without the speed of each rotor."""

    def __init__(self, rotor_count: int) -> None:
        #: (R,) s at the last row; NaN before any speed came.
        self._unheard_s = np.full(rotor_count, np.nan)

    def add(self, known: NDArray[np.bool_], time_s: Floats, first: int, pause: float) -> Floats:
        """Return the time, s, since each rotor's last speed report, for the rows from `first` on
        (N, R).

        `known` (T, R) marks the reported speeds of the rows at `time_s` (T,), s. NaN before any
        rotor's first report; a rotor that never reported counts from then. A gap between rows
        longer than `pause` s does not count: there the whole link was lost.
        """
        known = known[first:]
        if known.shape[1] != self._unheard_s.size:
            self._unheard_s = np.full(known.shape[1], np.nan)
        ever = np.logical_or.accumulate(known.any(axis=1)) | np.isfinite(self._unheard_s).any()
        steps = np.diff(time_s, prepend=time_s[:1])[first:]
        steps = np.where(steps > pause, 0.0, steps)
        passed = np.where(ever, np.cumsum(steps), 0.0)[:, None]
        # A rotor that never reported a speed is missed as soon as another has.
        start = np.where(np.isfinite(self._unheard_s), -self._unheard_s, passed[np.argmax(ever)])
        heard = np.maximum.accumulate(np.where(known, passed, start), axis=0)
        unheard = np.where(ever[:, None], np.maximum(passed - heard, 0.0), np.nan)
        self._unheard_s = unheard[-1]
        return unheard
