"""Play a telemetry log onto a link: every frame unchanged, in order, at the log's own rate."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable
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
    """What has been sent."""

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
    """Send every frame of the log `speed` times as fast as it was recorded.

    Each frame has its time from the start, so that delays do not add up. With `loop` it starts
    again at the end, without end. `progress` is called about four times a second. Waits
    first until the transport has somebody to send to; what they answer is received and ignored.
    Raises LogError when the log holds no frame.
    """
    stop = threading.Event()
    answers = threading.Thread(target=_ignore_answers, args=(transport, stop), daemon=True)
    answers.start()
    try:
        while not transport.ready:
            time.sleep(0.02)
        return _play(path, transport, speed, loop, progress)
    finally:
        stop.set()
        answers.join()


def _ignore_answers(transport: Transport, stop: threading.Event) -> None:
    while not stop.is_set():
        transport.receive(0.1)


def _play(
    path: Path,
    transport: Transport,
    speed: float,
    loop: bool,
    progress: Callable[[Played], None] | None,
) -> Played:
    started = time.monotonic()
    due = 0.0  # s of playing
    frames = sent = 0
    log_s = late = 0.0
    last_call = started
    for _ in itertools.count() if loop else range(1):
        last_us: int | None = None
        for stamp_us, data in stamped_frames(path):
            # A stamp that steps back (a clock set while recording) costs no time.
            step = 0.0 if last_us is None else max(stamp_us - last_us, 0) * 1e-6
            last_us = stamp_us
            step = min(step, LONGEST_PAUSE)
            log_s += step
            due += step / speed
            ahead = started + due - time.monotonic()
            if ahead > TICK:
                time.sleep(ahead)
            late = max(late, -ahead)
            transport.send(data)
            frames, sent = frames + 1, sent + len(data)
            if progress is not None and time.monotonic() - last_call > 0.25:
                last_call = time.monotonic()
                progress(Played(frames, sent, log_s, late))
    return Played(frames, sent, log_s, late)
