"""A flight replayed on the screen: one thread moves the scene by the replay's clock.

It is the only one that draws. It ticks at a fixed rate and assigns to nodes that exist; the
analysis was done before, and what the browser asks for only moves the clock or asks this thread.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from thrustmargin.gcs_plugin.live.alarms.alarm import CRITICAL, Alarm
from thrustmargin.gcs_plugin.live.watch.outlook import recorded_seconds_to_empty
from thrustmargin.gcs_plugin.view.figures import charts
from thrustmargin.gcs_plugin.view.figures.charts import SPEEDS, ReplayClock
from thrustmargin.gcs_plugin.view.figures.screen import Acts, PageState, field_state, finite
from thrustmargin.gcs_plugin.view.figures.vehicle_summary import VehicleSummary
from thrustmargin.gcs_plugin.view.page.guard import LOOPBACK
from thrustmargin.gcs_plugin.view.page.view_page import BrowserTab, Tabs, ViewPage
from thrustmargin.gcs_plugin.view.scene.overlays import (
    Overlay,
    overlays_of,
    planned_overlays,
    speed_overlay,
)
from thrustmargin.gcs_plugin.view.scene.scene import Scene, row_hit
from thrustmargin.gcs_plugin.view.scene.shown_row import (
    ShownRow,
    enu,
    ground_height,
    lower_ends,
    plan_enu,
    row_at,
)
from thrustmargin.gcs_plugin.view.scene.surroundings import Camera
from thrustmargin.gcs_plugin.wording import live_words as words
from thrustmargin.gcs_plugin.wording import thrust_left
from thrustmargin.gcs_plugin.wording.answer import FlightAnswer
from thrustmargin.gcs_plugin.wording.check_words import no_verdict_words
from thrustmargin.gcs_plugin.wording.forecast_words import fill_words, verdict
from thrustmargin.gcs_plugin.wording.glance_words import alarm_then
from thrustmargin.gcs_plugin.wording.language import say, spoken
from thrustmargin.mission.field import sprayed_field
from thrustmargin.mission.forecast.plan_forecast import PlanForecast
from thrustmargin.mission.route import Trail
from thrustmargin.models.errors import DataError
from thrustmargin.models.model.advice import explained_by_stop, stopped_episodes
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.fault_test import RotorFault
from thrustmargin.models.model.rotor_faults import FaultEpisode, fault_history

if TYPE_CHECKING:
    import viser
    from viser import SceneClickEvent

    from thrustmargin.mission.plan_items import PlanItem

TICK_HZ = 15.0
#: How long a message of the vehicle stays on the screen, s of the flight.
MESSAGE_S = 10.0
VEHICLE = "1"
#: Rows of flight that are searched for bad rotors and motors before the page is opened: a quarter
#: of a second. More of them later: the first picture needs the whole computer for `PICTURE_S`.
SEARCHED_FIRST, PICTURE_S = 3000, 2.0
#: s after which the search does not wait for a browser any longer.
NOBODY_S = 20.0
_log = logging.getLogger(__name__)


@dataclass(slots=True, eq=False, kw_only=True)
class ReplayTab(BrowserTab):
    """A tab of a replay, with its own time and colour."""

    clock: ReplayClock
    overlay: Overlay
    pinned: dict[str, Any] | None = None  # the worst place, as the legend has it


class ReplayView(ViewPage):
    """The view of one analysed flight. `start` opens it, `stop` closes it; `url` is its address.

    `waypoints` are the log's mission items and `messages` its texts with their time in s from the
    first row; `whole` returns the answer of the whole flight in the current language; `overlays`
    are further ways to colour the route, besides those of the analysis; a `planned` flight has only
    those; `limit` is the largest share of a rotor's maximum thrust that may be in use. After its
    end the replay stops at the worst row. Raises DataError for a flight without rows, and LinkError
    from `start` when the port is taken.
    """

    def __init__(
        self,
        analysis: FlightAnalysis,
        *,
        waypoints: Sequence[PlanItem] = (),
        messages: Sequence[tuple[float, str]] = (),
        overlays: Sequence[Overlay] = (),
        host: str = LOOPBACK,
        port: int = 8080,
        token: str = "",
        speed: float = 1.0,
        paused: bool = False,
        whole: FlightAnswer | Callable[[], FlightAnswer] | None = None,
        planned: bool = False,
        limit: float = 0.5,
    ) -> None:
        self._answer = whole if callable(whole) else lambda: whole
        self._answers: dict[str, FlightAnswer | None] = {}  # by language
        self._screen = PageState(
            lambda tab: [self._summary_at(self._tabs.of(tab).clock.now())],
            self._acts(),
            more=self._replay_state,
            charts=self._drawn_charts,
            connected=self._connected,
            recorded=True,
            planned=planned,
            timeline=charts.timeline_colours(analysis, 1.0 - limit),
        )
        super().__init__(
            "plan" if planned else "replay",
            host=host,
            port=port,
            token=token,
            every=1 / TICK_HZ,
            addition=self._screen,
        )
        track = analysis.track
        if track.time_s.size == 0:
            raise DataError(f"{track.name}: no rows to replay; is the log empty?")
        if not 0 < speed < np.inf:
            raise DataError(f"a replay cannot run at speed {speed:g}; give a number above 0")
        self._analysis, self._least = analysis, 1.0 - limit
        self._low = thrust_left.too_little(lower_ends(analysis), self._least)
        self._airframe = analysis.model.airframe
        self._speeds = charts.Speeds.of(analysis)
        shown = (
            (speed_overlay(track),) if analysis.no_verdict else overlays_of(analysis, self._least)
        )
        self._overlays = tuple(overlays) if planned else (*shown, *overlays)
        self._waypoints = waypoints
        self._messages = sorted(messages)
        self._message_times = np.array([t for t, _ in self._messages])
        self._faults: list[tuple[float, tuple[RotorFault, ...]]] = []
        self._fault_times = np.empty(0)
        self._stopped: list[FaultEpisode] = []
        self._alarms_pending = words.ALARMS_SOUGHT
        self._opened = threading.Event()
        if track.time_s.size <= SEARCHED_FIRST:
            self._search_faults()
        self._start_s = float(track.time_s[0])
        self._flown = track.flying if track.flying.any() else np.ones_like(track.flying)
        self._trail = Trail([o.worst for o in self._overlays])
        self._trail.add(
            track.time_s[self._flown],
            track.position_ned[self._flown],
            np.column_stack([o.values for o in self._overlays])[self._flown],
        )
        self._speed, self._paused, self._begin_s = speed, paused, 0.0  # of tabs that open
        self._tabs = Tabs(self._new_tab)

    def _new_tab(self, name: str) -> ReplayTab:
        """Return a tab with the first overlay, at the time and state set by `seek` and `pause`.

        Without such a call it plays from the begin of the flight.
        """
        overlay = self._overlays[0]
        worst = self._worst_row(overlay)
        rest = None if worst is None else self._time_of(worst)
        duration = self._analysis.track.duration
        clock = ReplayClock(duration, speed=self._speed, paused=self._paused, rest=rest)
        clock.seek(self._begin_s)
        return ReplayTab(name, clock=clock, overlay=overlay)

    def _connected(self, tab: str, client: int) -> None:
        """Store viser's number of a tab's connection; called on a thread of the server."""
        if (one := self._tabs.of(tab)).name and one.wanted != client:
            one.wanted = client
            self.wake.set()

    @property
    def clock(self) -> ReplayClock:
        """Return the clock for programs that name no tab; each browser tab has its own."""
        return self._tabs.shared.clock

    @property
    def _every_tab(self) -> list[ReplayTab]:
        return [self._tabs.shared, *self._tabs.all]

    def seek(self, time_s: float) -> None:
        """Go to a time of the flight, s after its first row, in every browser."""
        self._begin_s = time_s
        for tab in self._every_tab:
            self._seek(tab, time_s)

    def _seek(self, tab: ReplayTab, time_s: float) -> None:
        tab.clock.seek(time_s)
        self.wake.set()

    def play(self) -> None:
        """Start the playback in every browser."""
        self._paused = False
        for tab in self._every_tab:
            tab.clock.play()

    def pause(self) -> None:
        """Stop the time in every browser."""
        self._paused = True
        for tab in self._every_tab:
            tab.clock.pause()

    def set_overlay(self, name: str) -> None:
        """Colour the route by the overlay of this name, in every browser.

        Raises DataError for an unknown name.
        """
        for tab in self._every_tab:
            self._set_overlay(tab, name)

    def _set_overlay(self, tab: ReplayTab, name: str) -> None:
        by_name = {o.name: o for o in self._overlays}
        if name not in by_name:
            raise DataError(f"no colour {name!r} for the route; there are {', '.join(by_name)}")
        self.ask(lambda: self._recolour(tab, by_name[name]))

    def set_camera(self, camera: Camera) -> None:
        """Show the whole field, or follow the aircraft, in every browser."""
        for tab in self._every_tab:
            self.ask(partial(self._set_camera, tab, camera))

    def _set_camera(self, tab: ReplayTab, camera: Camera) -> None:
        tab.camera = camera
        if tab.scene is not None:
            tab.scene.set_camera(camera)

    def _build(self, server: viser.ViserServer) -> None:
        track = self._analysis.track
        self._scene = Scene(server)
        server.scene.on_click()(self._clicked)
        ground = ground_height(track)
        self._scene.set_ground(enu(track.position_ned), ground)
        self._scene.set_field(sprayed_field(track.time_s, track.position_ned, track.spraying))
        self._scene.set_plan(VEHICLE, plan_enu(self._waypoints, track.origin, ground), ground)
        if self._trail.route.count:
            begin = enu(self._trail.route.start_ned[0])
            self._scene.surroundings.home(VEHICLE, np.array([*begin[:2], ground]))
        self._draw()
        if self._alarms_pending:
            server.on_client_connect(lambda _: self._opened.set())
            threading.Thread(target=self._search_later, name="replay-search", daemon=True).start()

    def _search_later(self) -> None:
        """Find the alarms of a long flight on a thread of its own, after the first browser has
        drawn the page."""
        if self._opened.wait(NOBODY_S):
            self._stopping.wait(PICTURE_S)
        if self._stopping.is_set():
            return
        try:
            self._search_faults()
        except Exception:  # of any kind: the page must not say for ever that it is looking
            _log.exception(words.ALARMS_UNKNOWN)
            self._alarms_pending = words.ALARMS_UNKNOWN
        self.wake.set()

    def _search_faults(self) -> None:
        self._faults = fault_history(self._analysis)
        self._fault_times = np.array([time_s for time_s, _ in self._faults])
        self._stopped = stopped_episodes(self._analysis.track)
        self._alarms_pending = ""

    def _draw(self) -> None:
        if self._server is None:
            return
        tabs, new = self._tabs.drawn(self._server, self._scene)
        for tab in new:
            assert tab.scene is not None
            tab.scene.add_vehicle(VEHICLE, self._airframe)
            self._recolour(tab, tab.overlay)
        for tab in tabs:
            if tab.scene is not None:
                with tab.scene.atomic():
                    self._show(tab, tab.scene)

    def _show(self, tab: ReplayTab, scene: Scene) -> None:
        """Draw the row at the time of a tab's clock in its scene."""
        summary = self._summary_at(tab.clock.now())
        row = summary.row
        assert row is not None
        scene.show(VEHICLE, row, faulty=summary.faulty)
        scene.show_wind(row.analysis.track.wind_ned[row.row])

    def _acts(self) -> Acts:
        """Return a function for each action that the page may request, by the action's name.

        Each is called with the request's text and the tab's name, and raises ValueError or
        DataError for a text that it does not take.
        """

        def of(tab: str) -> ReplayTab:
            return self._tabs.of(tab)

        def speed(text: str, tab: str) -> None:
            if float(text) not in SPEEDS:
                raise ValueError(text)
            of(tab).clock.set_speed(float(text))

        return {
            "play": lambda _, tab: of(tab).clock.play(),
            "pause": lambda _, tab: of(tab).clock.pause(),
            "seek": lambda text, tab: self._seek(of(tab), finite(text)),
            "speed": speed,
            "worst": lambda _, tab: self.ask(lambda: self._to_worst(of(tab))),
            "colour": lambda text, tab: self._set_overlay(of(tab), text),
            "camera": lambda text, tab: self._choose_camera(of(tab), Camera(text)),
        }

    def _choose_camera(self, tab: ReplayTab, camera: Camera) -> None:
        self.ask(lambda: self._set_camera(tab, camera))

    def _replay_state(self, tab: str) -> dict[str, Any]:
        """Return a tab's state without the aircraft as JSON: `replay` and `field`.

        `replay` has `time`, `duration` and `worst` (time of the worst value, None if unknown), s
        from the first row, if it is `playing` or `ended`, and the `speed` among `speeds`. `field`
        is the state of overlay and camera, with the pinned `worst` value.
        """
        one = self._tabs.of(tab)
        clock, worst = one.clock, self._worst_row(one.overlay)
        return {
            "replay": {
                "time": round(clock.now(), 2),
                "duration": clock.duration,
                "playing": clock.playing,
                "ended": clock.ended,
                "speed": clock.speed,
                "speeds": SPEEDS,
                "worst": None if worst is None else self._time_of(worst),
            },
            "field": {
                **field_state([o.name for o in self._overlays], one.overlay, one.camera),
                "worst": one.pinned,
            },
        }

    def _drawn_charts(self, _number: int, _back_s: float, tab: str) -> dict[str, Any]:
        now_s = self._start_s + self._tabs.of(tab).clock.now()
        shown = {"window_s": charts.WINDOW_S, "future_share": charts.FUTURE_SHARE}
        return {"charts": charts.chart_images(self._analysis.places, self._speeds, now_s, **shown)}

    def _clicked(self, event: SceneClickEvent) -> None:
        """Move the tab's time to the row of the position nearest to the click, if near."""
        tab = self._tabs.of_client(event.client_id)
        if tab.scene is None:
            return
        origin, ray = tab.scene.in_world(event.ray_origin, event.ray_direction)
        row = row_hit(enu(self._analysis.track.position_ned), self._flown, origin, ray)
        if row is not None:
            self._seek(tab, self._time_of(row))

    def _message_at(self, time_s: float) -> str:
        """Return the vehicle's last message up to `time_s`, s from the first row.

        Empty if there is none, or it is more than MESSAGE_S s older.
        """
        last = int(np.searchsorted(self._message_times, time_s, side="right")) - 1
        if last < 0 or time_s - self._messages[last][0] > MESSAGE_S:
            return ""
        return self._messages[last][1]

    @property
    def whole(self) -> FlightAnswer | None:
        """Return the answer of the whole flight in the current language; None without one."""
        language = spoken()
        if language not in self._answers:
            self._answers[language] = self._answer()
        return self._answers[language]

    def _summary_at(self, time_s: float) -> VehicleSummary:
        """Return the vehicle's summary at `time_s`, s from the first row.

        Its alarms are the faults of rotors and motors that are known from the rows up to then.
        """
        at_s = self._start_s + time_s
        at = row_at(self._analysis.track.time_s, at_s)
        row = ShownRow(self._analysis, at, least=self._least, low=self._low[at])
        last = int(np.searchsorted(self._fault_times, at_s, side="right")) - 1
        stopped = [e.fault for e in self._stopped if e.holds(at_s)]
        found = self._faults[last][1] if last >= 0 else ()
        faults = (*stopped, *(f for f in found if not explained_by_stop(f, self._stopped, at_s)))
        names = {"propeller": "rotor", "motor": "motor", "stopped": "stopped"}
        return VehicleSummary(
            number=1,
            whole=self.whole,
            recorded=True,
            row=row,
            seconds_to_empty=recorded_seconds_to_empty(row.analysis.track, row.row),
            problem="; ".join(no_verdict_words(self._analysis.airframe_match)),
            pending=say(self._alarms_pending),
            message=self._message_at(time_s),
            alarms=tuple(
                Alarm(
                    names[f.kind],
                    None if f.rotors else f.rotor + 1,
                    CRITICAL,
                    alarm_then(f, self._analysis.places),
                    time_s,
                    rotors=tuple(rotor + 1 for rotor in f.rotors),
                )
                for f in faults
            ),
        )

    def _recolour(self, tab: ReplayTab, overlay: Overlay) -> None:
        tab.overlay = overlay
        route = self._trail.route
        row = self._worst_row(overlay)
        time_s = None if row is None else self._time_of(row)
        tab.pinned = (
            None
            if row is None or time_s is None
            else overlay.at(row, time_s, self._analysis.places)
        )
        if tab.scene is None:
            return
        points = np.stack([enu(route.start_ned), enu(route.end_ned)], axis=1)
        worst = route.worst(self._trail.values(self._overlays.index(overlay)), overlay.worst)
        tab.scene.set_route(VEHICLE, points, worst, overlay.scale)
        nowhere = np.full(3, np.nan)
        tab.scene.set_pin(nowhere if row is None else ShownRow(self._analysis, row).position_enu)

    def _worst_row(self, overlay: Overlay) -> int | None:
        placed = np.isfinite(self._analysis.track.position_ned).all(axis=1)
        return overlay.worst_row(self._flown & placed)

    def _time_of(self, row: int) -> float:
        return float(self._analysis.track.time_s[row]) - self._start_s

    def _to_worst(self, tab: ReplayTab) -> None:
        row = self._worst_row(tab.overlay)
        if row is not None:
            tab.clock.pause()
            tab.clock.seek(self._time_of(row))


def run_replay(
    view: ReplayView,
    *,
    browser: bool = True,
    ready: threading.Event | None = None,
    stop: threading.Event | None = None,
) -> None:
    """Open the view, print its address, and wait for Ctrl-C; then close it.

    `browser` opens the page in the browser where there is a screen; `ready` is set once it is open,
    and setting `stop` ends it like Ctrl-C. Raise LinkError if it cannot open.
    """
    try:
        view.start()
        view.announce(browser=browser)
        if ready is not None:
            ready.set()
        ending = stop or threading.Event()
        while not ending.wait(0.5):
            pass
    except KeyboardInterrupt:
        pass
    finally:
        view.stop()


def planned_view(made: PlanForecast, **options: Any) -> ReplayView:
    """Return the view of a plan that is not flown yet, with its forecast as the flight.

    `options` are further arguments of ReplayView.
    """
    advised = made.advised
    return ReplayView(
        advised.analysis,
        waypoints=made.plan.items,
        overlays=planned_overlays(advised.analysis, advised.advice.limit),
        whole=lambda: FlightAnswer(verdict(made), made.level, fill_words(made)),
        planned=True,
        limit=advised.advice.limit,
        **options,
    )
