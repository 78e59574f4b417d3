"""Compare a flight with the forecast of its plan, stretch by stretch.

The forecast is made under the conditions known before take-off without asking: still air of the
density that the vehicle reports, its battery at rest with the capacity of the parameters, and the
pump driven by the sprayer's parameters.

The flight is matched to the plan by place and time. The end of each stretch is searched for near
its planned place, about as long after the end before as the forecast took.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
import pymap3d

from thrustmargin.mission.forecast.battery import FlightBattery, stated_capacity
from thrustmargin.mission.forecast.fill_along import worst_use
from thrustmargin.mission.forecast.limits import flight_limits
from thrustmargin.mission.forecast.plan_flight import (
    PLANNED,
    PlanConditions,
    PlanFlight,
    fly_plan,
    known_pump,
    with_slower_yaw,
)
from thrustmargin.mission.forecast.way import Course, Span, SpanKind, course, plan_legs
from thrustmargin.mission.plan_items import FIRMWARE_PX4, MissionPlan
from thrustmargin.mission.pump_rule import pumped_by_airframe
from thrustmargin.mission.steps import plan_steps, pump_output
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.day import Day, DaySource, DayValue, complete_day
from thrustmargin.models.physics.smoothing import known_mean, known_most, moving_mean


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanToFly:
    """The course of a plan on one vehicle, ready to be simulated under any conditions."""

    course: Course  # by the limits of the vehicle
    model: RotorModel
    home: tuple[float, float, float]
    start_yaw: float = math.nan  # rad, the heading before take-off; NaN unknown

    @classmethod
    def from_plan(
        cls,
        plan: MissionPlan,
        parameters: Mapping[str, float],
        model: RotorModel,
        *,
        start_yaw: float = math.nan,
    ) -> PlanToFly:
        """Return the plan as a course of the vehicle over time, to be simulated with `model`.

        `parameters` are the autopilot's, by name; `start_yaw` is the heading before take-off, rad;
        NaN unknown. Raise PlanError if the plan flies nowhere.
        """
        px4 = plan.firmware == FIRMWARE_PX4
        limits = flight_limits(parameters, px4=px4, model=model)
        steps = plan_steps(plan, pump_output(parameters))
        pumped = pumped_by_airframe(plan, steps, model.airframe)
        legs = plan_legs(plan, pumped, limits, start_yaw=start_yaw)
        way = course(legs, limits, start_yaw=start_yaw)
        return cls(course=way, model=model, home=plan.home, start_yaw=start_yaw)

    def fly(self, given: PlanConditions) -> tuple[PlanFlight, FlightAnalysis]:
        """Simulate the planned flight and return it with its analysis."""

        def fly(way: Course) -> PlanFlight:
            return fly_plan("the plan", way, self.model, given)

        legs = [timed.leg for timed in self.course.legs]
        by_limits = partial(course, legs, start_yaw=self.start_yaw)
        flight = with_slower_yaw(fly(self.course), self.model, by_limits, fly)
        return flight, analyse(flight.track, self.model, flight.density, airframe_match=PLANNED)

    def compare(
        self, given: PlanConditions, flown: FlownWay, *, over_s: float = 0.0
    ) -> PlanComparison:
        """Simulate the plan under `given` and compare it with the path `flown`; `over_s` as in
        `compare_with_plan`."""
        return compare_with_plan(*self.fly(given), flown, over_s=over_s)


def conditions_before_take_off(
    parameters: Mapping[str, float],
    airframe: Airframe,
    *,
    fill_kg: float,
    altitude: float,
    density: float = math.nan,
    rest_voltage: float = math.nan,
) -> PlanConditions:
    """Return the conditions known before take-off, with `fill_kg` in the tank (NaN: full).

    `altitude` is m above the sea; NaN counts as 0. `density` is that of the air, kg/m³; NaN: that
    of the default day at `altitude`. `rest_voltage` is V of the battery before take-off; NaN: full.
    """
    pump, capacity_ah = known_pump(parameters, airframe), stated_capacity(parameters)
    there = Day(height=DayValue(altitude, DaySource.PLAN))
    air = complete_day(airframe.nominal_voltage, there).density
    most = pump.most if math.isfinite(pump.most) else 0.0
    return PlanConditions(
        fill_kg=fill_kg if math.isfinite(fill_kg) else airframe.tank_capacity_kg,
        density=density if math.isfinite(density) else air,
        flow=0.0 if pump.per_metre > 0.0 else most,
        flow_per_metre=pump.per_metre,
        most_flow=most,
        battery=FlightBattery(
            # Without a capacity the voltage would be held, and under load it is not that at rest.
            voltage=rest_voltage if capacity_ah > 0.0 else math.nan,
            capacity_ah=capacity_ah,
        ),
    )


NEAR = 2.0  # m by which a flight is usually off its way
LATE, LATE_SHARE = 3.0, 0.2  # s, and share of a stretch, by which it is usually late
LEFT = 3.0  # times the usual, by place and time together, beyond which the plan was left
SMOOTH_S = 0.5  # a reading's noise is no load
SHORTEST_S = 1.0  # stretches shorter than that are not compared


@dataclass(frozen=True, slots=True)
class Pair:
    """A value as forecast and as flown; NaN where unknown."""

    forecast: float
    flown: float

    @property
    def off(self) -> float:
        """Return flown minus forecast."""
        return self.flown - self.forecast

    @property
    def least(self) -> float:
        """Return the smaller of forecast and flown."""
        return min(self.forecast, self.flown)


@dataclass(frozen=True, slots=True, kw_only=True)
class StretchComparison:
    """A stretch of a plan as forecast and as flown; utilisations are of the most used rotor."""

    item: int
    kind: SpanKind
    seconds: Pair
    speed: Pair  # m/s over ground, mean
    utilisation_mean: Pair
    utilisation_peak: Pair
    interval: tuple[float, float]  # 90 %, of the forecast's peak
    tank_end_kg: Pair
    voltage: Pair  # mean


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanComparison:
    """The stretches that were flown, and the item at which the flight left the plan (None: it
    did not)."""

    stretches: tuple[StretchComparison, ...]
    left_at: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlownWay:
    """The T rows of a flight off the ground, placed about the plan's home."""

    time_s: Floats
    place_ned: Floats  # (T, 3) m
    speed: Floats  # (T,) m/s over ground
    utilisation: Floats  # (T,) of the worst rotor, half-second means
    tank_kg: Floats
    voltage: Floats


def flown_way(analysis: FlightAnalysis, home: tuple[float, float, float]) -> FlownWay:
    """Return the rows off the ground of an analysed flight, with positions, m NED about `home`.

    `home` is latitude and longitude, degrees, and m above the sea; a NaN height counts as that of
    the log's origin.
    """
    track = analysis.track
    rows = track.flying
    return FlownWay(
        time_s=track.time_s[rows],
        place_ned=(track.position_ned + shift(track, home))[rows],
        speed=np.hypot(track.velocity_ned[rows, 0], track.velocity_ned[rows, 1]),
        utilisation=worst_smoothed(track.time_s, analysis.known_utilisation)[rows],
        tank_kg=track.tank_kg[rows],
        voltage=track.voltage[rows],
    )


def worst_smoothed(time_s: Floats, use: Floats) -> Floats:
    """Return the utilisation (T,) of the most used rotor, of half-second means of `use` (T, R)."""
    return np.max([moving_mean(time_s, rotor, SMOOTH_S) for rotor in use.T], axis=0)


def shift(track: FlightTrack, home: tuple[float, float, float]) -> Floats:
    """Return the vector (3,), m NED, from the plan's home to the origin of a track.

    The vertical part is 0, because the ground at the origin counts as that at home. NaN without an
    origin.
    """
    if track.origin is None:
        return np.full(3, np.nan)
    origin = track.origin
    north, east, _ = pymap3d.geodetic2ned(
        origin.latitude_deg, origin.longitude_deg, 0.0, home[0], home[1], 0.0
    )
    return np.array([float(north), float(east), 0.0])


def yaw_before(track: FlightTrack) -> float:
    """Return the heading, rad, at the first row off the ground that reports one; NaN without."""
    yaw = track.attitude[track.flying, 2]
    known = yaw[np.isfinite(yaw)]
    return float(known[0]) if known.size else math.nan


def stretch_ends(flight: PlanFlight, flown: FlownWay, *, over_s: float = 0.0) -> tuple[int, ...]:
    """Return, for each span of the forecast in order, the row of `flown` at which it ended.

    It is the row nearest to the planned end: in place, in height gained, because heights of logs
    and homes are not one, and in time. The result is shorter if the flight left the plan, and in a
    flight in progress, where an end counts only if `flown` goes on for `over_s` s after it.
    """
    time_s, place = flight.track.time_s, flight.track.position_ned
    row = 0
    ends: list[int] = []
    for span in flight.course.spans:
        end = min(span.last, time_s.size - 1)
        took = float(time_s[end] - time_s[span.first])
        if row == flown.time_s.size - 1 and ends:
            break  # the flight ended before
        began = float(flown.time_s[row])
        stop = int(np.searchsorted(flown.time_s, began + 2.0 * took + 4.0 * LATE))
        rows = slice(row, stop)
        away = np.linalg.norm(flown.place_ned[rows, :2] - place[end, :2], axis=1)
        sinking = float(place[end, 2] - place[span.first, 2])
        sunk = flown.place_ned[rows, 2] - flown.place_ned[row, 2]
        amiss = (sunk - sinking) / NEAR
        late = (flown.time_s[rows] - began - took) / (LATE + LATE_SHARE * took)
        cost = (away / NEAR) ** 2 + amiss**2 + late**2
        if not np.isfinite(cost).any():
            break
        best = int(np.nanargmin(cost))
        if cost[best] > LEFT**2:
            break
        if flown.time_s[-1] - flown.time_s[row + best] < over_s:
            break
        row += best
        ends.append(row)
    return tuple(ends)


def compare_with_plan(
    flight: PlanFlight, forecast: FlightAnalysis, flown: FlownWay, *, over_s: float = 0.0
) -> PlanComparison:
    """Compare the simulated `flight` of a plan with the path `flown`, stretch by stretch.

    `forecast` is the analysis of the simulated flight. Stretches that lasted less than SHORTEST_S
    s, forecast or flown, are left out. In a flight in progress a stretch has ended only if `flown`
    has rows for `over_s` s more. `left_at` of the result is the mission item of the first stretch
    whose end was not reached, None if all were. Without rows in `flown` it is the first item, None
    if the plan has none.
    """
    if not flown.time_s.size or not flight.course.spans:
        return PlanComparison(
            stretches=(), left_at=flight.course.spans[0].item if flight.course.spans else None
        )
    ends = stretch_ends(flight, flown, over_s=over_s)
    _, reach = worst_use(forecast, slice(None))
    planned = _Planned(
        # Smoothed like the flown one: of a peak both are half-second means.
        utilisation=worst_smoothed(flight.track.time_s, forecast.utilisation_predicted),
        reach=reach,
        speed=np.hypot(flight.track.velocity_ned[:, 0], flight.track.velocity_ned[:, 1]),
    )
    stretches = [
        _stretch(span, flight, planned, flown, slice(first, last))
        for span, first, last in zip(flight.course.spans, (0, *ends), ends, strict=False)
    ]
    unfinished = (
        None if len(ends) == len(flight.course.spans) else flight.course.spans[len(ends)].item
    )
    return PlanComparison(
        stretches=tuple(s for s in stretches if s.seconds.least >= SHORTEST_S), left_at=unfinished
    )


class _Planned(NamedTuple):
    """The predicted utilisation (T,), half its interval (T,), and the speed over ground (T,),
    m/s.
    """

    utilisation: Floats
    reach: Floats
    speed: Floats


def _stretch(
    span: Span, flight: PlanFlight, planned: _Planned, flown: FlownWay, done: slice
) -> StretchComparison:
    """Return the comparison of one span of the forecast with the rows `done` of `flown`.

    Each figure is a pair: as forecast and as flown.
    """
    track, rows = flight.track, slice(span.first, span.last)
    end = min(span.last, track.time_s.size - 1)
    use = planned.utilisation[rows]
    most = span.first + int(np.argmax(np.nan_to_num(use, nan=-1.0)))
    peak, reach = float(planned.utilisation[most]), float(planned.reach[most])
    last = max(done.stop - 1, done.start)
    return StretchComparison(
        item=span.item,
        kind=span.kind,
        seconds=Pair(
            float(track.time_s[end] - track.time_s[span.first]),
            float(flown.time_s[done.stop] - flown.time_s[done.start]),
        ),
        speed=Pair(known_mean(planned.speed[rows]), known_mean(flown.speed[done])),
        utilisation_mean=Pair(known_mean(use), known_mean(flown.utilisation[done])),
        utilisation_peak=Pair(peak, known_most(flown.utilisation[done])),
        interval=(peak - reach, peak + reach),
        tank_end_kg=Pair(float(track.tank_kg[end]), float(flown.tank_kg[last])),
        voltage=Pair(known_mean(track.voltage[rows]), known_mean(flown.voltage[done])),
    )


def mean_off(pairs: Sequence[Pair]) -> float:
    """Return the mean of flown minus forecast over the pairs with both known; NaN if there are
    none.
    """
    return known_mean(np.array([pair.off for pair in pairs]))
