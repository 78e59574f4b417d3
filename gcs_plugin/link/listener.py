"""Receive, forward and split the bytes of links into frames, one thread a link.

Bytes are forwarded before they are interpreted, unchanged: each datagram as it came, a byte stream
in whole frames with the bytes between. Bytes from a ground station behind `forwards` go to the
vehicle's links, unchanged too. A listener sends nothing of its own accord.

Only the listener knows the times of arrival: `heard_us` of each vehicle, and `looked_us`, up to
which no bytes can be unread in a socket. A vehicle's silence is their difference, however late this
computer processes the bytes.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence

from thrustmargin.gcs_plugin.link.transport import Address, Chunk, Transport, open_transport
from thrustmargin.gcs_plugin.mavlink.frame import Frame, FrameCounts, FrameSplitter

#: s that a thread waits for bytes before it checks whether it should stop.
WAIT = 0.2
#: Senders of datagrams whose unfinished frames are remembered, a link.
SENDERS = 256


class SteadyClock:
    """A Unix clock that never jumps: the wall clock read once, plus the monotonic clock since."""

    def __init__(self) -> None:
        self._offset_ns = time.time_ns() - time.monotonic_ns()

    def now_us(self) -> int:
        return (time.monotonic_ns() + self._offset_ns) // 1000


class Link:
    """A URL with its transport, its frame counts, and its receiving thread."""

    def __init__(self, url: str, number: int, transport: Transport) -> None:
        self.url = url
        self.number = number
        self.transport = transport
        self.counts = FrameCounts()
        self.refused = 0  # whole frames that the filter did not let in
        self.finished = False
        self.looked_us = 0  # when its transport was last found empty; 0 before the first look
        self._splitters: dict[Address | None, FrameSplitter] = {}

    def frames(self, chunk: Chunk, stamp_us: int) -> tuple[list[Frame], bytes]:
        """Return the frames of a chunk received at `stamp_us`, Unix µs, and bytes to forward.

        The bytes of a stream are forwarded once a frame is whole, the bytes of a datagram as they
        came.
        """
        splitter = self._splitters.get(chunk.peer)
        if splitter is None:
            if len(self._splitters) >= SENDERS:
                del self._splitters[next(iter(self._splitters))]
            splitter = self._splitters[chunk.peer] = FrameSplitter(self.number, self.counts)
        if self.transport.datagrams:
            return splitter.feed_datagram(chunk.data, stamp_us), chunk.data
        frames = splitter.feed(chunk.data, stamp_us)
        return frames, splitter.passed


class Listener:
    """All links to vehicles, and the forwards to ground stations.

    `on_frames(frames)` is called on the receiving threads, in order within a link, and must be
    quick. `accept(frame, link)` may refuse a frame (signing); forwarding is not affected.
    """

    def __init__(
        self,
        urls: Sequence[str],
        *,
        on_frames: Callable[[list[Frame]], None],
        forwards: Sequence[str] = (),
        accept: Callable[[bytes, int], bool] | None = None,
    ) -> None:
        self._on_frames = on_frames
        self._accept = accept
        self._clock = SteadyClock()
        self._stop = threading.Event()
        self._threads: list[threading.Thread] = []
        self._homes: dict[int, tuple[Link, Address | None]] = {}
        self.failure: BaseException | None = None
        #: System id -> ground's clock when a frame of it last came from a link to vehicles.
        self.heard_us: dict[int, int] = {}
        self.links: list[Link] = []
        self.forwards: list[Link] = []
        try:
            for number, url in enumerate(urls):
                self.links.append(Link(url, number, open_transport(url)))
            for number, url in enumerate(forwards, start=len(urls)):
                self.forwards.append(Link(url, number, open_transport(url)))
        except BaseException:
            self.close()
            raise

    def start(self) -> None:
        """Start the receiving threads."""
        for link in [*self.links, *self.forwards]:
            back = link in self.forwards
            thread = threading.Thread(
                target=self._run, args=(link, back), name=f"link {link.url}", daemon=True
            )
            self._threads.append(thread)
            thread.start()

    def close(self) -> None:
        """Stop the threads and close every link."""
        self._stop.set()
        for thread in self._threads:
            thread.join(timeout=3.0)
        for link in [*self.links, *self.forwards]:
            link.transport.close()

    @property
    def finished(self) -> bool:
        """Return True if no more bytes can arrive (recordings read to their end)."""
        return all(link.finished for link in self.links)

    def now_us(self) -> int:
        """Return the clock that stamps arrivals: Unix µs, never jumping."""
        return self._clock.now_us()

    def looked_us(self) -> int:
        """Return the ground's clock, µs, up to which every open link has been read completely.

        The present if no link is open.
        """
        looked = [link.looked_us for link in self.links if not link.finished]
        return min(looked, default=self.now_us())

    def send(self, data: bytes, *, system: int | None = None, forwards: bool = False) -> None:
        """Send bytes to link and address where `system` was last received, else to all.

        With `forwards` send them to the ground stations too.
        """
        home = self._homes.get(system) if system is not None else None
        if home is not None:
            home[0].transport.send(data, home[1])
        else:
            for link in self.links:
                link.transport.send(data)
        if forwards:
            for link in self.forwards:
                link.transport.send(data)

    def _run(self, link: Link, back: bool) -> None:
        others = self.links if back else self.forwards
        try:
            while not self._stop.is_set():
                try:
                    chunks = link.transport.receive(WAIT)
                except EOFError:
                    link.finished = True
                    return
                stamp_us = self._clock.now_us()
                if chunks:
                    self._take(link, chunks, stamp_us, others, learn=not back)
                if link.transport.emptied:
                    link.looked_us = stamp_us
        except Exception as error:
            if not self._stop.is_set():
                self.failure = error

    def _take(
        self, link: Link, chunks: list[Chunk], stamp_us: int, others: list[Link], learn: bool
    ) -> None:
        frames: list[Frame] = []
        for chunk in chunks:
            received, passed = link.frames(chunk, chunk.stamp_us or stamp_us)
            if passed:
                for other in others:
                    other.transport.send(passed)
            if learn and received and self._homes.get(received[0].system) != (link, chunk.peer):
                self._homes[received[0].system] = (link, chunk.peer)
            frames += received
        if self._accept is not None:
            let_in = [f for f in frames if self._accept(f.data, link.number)]
            link.refused += len(frames) - len(let_in)
            frames = let_in
        if learn:
            self.heard_us.update((frame.system, frame.stamp_us) for frame in frames)
        if frames:
            self._on_frames(frames)
