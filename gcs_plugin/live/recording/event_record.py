"""What happens to the vehicles of a link, recorded with the time at which it did.

Each line of `events.jsonl` has `unix_s`, the ground's clock: of an alarm when the report came that
raised or cleared it, of a lost link when the silence became too long, of a vehicle when it was
first heard. However late it was found out, and however many messages were analysed in one go.
The lines are in the order of these times: an event waits until nothing earlier can be found.
"""

from __future__ import annotations

import heapq
import math
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.live.watch.watch_settings import GONE
from thrustmargin.gcs_plugin.wording.live_words import heard_words, silent_words

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.live.alarms.alarm import AlarmEvent
    from thrustmargin.gcs_plugin.live.link_vehicles import Fleet, Subscriber
    from thrustmargin.gcs_plugin.live.recording.recorder import Recorder


class EventRecord:
    """Hands events to `recorder`, which may be None, and notes on vehicles to `subscribers` too.

    Times are the ground's clock, µs.
    """

    def __init__(self, recorder: Recorder | None, subscribers: Sequence[Subscriber] = ()) -> None:
        self._recorder = recorder
        self._subscribers = subscribers
        self._lock = threading.Lock()
        #: Events that are not written yet: their time, how many came before, and what is written.
        self._waiting: list[tuple[int, int, dict[str, object]]] = []
        self._count = 0
        self._known: set[int] = set()
        self._gone: dict[int, int] = {}  # vehicle -> when it was last heard

    def note(self, at_us: int, vehicle: int | None, kind: str, text: str, **more: object) -> None:
        """Record one event of a vehicle, or (None) of the whole link."""
        if self._recorder is not None:
            event = {"unix_s": at_us * 1e-6, "vehicle": vehicle, "event": kind, "text": text}
            with self._lock:
                self._count += 1
                heapq.heappush(self._waiting, (at_us, self._count, event | more))

    def write(self, until_us: float = math.inf) -> None:
        """Write the events up to a time before which nothing more can be found; all without one."""
        if self._recorder is None:
            return
        with self._lock:
            while self._waiting and self._waiting[0][0] <= until_us:
                self._recorder.event(heapq.heappop(self._waiting)[2])

    def alarm(self, at_us: int, vehicle: int, event: AlarmEvent) -> None:
        """Record an alarm that was raised, cleared, or can (not) be confirmed."""
        self.note(
            at_us,
            vehicle,
            event.kind,
            event.alarm.text,
            alarm=event.alarm.name,
            rotor=event.alarm.rotor,
            rotors=event.alarm.rotors,
            severity=event.alarm.severity,
            state=event.alarm.state,
            missing=event.alarm.missing,
            times=event.alarm.times,
            since_s=event.alarm.since_s,
            time_s=event.time_s,
        )

    def come_and_go(self, fleet: Fleet, now_us: int) -> None:
        """Record which vehicles appeared, left and returned, and what was noted of them."""
        for number, watch in fleet.vehicles.items():
            if number not in self._known:
                self._known.add(number)
                self.note(watch.first_us, number, "appeared", heard_words(number))
            for at_us, text in watch.notes:
                self.note(at_us, number, "note", text)
                for subscriber in self._subscribers:
                    subscriber.on_note(number, text, at_us * 1e-6)
            watch.notes.clear()
            if number not in self._gone and watch.silent(now_us) > GONE:
                self._gone[number] = watch.last_us
                left_us = watch.last_us + round(GONE * 1e6)
                self.note(left_us, number, "left", silent_words(number, GONE))
            elif watch.back_us > self._gone.get(number, watch.back_us):
                del self._gone[number]
                self.note(watch.back_us, number, "returned", heard_words(number, again=True))
