"""The missions of the vehicles that a monitor hears, over the monitor's own links.

Each vehicle is asked once when it appears, one after the other, on a thread of its own; the plan
is handed over on the compute thread. Nothing is sent before or after, and what is sent is signed
where the monitor signs.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from queue import Queue
from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.link.listener import Listener
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet, Subscriber
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.models.errors import ThrustMarginError

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.vehicle.connection import VehicleLink
    from thrustmargin.mission.plan import MissionPlan


class MissionFetcher(Subscriber):
    """A subscriber of the monitor. Give `feed` every batch of frames; end it with `close`.

    What came, or why nothing did, becomes a note of the vehicle's watch, which the monitor records.
    """

    def __init__(
        self,
        listener: Listener,
        *,
        sign: Callable[[bytes], bytes] | None = None,
        timeout: float = 10.0,
    ) -> None:
        self._listener = listener
        self._sign = sign
        self._timeout = timeout
        self._asked: set[int] = set()
        self._wanted: Queue[int | None] = Queue()
        self._found: deque[tuple[int, MissionPlan | str]] = deque()
        self._link: VehicleLink | None = None
        self._vehicle = 0
        self._lock = threading.Lock()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="mission", daemon=True)
        self._thread.start()

    def feed(self, frames: Sequence[Frame]) -> None:
        """Frames as they arrive; returns at once unless a mission is being fetched."""
        if self._link is None:
            return
        data = b"".join(frame.data for frame in frames if frame.system == self._vehicle)
        with self._lock:
            if self._link is not None and data:
                self._link.feed(data)

    def on_round(self, fleet: Fleet, now_us: int) -> None:
        """Ask for the missions of vehicles that are new, and hand over those that have come."""
        for number in fleet.vehicles.keys() - self._asked:
            self._asked.add(number)
            self._wanted.put(number)
        while self._found:
            number, plan = self._found.popleft()
            watch = fleet.vehicles.get(number)
            if watch is None:
                continue
            if isinstance(plan, str):
                watch.notes.append((now_us, f"no mission fetched: {plan}"))
            else:
                watch.use_plan(plan)
                watch.notes.append((now_us, f"mission of {len(plan.items)} items fetched"))

    def close(self) -> None:
        """End a transfer that is under way; may be called again."""
        self._closed = True
        self._wanted.put(None)
        with self._lock:
            if self._link is not None:
                self._link.cancel()
        self._thread.join(5.0)

    def _run(self) -> None:
        while (number := self._wanted.get()) is not None and not self._closed:
            try:
                self._found.append((number, self._fetch(number)))
            except ThrustMarginError as error:
                self._found.append((number, str(error)))
            finally:
                with self._lock:
                    link, self._link = self._link, None
                if link is not None:
                    link.close()

    def _fetch(self, number: int) -> MissionPlan:
        from thrustmargin.gcs_plugin.vehicle.connection import VehicleLink
        from thrustmargin.gcs_plugin.vehicle.downloads import download_mission

        def send(frame: bytes) -> None:
            signed = frame if self._sign is None else self._sign(frame)
            self._listener.send(signed, system=number)

        link = VehicleLink.over(send, name=f"vehicle {number}")
        self._vehicle = number
        with self._lock:
            self._link = link
            if self._closed:
                link.cancel()
        return download_mission(link, link.vehicle(number, timeout=self._timeout))
