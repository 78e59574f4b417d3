"""The 3D view of aircraft that fly now: a subscriber of the monitor, drawn by a thread of its own.

The compute thread only leaves its latest findings here; the drawing thread wakes at once, and what
it cannot draw in time it leaves out. One tab of gauges an aircraft, with the alarms of all, and one
bar each beside them; all in one scene, placed from the first one's home. A number that is old is
greyed out and its age is written over it; an aircraft that was switched off on the ground leaves.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import pymap3d

from thrustmargin.gcs_plugin.live.alarms.alarm import Alarm, AlarmEvent
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet, Subscriber
from thrustmargin.gcs_plugin.live.watch.update import Update
from thrustmargin.gcs_plugin.view.figures import live_html
from thrustmargin.gcs_plugin.view.figures.before_take_off import FillAdvice
from thrustmargin.gcs_plugin.view.figures.controls import choice
from thrustmargin.gcs_plugin.view.figures.gauges import STYLE, gauges_html
from thrustmargin.gcs_plugin.view.figures.live_html import (
    Standing,
    aged,
    alarms_html,
    fleet_html,
    outlook_html,
    status_html,
)
from thrustmargin.gcs_plugin.view.figures.pilot_bar import PilotBar, snapshot_html
from thrustmargin.gcs_plugin.view.live.live_charts import LiveCharts
from thrustmargin.gcs_plugin.view.live.live_heard import Heard
from thrustmargin.gcs_plugin.view.page.guard import LOOPBACK
from thrustmargin.gcs_plugin.view.page.view_page import ViewPage, arrange, left_panel
from thrustmargin.gcs_plugin.view.scene.camera import Camera
from thrustmargin.gcs_plugin.view.scene.scene import Scene
from thrustmargin.gcs_plugin.view.scene.shown_row import (
    ENU_NED,
    ShownRow,
    enu,
    ground_height,
    plan_enu,
)
from thrustmargin.gcs_plugin.view.scene.surroundings import SprayedGround
from thrustmargin.gcs_plugin.wording import view_words as words
from thrustmargin.gcs_plugin.wording.live_words import NO_VEHICLE
from thrustmargin.gcs_plugin.wording.palette import legend_html
from thrustmargin.mission.route import Trail
from thrustmargin.models.flight import Floats, Origin
from thrustmargin.models.physics.airframe import Airframe

if TYPE_CHECKING:
    import viser

#: s; gauges for up to two aircraft
GAUGES_EVERY, BARS_EVERY, TRAIL_EVERY, STATUS_EVERY, CHARTS_EVERY = 0.1, 0.2, 0.5, 0.5, 0.5


@dataclass(slots=True, eq=False)
class Aircraft:
    """What is drawn of one vehicle; for the drawing thread alone."""

    number: int
    trail: Trail
    offset_ned: Floats | None = None  # (3,) m, its origin from the scene's
    boot: int = 0  # of the flight that the offset belongs to
    plan: Any = None  # mission that is drawn
    tab: Any = None
    gauges: Any = None  # in the tab; None while there is none
    label: Any = None
    shown: Any = None  # rows and words that the gauges show
    drawn_s: float = 0.0
    rotor_count: int = -1  # of the aircraft that is drawn
    sprayed: SprayedGround = field(default_factory=SprayedGround)
    fill: FillAdvice | None = None


class LiveView(ViewPage, Subscriber):
    """The view of every vehicle that a monitor hears; `start` opens it, `stop` ends it.

    `status` gives lines about link and recording, `clock` the ground's time, µs; `silent` makes no
    sound, `max_utilisation` is the limit that the advice before take-off keeps, `acknowledged`
    hears of what the pilot acknowledged. Raises LinkError from `start` when the port is taken.
    """

    def __init__(
        self,
        airframe: Airframe,
        *,
        host: str = LOOPBACK,
        port: int = 8080,
        token: str = "",
        status: Callable[[], list[str]] = list,
        clock: Callable[[], int] | None = None,
        silent: bool = False,
        max_utilisation: float = 0.5,
        acknowledged: Callable[[int, Alarm], None] | None = None,
    ) -> None:
        self._bar = PilotBar(
            lambda: [s.as_drawn(self._drawn.get(s.number)) for s in self._heard.standing],
            style=STYLE + live_html.STYLE,
            silent=silent,
            acknowledged=acknowledged,
        )
        super().__init__("view", host=host, port=port, token=token, every=0.25, addition=self._bar)
        self._airframe = airframe
        self._status, self._limit = status, max_utilisation
        self._heard = Heard(self.wake, clock)
        self._origin: Origin | None = None
        self._shown = 0  # number of the overlay
        self._focus: int | None = None
        self._aircraft: dict[int, Aircraft] = {}
        self._drawn: dict[int, Standing] = {}  # whose figures the gauges show
        self._status_s = self._trails_s = self._bars_s = self._charts_s = 0.0

    def on_update(self, update: Update) -> None:
        """New rows; called on the compute thread."""
        self._heard.update(update)

    def on_event(self, vehicle: int, event: AlarmEvent) -> None:
        """An alarm was raised or cleared; called on the compute thread."""
        self._bar.on_event(vehicle, event)

    def on_round(self, fleet: Fleet, now_us: int) -> None:
        """Ages, alarms and missions; called on the compute thread."""
        self._heard.round(fleet, now_us)

    def _build(self, server: viser.ViserServer) -> None:
        self._gui = gui = server.gui
        self._api = server.scene
        arrange(gui, width=340)
        self._bars = gui.add_html("")
        self._words = gui.add_html(status_html([NO_VEHICLE]))
        self._colour = choice(gui, "Colour", ["Load"], self.ask, self._recolour)
        self._legend = gui.add_html("")
        choice(
            gui, "Camera", [*Camera], self.ask, lambda name: self._scene.set_camera(Camera(name))
        )
        self._followed = choice(gui, "Aircraft", ["-"], self.ask, self._follow)
        self._charts = LiveCharts(gui, self.ask)
        self._tabs = left_panel(gui)
        self._scene = Scene(server)
        self._scene.set_ground(np.array([[-30.0, -30.0, 0.0], [30.0, 30.0, 5.0]]), 0.0)

    def _draw(self, *, hurry: bool) -> None:
        del hurry
        now = time.monotonic()
        fleet = self._heard.standing
        spacing = GAUGES_EVERY * max(1.0, len(fleet) / 2)
        for standing in fleet:
            one = self._aircraft.get(standing.number)
            if standing.gone:
                if one is not None:
                    self._leave(one)
                continue
            if one is None or one.gauges is None:
                one = self._add(standing.number, fleet)
            shown = standing.update, [other.shown for other in fleet]
            if (shown != one.shown or standing.old) and now - one.drawn_s >= spacing:
                one.drawn_s, one.shown = now, shown
                self._show(one, standing, fleet)
            elif shown != one.shown:
                self.wake.set()  # too soon: once more
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
        if now - self._charts_s >= CHARTS_EVERY:
            self._charts_s = now
            self._draw_charts(fleet)
        if now - self._status_s >= STATUS_EVERY:
            self._status_s = now
            self._words.content = status_html(self._status())

    def _draw_charts(self, fleet: list[Standing]) -> None:
        """Of the aircraft that is followed, and its wind."""
        one = next((s for s in fleet if s.number == self._focus and not s.gone), None)
        if one is None or one.update is None:
            self._charts.hide()
            return
        track = one.update.analysis.track
        self._scene.show_wind(np.full(3, np.nan) if one.old else track.wind_ned[-1])
        speeds = self._heard.history[one.number].speeds
        if speeds is None or one.update.analysis.withheld:
            self._charts.hide()
        else:
            airframe = one.update.analysis.model.airframe
            self._charts.show(one.number, airframe, speeds, one.age if one.old else 0.0)

    def _add(self, number: int, fleet: list[Standing]) -> Aircraft:
        overlays = self._heard.overlays
        one = self._aircraft.setdefault(
            number, Aircraft(number, Trail([o.worst for o in overlays]))
        )
        one.tab = self._tabs.add_tab(words.vehicle_name(number))
        with one.tab:
            one.gauges = self._gui.add_html("")
        if one.label is not None:
            return one  # it is back, and only its tab had been taken away
        one.rotor_count = self._airframe.rotor_count
        self._scene.add_vehicle(str(number), self._airframe)
        one.label = self._api.add_label(
            f"/world/name_{number}",
            words.vehicle_name(number),
            anchor="bottom-center",
            font_screen_scale=1.25,
            visible=False,
        )
        self._followed.options = tuple(map(words.vehicle_name, sorted(s.number for s in fleet)))
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
        self._drawn.pop(one.number, None)
        one.gauges = None
        one.label.visible = False
        self._scene.hide(str(one.number))

    def _show(self, one: Aircraft, standing: Standing, fleet: list[Standing]) -> None:
        update = standing.update
        if update is None:
            return
        row = ShownRow(update.analysis, -1, self._offset_ned(one, update))
        airframe = update.analysis.model.airframe
        if airframe.rotor_count != one.rotor_count:
            one.rotor_count = airframe.rotor_count
            self._scene.add_vehicle(str(one.number), airframe)
        focus, faulty = one.number == self._focus, standing.faulty
        self._scene.show(str(one.number), row, focus=focus, faulty=faulty, old=standing.old)
        position = row.position_enu
        placed = bool(np.all(np.isfinite(position)))
        one.label.visible = placed and len(fleet) > 1
        if placed:
            one.label.position = position + self._scene.above(str(one.number))
        html = gauges_html(row, words.titled(airframe.title, one.number), faulty=faulty)
        one.fill = one.fill or FillAdvice(self._limit)
        html += one.fill.html(update.analysis)
        html += outlook_html(update.outlook, standing.stale, update.beside_the_airframe)
        self._drawn[one.number] = standing
        one.gauges.content = (
            alarms_html(one.number, fleet) + aged(html, standing.old) + snapshot_html(standing)
        )

    def _offset_ned(self, one: Aircraft, update: Update) -> Floats:
        """(3,) m from the scene's origin, which is that of the first aircraft, to its own."""
        if one.offset_ned is None or one.boot != update.boot:
            origin = update.analysis.track.origin
            if self._origin is None:
                self._origin = origin
            if origin is None or self._origin is None:
                return np.zeros(3)
            home = self._origin
            one.boot = update.boot
            one.offset_ned = np.array(
                pymap3d.geodetic2ned(
                    *(origin.latitude_deg, origin.longitude_deg, origin.altitude),
                    *(home.latitude_deg, home.longitude_deg, home.altitude),
                )
            )
        return one.offset_ned

    def _draw_trail(self, one: Aircraft, standing: Standing) -> None:
        update, rows = standing.update, self._heard.rows[one.number]
        if update is None:
            return
        offset_ned = self._offset_ned(one, update)
        fresh = bool(rows)
        while rows:
            time_s, position_ned, values, spraying = rows.popleft()
            one.trail.add(time_s, position_ned + offset_ned, values)
            places = (position_ned + offset_ned) @ ENU_NED.T
            height = enu(offset_ned)[2] + ground_height(update.analysis.track)
            one.sprayed.add(places, spraying, height)
        if one.sprayed.changed:
            one.sprayed.changed = False
            self._scene.surroundings.sprayed(str(one.number), one.sprayed.points)
        if update.analysis.track.origin is not None:
            at = np.array([0.0, 0.0, ground_height(update.analysis.track)]) + enu(offset_ned)
            self._scene.surroundings.home(str(one.number), at)
        if fresh:
            self._colour_trail(one)
        origin = update.analysis.track.origin
        if standing.mission is not one.plan and origin is not None:
            one.plan = standing.mission
            ground = ground_height(update.analysis.track)
            places = plan_enu([*(one.plan or {}).values()], origin, ground)
            offset = enu(offset_ned)
            self._scene.set_plan(str(one.number), places + offset, ground + offset[2])
            if len(places) > 1:
                self._scene.hold(
                    np.column_stack([places[:, :2], np.full(len(places), ground)]) + offset
                )

    def _colour_trail(self, one: Aircraft) -> None:
        route, overlay = one.trail.route, self._heard.overlays[self._shown]
        if route.count:
            points = np.stack([enu(route.start_ned), enu(route.end_ned)], axis=1)
            worst = route.worst(one.trail.values(self._shown), overlay.worst)
            self._scene.set_route(str(one.number), points, worst, overlay.scale)
            self._scene.hold(points.reshape(-1, 3))

    def _recolour(self, name: str) -> None:
        for number, overlay in enumerate(self._heard.overlays):
            if overlay.name == name:
                self._shown = number
                self._legend.content = legend_html(overlay.scale, overlay.note)
                for one in self._aircraft.values():
                    self._colour_trail(one)

    def _follow(self, name: str) -> None:
        for number in self._aircraft:
            if name == words.vehicle_name(number):
                self._focus = number
