"""Play a telemetry log onto a link: every frame unchanged, in order, at the log's own rate."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from thrustmargin.gcs_plugin.link.transport import Transport
from thrustmargin.gcs_plugin.mavlink.scan import stamped_frames

#: A pause in the log is played no longer than this, s: nobody waits for a flight on another day.
LONGEST_PAUSE = 60.0
#: Frames closer together than this are sent in one go: a sleep shorter than it is not kept to.
TICK = 0.002  # s


@dataclass(frozen=True, slots=True)
class Played:
    """The counts of a playback so far."""

    frames: int
    bytes: int
    log_s: float  # of the log's time
    late_s: float  # the furthest that a frame was behind its time


def play(
    path: Path,
    transport: Transport,
    *,
    speed: float = 1.0,
    loop: bool = False,
    progress: Callable[[Played], None] | None = None,
) -> Played:
    """Send every frame of the log `path` over `transport`, `speed` times as fast as recorded.

    Each frame has its time from the start, so that delays do not add up; pauses are cut to
    LONGEST_PAUSE s. With `loop` it starts again at the end, without end. `progress` is called about
    four times a second; return the final counts. Wait first until the transport has a receiver,
    whose answers are ignored. Raise LogError if the log contains no frame.
    """
    stop = threading.Event()

    def ignore_answers() -> None:
        while not stop.is_set():
            transport.receive(0.1)

    answers = threading.Thread(target=ignore_answers, daemon=True)
    answers.start()
    frames = sent = 0
    log_s = late = 0.0
    try:
        while not transport.ready:
            time.sleep(0.02)
        started = last_call = time.monotonic()
        for stamp_us, last_us, data in _in_turn(path, loop=loop):
            # A stamp that steps back (a clock set while recording) costs no time.
            log_s += min(max(stamp_us - last_us, 0) * 1e-6, LONGEST_PAUSE)
            wait_s = started + log_s / speed - time.monotonic()
            if wait_s > TICK:
                time.sleep(wait_s)
            late = max(late, -wait_s)
            transport.send(data)
            frames, sent = frames + 1, sent + len(data)
            if progress is not None and time.monotonic() - last_call > 0.25:
                last_call = time.monotonic()
                progress(Played(frames, sent, log_s, late))
        return Played(frames, sent, log_s, late)
    finally:
        stop.set()
        answers.join()


def _in_turn(path: Path, *, loop: bool) -> Iterator[tuple[int, int, bytes]]:
    """Yield, for each frame of the log: its stamp, the stamp before it (both µs), and its bytes.

    The first frame has its own stamp as the one before. With `loop` repeat for ever, each time as
    from the start.
    """
    for _ in itertools.count() if loop else range(1):
        before: int | None = None
        for stamp_us, data in stamped_frames(path):
            yield stamp_us, stamp_us if before is None else before, data
            before = stamp_us
