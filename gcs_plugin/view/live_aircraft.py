"""What the live view keeps of one aircraft: latest rows, alarms, and what is drawn of it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Any

from thrustmargin.gcs_plugin.live.alarm import Alarm
from thrustmargin.gcs_plugin.live.vehicle_monitor import Update
from thrustmargin.gcs_plugin.view.live_html import Standing
from thrustmargin.gcs_plugin.view.shown_row import ShownRow
from thrustmargin.gcs_plugin.view.trail import Trail
from thrustmargin.models.flight import Floats

#: Rows in flight: time s, place ENU m, value of each overlay.
Rows = deque[tuple[float, Floats, Floats]]


@dataclass(slots=True, eq=False)
class Aircraft:
    """What is known and drawn of one vehicle."""

    number: int
    trail: Trail
    update: Update  # its last rows
    fresh: bool = False  # there is something new to draw
    rows: Rows = field(default_factory=deque)  # for the trail
    age: float = 0.0
    alarms: tuple[Alarm, ...] = ()
    gone: bool = False
    problem: str = ""
    stale: str = ""  # fields that are no longer reported, in words
    offset: Floats | None = None  # ENU of its origin from the scene's
    plan: Any = None  # mission that is drawn
    waypoints: Any = None
    tab: Any = None
    gauges: Any = None  # in the tab; None while there is none
    label: Any = None
    line: Any = None
    drawn_s: float = 0.0
    boot: int = 0

    def standing(self, old: float) -> Standing:
        """What every page tells of it; rows of more than `old` s are called old."""
        analysis = self.update.analysis
        return Standing(
            number=self.number,
            alarms=self.alarms,
            age=self.age,
            old=self.age > old,
            problem=self.problem,
            gone=self.gone,
            margin=ShownRow(analysis, -1).worst[0],
            tank_kg=float(analysis.track.tank_kg[-1]),
            flying=bool(analysis.track.flying[-1]),
        )
