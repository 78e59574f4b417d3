"""One vehicle, from its frames to analysed rows and alarms.

No threads, sockets or clocks of its own: what happens depends only on the frames and on the times
given, so that a recording gives live what it gives from its file.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gcs_plugin.ages import stale, stale_words
from gcs_plugin.alarm import Alarm, AlarmEvent
from gcs_plugin.alarms import Alarms, AlarmSettings
from gcs_plugin.frames import Frame
from gcs_plugin.logs.recording import Waypoint
from gcs_plugin.sampler import COLUMNS, FIXED, Sample, Sampler, track_of
from gcs_plugin.senders import SenderWatch, Verdict
from gcs_plugin.state import (
    VehicleState,
    fold,
    fold_mission,
)
from gcs_plugin.tank import FlowMeter, TankReading, virtual_gauge
from mission.forecast import Conditions, Forecast, forecast, margin_at_fill, route_ahead
from mission.plan import MissionPlan, PlanItem, plan_from_items
from models.analysis import FlightAnalysis, analyse
from models.errors import PlanError
from models.flight import Floats
from models.rotor_model import RotorModel

ARDUPILOT = 3
#: Rows before the new ones that the analysis also gets: effects need neighbours for rates.
CONTEXT = 40
#: s after which more rows no longer change a prediction by effects, which look both ways.
SETTLED_AFTER = 1.2
#: Vehicle's s between two forecasts, and over which the flow is measured.
FORECAST_EVERY, FLOW_WINDOW = 2.0, 20.0
#: s for which two vehicles with one id stay suspended after they were last seen to take turns.
SHARED_HOLD = 10.0
#: s of silence after which a vehicle has left.
GONE = 60.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outlook:
    """What the rest of the flight will be like, as far as it can be told now."""

    seconds_to_empty: float = math.nan  # at the present flow, spraying on; inf without flow
    margin_full: float = math.nan  # predicted worst-rotor margin after a refill to the brim
    route: Forecast | None = None  # the rest of the mission, where one is known

    @property
    def margin_ahead(self) -> float:
        """Least predicted margin on the rest of the route; NaN without a mission."""
        return math.nan if self.route is None else self.route.least_margin


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
        self.plan: MissionPlan | None = None
        self._given_plan = False
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
        self._outlook = Outlook()
        self._outlook_s = -math.inf
        self._levels: deque[tuple[float, float]] = deque()  # (clock s, kg) at each forecast
        self._items: object = None
        #: (R,) ground's clock when each rotor's speed was last known; 0 before any was.
        self._rotor_us = np.zeros(model.airframe.rotor_count, dtype=np.int64)
        self._flying: bool | None = None  # in the last row
        self._tank: TankReading | None = None  # the last that had a level
        self._last_flow = 0.0  # kg/s when the pump was last on
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

    def use_plan(self, plan: MissionPlan) -> None:
        """Forecast along this mission rather than along one overheard."""
        self.plan, self._given_plan = plan, True

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
            self._outlook_s = -math.inf
            self._levels.clear()
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
        self._look_ahead(analysis, samples)
        events = self.alarms.rows(
            analysis,
            first,
            settled=slice(unsettled, settled),
            clock_s=clock_s,
            pumped_kg=pumped * self._flow_meter.first,
            virtual_kg=virtual,
            margin_ahead=self._outlook.margin_ahead,
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
            outlook=self._outlook,
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

    def _look_ahead(self, analysis: FlightAnalysis, samples: Sequence[Sample]) -> None:
        now = samples[-1]
        if now.clock_s - self._outlook_s < FORECAST_EVERY:
            return
        self._outlook_s = now.clock_s
        track, airframe = analysis.track, self._model.airframe
        tank = float(track.tank_kg[-1])
        flow = self._flow(samples)
        wind = track.wind_ned[-1]
        conditions = Conditions(
            tank_kg=tank,
            flow=flow,
            density=float(analysis.density[-1]),
            voltage=float(track.voltage[-1]),
            wind_ned=tuple(float(w) for w in np.nan_to_num(wind)),  # type: ignore[arg-type]
        )
        full = margin_at_fill(
            airframe,
            self._model,
            conditions,
            airframe.tank_capacity_kg,
            float(track.airspeed[-1]),
        )
        self._outlook = Outlook(
            seconds_to_empty=tank / flow if flow > 0.0 else (math.inf if flow == 0.0 else math.nan),
            margin_full=full,
            route=self._route(analysis, conditions),
        )

    def _flow(self, samples: Sequence[Sample]) -> float:
        """kg/s out of the tank while spraying: by the pump, else by the gauge; NaN unknown."""
        airframe, tank = self._model.airframe, samples[-1].tank
        if math.isfinite(tank.pump_share):
            full = airframe.pump_max_flow_l_min / 60.0 * airframe.liquid_density
            if tank.pump_share > 0.0:
                self._last_flow = full * tank.pump_share
            return self._last_flow * max(self._flow_meter.now, 0.0)
        level = float(samples[-1].values[COLUMNS["tank_kg"]])
        self._levels.append((samples[-1].clock_s, level))
        while self._levels[-1][0] - self._levels[0][0] > FLOW_WINDOW:
            self._levels.popleft()
        began, before = self._levels[0]
        seconds = samples[-1].clock_s - began
        # Without a full window a slope would be mostly the gauge's noise.
        return max(before - level, 0.0) / seconds if seconds > 0.8 * FLOW_WINDOW else math.nan

    def _route(self, analysis: FlightAnalysis, now: Conditions) -> Forecast | None:
        state, origin = self.state, self._sampler.origin
        if not self._given_plan and state.mission is not self._items:
            self._items = state.mission
            self.plan = _plan(state.mission.values(), home_first=state.autopilot == ARDUPILOT)
        position = analysis.track.position_ned[-1]
        if self.plan is None or origin is None or not np.all(np.isfinite(position)):
            return None
        speed = state.parameters.get("WPNAV_SPEED", 100.0 * self.plan.cruise_speed) / 100.0
        legs = route_ahead(
            self.plan,
            max(state.mission_item, 0),
            position,
            origin,
            speed=speed,
            spraying=float(analysis.track.spraying[-1]) > 0.5,
        )
        return forecast(legs, self._model, now)


def _plan(waypoints: Iterable[Waypoint], *, home_first: bool) -> MissionPlan | None:
    """The mission overheard, if it is whole."""
    ordered = sorted(waypoints, key=lambda w: w.number)
    if not ordered or [w.number for w in ordered] != list(range(len(ordered))):
        return None
    items = [
        PlanItem(
            number=w.number,
            command=w.command,
            frame=w.frame,
            parameters=(*w.parameters, w.latitude_deg, w.longitude_deg, w.altitude),
        )
        for w in ordered
    ]
    try:
        return plan_from_items(items, home_first=home_first)
    except PlanError:
        return None
