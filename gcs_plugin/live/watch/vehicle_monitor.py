"""One vehicle, from its frames to analysed rows and alarms.

No threads, sockets or clocks of its own: what happens depends only on the frames and on the times
given, so that a recording gives live what it gives from its file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.live.alarms.alarm import AlarmEvent, LinkNow
from thrustmargin.gcs_plugin.live.alarms.listed_alarms import Alarms
from thrustmargin.gcs_plugin.live.rows.tank_balance import virtual_gauge
from thrustmargin.gcs_plugin.live.rows.vehicle_state import VehicleState, fold_mission
from thrustmargin.gcs_plugin.live.rows.vehicle_telemetry import LiveRows, VehicleTelemetry
from thrustmargin.gcs_plugin.live.watch.flight_so_far import FlightAdvice, FlightSoFar, SortieRows
from thrustmargin.gcs_plugin.live.watch.landed_flight import LandedFlights
from thrustmargin.gcs_plugin.live.watch.link_watch import LinkWatch, RotorSilence
from thrustmargin.gcs_plugin.live.watch.outlook import LookAhead
from thrustmargin.gcs_plugin.live.watch.prepared_rows import RowPreparation
from thrustmargin.gcs_plugin.live.watch.settled_rows import CARRIED, SettledRows, kept_rows
from thrustmargin.gcs_plugin.live.watch.update import (
    GONE,
    LASTING,
    ROWLESS,
    Later,
    Update,
    WatchSettings,
    when_asked,
)
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.gcs_plugin.wording.check_words import described_words, remedy_words
from thrustmargin.gcs_plugin.wording.live_words import NO_ROWS, stale_words, two_vehicles
from thrustmargin.mission.plan import MissionPlan
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.analysis import (
    FlightAnalysis,
    FlightState,
    analyse,
    with_bad_part,
    with_load_beyond_gauge,
)
from thrustmargin.models.model.rotor_model import RotorModel


class VehicleMonitor:
    """Monitor of one system id: call `take` with its frames, `updates` for its rows, `tick` often.

    `heard_us` is the listener's, system id -> ground's clock, µs, of its last message; `later` runs
    the report of an ended flight in the background.
    """

    def __init__(
        self,
        system: int,
        model: RotorModel,
        settings: WatchSettings,
        *,
        heard_us: Mapping[int, int] = MappingProxyType({}),
        later: Later[FlightAdvice] = when_asked,
    ) -> None:
        self.system = system
        self._model, self._asked = model, settings.asked
        self.link = LinkWatch(system, heard_us)
        options = replace(settings, airframe=model.airframe, sampling="hold")
        self.telemetry = VehicleTelemetry(system, options, self._asked)
        self.alarms = Alarms(settings.alarms)
        #: What happened since the events were last processed, and when by the ground's clock, µs.
        self.notes: list[tuple[int, str]] = []
        self.not_followed: Mapping[str, tuple[float, float]] = {}  # in vain: Hz that come, asked
        self.last: Update | None = None
        self.rows = 0
        self._piloted = False  # a heartbeat of a vehicle's autopilot has come
        self._preparation = RowPreparation(
            model, given=settings.airframe_given, source=settings.link
        )
        self._settled = SettledRows(model)
        self._outlook = LookAhead(model)
        self._landed = LandedFlights(system, model, settings, later)
        self._sortie = SortieRows(model, self.alarms, self._landed.answer)
        self._rotor_silence = RotorSilence(model.airframe.rotor_count)
        #: The last flight before a restart: its verdict outlives a change of battery.
        self._flight_before: FlightSoFar | None = None

    @property
    def state(self) -> VehicleState:
        """Return the vehicle's own reports: kind, parameters, mission."""
        return self.telemetry.state

    @property
    def vehicle(self) -> bool:
        """Return True if an autopilot's heartbeat was received; a radio, gimbal or tracker has
        none."""
        return self._piloted or self.link.shared

    @property
    def seen(self) -> bool:
        """Return True for a vehicle, or an id with rows of a flight, and False for a stray id."""
        return self.vehicle or self.rows > 0

    @property
    def problem(self) -> str:
        """Return the sentence on why there are no rows or no margin; empty without a problem."""
        if self.link.shared:
            return two_vehicles(self.system)
        if self.rows == 0 and self.telemetry.read_us - self.link.first_us > ROWLESS * 1e6:
            return self.telemetry.problem or NO_ROWS.text(self._asked)
        return self.telemetry.problem

    @property
    def airframe_match(self) -> AirframeMatch:
        """Return the last decision whether the vehicle is of the airframe."""
        return self._preparation.airframe_match

    @property
    def waiting(self) -> bool:
        """Return True if `updates` may have new rows."""
        return self.telemetry.waiting

    @property
    def plan(self) -> MissionPlan | None:
        """Return the mission used for the forecast; None while none is known."""
        return self._outlook.plan

    def use_plan(self, plan: MissionPlan | None) -> None:
        """Forecast along `plan` until the vehicle's mission changes; None if it has none."""
        self._outlook.use_plan(plan, self.state)

    def take(self, frame: Frame) -> None:
        """Process the next frame of this vehicle, in the order of arrival.

        Copies and late frames are dropped. While two vehicles share the id, frames count as heard,
        and all that is known of the vehicle is forgotten.
        """
        if not self.link.take(frame):
            return
        if self.link.shared:
            # A mix of two aircraft must not pass for one: heard, but not used.
            self.telemetry.stamp_us = frame.stamp_us
            self.telemetry.forget()
            return
        self.telemetry.take(frame)
        self._landed.take(frame)
        self._piloted |= self.state.autopilot >= 0

    def overhear(self, frame: Frame) -> None:
        """Store a mission message that another system sends to this vehicle."""
        self.telemetry.state = fold_mission(self.state, frame)

    def updates(self, *, final: bool = False) -> list[Update]:
        """Return the new rows since the last call, analysed, in order of time.

        There is one Update for each start of the vehicle, and for each change of its own reports.
        `final`: no more frames will come; a last Update without new rows makes all predictions
        final.
        """
        made = [
            self._update(part)
            for rows in self.telemetry.rows()
            for part in self._preparation.parts(rows)
        ]
        self.notes += self.telemetry.events
        self.telemetry.events.clear()
        if final and self.last is not None:
            made.append(self._update(None))
        return made

    def _update(self, new: LiveRows | None) -> Update:
        """Return the next Update, with the `new` rows; None makes the last predictions final.

        It is stored as `last`. Rows that do not continue the last ones (a restart, a gap) begin a
        new analysis. New rows are prepared, checked for alarms, and added to the sortie.
        """
        last = self.last
        if last is None or (new is not None and not _continues(last, new)):
            if last is not None and new is not None and last.boot != new.boot:
                self.alarms.restarted(float(new.clock_s[0]))
            last = None
            self._begin_anew()
        window, start, reported = slice(0, 0), None, None
        if last is not None:
            window, start = kept_rows(last, self._model.look_back_s)
        if new is not None:
            reported, before = new.track, self.airframe_match
            new = self._preparation.prepare(new, self.telemetry.facts, self.state.parameters)
            start = self._state_by_match(before, new, start)
        analysis = self._analysed(_with_rows(last, window, new), start)
        time_s = analysis.track.time_s
        first = time_s.size - (0 if new is None else new.clock_s.size)
        settled, sought = self._settled.settled(time_s, first, at_once=new is None)
        arrays = {
            name: np.zeros(0) if last is None else getattr(last, name)[window] for name in CARRIED
        }
        unheard = failures = None
        if new is not None:
            pause = self.alarms.settings.silence
            known = self._preparation.outputs.heard.readings(analysis.track)
            unheard = self._rotor_silence.add(known, time_s, first, pause)
            unheard = np.pad(unheard, ((first, 0), (0, 0)))
            self._landed.follow_landing(analysis.track.flying[first:], new.stamp_us)
            failures = np.pad(new.esc_failures, ((first, 0), (0, 0)), constant_values=np.nan)
            added = self._beyond_the_rows(analysis, first, new)
            arrays = {name: np.concatenate([arrays[name], added[name]]) for name in CARRIED}
            self.rows += new.clock_s.size
        virtual = virtual_gauge(analysis)
        events = self.alarms.rows(
            analysis,
            first,
            settled=settled,
            sought=sought,
            clock_s=arrays["clock_s"],
            pumped_kg=arrays["delivered_kg"],
            virtual_kg=virtual,
            margin_ahead=arrays["margin_ahead"],
            unheard_s=unheard,
            from_outputs=self._preparation.outputs.in_use,
            esc_failures=failures,
        )
        if new is None or reported is None:
            self._sortie.settle()
            self._sortie.restate()
        else:
            self._sortie.add(reported, new.clock_s, self.airframe_match, self.state, events)
            self._landed.forget(float(new.stamp_us[-1]) - self._sortie.kept_s * 1e6)
        rows = self.last if new is None else new  # of which start of the vehicle
        made = Update(
            vehicle=self.system,
            boot=0 if rows is None else rows.boot,
            analysis=analysis,
            first=first,
            unsettled=settled.start,
            settled=settled.stop,
            clock_s=arrays["clock_s"],
            stamp_us=arrays["stamp_us"].astype(np.int64),
            virtual_kg=virtual,
            pumped_kg=arrays["pumped_kg"],
            delivered_kg=arrays["delivered_kg"],
            margin_ahead=arrays["margin_ahead"],
            outlook=self._outlook.now,
            alarms=tuple(self.alarms.listed.values()),
            events=self._settled.stamped(events, time_s, arrays, last=new is None),
            flight=self._sortie.now or self._flight_before,
            takeoff=self.alarms.takeoff,
            landed_us=self._landed.landed_us,
            notes=() if rows is None else rows.notes,
            asked=self._asked,
        )
        self.last = _with_bad_part(made) if self._sortie.found_bad else made
        return self.last

    def _begin_anew(self) -> None:
        """Forget the rows so far, because the vehicle has restarted or has another number of
        rotors."""
        self._flight_before = self._sortie.now or self._flight_before
        self._settled.restart()
        self._preparation.restart()
        self._outlook.restart()
        self._sortie = SortieRows(self._model, self.alarms, self._landed.answer)

    def _state_by_match(
        self, before: AirframeMatch, new: LiveRows, start: FlightState | None
    ) -> FlightState | None:
        """Note a changed decision on the airframe; return the model's state for new rows.

        `before` is the decision of the last rows, `start` the model's state after them. Return
        None, to start anew, if the verdict was allowed or withdrawn with the change.
        """
        airframe_match = self.airframe_match
        if replace(airframe_match, outputs=before.outputs) == before and self.last is not None:
            return start
        helps = [remedy_words(airframe_match)] if airframe_match.no_verdict else []
        self.notes.append(
            (int(new.stamp_us[-1]), "; ".join([described_words(airframe_match), *helps]))
        )
        return None if bool(before.no_verdict) != bool(airframe_match.no_verdict) else start

    def _analysed(self, track: FlightTrack, start: FlightState | None) -> FlightAnalysis:
        """Analyse `track` from the model's state `start`, with what the whole flight so far shows.

        That is the airframe's match, and the load beyond what the gauge shows.
        """
        flight = self._sortie.now
        airframe_match = (
            self.airframe_match if flight is None else flight.shown_by(self.airframe_match)
        )
        analysis = analyse(track, self._model, start=start, airframe_match=airframe_match)
        if flight is not None and not airframe_match.no_verdict:
            analysis = with_load_beyond_gauge(analysis, flight.beyond_gauge_kg)
        return analysis

    def _beyond_the_rows(
        self, analysis: FlightAnalysis, first: int, new: LiveRows
    ) -> dict[str, NDArray[Any]]:
        """Return the arrays that CARRIED names for the rows `new`, the analysis's from `first` on.

        They are vehicle's and ground's clock, pumped and delivered mass, kg, and the least margin
        on the remaining route.
        """
        delivered, margin_ahead = self._outlook.rows(analysis, first, new, self.state)
        return {
            "clock_s": new.clock_s,
            "stamp_us": new.stamp_us,
            "pumped_kg": new.pumped_kg,
            "delivered_kg": delivered,
            "margin_ahead": margin_ahead,
        }

    def tick(self, now_us: int) -> list[AlarmEvent]:
        """Check the link as of `now_us`, the ground's clock, up to which all frames were received.

        Return the alarms raised or cleared, with Unix times; none for an id that has not proved to
        be a vehicle. The result does not depend on how far the analysis is: missing messages show
        by their own clock.
        """
        if not self.seen:
            return []
        self._sortie.restate()
        link = LinkNow(
            silent=self.link.silent(now_us),
            flying=self.flying,
            shared_id=self.system if self.link.shared else 0,
            shared_since_s=self.link.shared_since_us * 1e-6,
            rows_behind=self._rows_behind,
            read_s=self.telemetry.read_us * 1e-6,
        )
        return [replace(e, unix_s=e.time_s) for e in self.alarms.heard(now_us * 1e-6, link)]

    @property
    def _rows_behind(self) -> float:
        """Return the time, s, from the last row to the last analysed message; 0 without a row."""
        if self.last is None:
            return 0.0
        return max(self.telemetry.read_us - int(self.last.stamp_us[-1]), 0) * 1e-6

    def stale(self, now_us: int) -> str:
        """Return the sentence on fields no longer reported for more than LASTING s at `now_us`, the
        ground's clock, µs.

        Empty without such a field, while the vehicle as a whole is silent, and if several vehicles
        share its system id.
        """
        if self.link.shared or self.link.silent(now_us) > self.alarms.settings.silence:
            return ""
        ages = self.telemetry.stale()
        return stale_words({field: age for field, age in ages.items() if age > LASTING})

    @property
    def flying(self) -> bool:
        """Return True if the last row is off the ground; before the first row, if the vehicle is
        armed."""
        return self.state.armed if self.last is None else bool(self.last.analysis.track.flying[-1])

    def has_left(self, now_us: int) -> bool:
        """Return True if it has gone: long silent, and on the ground when last heard.

        A vehicle that fell silent in flight stays listed.
        """
        return self.link.silent(now_us) > GONE and not self.flying


def _with_bad_part(update: Update) -> Update:
    """Return the update for an aircraft with a bad rotor or motor: without the figures that assume
    sound ones (predicted margin, margin on the route and with a full tank)."""
    outlook = replace(update.outlook, sound=False)
    return replace(update, analysis=with_bad_part(update.analysis), outlook=outlook)


def _continues(last: Update, new: LiveRows) -> bool:
    """Return True if the new rows follow the last: no restart, and the same number of rotors."""
    before = last.analysis.track.rotor_count
    return last.boot == new.boot and before == new.track.rotor_count


def _with_rows(last: Update | None, window: slice, new: LiveRows | None) -> FlightTrack:
    """Return the rows `window` of the last update, followed by the new ones."""
    if last is None:
        assert new is not None
        return new.track
    track = last.analysis.track
    return track.rows(window) if new is None else track.followed_by(new.track, window.start)
