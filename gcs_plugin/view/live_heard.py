"""What the compute thread leaves for the thread that draws: every aircraft as it was last heard."""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.live.alarm import worst_first
from thrustmargin.gcs_plugin.live.fleet import Fleet
from thrustmargin.gcs_plugin.live.vehicle_monitor import Update
from thrustmargin.gcs_plugin.view.live_aircraft import Aircraft, Rows
from thrustmargin.gcs_plugin.view.live_html import Standing
from thrustmargin.gcs_plugin.view.overlays import Overlay, overlays_of
from thrustmargin.gcs_plugin.view.shown_row import enu
from thrustmargin.gcs_plugin.view.trail import Trail

STALE_EVERY = 0.5  # s between two looks at which fields are no longer reported


class Heard:
    """Aircraft by number. `update` and `round` are for the compute thread, the rest for drawing.

    `wake` is set when there is something new to draw; `overlays` are those of the last rows.
    """

    def __init__(self) -> None:
        self.wake = threading.Event()
        self.overlays: tuple[Overlay, ...] = ()
        self._lock = threading.Lock()
        self._aircraft: dict[int, Aircraft] = {}
        self._stale_s = 0.0

    def update(self, update: Update) -> None:
        """New rows of one aircraft."""
        overlays = overlays_of(update.analysis)
        track = update.analysis.track
        values = np.column_stack([overlay.values for overlay in overlays])
        places = enu(track.position_ned)
        with self._lock:
            aircraft = self._aircraft.get(update.vehicle)
            if aircraft is None:
                trail = Trail([overlay.worst for overlay in overlays])
                aircraft = self._aircraft[update.vehicle] = Aircraft(update.vehicle, trail, update)
            if update.boot != aircraft.boot:
                aircraft.boot, aircraft.offset = update.boot, None
            aircraft.update, aircraft.fresh = update, True
            for row in range(update.first, track.time_s.size):
                if track.flying[row]:
                    aircraft.rows.append((float(update.clock_s[row]), places[row], values[row]))
            self.overlays = overlays
        self.wake.set()

    def round(self, fleet: Fleet, now_us: int) -> None:
        """Ages, alarms and missions."""
        tell_stale = time.monotonic() - self._stale_s >= STALE_EVERY
        if tell_stale:
            self._stale_s = time.monotonic()
        with self._lock:
            for number, watch in fleet.vehicles.items():
                aircraft = self._aircraft.get(number)
                if aircraft is None:
                    continue
                aircraft.age = (now_us - int(aircraft.update.stamp_us[-1])) * 1e-6
                told = (
                    tuple(worst_first(list(watch.alarms.standing.values()))),
                    watch.problem,
                    watch.left(now_us),
                )
                if told != (aircraft.alarms, aircraft.problem, aircraft.gone):
                    aircraft.alarms, aircraft.problem, aircraft.gone = told
                    # Every tab tells the alarms of all.
                    for one in self._aircraft.values():
                        one.fresh = True
                    self.wake.set()
                aircraft.waypoints = watch.state.mission
                if tell_stale:
                    aircraft.stale = watch.stale(now_us)

    def aircraft(self) -> list[Aircraft]:
        """All that have rows, in the order in which they were first heard."""
        with self._lock:
            return list(self._aircraft.values())

    def standing(self, old: float) -> list[Standing]:
        """Every aircraft as all pages tell of it, in the order of numbers.

        Rows of more than `old` s are called old.
        """
        with self._lock:
            return [one.standing(old) for _, one in sorted(self._aircraft.items())]

    def taken(self, one: Aircraft) -> tuple[Update, float]:
        """Its last rows, from now on no longer fresh, and their age in s."""
        with self._lock:
            one.fresh = False
            return one.update, one.age

    def taken_rows(self, one: Aircraft) -> tuple[Rows, Update, Any]:
        """The rows in flight since they were last taken, the last update, and the mission."""
        with self._lock:
            rows, one.rows = one.rows, deque()
            return rows, one.update, one.waypoints
