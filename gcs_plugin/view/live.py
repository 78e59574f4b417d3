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
from typing import TYPE_CHECKING, Any

import numpy as np
import pymap3d

from thrustmargin.gcs_plugin.live.alarm import AlarmEvent
from thrustmargin.gcs_plugin.live.fleet import Fleet
from thrustmargin.gcs_plugin.live.vehicle_monitor import Update
from thrustmargin.gcs_plugin.view import live_html
from thrustmargin.gcs_plugin.view.camera import Camera
from thrustmargin.gcs_plugin.view.gauges import STYLE, gauges_html
from thrustmargin.gcs_plugin.view.guard import LOOPBACK
from thrustmargin.gcs_plugin.view.live_aircraft import Aircraft
from thrustmargin.gcs_plugin.view.live_heard import Heard
from thrustmargin.gcs_plugin.view.live_html import (
    aged,
    alarms_html,
    fleet_html,
    outlook_html,
    status_html,
)
from thrustmargin.gcs_plugin.view.live_paths import Paths
from thrustmargin.gcs_plugin.view.page import Page, arrange, left_panel
from thrustmargin.gcs_plugin.view.planned_path import plan_enu
from thrustmargin.gcs_plugin.view.scene import Scene
from thrustmargin.gcs_plugin.view.shown_row import ShownRow, ground_height
from thrustmargin.gcs_plugin.wording.palette import legend_html
from thrustmargin.models.flight import Floats, Origin
from thrustmargin.models.physics.airframe import Airframe

if TYPE_CHECKING:
    import viser

FASTEST = 0.04  # s between two drawings
#: s; gauges for up to two aircraft
GAUGES_EVERY, BARS_EVERY, TRAIL_EVERY, STATUS_EVERY = 0.1, 0.2, 0.5, 0.5
OLD = 1.5  # s after which what is shown is called old
_log = logging.getLogger(__name__)


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
        self._told_s = self._trails_s = self._bars_s = 0.0
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
        gui = server.gui
        arrange(gui, width=340)
        gui.add_html(STYLE + live_html.STYLE)
        self._bars = gui.add_html("")
        self._words = gui.add_html(status_html(["no vehicle heard yet"]))
        self._colour = gui.add_dropdown("Colour", ["Load"])
        self._legend = gui.add_html("")
        self._camera = gui.add_dropdown("Camera", [camera.value for camera in Camera])
        self._followed = gui.add_dropdown("Aircraft", ["-"])
        self._tabs = left_panel(gui)
        self._scene = Scene(server)
        self._scene.set_ground(np.array([[-30.0, -30.0, 0.0], [30.0, 30.0, 5.0]]), 0.0)
        self._paths = Paths(server, self._scene)
        put = self._requests.put

        # A page may send anything: only known names are acted on.
        @self._colour.on_update
        async def _(event: Any) -> None:
            name = event.target.value
            put(lambda: self._recolour(name))

        @self._camera.on_update
        async def _(event: Any) -> None:
            if event.target.value in {camera.value for camera in Camera}:
                camera = Camera(event.target.value)
                put(lambda: self._scene.set_camera(camera))

        @self._followed.on_update
        async def _(event: Any) -> None:
            name = str(event.target.value)
            put(lambda: self._follow(name))

    def _run(self, server: viser.ViserServer) -> None:
        while not self._page.stopping.is_set():
            self._heard.wake.wait(0.25)
            self._heard.wake.clear()
            begun = time.monotonic()
            try:
                while not self._requests.empty():
                    self._requests.get()()
                self._draw(server, begun)
            except Exception:
                _log.exception("the live view could not draw")
            took = time.monotonic() - begun
            self.draw_seconds.append(took)
            self._page.stopping.wait(max(FASTEST - took, 0.0))

    def _draw(self, server: viser.ViserServer, now: float) -> None:
        aircraft = self._heard.aircraft()
        spacing = GAUGES_EVERY * max(1.0, len(aircraft) / 2)
        with server.atomic():
            for one in aircraft:
                if one.gone:
                    self._leave(one)
                    continue
                if one.gauges is None:
                    self._add(server, one)
                if (one.fresh or one.age > OLD) and now - one.drawn_s >= spacing:
                    one.drawn_s = now
                    self._show(one)
                elif one.fresh:
                    self._heard.wake.set()  # too soon: once more
            if now - self._bars_s >= BARS_EVERY:
                self._bars_s = now
                bars = fleet_html(self._heard.standing(OLD))
                if bars != self._bars.content:
                    self._bars.content = bars
            if now - self._trails_s >= TRAIL_EVERY:
                self._trails_s = now
                for one in aircraft:
                    self._draw_trail(one)
                self._paths.fit(aircraft)
            if now - self._told_s >= STATUS_EVERY:
                self._told_s = now
                self._words.content = status_html(self._status())

    def _add(self, server: viser.ViserServer, one: Aircraft) -> None:
        key = str(one.number)
        one.tab = self._tabs.add_tab(f"Vehicle {key}")
        with one.tab:
            one.gauges = server.gui.add_html("")
        if one.label is not None:
            return  # it is back, and only its tab had been taken away
        self._scene.add_vehicle(key, self._airframe)
        one.label = server.scene.add_label(
            f"/world/name_{key}",
            f"Vehicle {key}",
            anchor="bottom-center",
            font_screen_scale=1.25,
            visible=False,
        )
        numbers = sorted(other.number for other in self._heard.aircraft())
        self._followed.options = tuple(f"Vehicle {n}" for n in numbers)
        if self._focus is None:
            self._focus = one.number
            overlays = self._heard.overlays
            self._colour.options = tuple(overlay.name for overlay in overlays)
            self._recolour(overlays[0].name)

    def _leave(self, one: Aircraft) -> None:
        """Take away the tab and the aircraft; where it flew stays."""
        if one.gauges is None:
            return
        one.tab.remove()
        one.gauges = None
        one.label.visible = False
        self._scene.hide(str(one.number))

    def _show(self, one: Aircraft) -> None:
        update, age = self._heard.taken(one)
        row = ShownRow(update.analysis, -1, self._offset(one, update))
        self._scene.show(str(one.number), row, focus=one.number == self._focus)
        placed = bool(np.all(np.isfinite(row.position_enu)))
        one.label.visible = placed and len(self._heard.aircraft()) > 1
        if placed:
            one.label.position = row.position_enu + self._scene.above(str(one.number))
        title = f"{self._airframe.title} · vehicle {one.number}"
        html = gauges_html(row, title)
        html += outlook_html(update.outlook, one.stale, update.remarks)
        said = alarms_html(one.number, self._heard.standing(OLD), age, OLD)
        one.gauges.content = said + aged(html, age > OLD)

    def _offset(self, one: Aircraft, update: Update) -> Floats:
        origin = update.analysis.track.origin
        if one.offset is None or one.boot != update.boot:
            if self._origin is None:
                self._origin = origin
            if origin is None or self._origin is None:
                return np.zeros(3)
            home = self._origin
            one.offset = np.array(
                pymap3d.geodetic2enu(
                    *(origin.latitude_deg, origin.longitude_deg, origin.altitude),
                    *(home.latitude_deg, home.longitude_deg, home.altitude),
                )
            )
        return one.offset

    def _draw_trail(self, one: Aircraft) -> None:
        rows, update, waypoints = self._heard.taken_rows(one)
        offset = self._offset(one, update)
        for time_s, place, values in rows:
            one.trail.add(time_s, place + offset, values)
        if rows and one.trail.count:
            self._paths.draw_trail(one, self._heard.overlays[self._shown], self._shown)
        if waypoints and waypoints is not one.plan:
            one.plan = waypoints
            ground = ground_height(update.analysis.track)
            points = plan_enu(list(waypoints.values()), update.analysis.track.origin, ground)
            self._paths.draw_plan(one, points, ground, offset)

    def _recolour(self, name: str) -> None:
        for number, overlay in enumerate(self._heard.overlays):
            if overlay.name == name:
                self._shown = number
                self._legend.content = legend_html(overlay.scale, overlay.note)
                for one in self._heard.aircraft():
                    if one.trail.count:
                        self._paths.draw_trail(one, overlay, number)

    def _follow(self, name: str) -> None:
        for one in self._heard.aircraft():
            if name == f"Vehicle {one.number}":
                self._focus = one.number
