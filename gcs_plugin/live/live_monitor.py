"""The live monitor: links, recorder and fleet put together, each on its own thread.

    link threads     receive, stamp, forward, cut into frames; hand them to recorder and queue
    recorder thread  writes
    compute thread   frames -> state -> samples -> analysis -> alarms -> outputs
Outputs (live/output.py) get every Update (new rows of one vehicle) and every alarm event on the
compute thread. What does not fit into a queue is dropped and counted, never waited for: by the
compute thread the oldest, so that screens show the newest that it can.

When the compute thread is late, `MonitorStatus.behind_s` says by how much. Rows of a vehicle are
analysed in order all the same, all that wait in one go, and alarms come in that order with the time
at which their report came. Silence is checked by what came, and between any two vehicles.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

from thrustmargin.gcs_plugin.link.bounded_queue import BoundedQueue
from thrustmargin.gcs_plugin.link.listener import Listener
from thrustmargin.gcs_plugin.link.sender import Sender, Sign
from thrustmargin.gcs_plugin.live.alarms.alarm import Alarm, AlarmEvent
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet, Presence
from thrustmargin.gcs_plugin.live.output import Output
from thrustmargin.gcs_plugin.live.recording.recorder import (
    Recorder,
    RecorderStatus,
    RecordingOutput,
)
from thrustmargin.gcs_plugin.live.watch.update import Update, WatchSettings, in_background
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.gcs_plugin.wording.live_words import (
    NOT_BEHIND,
    behind_words,
    not_read_again,
    output_failed,
)
from thrustmargin.models.model.rotor_model import RotorModel

#: s between two rounds: at least, as often as a page asks; at most; with many vehicles so much for
#: each, up to RAREST.
SHORTEST, LONGEST, EACH, RAREST = 0.25, 1.0, 0.11, 2.2
#: Share of the time that rounds may take before they are made rarer (and larger): what a vehicle
#: costs in a round hardly depends on how many of its rows are new.
DUTY = 0.1
QUEUE = 200_000  # frames that may wait for the compute thread
LATE = 0.25  # s of a round after which frames received meanwhile are added to it
BEHIND = 2.0  # s by which the newest figures may be late before that is shown
ROUND = 1.0  # s beyond the planned wait for a round, the same
CAUGHT_UP = 20.0  # s of keeping up after which a computer is no longer behind
_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class MonitorSettings:
    """The links to listen to, the recording, and how vehicles are watched."""

    urls: tuple[str, ...] = ("udpin:127.0.0.1:14550",)
    forwards: tuple[str, ...] = ()
    record: Path | None = None
    extra_files: Mapping[str, bytes] = field(
        default_factory=dict
    )  # files of the recording, by name
    watch: WatchSettings = field(default_factory=WatchSettings)


@dataclass(frozen=True, slots=True, kw_only=True)
class MonitorStatus:
    """The monitor's own state: counts of data received, losses, delay and recording."""

    frames: int
    bytes: int
    bad_checksum: int
    unknown: int
    bytes_skipped: int
    refused: int
    refused_why: str  # by signing, in words
    kernel_drops: int
    compute_drops: int
    behind_s: float  # s since what waits to be analysed came; 0 when that is not worth a word
    cut_off: bool  # it ended before all that came was analysed
    recorder: RecorderStatus | None
    failed: Mapping[str, Exception] = field(default_factory=dict)  # outputs closed for an error


class Lateness:
    """State of the analysis, behind or not, to report each change; a short recovery is no
    change."""

    def __init__(self) -> None:
        self.late = False
        self._last_s = -math.inf

    def changes(self, behind_s: float, now_s: float) -> bool:
        """Update `late` by a delay of `behind_s` s at `now_s`, s; return True if it changed.

        A delay above 0 is late at once; `late` ends after CAUGHT_UP s without one.
        """
        before = self.late
        self._last_s = now_s if behind_s > 0.0 else self._last_s
        self.late = now_s - self._last_s < CAUGHT_UP
        return self.late != before


class LiveMonitor:
    """A monitor of every vehicle on links, from `start` to `close`; `settings` may be just a URL.

    Raises LinkError if a link or the recording cannot be opened.

        >>> with LiveMonitor(load_model(), "udpin:127.0.0.1:14550") as live:
        ...     newest = live.wait(0.1)
        >>> newest
        {}
    """

    def __init__(
        self,
        model: RotorModel,
        settings: MonitorSettings | str,
        *,
        outputs: Sequence[Output] = (),
        accept: Callable[[bytes, int], bool] | None = None,
        refused_why: Callable[[], str] = str,
    ) -> None:
        if isinstance(settings, str):
            settings = MonitorSettings(urls=(settings,))
        self.settings, self.model = settings, model
        #: All that get what is found, in this order; the recording is the first of them.
        self.outputs = list(outputs)
        #: Outputs that raised an exception and were closed, by name.
        self.failed: dict[str, Exception] = {}
        self._closed = False
        self._presence = Presence()
        self._queue: BoundedQueue[Frame] = BoundedQueue(QUEUE, keep_newest=True)
        self.recorder: Recorder | None = None
        self._refused_why = refused_why
        self._stop = threading.Event()
        self._newest_us = self._ticked_us = 0
        self._taken_us: int | None = None  # when the oldest frame of the running round came
        self._cut_off = False
        self._lateness = Lateness()
        self.failure: BaseException | None = None
        self.listener = Listener(
            settings.urls,
            forwards=settings.forwards,
            on_frames=self._on_frames,
            accept=accept,
        )
        watch = settings.watch
        if settings.record is not None:
            try:
                self.recorder = Recorder(settings.record, extra_files=settings.extra_files)
            except BaseException:
                self.listener.close()
                raise
            if self.live:  # the link itself is taken as long as this runs
                watch = replace(watch, link=str(self.recorder.telemetry))
        self._after_landing = ThreadPoolExecutor(1, thread_name_prefix="landed")
        if self.live:
            later = in_background(self._after_landing, self._not_read_again)
            self.fleet = Fleet(model, watch, heard_us=self.listener.heard_us, later=later)
        else:  # all may have been read before any is analysed, and it waits
            self.fleet = Fleet(model, watch)
        if self.recorder is not None:
            self.outputs.insert(0, RecordingOutput(self.recorder, self._found_us))
        self._thread = threading.Thread(target=self._run, name="compute", daemon=True)

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def start(self) -> None:
        """Start the outputs, then the listener and the analysis.

        Raises the error of an output's start, with everything closed again.
        """
        try:
            for output in self.outputs:
                output.start()
        except BaseException:
            self.close()
            raise
        self.listener.start()
        self._thread.start()

    def wait(self, seconds: float) -> dict[int, Update]:
        """Wait for `seconds` s, at most to the end of a recording; return system id -> newest rows.

        Raises the error that ended a thread or an output.
        """
        until = time.monotonic() + seconds
        while not self.finished and time.monotonic() < until:
            time.sleep(0.02)
        self.check()
        return {n: w.last for n, w in self.fleet.vehicles.items() if w.last is not None}

    def close(self, patience: float | None = None) -> None:
        """Stop listening, analyse the frames received, and close the outputs.

        With `patience` the analysis stops after that many s; frames not analysed by then are only
        recorded.
        """
        self._each(lambda output: output.on_links_closing())
        self.listener.close()
        self._queue.close()
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(patience)
        self._cut_off = self._thread.is_alive()
        self._after_landing.shutdown(wait=False, cancel_futures=True)
        self._each(lambda output: output.close())
        self._closed = True

    @property
    def finished(self) -> bool:
        """Return True if a recording has ended and all of it was analysed, or if a thread has
        failed."""
        failed = self.failure or self.listener.failure
        return failed is not None or (self.listener.finished and not self._thread.is_alive())

    def check(self) -> None:
        """Raise the error that ended a thread or an output, if there is one."""
        failure = self.failure or self.listener.failure or next(iter(self.failed.values()), None)
        if failure is not None:
            raise failure

    def _each(self, call: Callable[[Output], None]) -> None:
        """Call every output; close one that raises an exception, and go on with the others."""
        for output in list(self.outputs):
            try:
                call(output)
            except Exception as error:  # of any kind: a screen's defect must not end the alarms
                self._drop(output, error)

    def _drop(self, output: Output, error: Exception) -> None:
        """Close an output that failed, and report the error to the other outputs."""
        try:
            self.outputs.remove(output)
        except ValueError:
            return  # another thread has met the same error
        if self._closed:
            return
        words = output_failed(output.name, error)
        self.failed.setdefault(output.name, error)
        _log.error("%s", words, exc_info=error)
        with suppress(Exception):  # its first error is the one that is reported
            output.close()
        self._happened(self.now_us(), None, "note", words)

    def _happened(
        self, at_us: int, vehicle: int | None, kind: str, text: str, **more: object
    ) -> None:
        self._each(lambda output: output.on_happening(at_us, vehicle, kind, text, more))

    def _come_and_go(self, now_us: int) -> None:
        """Report to the outputs the vehicles that appeared, left and returned, and their notes."""
        for one in self._presence.changes(self.fleet, now_us):
            self._happened(one.at_us, one.vehicle, one.kind, one.text)
            if one.kind == "note":
                self._each(lambda o, one=one: o.on_note(one.vehicle, one.text, one.at_us * 1e-6))

    def status(self) -> MonitorStatus:
        links = self.listener.links
        return MonitorStatus(
            frames=sum(link.counts.frames for link in links),
            bytes=sum(link.counts.bytes for link in links),
            bad_checksum=sum(link.counts.bad_checksum for link in links),
            unknown=sum(link.counts.unknown for link in links),
            bytes_skipped=sum(link.counts.bytes_skipped for link in links),
            refused=sum(link.refused for link in links),
            refused_why=self._refused_why(),
            kernel_drops=sum(link.transport.kernel_drops for link in links),
            compute_drops=self._queue.dropped,
            behind_s=self._behind_s(),
            cut_off=self._cut_off,
            recorder=None if self.recorder is None else self.recorder.status(),
            failed=dict(self.failed),
        )

    @property
    def live(self) -> bool:
        """Return True if any link is no recording, whose stamps are of an earlier time."""
        return any(link.transport.live for link in self.listener.links)

    def now_us(self) -> int:
        """Return the ground's clock, µs: the computer's, or for recordings that of the last
        frame.
        """
        return self.listener.now_us() if self.live else self._newest_us

    def _behind_s(self) -> float:
        if not self.live:
            return 0.0
        first = self._queue.first()
        waiting = [first.stamp_us] if first is not None else []
        waiting += [us for us in (self._taken_us, self.listener.looked_us()) if us]
        behind = (self.now_us() - min(waiting)) * 1e-6 if waiting else 0.0
        # With many vehicles what comes waits for its round, as planned.
        return behind if behind > max(BEHIND, self.fleet.every_s + ROUND) else 0.0

    def _on_frames(self, frames: list[Frame]) -> None:
        # A recording waits until there is room; a radio does not.
        while not self.live and len(self._queue) > QUEUE // 2 and not self._stop.is_set():
            time.sleep(0.01)
        self._each(lambda output: output.on_frames(frames))
        self._queue.put(frames)

    def _run(self) -> None:
        try:
            while True:
                frames = self._queue.take(0.1)
                began = time.monotonic()
                self._round(frames)
                round_s = time.monotonic() - began
                if self._queue.finished or (self.listener.finished and not frames):
                    for update in self.fleet.finish():
                        self._publish(update)
                    self._round_over()
                    return
                self.fleet.every_s = spacing(round_s, len(self.fleet.vehicles))
                pause = self.fleet.every_s - round_s
                if pause > 0.0 and not self.listener.finished:
                    self._stop.wait(pause)
        except BaseException as error:
            if not self._cut_off:
                self.failure = error

    def _round(self, frames: list[Frame]) -> None:
        if self.live:
            self._live_round(frames)
        else:
            for piece in _pieces(frames):
                if piece:
                    # Silence before these frames is over once they are processed.
                    self._tick(piece[0].stamp_us)
                    self._come_and_go(piece[0].stamp_us)
                    self._newest_us = max(self._newest_us, piece[-1].stamp_us)
                self._analyse(piece)
                self._tick(self.now_us())
                self._round_over()

    def _round_over(self) -> None:
        now_us = self.now_us()
        self._come_and_go(now_us)
        self._each(lambda output: output.on_round(self.fleet, now_us))

    def _found_us(self) -> int:
        """Return the ground's clock, µs, up to which frames are analysed and links checked."""
        until_us = self._ticked_us
        first = self._queue.first()
        waiting = [until_us] if first is None else [until_us, first.stamp_us - 1]
        return min(waiting + [us - 1 for us in self.fleet.unread_us()])

    def _live_round(self, frames: list[Frame]) -> None:
        self._taken_us = frames[0].stamp_us if frames else None
        self._note_behind()
        until = time.monotonic() + LATE
        self.fleet.take(frames)
        for watch in self.fleet.waiting():
            for update in watch.updates():
                self._publish(update)
            if time.monotonic() > until:
                until = time.monotonic() + LATE
                self._note_behind()
                self.fleet.take(self._queue.take(0.0))
                self._listen()
        self._listen()
        self._taken_us = None
        self._round_over()

    def _analyse(self, frames: list[Frame]) -> None:
        self.fleet.take(frames)
        for update in self.fleet.updates():
            self._publish(update)

    def _listen(self) -> None:
        """Check the links, as of the time up to which all received data is known."""
        self._tick(min(self.now_us(), self.listener.looked_us()))

    def _note_behind(self) -> None:
        behind, now_us = self._behind_s(), self.now_us()
        if self._lateness.changes(behind, now_us * 1e-6):
            words = behind_words(behind) if behind else NOT_BEHIND
            self._happened(now_us, None, "note", words)

    def _tick(self, now_us: int) -> None:
        self._ticked_us = now_us
        for vehicle, event in self.fleet.tick(now_us):
            self._event(vehicle, event)

    def _publish(self, update: Update) -> None:
        if self._cut_off:
            raise SystemExit  # of this thread alone
        for event in update.events:
            self._event(update.vehicle, event)
        self._each(lambda output: output.on_update(update))

    def _not_read_again(self, error: BaseException) -> None:
        self._happened(self.now_us(), None, "note", not_read_again(error))

    def acknowledge(self, vehicle: int, alarm: Alarm) -> None:
        """Record that the pilot knows of an alarm; callable from any thread."""
        more = {"alarm": alarm.name, "rotor": alarm.rotor}
        self._happened(self.now_us(), vehicle, "acknowledged", alarm.text, **more)

    def say_of_plan(self, vehicle: int, text: str) -> None:
        """Pass a sentence on how the plan is flown to every output; callable from any thread."""
        self._each(lambda output: output.on_plan(vehicle, text))

    def _event(self, vehicle: int, event: AlarmEvent) -> None:
        self._each(lambda output: output.on_event(vehicle, event))


@dataclass(frozen=True, kw_only=True)
class OutputContext:
    """The monitor and the options of its command, from which outputs are made."""

    monitor: LiveMonitor
    #: Parameters of the command by name, as the user gave them; `plan` and `assumed` are read.
    options: Mapping[str, Any]
    sign: Sign | None  # signs a frame that is sent; None on links that are not signed
    print_line: Callable[[str], None]  # to standard output
    print_note: Callable[[str], None]  # to standard error

    @property
    def least_margin(self) -> float:
        """Return the smallest acceptable thrust margin, a share of 1: 1 less `max_utilisation`."""
        return 1.0 - float(self.options["max_utilisation"])

    @cached_property
    def sender(self) -> Sender:
        """Return the one sender of all outputs; its frames share one count of sequence numbers."""
        return Sender(self.monitor.listener, self.sign)


#: A function that makes an output from the context and the value of the option that switches it on.
OutputFactory = Callable[[OutputContext, Any], Output]


def spacing(round_s: float, vehicles: int) -> float:
    """Return the s from the start of an analysis round, which took `round_s` s, to the next start.

    With several vehicles at most 1/EACH analyses a second are made, however fast the computer is:
    no alarm needs more, and the cost of an aircraft grows with their rate. At most RAREST.
    """
    longest = min(max(EACH * vehicles, LONGEST), RAREST)
    return min(max(round_s / DUTY, EACH * (vehicles - 1), SHORTEST), longest)


def _pieces(frames: list[Frame]) -> list[list[Frame]]:
    """Split frames of a recording into pieces of at most 256, and at pauses of over a second.

    Without frames there is one empty piece.
    """
    pieces: list[list[Frame]] = [[]]
    for frame in frames:
        last = pieces[-1]
        if last and (len(last) >= 256 or frame.stamp_us - last[-1].stamp_us > 1_000_000):
            pieces.append([])
        pieces[-1].append(frame)
    return pieces
