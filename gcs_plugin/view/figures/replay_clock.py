"""A replay's clock: from the wall clock to a time in the flight."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

SPEEDS = (1, 2, 5, 10, 30, 60)


class ReplayClock:
    """Runs from 0 to `duration` s at `speed` times real time; at the end it rests at `rest`.

    `ended` is True from then until somebody plays or seeks.
    """

    def __init__(
        self,
        duration: float,
        *,
        speed: float = 1.0,
        paused: bool = False,
        rest: float | None = None,
        wall: Callable[[], float] = time.monotonic,
    ) -> None:
        self.duration = duration
        self._wall = wall
        self._lock = threading.Lock()
        self._time_s = 0.0
        self._since = wall()
        self._speed = speed
        self._playing = not paused
        self._rest = duration if rest is None else rest
        self._ended = False

    @property
    def speed(self) -> float:
        return self._speed

    @property
    def playing(self) -> bool:
        """True while time passes; False when paused and at the end."""
        with self._at_now():
            return self._playing

    @property
    def ended(self) -> bool:
        with self._at_now():
            return self._ended

    def now(self) -> float:
        """Seconds into the flight."""
        with self._at_now():
            return self._time_s

    def play(self) -> None:
        """Go on; from the start when at the end."""
        with self._at_now():
            if self._ended or self._time_s >= self.duration:
                self._time_s = 0.0
            self._playing, self._ended = True, False

    def pause(self) -> None:
        with self._at_now():
            self._playing = False

    def seek(self, time_s: float) -> None:
        """Go to a time; outside the flight to its nearest end. NaN is ignored."""
        if math.isnan(time_s):
            return
        with self._at_now():
            self._time_s, self._ended = min(max(time_s, 0.0), self.duration), False

    def set_speed(self, speed: float) -> None:
        with self._at_now():
            self._speed = speed

    @contextmanager
    def _at_now(self) -> Iterator[None]:
        """The clock as it stands now, for one thread at a time."""
        with self._lock:
            wall = self._wall()
            if self._playing:
                self._time_s += (wall - self._since) * self._speed
                if self._time_s >= self.duration:
                    self._time_s, self._playing, self._ended = self._rest, False, True
            self._since = wall
            yield
