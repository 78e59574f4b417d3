"""Fetch the missions of the vehicles that a monitor receives, over the monitor's own links.

Each vehicle is asked when it appears, returns or restarts, and when its mission is replaced by
anybody. Vehicles are asked one after the other, on a thread of their own; the plan is handed over
on the compute thread. A vehicle that does not answer is asked again at growing intervals. Nothing
is sent before or after a transfer, and requests are signed if the monitor signs.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from queue import Queue
from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.link.listener import Listener
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.live.live_monitor import OutputContext
from thrustmargin.gcs_plugin.live.output import Output
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.models.errors import PlanError, ThrustMarginError, require

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.vehicle.connection import VehicleLink
    from thrustmargin.mission.plan import MissionPlan


#: s without a change of the mission before it is requested: an upload has many messages
SETTLED = 2.0
#: first and longest delay, s, before an unanswered request is repeated; it doubles each time
AGAIN, RAREST = 10.0, 300.0


@dataclass(slots=True)
class _Asked:
    """The state of fetching one vehicle's mission; times are the ground's clock, µs."""

    of: object = None  # which mission was there when it was asked last
    seen: object = None  # which is there now
    seen_us: int = 0  # since when
    pending: bool = False
    failures: int = 0
    again_us: int = 0


class MissionFetcher(Output):
    """An output that downloads the mission of every vehicle.

    The result of a transfer, or its error, becomes a note of the vehicle's watch, which the monitor
    records.
    """

    name = "--fetch-mission"

    def __init__(
        self,
        listener: Listener,
        *,
        sign: Callable[[bytes], bytes] | None = None,
        timeout: float = 10.0,
    ) -> None:
        require("--fetch-mission", "mavsdk")
        self._listener = listener
        self._sign = sign
        self._timeout = timeout
        self._asked: dict[int, _Asked] = {}
        self._wanted: Queue[int | None] = Queue()
        self._found: deque[tuple[int, MissionPlan | ThrustMarginError]] = deque()
        self._link: VehicleLink | None = None
        self._vehicle = 0
        self._lock = threading.Lock()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="mission", daemon=True)
        self._thread.start()

    def on_frames(self, frames: Sequence[Frame]) -> None:
        """Pass the frames of the vehicle whose mission is being fetched to that transfer."""
        if self._link is None:
            return
        data = b"".join(frame.data for frame in frames if frame.system == self._vehicle)
        with self._lock:
            if self._link is not None and data:
                self._link.feed(data)

    def on_round(self, fleet: Fleet, now_us: int) -> None:
        """Queue the requests for missions that are due, and pass on the missions that arrived.

        One is due SETTLED s after the mission changed, the vehicle restarted or was heard again,
        and after a growing delay if unanswered. `now_us` is the ground's clock, µs.
        """
        for number, watch in fleet.vehicles.items():
            request = self._asked.setdefault(number, _Asked())
            now = (watch.state.mission_changes, watch.telemetry.clock.boot, watch.link.back_us)
            if now != request.seen:
                # One that appears is asked at once.
                request.seen_us = now_us if request.seen else now_us - round(SETTLED * 1e6)
                request.seen = now
            settled = now_us - request.seen_us >= SETTLED * 1e6
            other = now != request.of or (request.failures and now_us >= request.again_us)
            if other and settled and not request.pending:
                request.of, request.pending = now, True
                self._wanted.put(number)
        while self._found:
            number, mission = self._found.popleft()
            request, watch = self._asked[number], fleet.vehicles.get(number)
            request.pending = False
            if watch is None:
                continue
            if isinstance(mission, ThrustMarginError):
                # A vehicle without a mission has replied.
                none = isinstance(mission, PlanError)
                request.failures = 0 if none else request.failures + 1
                wait = min(AGAIN * 2.0 ** (request.failures - 1), RAREST)
                request.again_us = now_us + round(wait * 1e6)
                if none:
                    watch.use_plan(None)
                watch.notes.append((now_us, f"no mission fetched: {mission}"))
            else:
                request.failures = 0
                watch.use_plan(mission)
                watch.notes.append((now_us, f"mission of {len(mission.items)} items fetched"))

    def on_links_closing(self) -> None:
        self.close()

    def close(self) -> None:
        """End a running transfer; repeated calls are allowed."""
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
                self._found.append((number, error))
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

        link = VehicleLink.from_sender(send, name=f"vehicle {number}")
        self._vehicle = number
        with self._lock:
            self._link = link
            if self._closed:
                link.cancel()
        return download_mission(link, link.vehicle(number, timeout=self._timeout))


def output(context: OutputContext, value: bool) -> MissionFetcher:  # noqa: ARG001
    """Return the output of `--fetch-mission`."""
    return MissionFetcher(context.monitor.listener, sign=context.sign)
