"""Recorded frames sent over UDP no faster than the receiver reads them.

A kernel's buffer holds a tenth of a second of a fast playback: without this a receiver that a busy
machine keeps waiting would lose frames, or hear many at once.
"""

import socket
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.waiting import PATIENCE


def all_read(port: int) -> bool:
    """Return whether nothing waits in the UDP socket bound to `port`; True where Linux is not."""
    table = Path("/proc/net/udp")
    rows = [line.split() for line in table.read_text().splitlines()] if table.exists() else []
    place = f":{port:04X}"
    return all(row[4].endswith(":00000000") for row in rows if row[1].endswith(place))


def send_frames(
    frames: Iterable[tuple[int, bytes]],
    port: int,
    speed: float,
    ended: threading.Event | None = None,
) -> None:
    """Send (µs, frame) in order at most `speed` times as fast as stamped, until `ended`."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        last_us, due = None, time.monotonic()
        give_up = due + 4 * PATIENCE  # the receiver may have died
        for stamp_us, data in frames:
            if ended is not None and ended.is_set():
                return
            if last_us is None:
                last_us = stamp_us
            due += (stamp_us - last_us) * 1e-6 / speed
            if stamp_us - last_us > 10_000:
                while not all_read(port) and time.monotonic() < give_up:
                    time.sleep(0.001)
                # A receiver that was late is not sent the more afterwards.
                due = max(due, time.monotonic() - 0.05)
            last_us = stamp_us
            if (ahead := due - time.monotonic()) > 0.002:
                time.sleep(ahead)
            sender.sendto(data, ("127.0.0.1", port))


@contextmanager
def sending_frames(
    frames: Iterable[tuple[int, bytes]], port: int, speed: float
) -> Iterator[threading.Thread]:
    """Send on a thread meanwhile, and no longer than the caller looks."""
    ended = threading.Event()
    thread = threading.Thread(target=send_frames, args=(frames, port, speed, ended))
    thread.start()
    try:
        yield thread
    finally:
        ended.set()
        thread.join()
