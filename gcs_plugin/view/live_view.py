"""The 3D view of aircraft that fly now: an output of the monitor, drawn by a thread of its own.

The compute thread leaves its newest findings in `HeardVehicles` and sets `wake`; the drawing thread
draws the newest state, and skips what it cannot draw in time. All aircraft are in one scene, placed
from the first one's home; one that was switched off on the ground is removed. Numbers and alarms
are the page's part (figures/screen.py).
"""

from __future__ import annotations

import threading
import time
from collections import defaultdict, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from thrustmargin.gcs_plugin.live.alarms.alarm import Alarm, AlarmEvent
from thrustmargin.gcs_plugin.live.console import rowless_lines, status_lines
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.live.live_monitor import OutputContext
from thrustmargin.gcs_plugin.live.output import Output
from thrustmargin.gcs_plugin.live.watch.update import Update
from thrustmargin.gcs_plugin.live.watch.vehicle_monitor import VehicleMonitor
from thrustmargin.gcs_plugin.view.figures.charts import LIVE_WINDOW_S, Speeds, chart_images
from thrustmargin.gcs_plugin.view.figures.screen import FillAdvice, PageState, field_state
from thrustmargin.gcs_plugin.view.figures.vehicle_summary import VehicleSummary
from thrustmargin.gcs_plugin.view.page.guard import LOOPBACK, is_loopback
from thrustmargin.gcs_plugin.view.page.view_page import OPEN_TO_ALL, BrowserTab, Tabs, ViewPage
from thrustmargin.gcs_plugin.view.scene.overlays import Overlay, overlays_of
from thrustmargin.gcs_plugin.view.scene.scene import Scene
from thrustmargin.gcs_plugin.view.scene.shown_row import (
    ShownRow,
    enu,
    ground_height,
    lower_ends,
    plan_enu,
)
from thrustmargin.gcs_plugin.view.scene.surroundings import Camera, SprayedGround
from thrustmargin.gcs_plugin.wording import thrust_left
from thrustmargin.gcs_plugin.wording.language import Sentence
from thrustmargin.mission.route import Trail
from thrustmargin.models.flight import Bools, Floats, Origin
from thrustmargin.models.physics.airframe import Airframe

if TYPE_CHECKING:
    import viser

AIRCRAFT_EVERY, TRAIL_EVERY = 0.1, 0.5  # s; the first for up to two aircraft
KEPT_S = 600.0  # s of rotor speeds that the charts can go back
STALE_EVERY = 0.5  # s between two looks at which fields are no longer reported


class LiveHistory:
    """The rotor speeds of one aircraft over the last KEPT_S s.

    The compute thread calls `add`, the drawing thread reads `speeds`.
    """

    def __init__(self) -> None:
        self._parts: deque[Speeds] = deque()
        self._boot = 0

    def add(self, update: Update) -> None:
        """Append the new rows of an update; rows older than KEPT_S s before the newest are dropped.

        All earlier rows are dropped after a restart or with another number of rotors.
        """
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
        """Return the speeds in all stored rows; None before the first."""
        parts = list(self._parts)
        if not parts:
            return None
        rotors = parts[-1].measured.shape[1]
        parts = [part for part in parts if part.measured.shape[1] == rotors]
        return Speeds(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


class HeardVehicles:
    """The newest state of each aircraft, passed from the compute thread to the drawing thread.

    Each `VehicleSummary` is replaced as a whole and never changed, so no lock is needed; rows for
    the trails wait in a queue for each aircraft. `wake` is set when there is something new to draw;
    `overlays` are those of the last rows; `least` is the share of thrust that must be left. `clock`
    is the ground's, µs: with it ages increase while the compute thread is busy; without it they are
    those of the last `round`.
    """

    def __init__(
        self,
        wake: threading.Event,
        clock: Callable[[], int] | None = None,
        *,
        least: float = 0.5,
    ) -> None:
        self.wake = wake
        self._clock, self._least = clock, least
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
        """Return all aircraft with rows, in the order in which they were first heard."""
        known = list(self._summaries.values())
        return known if self._clock is None else [self._aged(s, self._clock()) for s in known]

    def _aged(self, one: VehicleSummary, now_us: int) -> VehicleSummary:
        watch = self._watches.get(one.number)
        if watch is None or one.update is None:
            return one
        return replace(one, age=one.update.age_s(now_us), silent=watch.link.silent(now_us))

    def update(self, update: Update) -> None:
        """Store the new rows of one aircraft for trail and charts, and its summary; set `wake`."""
        number, track = update.vehicle, update.analysis.track
        overlays = overlays_of(update.analysis, self._least)
        values = np.column_stack([overlay.values for overlay in overlays])
        fresh = update.first + np.flatnonzero(track.flying[update.first :])
        self.rows[number].append(
            (update.clock_s[fresh], track.position_ned[fresh], values[fresh], track.spraying[fresh])
        )
        self.history[number].add(update)
        self.overlays = overlays
        before = self._summaries.get(number) or VehicleSummary(number=number)
        row = self._shown_row(update, None if before.row is None else before.row.low)
        self._put(
            replace(
                before,
                row=row,
                update=update,
                seconds_to_empty=update.outlook.seconds_to_empty,
            )
        )
        self.wake.set()

    def _shown_row(self, update: Update, before: Bools | None) -> ShownRow:
        """Return the update's last row, with flags of the rotors that have too little thrust left.

        The flags have hysteresis: `before` (R,) are those of the last update, None without one.
        """
        left = lower_ends(update.analysis)[update.first :]
        rotors = left.shape[1]
        begin = np.zeros(rotors, dtype=np.bool_)
        if before is not None and before.size == rotors:
            begin = before
        low = thrust_left.too_little(left, self._least, begin)[-1] if len(left) else begin
        return ShownRow(update.analysis, -1, least=self._least, low=low)

    def round(self, fleet: Fleet, now_us: int) -> None:
        """Store ages, alarms and missions of all aircraft that have rows, as of `now_us`, the
        ground's clock.

        Set `wake` if anything shown has changed.
        """
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
                problem=Sentence.of(lambda one=watch: one.problem),
                gone=watch.has_left(now_us),
                mission=watch.state.mission,
                stale=Sentence.of(partial(watch.stale, now_us)) if look else before.stale,
            )
            self._put(now)
            if now.shown != before.shown:
                self.wake.set()

    def _put(self, one: VehicleSummary) -> None:
        self._summaries = {**self._summaries, one.number: one}


@dataclass(slots=True, eq=False)
class Aircraft:
    """The state of one vehicle that all browsers share; used by the drawing thread alone."""

    number: int
    trail: Trail
    offset_ned: Floats | None = None  # (3,) m, its origin from the scene's
    boot: int = 0  # of the flight that the offset belongs to
    plan: Any = None  # mission that is drawn
    sprayed: SprayedGround = field(default_factory=SprayedGround)


@dataclass(slots=True, eq=False)
class Drawn:
    """State of one vehicle's drawing in one tab; used by the drawing thread alone."""

    label: Any
    rotor_count: int
    there: bool = True  # in the scene
    shown: Any = None  # rows and alarms that the scene shows
    drawn_s: float = 0.0


@dataclass(slots=True, eq=False)
class LiveTab(BrowserTab):
    """A tab of the live page, with its own colour and aircraft in focus."""

    colour: int = 0  # number of the overlay
    focus: int | None = None  # None: the first that was heard
    drawn: dict[int, Drawn] = field(default_factory=dict)


class LiveView(ViewPage, Output):
    """The output that draws every vehicle that a monitor hears on a page.

    `status` returns lines about link and recording, `listens` are the links listened to, `clock`
    returns the ground's time, µs; `silent` makes no sound, `max_utilisation` is the limit for the
    advice before take-off, `acknowledged` is called with each alarm that the pilot acknowledges.
    With `browser` not None, `start` prints where the page is, and opens it in the browser if True.
    Raises LinkError from `start` when the port is taken.
    """

    name = "page"

    def __init__(
        self,
        airframe: Airframe,
        *,
        host: str = LOOPBACK,
        port: int = 8080,
        token: str = "",
        status: Callable[[], list[str]] = list,
        listens: Sequence[str] = (),
        clock: Callable[[], int] | None = None,
        silent: bool = False,
        max_utilisation: float = 0.5,
        acknowledged: Callable[[int, Alarm], None] | None = None,
        browser: bool | None = None,
    ) -> None:
        self._screen = PageState(
            self._fleet,
            {
                "colour": self._choose_colour,
                "camera": self._choose_camera,
                "follow": lambda number, tab: self._follow(self._tabs.of(tab), int(number)),
            },
            more=self._live_state,
            charts=self._drawn_charts,
            connected=self._connected,
            silent=silent,
            acknowledged=acknowledged,
            clock=clock,
        )
        super().__init__(
            "view", host=host, port=port, token=token, every=0.25, addition=self._screen
        )
        self._airframe = airframe
        self._status, self._limit, self._browser = status, max_utilisation, browser
        self._listens, self._open = tuple(listens), not is_loopback(host)
        self._heard = HeardVehicles(self.wake, clock, least=1.0 - max_utilisation)
        self._origin: Origin | None = None
        self._tabs = Tabs(LiveTab)
        self._aircraft: dict[int, Aircraft] = {}
        self._fill: dict[int, FillAdvice] = {}
        self._trails_s = 0.0

    def start(self) -> None:
        super().start()
        if self._browser is not None:
            self.announce(browser=self._browser)

    def close(self) -> None:
        self.stop()

    def on_update(self, update: Update) -> None:
        """Store new rows; called on the compute thread."""
        self._heard.update(update)

    def on_event(self, vehicle: int, event: AlarmEvent) -> None:
        """Display a change of an alarm; called on the compute thread."""
        self._screen.on_event(vehicle, event)

    def on_plan(self, vehicle: int, text: str) -> None:
        self._screen.note(vehicle, "plan", text)

    def on_round(self, fleet: Fleet, now_us: int) -> None:
        """Store ages, alarms and missions; called on the compute thread."""
        self._heard.round(fleet, now_us)

    def _build(self, server: viser.ViserServer) -> None:
        self._scene = Scene(server)
        self._scene.set_ground(np.array([[-30.0, -30.0, 0.0], [30.0, 30.0, 5.0]]), 0.0)

    def _draw(self) -> None:
        if self._server is None:
            return
        now = time.monotonic()
        fleet = self._heard.summaries
        for summary in fleet:
            if not summary.gone and summary.number not in self._aircraft:
                trail = Trail([overlay.worst for overlay in self._heard.overlays])
                self._aircraft[summary.number] = Aircraft(summary.number, trail)
        tabs, new = self._tabs.drawn(self._server, self._scene)
        for tab in new:
            tab.drawn = {}
            for one in self._aircraft.values():
                self._colour_trail(one, tab)
        spacing = AIRCRAFT_EVERY * max(1.0, len(fleet) * len(tabs) / 2)
        for tab in tabs:
            if tab.scene is not None:
                with tab.scene.atomic():
                    self._draw_tab(tab, tab.scene, fleet, now, spacing)
        if now - self._trails_s >= TRAIL_EVERY:
            self._trails_s = now
            for summary in fleet:
                if summary.number in self._aircraft:
                    self._draw_trail(self._aircraft[summary.number], summary, tabs)

    def _draw_tab(
        self,
        tab: LiveTab,
        scene: Scene,
        fleet: list[VehicleSummary],
        now: float,
        spacing: float,
    ) -> None:
        """Draw the newest row of each vehicle of `fleet` in one tab's scene, at most every
        `spacing` s.

        `now` is the monotonic clock, s. Vehicles that have left are hidden; their trails stay.
        """
        for summary in fleet:
            one = tab.drawn.get(summary.number)
            if summary.gone:
                if one is not None:  # where it flew stays
                    one.there, one.shown, one.label.visible = False, None, False
                    scene.hide(str(summary.number))
                continue
            if one is None:
                one = tab.drawn[summary.number] = self._added(scene, summary.number)
            one.there = True
            if tab.focus is None:
                tab.focus = summary.number
            shown = summary.update, summary.shown, summary.old
            if shown != one.shown and now - one.drawn_s >= spacing:
                one.drawn_s, one.shown = now, shown
                self._show(tab, scene, one, summary, fleet)
            elif shown != one.shown:
                self.wake.set()  # too soon: once more
            if summary.number == tab.focus and summary.row is not None:
                wind_ned = summary.row.analysis.track.wind_ned[-1]
                scene.show_wind(np.full(3, np.nan) if summary.old else wind_ned)

    def _fleet(self, _tab: str) -> list[VehicleSummary]:
        """Return the summaries, with the largest fill for aircraft on the ground."""
        return [self._advised(one) for one in self._heard.summaries]

    def _advised(self, one: VehicleSummary) -> VehicleSummary:
        """Return a summary with the largest fill, in kg and words; unchanged without one.

        Only this function makes the page's line on the fill.
        """
        advice = self._fill.setdefault(one.number, FillAdvice(self._limit))
        largest = None if one.update is None else advice.fill(one.update.analysis)
        if one.update is None or largest is None:
            return one
        return replace(one, largest=largest, fill=advice.text(largest))

    def _live_state(self, tab: str) -> dict[str, Any]:
        """Return a tab's state without the aircraft as JSON: `status` (link), `field` (overlay and
        camera, None before the first row) and `follow` (the aircraft in focus).

        While no aircraft is heard it also includes, as `waiting`, what to display before the first
        message.
        """
        overlays, one = self._heard.overlays, self._tabs.of(tab)
        field = None
        if overlays:
            names = [overlay.name for overlay in overlays]
            field = field_state(names, overlays[one.colour], one.camera)
        shown = {"status": self._status(), "field": field, "follow": one.focus}
        if not all(summary.gone for summary in self._heard.summaries):
            return shown
        return {**shown, "waiting": self._waiting()}

    def _waiting(self) -> dict[str, Any]:
        """Return what to display before the first message: links, and the way for a phone.

        `page` is the address for a phone, `option` the option that opens the page to other devices.
        """
        return {
            "listens": self._listens,
            "page": self.phone_page(),
            "open": self._open,
            "option": OPEN_TO_ALL,
        }

    def _drawn_charts(self, number: int, back_s: float, _tab: str) -> dict[str, Any]:
        """Return the charts of vehicle `number`, ending `back_s` s before its newest row, as JSON.

        An empty list without rows or a verdict, or if the vehicle has left.
        """
        one = next((s for s in self._heard.summaries if s.number == number and not s.gone), None)
        history = self._heard.history.get(number)
        speeds = None if history is None else history.speeds
        if one is None or one.row is None or speeds is None or one.row.analysis.no_verdict:
            return {"charts": []}
        newest_s = float(speeds.time_s[-1])
        end_s = max(newest_s - back_s, float(speeds.time_s[0]))
        shown = {"window_s": LIVE_WINDOW_S, "future_share": 0.0}
        made = chart_images(one.row.analysis.places, speeds, end_s, **shown)
        return {
            "charts": made,
            "back": round(newest_s - end_s + one.age, 1) if back_s else 0.0,
            "age": one.age if one.old else 0.0,
        }

    def _connected(self, tab: str, client: int) -> None:
        """Store viser's number of a tab's connection; called on a thread of the server."""
        if (one := self._tabs.of(tab)).name and one.wanted != client:
            one.wanted = client
            self.wake.set()

    def _choose_camera(self, name: str, tab: str) -> None:
        camera, one = Camera(name), self._tabs.of(tab)
        self.ask(lambda: self._set_camera(one, camera))

    def _set_camera(self, tab: LiveTab, camera: Camera) -> None:
        tab.camera = camera
        if tab.scene is not None:
            tab.scene.set_camera(camera)

    def _added(self, scene: Scene, number: int) -> Drawn:
        """Add a vehicle to a scene, with its name above it."""
        scene.add_vehicle(str(number), self._airframe)
        return Drawn(scene.add_name(str(number)), self._airframe.rotor_count)

    def _show(
        self,
        tab: LiveTab,
        scene: Scene,
        one: Drawn,
        summary: VehicleSummary,
        fleet: list[VehicleSummary],
    ) -> None:
        update, key = summary.update, str(summary.number)
        if update is None:
            return
        offset_ned = self._offset_ned(self._aircraft[summary.number], update)
        shown = summary.row
        assert shown is not None
        row = replace(shown, analysis=update.analysis, offset_ned=offset_ned)
        airframe = update.analysis.model.airframe
        if airframe.rotor_count != one.rotor_count:
            one.rotor_count = airframe.rotor_count
            scene.add_vehicle(key, airframe)
        focus = summary.number == tab.focus
        scene.show(key, row, focus=focus, faulty=summary.faulty, old=summary.old)
        position = row.position_enu
        placed = bool(np.all(np.isfinite(position)))
        one.label.visible = placed and len(fleet) > 1
        if placed:
            one.label.position = position + scene.above(key)

    def _offset_ned(self, one: Aircraft, update: Update) -> Floats:
        """Return the vector (3,), m NED, from the scene's origin to that of the aircraft's
        positions.

        The scene's origin is that of the first aircraft that has one. Zero while either is unknown.
        """
        if one.offset_ned is None or one.boot != update.boot:
            origin = update.analysis.track.origin
            if self._origin is None:
                self._origin = origin
            if origin is None or self._origin is None:
                return np.zeros(3)
            one.boot = update.boot
            one.offset_ned = self._origin.ned(origin.geodetic(np.zeros(3)))
        return one.offset_ned

    def _draw_trail(self, one: Aircraft, summary: VehicleSummary, tabs: list[LiveTab]) -> None:
        update, rows, key = summary.update, self._heard.rows[one.number], str(one.number)
        if update is None:
            return
        track, offset_ned = update.analysis.track, self._offset_ned(one, update)
        ground, offset, fresh = ground_height(track), enu(offset_ned), bool(rows)
        while rows:
            time_s, position_ned, values, spraying = rows.popleft()
            one.trail.add(time_s, position_ned + offset_ned, values)
            one.sprayed.add(enu(position_ned + offset_ned), spraying, offset[2] + ground)
        if one.sprayed.changed:
            one.sprayed.changed = False
            self._scene.surroundings.draw_sprayed(key, one.sprayed.points)
        for tab in tabs if fresh else ():
            self._colour_trail(one, tab)
        if track.origin is None:
            return
        self._scene.surroundings.home(key, offset + np.array([0.0, 0.0, ground]))
        if summary.mission is not one.plan:
            one.plan = summary.mission
            places = plan_enu([*(one.plan or {}).values()], track.origin, ground) + offset
            self._scene.set_plan(key, places, ground + offset[2])
            if len(places) > 1:
                self._scene.hold(
                    np.column_stack([places[:, :2], np.full(len(places), ground + offset[2])])
                )

    def _colour_trail(self, one: Aircraft, tab: LiveTab) -> None:
        route, overlay = one.trail.route, self._heard.overlays[tab.colour]
        if route.count and tab.scene is not None:
            points = np.stack([enu(route.start_ned), enu(route.end_ned)], axis=1)
            worst = route.worst(one.trail.values(tab.colour), overlay.worst)
            tab.scene.set_route(str(one.number), points, worst, overlay.scale)
            self._scene.hold(points.reshape(-1, 3))

    def _choose_colour(self, name: str, tab: str) -> None:
        one = self._tabs.of(tab)
        self.ask(lambda: self._recolour(one, name))

    def _recolour(self, tab: LiveTab, name: str) -> None:
        names = [overlay.name for overlay in self._heard.overlays]
        if name in names:
            tab.colour = names.index(name)
            for one in self._aircraft.values():
                self._colour_trail(one, tab)

    def _follow(self, tab: LiveTab, number: int) -> None:
        if number in self._aircraft:
            tab.focus = number


def output(context: OutputContext, value: bool) -> LiveView:  # noqa: ARG001
    """Return the output of the option `--view`, the page."""
    monitor = context.monitor
    names = ("host", "port", "token", "browser", "silent", "max_utilisation")
    return LiveView(
        monitor.model.airframe,
        **{name: context.options[name] for name in names},
        status=lambda: [*status_lines(monitor.status(), page=True), *rowless_lines(monitor.fleet)],
        listens=monitor.settings.urls,
        clock=monitor.now_us,
        acknowledged=monitor.acknowledge,
    )
