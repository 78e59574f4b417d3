"""One vehicle, from its frames to analysed rows and alarms.

No threads, sockets or clocks of its own: what happens depends only on the frames and on the times
given, so that a recording gives live what it gives from its file.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.link.sequence import SenderWatch, Verdict
from thrustmargin.gcs_plugin.live.alarms.alarm import AlarmEvent, LinkNow
from thrustmargin.gcs_plugin.live.alarms.alarm_rules import OF_SETTLED_ROWS, OF_SOUGHT_ROWS
from thrustmargin.gcs_plugin.live.alarms.listed_alarms import Alarms
from thrustmargin.gcs_plugin.live.rows.tank_balance import virtual_gauge
from thrustmargin.gcs_plugin.live.rows.vehicle_state import VehicleState, fold_mission
from thrustmargin.gcs_plugin.live.rows.vehicle_telemetry import LiveRows, VehicleTelemetry
from thrustmargin.gcs_plugin.live.watch.airframe_watch import AirframeWatch
from thrustmargin.gcs_plugin.live.watch.flight_so_far import FlightAdvice, SortieRows
from thrustmargin.gcs_plugin.live.watch.frozen_watch import FrozenWatch
from thrustmargin.gcs_plugin.live.watch.landed_flight import LandedFlights
from thrustmargin.gcs_plugin.live.watch.outlook import LookAhead
from thrustmargin.gcs_plugin.live.watch.update import (
    GONE,
    LASTING,
    ROWLESS,
    SHARED_HOLD,
    Later,
    Update,
    WatchSettings,
    goes_on,
    of_bad_part,
    when_asked,
    with_rows,
)
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.gcs_plugin.mavlink.scan import BOOT_CLOCKS
from thrustmargin.gcs_plugin.wording.live_words import NO_ROWS, stale_words, two_vehicles
from thrustmargin.mission.plan import MissionPlan
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.airframe_claim import AirframeClaim
from thrustmargin.models.model.analysis import (
    FlightAnalysis,
    FlightState,
    analyse,
    with_load_beyond_gauge,
)
from thrustmargin.models.model.inferred.prepared import Inferred, fill_channels_so_far
from thrustmargin.models.model.rotor_faults import fault_model
from thrustmargin.models.model.rotor_model import RotorModel, identified_airframe

#: Rows of which screens show a mean, and in which a loss of control lasts: so many stay at least.
SHOWN = 20
#: s of rows that are analysed in one go, at most: what is decided from time to time is not late.
PART = 5.0
#: Arrays of an Update that the next one goes on with.
CARRIED = ("clock_s", "stamp_us", "pumped_kg", "delivered_kg", "margin_ahead")


class VehicleMonitor:
    """One system id. Call `take` with its frames, `updates` for its rows, `tick` often.

    `heard_us` says by system id when it was heard last; `later` answers for a flight that is over.
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
        self._heard_us = heard_us
        self.alarms = Alarms(settings.alarms)
        self.senders: dict[int, SenderWatch] = {}
        self._piloted = False  # a heartbeat of a vehicle's autopilot has come
        self._shared_since_us = self.shared_until_us = 0
        #: What happened since they were last taken, and when by the ground's clock, µs.
        self.notes: list[tuple[int, str]] = []
        self.not_followed: Mapping[str, tuple[float, float]] = {}  # in vain: Hz that come, asked
        self.last: Update | None = None
        self.rows = 0
        self.first_us = 0  # ground's clock when it was first heard
        self.back_us = 0  # the same after it had left, the last time
        options = replace(settings, airframe=model.airframe, sampling="hold")
        self._asked = settings.asked
        self.telemetry = VehicleTelemetry(system, options, self._asked)
        self._model = model
        self._inferred = Inferred()
        self._unsettled = 0  # of the known rows, the last so many
        self._unsought = 0  # likewise, in which no fault was sought yet
        self._ahead = LookAhead(model)
        self._landed = LandedFlights(system, model, settings, later)
        self._sortie = SortieRows(model, self.alarms, self._landed.answer)
        self._frozen = FrozenWatch(identified_airframe(model))
        self._airframe = AirframeWatch(model, given=settings.airframe_given, source=settings.link)
        #: (R,) s for which messages have come without each rotor's speed; NaN before any came.
        self._unheard_s = np.full(model.airframe.rotor_count, np.nan)
        self._look_back_s, self._look_ahead_s = model.look_back_s, model.look_ahead_s
        self._fault_look_s = fault_model(model).look_ahead_s

    @property
    def state(self) -> VehicleState:
        """What the vehicle says of itself."""
        return self.telemetry.state

    @property
    def vehicle(self) -> bool:
        """True once an autopilot's heartbeat has come: no radio, gimbal or tracker."""
        return self._piloted or self.shared

    @property
    def seen(self) -> bool:
        """True when this is a vehicle, or may be one by its flight, and not only a stray id."""
        return self.vehicle or self.rows > 0

    @property
    def problem(self) -> str:
        """Why there is no margin; empty when nothing stands in the way."""
        if self.shared:
            return two_vehicles(self.system)
        if self.rows == 0 and self.telemetry.read_us - self.first_us > ROWLESS * 1e6:
            return self.telemetry.problem or NO_ROWS.text(self._asked)
        return self.telemetry.problem

    @property
    def claim(self) -> AirframeClaim:
        """On what ground it is one of the airframe, as decided last."""
        return self._airframe.claim

    @property
    def shared(self) -> bool:
        """True while two vehicles send under this id."""
        return self.telemetry.stamp_us < self.shared_until_us

    @property
    def waiting(self) -> bool:
        """True when `updates` may have rows."""
        return self.telemetry.waiting

    @property
    def plan(self) -> MissionPlan | None:
        """The mission that is forecast; None while none is known."""
        return self._ahead.plan

    def use_plan(self, plan: MissionPlan | None) -> None:
        """Forecast along this mission until the vehicle's is another; None: it holds none."""
        self._ahead.use_plan(plan, self.state)

    def take(self, frame: Frame) -> None:
        """One frame of this vehicle, in the order in which it came."""
        sender = self.senders.get(frame.component)
        if sender is None:
            sender = self.senders[frame.component] = SenderWatch()
        verdict = sender.look(frame.sequence, frame.data)
        if frame.id in BOOT_CLOCKS and verdict is Verdict.NEW and frame.verified:
            clock_s = int.from_bytes(frame.payload[:4], "little") * 1e-3
            sender.clocked(frame.id, frame.stamp_us * 1e-6, clock_s)
        if sender.shared:
            if not self.shared:
                self._shared_since_us = frame.stamp_us
            self.shared_until_us = frame.stamp_us + int(SHARED_HOLD * 1e6)
        if verdict is not Verdict.NEW:
            return
        self.first_us = self.first_us or frame.stamp_us
        if frame.stamp_us - self.telemetry.stamp_us > GONE * 1e6:
            self.back_us = frame.stamp_us
        if frame.stamp_us < self.shared_until_us:
            # A mix of two aircraft must not pass for one: heard, but not used.
            self.telemetry.stamp_us = frame.stamp_us
            self.telemetry.forget()
            return
        self.telemetry.take(frame)
        self._landed.take(frame)
        self._piloted |= self.state.autopilot >= 0

    @property
    def doubled(self) -> int:
        """Frames that came again over a second link or router, and were dropped."""
        return sum(sender.doubled for sender in list(self.senders.values()))

    def overhear(self, frame: Frame) -> None:
        """A mission item that somebody sends to this vehicle."""
        self.telemetry.state = fold_mission(self.state, frame)

    def updates(self, *, final: bool = False) -> list[Update]:
        """The rows that came since the last call, analysed.

        One part for each start of the vehicle, and for each change of what it says of itself.
        `final`: no more will come, and the last predictions count as settled.
        """
        made = [self._update(part) for rows in self.telemetry.rows() for part in self._parts(rows)]
        self.notes += self.telemetry.events
        self.telemetry.events.clear()
        if final and self.last is not None:
            made.append(self._update(None))
        return made

    def _parts(self, rows: LiveRows) -> Iterator[LiveRows]:
        """Yield new rows in parts that begin where the airframe is looked at again, and are no
        longer than PART: what is decided between two rows does not depend on how many came."""
        while True:
            time_s, due_s = rows.track.time_s, self._airframe.due_s
            cut = int(np.searchsorted(time_s, time_s[0] + PART))
            if due_s > time_s[0]:
                cut = min(cut, int(np.searchsorted(time_s, due_s)))
            elif flying := np.flatnonzero(rows.track.flying[1:]).tolist():
                cut = min(cut, 1 + flying[0])
            if cut >= time_s.size:
                yield rows
                return
            yield rows.rows(slice(0, cut))
            rows = rows.rows(slice(cut, None))

    def _update(self, new: LiveRows | None) -> Update:
        """The next update: with new rows, or (None) with the last predictions settled."""
        last = self.last
        if last is None or (new is not None and not goes_on(last, new)):
            if last is not None and new is not None and last.boot != new.boot:
                self.alarms.restarted(float(new.clock_s[0]))
            last, self._unsettled, self._unsought, self._inferred = None, 0, 0, Inferred()
            self._ahead.restart()
            self._sortie = SortieRows(self._model, self.alarms, self._landed.answer)
        window, start, reported = slice(0, 0), None, None
        if last is not None:
            window, start = self._window(last)
        if new is not None:
            parameters, reported = self.state.parameters, new.track
            measured = self._frozen.without_frozen(reported, parameters)
            notes = (*new.notes, *measured.notes[len(reported.notes) :])
            new = replace(new, track=measured, notes=notes)
            start = self._claimed(new, start)
            airframe = None if self.claim.withheld else identified_airframe(self._model)
            track, self._inferred = fill_channels_so_far(
                new.track, airframe, parameters, self._inferred
            )
            new = replace(new, track=track)
        track = with_rows(last, window, new)
        flight = self._sortie.now
        claim = self.claim if flight is None else flight.shown_by(self.claim)
        analysis = analyse(track, self._model, start=start, claim=claim)
        if flight is not None and not claim.withheld:
            analysis = with_load_beyond_gauge(analysis, flight.beyond_gauge_kg)
        total = track.time_s.size
        first = total - (0 if new is None else new.clock_s.size)
        final = new is None or not self._model.effects
        unsettled, settled = _known_rows(
            track.time_s, first - self._unsettled, 0.0 if final else self._look_ahead_s
        )
        self._unsettled = total - settled
        unsought, sought = _known_rows(
            track.time_s, first - self._unsought, 0.0 if final else self._fault_look_s
        )
        self._unsought = total - sought
        arrays = {
            name: np.zeros(0) if last is None else getattr(last, name)[window] for name in CARRIED
        }
        unheard = None
        if new is not None:
            unheard = np.pad(self._unheard(analysis, first), ((first, 0), (0, 0)))
            added = self._beyond_the_rows(analysis, first, new)
            arrays = {name: np.concatenate([arrays[name], added[name]]) for name in CARRIED}
            self.rows += new.clock_s.size
        virtual = virtual_gauge(analysis)
        events = self.alarms.rows(
            analysis,
            first,
            settled=slice(unsettled, settled),
            sought=slice(unsought, sought),
            clock_s=arrays["clock_s"],
            pumped_kg=arrays["delivered_kg"],
            virtual_kg=virtual,
            margin_ahead=arrays["margin_ahead"],
            unheard_s=unheard,
            from_outputs=self._inferred.outputs.in_use,
            esc_failures=None
            if new is None
            else np.pad(new.esc_failures, ((first, 0), (0, 0)), constant_values=np.nan),
        )
        if new is None or reported is None:
            self._sortie.settle()
            self._sortie.restate()
        else:
            self._sortie.add(reported, new.clock_s, self.claim, self.state, events)
            self._landed.forget(float(new.stamp_us[-1]) - self._sortie.kept_s * 1e6)
        kept = self.last
        made = Update(
            vehicle=self.system,
            boot=new.boot if new is not None else kept.boot if kept is not None else 0,
            analysis=analysis,
            first=first,
            unsettled=unsettled,
            settled=settled,
            clock_s=arrays["clock_s"],
            stamp_us=arrays["stamp_us"].astype(np.int64),
            virtual_kg=virtual,
            pumped_kg=arrays["pumped_kg"],
            delivered_kg=arrays["delivered_kg"],
            margin_ahead=arrays["margin_ahead"],
            outlook=self._ahead.now,
            alarms=tuple(self.alarms.listed.values()),
            events=self._stamped(events, track.time_s, arrays, last=new is None),
            flight=self._sortie.now,
            notes=new.notes if new is not None else kept.notes if kept is not None else (),
            asked=self._asked,
        )
        self.last = of_bad_part(made) if self._sortie.found_bad else made
        return self.last

    def _stamped(
        self,
        events: Sequence[AlarmEvent],
        time_s: Floats,
        arrays: Mapping[str, NDArray[Any]],
        *,
        last: bool,
    ) -> tuple[AlarmEvent, ...]:
        """Return events of rows with the ground's clock when the report came that gave them.

        Where predictions are final only later, that is the report that made them so; `last`: the
        end of what comes has. `time_s` (T,) is the track's, `arrays` are as `CARRIED`.
        """
        later = {rule.name for rule in OF_SETTLED_ROWS} if self._model.effects else set[str]()
        if self._fault_look_s > 0.0:
            later |= {rule.name for rule in OF_SOUGHT_ROWS}
        made = []
        for event in events:
            row = int(np.searchsorted(arrays["clock_s"], event.time_s))
            if event.alarm.name in later:
                row = int(np.searchsorted(time_s, time_s[row] + self._look_ahead_s))
            row = time_s.size - 1 if last else min(row, time_s.size - 1)
            made.append(replace(event, unix_s=float(arrays["stamp_us"][row]) * 1e-6))
        return tuple(sorted(made, key=lambda event: event.unix_s))

    def _claimed(self, new: LiveRows, start: FlightState | None) -> FlightState | None:
        """Decide the claim, and say what the model goes on from: nothing after a change."""
        before = self.claim
        claim = self._airframe.look(new.track, self.telemetry.facts, self.state.parameters)
        if replace(claim, outputs=before.outputs) == before and self.last is not None:
            return start
        helps = [claim.remedy] if claim.withheld else []
        self.notes.append((int(new.stamp_us[-1]), "; ".join([claim.described, *helps])))
        return None if bool(before.withheld) != bool(claim.withheld) else start

    def _window(self, last: Update) -> tuple[slice, FlightState | None]:
        """Rows of the last update that the next one needs, and what the model carries to them."""
        time_s = last.analysis.track.time_s
        needed = min(last.settled, time_s.size - 1)
        back = np.searchsorted(time_s, time_s[needed] - self._look_back_s, side="right") - 1
        begin = max(min(int(back), time_s.size - SHOWN), 0)
        start = last.analysis.start if begin == 0 else last.analysis.state_at(begin)
        return slice(begin, None), start

    def _beyond_the_rows(
        self, analysis: FlightAnalysis, first: int, new: LiveRows
    ) -> dict[str, NDArray[Any]]:
        """What is known at each new row of pump and route; as `CARRIED`."""
        delivered, ahead = self._ahead.rows(analysis, first, new, self.state)
        return {
            "clock_s": new.clock_s,
            "stamp_us": new.stamp_us,
            "pumped_kg": new.pumped_kg,
            "delivered_kg": delivered,
            "margin_ahead": ahead,
        }

    def _unheard(self, analysis: FlightAnalysis, first: int) -> Floats:
        """Return (N, R) s for which rows came without a rotor's speed, at each new row; NaN where
        no speed was ever reported.

        A pause of all rows counts nothing where it is as long as a lost link.
        """
        known = self._inferred.outputs.heard.readings(analysis.track)[first:]
        if known.shape[1] != self._unheard_s.size:
            self._unheard_s = np.full(known.shape[1], np.nan)
        ever = np.logical_or.accumulate(known.any(axis=1)) | np.isfinite(self._unheard_s).any()
        time_s = analysis.track.time_s
        steps = np.diff(time_s, prepend=time_s[:1])[first:]
        steps = np.where(steps > self.alarms.settings.silence, 0.0, steps)
        passed = np.where(ever, np.cumsum(steps), 0.0)[:, None]
        # One that never spoke is missed as soon as another did.
        start = np.where(np.isfinite(self._unheard_s), -self._unheard_s, passed[np.argmax(ever)])
        heard = np.maximum.accumulate(np.where(known, passed, start), axis=0)
        unheard = np.where(ever[:, None], np.maximum(passed - heard, 0.0), np.nan)
        self._unheard_s = unheard[-1]
        return unheard

    def tick(self, now_us: int) -> list[AlarmEvent]:
        """Check the link at a time of the ground's clock up to which all that came is known.

        Nothing here depends on how far the analysis is: what is missed in messages shows by their
        own clock.
        """
        if not self.seen:
            return []
        self._sortie.restate()
        link = LinkNow(
            silent=self.silent(now_us),
            flying=self.flying,
            shared_id=self.system if self.shared else 0,
            shared_since_s=self._shared_since_us * 1e-6,
            rows_behind=self._rows_behind,
            read_s=self.telemetry.read_us * 1e-6,
        )
        return [replace(e, unix_s=e.time_s) for e in self.alarms.heard(now_us * 1e-6, link)]

    @property
    def _rows_behind(self) -> float:
        """s of the last row before the last message that was analysed, which may be of no use."""
        if self.last is None:
            return 0.0
        return max(self.telemetry.read_us - int(self.last.stamp_us[-1]), 0) * 1e-6

    def silent(self, now_us: int) -> float:
        """s since anything was heard of it, at a time of the ground's clock, taken or not."""
        return max(now_us - self.last_us, 0) * 1e-6

    @property
    def last_us(self) -> int:
        """Ground's clock when anything was last heard of it, taken or not."""
        return max(self.telemetry.stamp_us, self._heard_us.get(self.system, 0))

    def stale(self, now_us: int) -> str:
        """Which fields are no longer reported and since when, in words; empty when none is.

        Nothing is shown of the single fields while the vehicle as a whole is silent.
        """
        if self.shared or self.silent(now_us) > self.alarms.settings.silence:
            return ""
        ages = self.telemetry.stale()
        return stale_words({field: age for field, age in ages.items() if age > LASTING})

    @property
    def flying(self) -> bool:
        """Off the ground when last heard; armed counts before the first row."""
        return self.state.armed if self.last is None else bool(self.last.analysis.track.flying[-1])

    def left(self, now_us: int) -> bool:
        """Whether it is gone for good: long silent, and on the ground when last heard.

        One that fell silent in flight is missed and never forgotten.
        """
        return self.silent(now_us) > GONE and not self.flying


def _known_rows(time_s: Floats, begin: int, look_s: float) -> tuple[int, int]:
    """Return the rows from `begin` to the last one that is followed by `look_s` seconds of the
    increasing times (T,) s, as begin and end."""
    if look_s <= 0.0:
        return begin, time_s.size
    until = int(np.searchsorted(time_s, time_s[-1] - look_s, side="right"))
    return begin, max(until, begin)
