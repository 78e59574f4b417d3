"""What the compute thread leaves for the thread that draws: every aircraft as it was last heard.

Each `VehicleSummary` is replaced as a whole and never changed, so that no lock is needed; rows for
the trails wait in a queue an aircraft.
"""

from __future__ import annotations

import threading
import time
from collections import defaultdict, deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.live.watch.update import Update
from thrustmargin.gcs_plugin.live.watch.vehicle_monitor import VehicleMonitor
from thrustmargin.gcs_plugin.view.figures.charts import Speeds
from thrustmargin.gcs_plugin.view.figures.vehicle_summary import VehicleSummary
from thrustmargin.gcs_plugin.view.scene.overlays import Overlay, overlays_of
from thrustmargin.gcs_plugin.view.scene.shown_row import ShownRow
from thrustmargin.models.flight import Floats

KEPT_S = 600.0


class LiveHistory:
    """Rows as they came: `add` is for the compute thread, `speeds` for the drawing thread."""

    def __init__(self) -> None:
        self._parts: deque[Speeds] = deque()
        self._boot = 0

    def add(self, update: Update) -> None:
        """The new rows; a vehicle that restarted, or has other rotors, begins anew."""
        rows = Speeds.of(update.analysis).rows(slice(update.first, None), update.clock_s)
        copies: Any = map(np.copy, rows)  # a view would keep its whole window alive
        now = Speeds(*copies)
        if not now.time_s.size:
            return
        last = self._parts[-1] if self._parts else now
        if update.boot != self._boot or last.measured.shape[1] != now.measured.shape[1]:
            self._parts.clear()
        self._boot = update.boot
        self._parts.append(now)
        while self._parts[0].time_s[-1] < now.time_s[-1] - KEPT_S:
            self._parts.popleft()

    @property
    def speeds(self) -> Speeds | None:
        """All that is kept; None of nothing."""
        parts = list(self._parts)
        if not parts:
            return None
        rotors = parts[-1].measured.shape[1]
        parts = [part for part in parts if part.measured.shape[1] == rotors]
        return Speeds(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


STALE_EVERY = 0.5  # s between two looks at which fields are no longer reported


class Heard:
    """Aircraft by number. `update` and `round` are for the compute thread, the rest for drawing.

    `wake` is set when there is something new to draw; `overlays` are those of the last rows.
    `clock` is the ground's, µs: figures age by it while the compute thread is busy; without it they
    are as old as at the last `round`.
    """

    def __init__(self, wake: threading.Event, clock: Callable[[], int] | None = None) -> None:
        self.wake = wake
        self._clock = clock
        self._watches: dict[int, VehicleMonitor] = {}
        self.overlays: tuple[Overlay, ...] = ()
        #: For the trails, rows in flight: (N,) time s, (N, 3) position NED m, (N, K) of overlays,
        #: (N,) pump on.
        self.rows: dict[int, deque[tuple[Floats, Floats, Floats, Floats]]] = defaultdict(deque)
        self.history: dict[int, LiveHistory] = defaultdict(LiveHistory)
        #: In the order in which they were first heard.
        self._summaries: dict[int, VehicleSummary] = {}
        self._stale_s = 0.0

    @property
    def summaries(self) -> list[VehicleSummary]:
        """All that have rows, in the order in which they were first heard."""
        known = list(self._summaries.values())
        return known if self._clock is None else [self._aged(s, self._clock()) for s in known]

    def _aged(self, one: VehicleSummary, now_us: int) -> VehicleSummary:
        watch = self._watches.get(one.number)
        if watch is None or one.update is None:
            return one
        return replace(one, age=one.update.age_s(now_us), silent=watch.link.silent(now_us))

    def update(self, update: Update) -> None:
        """New rows of one aircraft."""
        number, track = update.vehicle, update.analysis.track
        overlays = overlays_of(update.analysis)
        values = np.column_stack([overlay.values for overlay in overlays])
        fresh = update.first + np.flatnonzero(track.flying[update.first :])
        self.rows[number].append(
            (update.clock_s[fresh], track.position_ned[fresh], values[fresh], track.spraying[fresh])
        )
        self.history[number].add(update)
        self.overlays = overlays
        before = self._summaries.get(number) or VehicleSummary(number=number)
        self._put(
            replace(
                before,
                row=ShownRow(update.analysis, -1),
                update=update,
                seconds_to_empty=update.outlook.seconds_to_empty,
            )
        )
        self.wake.set()

    def round(self, fleet: Fleet, now_us: int) -> None:
        """Ages, alarms and missions."""
        look = time.monotonic() - self._stale_s >= STALE_EVERY
        if look:
            self._stale_s = time.monotonic()
        for number, watch in fleet.vehicles.items():
            before = self._summaries.get(number)
            if before is None or before.update is None:
                continue
            self._watches[number] = watch
            now = replace(
                self._aged(before, now_us),
                alarms=tuple(sorted(watch.alarms.listed.values(), key=lambda a: a.order)),
                old_s=fleet.old_s,
                problem=watch.problem,
                gone=watch.left(now_us),
                mission=watch.state.mission,
                stale=watch.stale(now_us) if look else before.stale,
            )
            self._put(now)
            if now.shown != before.shown:
                self.wake.set()

    def _put(self, one: VehicleSummary) -> None:
        self._summaries = {**self._summaries, one.number: one}
