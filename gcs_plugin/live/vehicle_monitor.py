"""One vehicle, from its frames to analysed rows and alarms.

No threads, sockets or clocks of its own: what happens depends only on the frames and on the times
given, so that a recording gives live what it gives from its file.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.link.sequence import SenderWatch, Verdict
from thrustmargin.gcs_plugin.live.ages import stale, stale_words
from thrustmargin.gcs_plugin.live.alarm import Alarm, AlarmEvent, AlarmSettings
from thrustmargin.gcs_plugin.live.alarms import Alarms
from thrustmargin.gcs_plugin.live.live_rows import COLUMNS, FIXED, Sample, track_of
from thrustmargin.gcs_plugin.live.outlook import LookAhead, Outlook
from thrustmargin.gcs_plugin.live.sampler import Sampler
from thrustmargin.gcs_plugin.live.tank import FlowMeter, TankReading, virtual_gauge
from thrustmargin.gcs_plugin.live.vehicle_state import (
    VehicleState,
    fold,
    fold_mission,
)
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.mission.plan import MissionPlan
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
from thrustmargin.models.model.rotor_model import RotorModel

#: Rows before the new ones that the analysis also gets: effects need neighbours for rates.
CONTEXT = 40
#: s after which more rows no longer change a prediction by effects, which look both ways.
SETTLED_AFTER = 1.2
#: s for which two vehicles with one id stay suspended after they were last seen to take turns.
SHARED_HOLD = 10.0
#: s of silence after which a vehicle has left.
GONE = 60.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Update:
    """New rows of one vehicle. Arrays are (T,) as the analysis; rows before `first` were known.

    What is measured is final in every row. What a model with effects predicts is final in the rows
    before `settled`, of which those from `unsettled` on are so for the first time.
    """

    vehicle: int
    boot: int
    analysis: FlightAnalysis
    first: int
    unsettled: int
    settled: int
    clock_s: Floats  # vehicle's clock
    stamp_us: NDArray[np.int64]  # ground's clock when the row's report came
    virtual_kg: Floats  # tank by thrust
    pumped_kg: Floats  # by the pump since it was first heard
    outlook: Outlook
    alarms: tuple[Alarm, ...]  # that stand after the last row
    events: tuple[AlarmEvent, ...]
    tank_source: str = ""
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        margins = ", ".join(f"{100.0 * m:.1f}" for m in self.analysis.margin[-1])
        alarms = "; ".join(alarm.text for alarm in self.alarms) or "no alarm"
        return f"Update(vehicle {self.vehicle}, margin by rotor {margins} %, {alarms})"

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the numbers rest on, for people."""
        return (f"tank by {self.tank_source or 'no source: level unknown'}", *self.notes)


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchSettings:
    """How vehicles are watched."""

    tank: str = "auto"
    tank_start_kg: float | None = None
    alarms: AlarmSettings = field(default_factory=AlarmSettings)


class VehicleWatch:
    """One system id. Call `take` with its frames, `update` when there may be rows, `tick` often."""

    def __init__(self, system: int, model: RotorModel, settings: WatchSettings) -> None:
        self.system = system
        self.state = VehicleState(system=system)
        self.alarms = Alarms(settings.alarms)
        self.senders: dict[int, SenderWatch] = {}
        self.shared_until_us = 0
        self.notes: list[str] = []  # what happened since they were last taken
        self.last: Update | None = None
        self.rows = 0
        self._model = model
        self._sampler = Sampler(
            f"vehicle {system}",
            model.airframe,
            tank=settings.tank,
            tank_start_kg=settings.tank_start_kg,
        )
        self._known: deque[Sample] = deque(maxlen=CONTEXT)
        self._new: list[Sample] = []
        self._unsettled = 0  # of the known rows, the last so many
        self._start_s = math.nan
        self._boot = 0
        self._ahead = LookAhead(model)
        #: (R,) ground's clock when each rotor's speed was last known; 0 before any was.
        self._rotor_us = np.zeros(model.airframe.rotor_count, dtype=np.int64)
        self._flying: bool | None = None  # in the last row
        self._tank: TankReading | None = None  # the last that had a level
        self._flow_meter = FlowMeter()

    @property
    def seen(self) -> bool:
        """True when this is a vehicle and not only a companion or a stray id."""
        return self.state.autopilot >= 0 or self.rows > 0

    @property
    def problem(self) -> str:
        """Why there is no margin; empty when nothing stands in the way."""
        if self.shared:
            return (
                f"two vehicles send as system {self.system}: nothing is computed; "
                "give each its own id (SYSID_THISMAV)"
            )
        return self._sampler.problem

    @property
    def shared(self) -> bool:
        """True while two vehicles send under this id."""
        return self.state.stamp_us < self.shared_until_us

    @property
    def waiting(self) -> bool:
        """True when `update` would have rows."""
        return bool(self._new)

    @property
    def plan(self) -> MissionPlan | None:
        """The mission that is forecast; None while none is known."""
        return self._ahead.plan

    def use_plan(self, plan: MissionPlan) -> None:
        """Forecast along this mission rather than along one overheard."""
        self._ahead.use_plan(plan)

    def take(self, frame: Frame) -> None:
        """One frame of this vehicle, in the order in which it came."""
        sender = self.senders.setdefault(frame.component, SenderWatch())
        verdict = sender.look(frame.sequence, frame.data)
        if sender.shared:
            if not self.shared:
                self.notes.append(f"two vehicles send as system {self.system}")
            self.shared_until_us = frame.stamp_us + int(SHARED_HOLD * 1e6)
        if verdict is not Verdict.NEW:
            return
        if frame.stamp_us < self.shared_until_us:
            # A mix of two aircraft must not pass for one: heard, but not used.
            self.state = VehicleState(
                system=self.system, boot=self.state.boot, stamp_us=frame.stamp_us
            )
            self._new.clear()
            return
        self.state = fold(self.state, frame)
        if self.state.note:
            self.notes.append(self.state.note)
        sample = self._sampler.after(self.state)
        if sample is None:
            return
        if sample.boot != self._boot or math.isnan(self._start_s):
            self._boot, self._start_s = sample.boot, sample.clock_s
            self._tank = None
            self._known.clear()
            self._new.clear()
            self._unsettled = 0
            self._ahead.restart()
        self._flying = sample.flying
        if math.isfinite(sample.tank.level_kg):
            self._tank = sample.tank
        if sample.rotors_heard:
            heard = np.isfinite(sample.values[FIXED : FIXED + self._rotor_us.size])
            # One that never spoke is missed as soon as another did.
            heard |= self._rotor_us == 0
            self._rotor_us[heard] = sample.stamp_us
        self._flow_meter.add(float(sample.values[COLUMNS["tank_kg"]]), sample.tank.pumped_kg)
        self._new.append(sample)

    def overhear(self, frame: Frame) -> None:
        """A mission item that somebody sends to this vehicle."""
        self.state = fold_mission(self.state, frame)

    def update(self, *, final: bool = False) -> Update | None:
        """The rows that came since the last call, analysed; None when there is none.

        `final`: no more will come, and the last predictions count as settled.
        """
        if not self._new and not (final and self._unsettled):
            return None
        samples = [*self._known, *self._new]
        first = len(self._known)
        track = track_of(
            samples,
            name=f"vehicle {self.system}",
            rotor_count=self._model.airframe.rotor_count,
            origin=self._sampler.origin,
            start_s=self._start_s,
        )
        analysis = analyse(track, self._model)
        clock_s = np.array([s.clock_s for s in samples])
        unsettled = first - self._unsettled
        settled = clock_s.size
        if self._model.effects and not final:
            until = np.searchsorted(clock_s, clock_s[-1] - SETTLED_AFTER, side="right")
            settled = max(int(until), unsettled)
        self._unsettled = clock_s.size - settled
        virtual = virtual_gauge(analysis)
        pumped = np.array([s.tank.pumped_kg for s in samples])
        self._ahead.look(
            analysis,
            samples,
            self.state,
            self._sampler.origin,
            let_through=self._flow_meter.now,
        )
        events = self.alarms.rows(
            analysis,
            first,
            settled=slice(unsettled, settled),
            clock_s=clock_s,
            pumped_kg=pumped * self._flow_meter.first,
            virtual_kg=virtual,
            margin_ahead=self._ahead.now.margin_ahead,
            esc_failures=samples[-1].esc_failures,
        )
        self.last = Update(
            vehicle=self.system,
            boot=self._boot,
            analysis=analysis,
            first=first,
            unsettled=unsettled,
            settled=settled,
            clock_s=clock_s,
            stamp_us=np.array([s.stamp_us for s in samples], dtype=np.int64),
            virtual_kg=virtual,
            pumped_kg=pumped,
            outlook=self._ahead.now,
            alarms=tuple(self.alarms.standing.values()),
            events=tuple(events),
            tank_source=samples[-1].tank.source,
            notes=(*self._sampler.notes, *samples[-1].tank.notes),
        )
        self.rows += len(self._new)
        self._known.extend(self._new)
        self._new.clear()
        return self.last

    def tick(self, now_us: int) -> list[AlarmEvent]:
        """Judge the link at a time of the ground's clock."""
        if not self.seen:
            return []
        rotors_silent = np.where(self._rotor_us > 0, (now_us - self._rotor_us) * 1e-6, np.nan)
        return self.alarms.heard(
            now_us * 1e-6, self.silent(now_us), rotors_silent, flying=self.flying
        )

    def silent(self, now_us: int) -> float:
        """s since anything was heard of it, at a time of the ground's clock."""
        return (now_us - self.state.stamp_us) * 1e-6

    def stale(self, now_us: int) -> str:
        """Which fields are no longer reported and since when, in words; empty when none is.

        Nothing is said of the single fields while the vehicle as a whole is silent.
        """
        if self.shared or self.silent(now_us) > self.alarms.settings.silence:
            return ""
        return stale_words(stale(self.state, self._tank, now_us))

    @property
    def flying(self) -> bool:
        """Off the ground when last heard; armed counts where no row has told."""
        return self.state.armed if self._flying is None else self._flying

    def left(self, now_us: int) -> bool:
        """Whether it is gone for good: long silent, and on the ground when last heard.

        One that fell silent in flight is missed and never forgotten.
        """
        return self.silent(now_us) > GONE and not self.flying
