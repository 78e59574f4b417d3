"""The forecast for the rest of a flight: how long the liquid lasts, and the margin to come."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from thrustmargin.gcs_plugin.live.rows.tank_balance import DeliveryMeter
from thrustmargin.gcs_plugin.live.rows.vehicle_state import ARDUPILOT, VehicleState
from thrustmargin.gcs_plugin.live.rows.vehicle_telemetry import LiveRows
from thrustmargin.mission.forecast.battery import FlightBattery
from thrustmargin.mission.forecast.plan_flight import PlanConditions
from thrustmargin.mission.plan import MissionPlan, plan_from_items
from thrustmargin.mission.plan_check import parameter
from thrustmargin.mission.plan_items import PlanItem
from thrustmargin.mission.route import (
    Forecast,
    forecast,
    margin_at_fill,
    remaining_route,
)
from thrustmargin.models.errors import PlanError
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.rotor_model import RotorModel

#: Vehicle's s between two forecasts, and over which the flow is measured.
FORECAST_EVERY, FLOW_WINDOW = 2.0, 20.0
#: Vehicle's s between two flights of the rest of the route, while it leads to the same item.
ROUTE_EVERY = 6.0
#: Standard errors that a level must have fallen by in the window to show a flow at all.
SURE_FALL = 3.0
LONGEST_FLIGHT = 3600.0  # s; no sprayer flies longer


@dataclass(frozen=True, kw_only=True, eq=False)
class Outlook:
    """The forecast for the rest of the flight, as of the newest row."""

    #: At the present flow, spraying on; inf where that is not within a flight.
    seconds_to_empty: float = math.nan
    full: Callable[[], float] = lambda: math.nan  # makes `margin_full`
    route: Forecast | None = None  # the rest of the mission, where one is known
    sound: bool = True  # no rotor or motor is known to be bad, as the predicted margins assume

    @cached_property
    def margin_full(self) -> float:
        """Return the predicted margin, a share of 1, of the worst rotor with a full tank;
        computed when requested. NaN where a rotor or motor is bad."""
        return self.full() if self.sound else math.nan

    @property
    def margin_ahead(self) -> float:
        """Return the least predicted lasting margin on the rest of the route; NaN without a
        mission, and where a rotor or motor is bad."""
        return self.route.lasting_margin if self.route and self.sound else math.nan


class LookAhead:
    """A forecast of liquid and margin for one vehicle, from its pump and route.

    `now` is the last forecast, made every two seconds of its clock.
    """

    def __init__(self, model: RotorModel) -> None:
        self.now = Outlook()
        self.plan: MissionPlan | None = None
        self._given_at = -1  # changes of the mission when the plan was given
        self._delivery = DeliveryMeter()
        self._model = model
        self._done_s = -math.inf
        self._levels: deque[tuple[float, float]] = deque()  # (clock s, kg) at each forecast
        self._items: object = None  # the mission overheard that `plan` is made of
        self._route_of: tuple[float, int, MissionPlan | None] = (-math.inf, -1, None)
        self._last_flow = 0.0  # kg/s when the pump was last on

    def use_plan(self, plan: MissionPlan | None, state: VehicleState) -> None:
        """Forecast along `plan` until the vehicle's own mission is replaced; None if it has
        none."""
        self.plan, self._given_at = plan, state.mission_changes

    def restart(self) -> None:
        """Reset times and tank levels for the new clock of a vehicle that restarted."""
        self._done_s = -math.inf
        self._levels.clear()

    def rows(
        self, analysis: FlightAnalysis, first: int, new: LiveRows, state: VehicleState
    ) -> tuple[Floats, Floats]:
        """Process the rows `new`, in order, which are those of the analysis from `first` on, and
        renew the forecast `now` every FORECAST_EVERY s.

        Return two arrays (N,), one value for each new row: kg delivered since the pump was first
        heard, by the delivery factor then known; and the least predicted margin, a share, on the
        rest of the route, NaN without a mission or a verdict.
        """
        gauge = analysis.track.measured("tank_kg")
        delivered, margin_ahead = np.full((2, new.clock_s.size), np.nan)
        for k, row in enumerate(range(first, analysis.track.time_s.size)):
            self._delivery.add(float(gauge[row]), float(new.pumped_kg[k]))
            delivered[k] = new.pumped_kg[k] * self._delivery.first
            clock_s = float(new.clock_s[k])
            if analysis.no_verdict:
                self.now, self._done_s = Outlook(), -math.inf
            elif clock_s - self._done_s >= FORECAST_EVERY:
                self._done_s = clock_s
                item = int(np.nan_to_num(new.mission_item[k], nan=-1.0))
                self._predict(analysis, row, clock_s, float(new.pump_share[k]), item, state)
            margin_ahead[k] = self.now.margin_ahead
        return delivered, margin_ahead

    def _predict(
        self,
        analysis: FlightAnalysis,
        row: int,
        clock_s: float,
        pump_share: float,
        mission_item: int,
        state: VehicleState,
    ) -> None:
        """Set `now` to the forecast from one row, at the vehicle's clock `clock_s`, s: time until
        the tank is empty, margin with a full tank, and the remaining route.

        `pump_share` is the pump's output, 0 to 1, NaN if unknown; `mission_item` the number of the
        item flown to, -1 if unknown. An unknown wind counts as none.
        """
        track, airframe = analysis.track, self._model.airframe
        tank = float(track.tank_kg[row])
        inferred = math.isnan(track.measured("tank_kg")[row])
        error = track.standard_errors["tank_kg"][row] if inferred and math.isfinite(tank) else 0.0
        flow = self._flow(clock_s, tank, float(error), pump_share, self._delivery.now)
        conditions = PlanConditions(
            fill_kg=tank,
            flow=flow,
            density=float(analysis.density[row]),
            battery=FlightBattery(voltage=float(track.voltage[row])),
            wind_ned=tuple(float(w) for w in np.nan_to_num(track.wind_ned[row])),  # type: ignore[arg-type]
        )
        airspeed, fill = float(track.airspeed[row]), airframe.tank_capacity_kg
        self.now = Outlook(
            seconds_to_empty=_seconds_to_empty(tank, flow),
            full=lambda: margin_at_fill(self._model, conditions, fill, airspeed),
            route=self._route(track, row, clock_s, conditions, state, mission_item),
        )

    def _flow(
        self, clock_s: float, level: float, error: float, pump_share: float, delivery: float
    ) -> float:
        """Return the flow out of the tank while spraying, kg/s, by pump, else by gauge.

        `pump_share` is the pump's output, 0 to 1, NaN if unknown: off, the last flow is kept.
        `delivery` is the ratio of delivered to pumped liquid; `level` kg, with the standard error
        `error` if inferred. NaN if unknown, as before the gauge was read for 80 % of FLOW_WINDOW.
        """
        airframe = self._model.airframe
        if math.isfinite(pump_share):
            full = airframe.pump_max_flow_l_min / 60.0 * airframe.liquid_density
            if pump_share > 0.0:
                self._last_flow = full * pump_share
            return self._last_flow * max(delivery, 0.0)
        self._levels.append((clock_s, level))
        while self._levels[-1][0] - self._levels[0][0] > FLOW_WINDOW:
            self._levels.popleft()
        # Without a full window a slope would be mostly the gauge's noise.
        if clock_s - self._levels[0][0] <= 0.8 * FLOW_WINDOW:
            return math.nan
        return _fall(np.array(self._levels), error)

    def _route(
        self,
        track: FlightTrack,
        row: int,
        clock_s: float,
        conditions: PlanConditions,
        state: VehicleState,
        mission_item: int,
    ) -> Forecast | None:
        if self._given_at != state.mission_changes and state.mission is not self._items:
            self._items = state.mission
            self.plan = _plan(state.mission.values(), home_first=state.autopilot == ARDUPILOT)
        position = track.position_ned[row]
        if self.plan is None or track.origin is None or not np.all(np.isfinite(position)):
            return None
        done_s, item, plan = self._route_of
        same = item == mission_item and plan is self.plan and self.now.route is not None
        if same and 0.0 <= clock_s - done_s < ROUTE_EVERY:
            return self.now.route
        self._route_of = (clock_s, mission_item, self.plan)
        set_speed = parameter(state.parameters, "WP_SPD")
        speed = set_speed if set_speed > 0.0 else self.plan.cruise_speed
        legs, limits = remaining_route(
            self.plan,
            max(mission_item, 0),
            position,
            track.origin,
            parameters=state.parameters,
            speed=speed,
            spraying=float(track.spraying[row]) > 0.5,
        )
        return forecast(legs, limits, self._model, conditions)


def recorded_seconds_to_empty(track: FlightTrack, row: int) -> float:
    """Return the s until a recorded flight's tank is empty, at its rate in FLOW_WINDOW s to `row`.

    NaN where the level is known for less than 80 % of that window or does not fall significantly.
    """
    time_s = track.time_s
    first = int(np.searchsorted(time_s, time_s[row] - FLOW_WINDOW))
    levels = np.column_stack([time_s[first : row + 1], track.tank_kg[first : row + 1]])
    levels = levels[np.isfinite(levels[:, 1])]
    if len(levels) < 2 or levels[-1, 0] - levels[0, 0] <= 0.8 * FLOW_WINDOW:
        return math.nan
    error = track.standard_errors.get("tank_kg")
    scatter = 0.0 if error is None else float(np.nan_to_num(error[row]))
    return _seconds_to_empty(float(levels[-1, 1]), _fall(levels, scatter))


def _fall(levels: Floats, error: float) -> float:
    """Return the rate, kg/s, at which levels (N, 2), clock s and kg, fall; NaN if not significant.

    Significant is a fall over the window of more than SURE_FALL times its standard error, of which
    `error`, kg, is one part. N must be at least 2.
    """
    time_s, kg = levels.T - levels.mean(axis=0)[:, None]
    square = float(time_s @ time_s)
    slope = float(time_s @ kg) / square
    scatter = float(np.sum((kg - slope * time_s) ** 2)) / max(len(levels) - 2, 1)
    seconds = float(levels[-1, 0] - levels[0, 0])
    sure = -slope * seconds > SURE_FALL * math.hypot(math.sqrt(scatter / square) * seconds, error)
    return -slope if sure else math.nan


def _seconds_to_empty(tank: float, flow: float) -> float:
    """Return the s until a tank of `tank` kg is empty at `flow` kg/s; NaN if either is unknown.

    inf without a flow, or if beyond LONGEST_FLIGHT.
    """
    seconds = tank / flow if flow > 0.0 else (math.inf if flow == 0.0 else math.nan)
    return math.inf if seconds > LONGEST_FLIGHT else seconds


def _plan(waypoints: Iterable[PlanItem], *, home_first: bool) -> MissionPlan | None:
    """Return the mission of the items received from the link; None unless it is complete and valid.

    `home_first`: item 0 is the home position, as in ArduPilot.
    """
    ordered = sorted(waypoints, key=lambda w: w.number)
    if not ordered or [w.number for w in ordered] != list(range(len(ordered))):
        return None
    try:
        return plan_from_items(ordered, home_first=home_first)
    except PlanError:
        return None
