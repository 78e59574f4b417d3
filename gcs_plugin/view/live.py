"""The 3D view of aircraft that fly now: a subscriber of the monitor, drawn by a thread of its own.

The compute thread only leaves its latest findings here; the drawing thread wakes at once, and what
it cannot draw in time it leaves out. One tab of gauges an aircraft, with the alarms of all, and one
bar each beside them; all in one scene, placed from the first one's home. A number that is old is
greyed out and its age is written over it; an aircraft that was switched off on the ground leaves.
"""

from __future__ import annotations

import logging
import queue
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pymap3d

from thrustmargin.gcs_plugin.live.alarm import AlarmEvent
from thrustmargin.gcs_plugin.live.fleet import Fleet
from thrustmargin.gcs_plugin.live.vehicle_monitor import Update
from thrustmargin.gcs_plugin.view import live_html
from thrustmargin.gcs_plugin.view.camera import Camera
from thrustmargin.gcs_plugin.view.controls import choice
from thrustmargin.gcs_plugin.view.gauges import STYLE, gauges_html
from thrustmargin.gcs_plugin.view.guard import LOOPBACK
from thrustmargin.gcs_plugin.view.live_heard import Heard
from thrustmargin.gcs_plugin.view.live_html import (
    Standing,
    aged,
    alarms_html,
    fleet_html,
    outlook_html,
    status_html,
)
from thrustmargin.gcs_plugin.view.page import Page, arrange, left_panel
from thrustmargin.gcs_plugin.view.planned_path import plan_enu
from thrustmargin.gcs_plugin.view.scene import Scene
from thrustmargin.gcs_plugin.view.shown_row import ShownRow, ground_height
from thrustmargin.gcs_plugin.view.trail import Trail
from thrustmargin.gcs_plugin.wording.palette import legend_html
from thrustmargin.models.flight import Floats, Origin
from thrustmargin.models.physics.airframe import Airframe

if TYPE_CHECKING:
    import viser

FASTEST = 0.04  # s between two drawings
#: s; gauges for up to two aircraft
GAUGES_EVERY, BARS_EVERY, TRAIL_EVERY, STATUS_EVERY = 0.1, 0.2, 0.5, 0.5
_log = logging.getLogger(__name__)


@dataclass(slots=True, eq=False)
class Aircraft:
    """What is drawn of one vehicle; for the drawing thread alone."""

    number: int
    trail: Trail
    offset: Floats | None = None  # (3,) m, ENU of its origin from the scene's
    boot: int = 0  # of the flight that the offset belongs to
    plan: Any = None  # mission that is drawn
    tab: Any = None
    gauges: Any = None  # in the tab; None while there is none
    label: Any = None
    shown: Any = None  # rows and words that the gauges show
    drawn_s: float = 0.0


class LiveView:
    """The view of every vehicle that a monitor hears; `start` opens it, `close` ends it.

    `status` gives lines about link and recording. Raises LinkError from `start` when the port is
    taken.
    """

    def __init__(
        self,
        airframe: Airframe,
        *,
        host: str = LOOPBACK,
        port: int = 8080,
        status: Callable[[], list[str]] = list,
    ) -> None:
        self._airframe = airframe
        self._page = Page(host=host, port=port)
        self._status = status
        self._heard = Heard()
        self._requests: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._origin: Origin | None = None
        self._shown = 0  # number of the overlay
        self._focus: int | None = None
        self._aircraft: dict[int, Aircraft] = {}
        self._status_s = self._trails_s = self._bars_s = 0.0
        self.draw_seconds: deque[float] = deque(maxlen=1000)

    @property
    def url(self) -> str:
        """Where the page is. Raises DataError before `start` and after `close`."""
        return self._page.url

    def start(self) -> None:
        """Open the port and begin to draw."""
        self._page.open(self._build, self._run, name="live-view")

    def close(self) -> None:
        """Stop drawing and close the page; harmless when called twice."""
        self._page.stopping.set()
        self._heard.wake.set()
        self._page.close()

    def announce(self, *, browser: bool) -> None:
        """Print where the view is, and open the `browser` on it."""
        self._page.announce("view", browser=browser)

    def on_update(self, update: Update) -> None:
        """New rows; called on the compute thread."""
        self._heard.update(update)

    def on_event(self, vehicle: int, event: AlarmEvent) -> None:
        """Nothing: what stands is read each round."""

    def on_round(self, fleet: Fleet, now_us: int) -> None:
        """Ages, alarms and missions; called on the compute thread."""
        self._heard.round(fleet, now_us)

    def _build(self, server: viser.ViserServer) -> None:
        gui, put = server.gui, self._requests.put
        arrange(gui, width=340)
        gui.add_html(STYLE + live_html.STYLE)
        self._bars = gui.add_html("")
        self._words = gui.add_html(status_html(["no vehicle heard yet"]))
        self._colour = choice(gui, "Colour", ["Load"], put, self._recolour)
        self._legend = gui.add_html("")
        choice(gui, "Camera", [*Camera], put, lambda name: self._scene.set_camera(Camera(name)))
        self._followed = choice(gui, "Aircraft", ["-"], put, self._follow)
        self._tabs = left_panel(gui)
        self._scene = Scene(server)
        self._scene.set_ground(np.array([[-30.0, -30.0, 0.0], [30.0, 30.0, 5.0]]), 0.0)

    def _run(self, server: viser.ViserServer) -> None:
        while not self._page.stopping.is_set():
            self._heard.wake.wait(0.25)
            self._heard.wake.clear()
            begun = time.monotonic()
            try:
                while not self._requests.empty():
                    self._requests.get()()
                with server.atomic():
                    self._draw(server, begun)
            except Exception:
                _log.exception("the live view could not draw")
            took = time.monotonic() - begun
            self.draw_seconds.append(took)
            self._page.stopping.wait(max(FASTEST - took, 0.0))

    def _draw(self, server: viser.ViserServer, now: float) -> None:
        fleet = self._heard.standing
        spacing = GAUGES_EVERY * max(1.0, len(fleet) / 2)
        for standing in fleet:
            one = self._aircraft.get(standing.number)
            if standing.gone:
                if one is not None:
                    self._leave(one)
                continue
            if one is None or one.gauges is None:
                one = self._add(server, standing.number, fleet)
            shown = standing.update, [other.words for other in fleet]
            if (shown != one.shown or standing.old) and now - one.drawn_s >= spacing:
                one.drawn_s, one.shown = now, shown
                self._show(one, standing, fleet)
            elif shown != one.shown:
                self._heard.wake.set()  # too soon: once more
        if now - self._bars_s >= BARS_EVERY:
            self._bars_s = now
            bars = fleet_html(sorted(fleet, key=lambda standing: standing.number))
            if bars != self._bars.content:
                self._bars.content = bars
        if now - self._trails_s >= TRAIL_EVERY:
            self._trails_s = now
            for standing in fleet:
                if standing.number in self._aircraft:
                    self._draw_trail(self._aircraft[standing.number], standing)
        if now - self._status_s >= STATUS_EVERY:
            self._status_s = now
            self._words.content = status_html(self._status())

    def _add(self, server: viser.ViserServer, number: int, fleet: list[Standing]) -> Aircraft:
        overlays = self._heard.overlays
        one = self._aircraft.setdefault(
            number, Aircraft(number, Trail([o.worst for o in overlays]))
        )
        one.tab = self._tabs.add_tab(f"Vehicle {number}")
        with one.tab:
            one.gauges = server.gui.add_html("")
        if one.label is not None:
            return one  # it is back, and only its tab had been taken away
        self._scene.add_vehicle(str(number), self._airframe)
        one.label = server.scene.add_label(
            f"/world/name_{number}",
            f"Vehicle {number}",
            anchor="bottom-center",
            font_screen_scale=1.25,
            visible=False,
        )
        self._followed.options = tuple(f"Vehicle {n}" for n in sorted(s.number for s in fleet))
        if self._focus is None:
            self._focus = number
            self._colour.options = tuple(overlay.name for overlay in overlays)
            self._recolour(overlays[0].name)
        return one

    def _leave(self, one: Aircraft) -> None:
        """Take away the tab and the aircraft; where it flew stays."""
        if one.gauges is None:
            return
        one.tab.remove()
        one.gauges = None
        one.label.visible = False
        self._scene.hide(str(one.number))

    def _show(self, one: Aircraft, standing: Standing, fleet: list[Standing]) -> None:
        update = standing.update
        if update is None:
            return
        row = ShownRow(update.analysis, -1, self._offset(one, update))
        self._scene.show(str(one.number), row, focus=one.number == self._focus)
        position = row.position_enu
        placed = bool(np.all(np.isfinite(position)))
        one.label.visible = placed and len(fleet) > 1
        if placed:
            one.label.position = position + self._scene.above(str(one.number))
        html = gauges_html(row, f"{self._airframe.title} · vehicle {one.number}")
        html += outlook_html(update.outlook, standing.stale, update.remarks)
        one.gauges.content = alarms_html(one.number, fleet) + aged(html, standing.old)

    def _offset(self, one: Aircraft, update: Update) -> Floats:
        """(3,) m, ENU from the scene's origin, which is that of the first aircraft, to its own."""
        if one.offset is None or one.boot != update.boot:
            origin = update.analysis.track.origin
            if self._origin is None:
                self._origin = origin
            if origin is None or self._origin is None:
                return np.zeros(3)
            home = self._origin
            one.boot = update.boot
            one.offset = np.array(
                pymap3d.geodetic2enu(
                    *(origin.latitude_deg, origin.longitude_deg, origin.altitude),
                    *(home.latitude_deg, home.longitude_deg, home.altitude),
                )
            )
        return one.offset

    def _draw_trail(self, one: Aircraft, standing: Standing) -> None:
        update, rows = standing.update, self._heard.rows[one.number]
        if update is None:
            return
        offset = self._offset(one, update)
        fresh = bool(rows)
        while rows:
            time_s, place, values = rows.popleft()
            one.trail.add(time_s, place + offset, values)
        if fresh and one.trail.count:
            self._colour_trail(one)
            self._scene.hold(one.trail.points().reshape(-1, 3))
        if standing.mission and standing.mission is not one.plan:
            one.plan = standing.mission
            ground = ground_height(update.analysis.track)
            places = plan_enu([*one.plan.values()], update.analysis.track.origin, ground)
            if len(places) > 1:
                self._scene.set_plan(str(one.number), places + offset, ground + offset[2])
                self._scene.hold(
                    np.column_stack([places[:, :2], np.full(len(places), ground)]) + offset
                )

    def _colour_trail(self, one: Aircraft) -> None:
        scale = self._heard.overlays[self._shown].scale
        values = one.trail.values(self._shown)
        self._scene.set_route(str(one.number), one.trail.points(), values, scale)

    def _recolour(self, name: str) -> None:
        for number, overlay in enumerate(self._heard.overlays):
            if overlay.name == name:
                self._shown = number
                self._legend.content = legend_html(overlay.scale, overlay.note)
                for one in self._aircraft.values():
                    if one.trail.count:
                        self._colour_trail(one)

    def _follow(self, name: str) -> None:
        for number in self._aircraft:
            if name == f"Vehicle {number}":
                self._focus = number
