"""Reduce a flown path to a bounded number of coloured segments, and predict the rest of a mission.

A segment ends after some distance or time and keeps the worst value of its rows. When there are too
many, the length doubles; rows that no segment needs are dropped, so that drawing an hour takes as
long as a minute.

The rest of a mission is simulated as a plan is before take-off, by the vehicle's limits, with
turns, climbs and stops, starting at rest at the present position. Flow, air, wind and battery stay
at their present values. Gusts are not modelled.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Literal

import numpy as np
import pymap3d
from numpy.typing import NDArray

from thrustmargin.mission.forecast.limits import FlightLimits, flight_limits
from thrustmargin.mission.forecast.plan_flight import (
    PlanConditions,
    PlanFlight,
    fly_plan,
    with_slower_yaw,
)
from thrustmargin.mission.forecast.way import Course, WayLeg, course, plan_legs, timed_legs
from thrustmargin.mission.plan_items import FIRMWARE_PX4, MissionPlan
from thrustmargin.mission.steps import plan_steps, pump_output
from thrustmargin.models.errors import PlanError
from thrustmargin.models.flight import Floats, Origin
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.analysis import FlightAnalysis, analyse, thrust_use
from thrustmargin.models.model.fill_limits import steady_flight
from thrustmargin.models.model.rotor_model import RotorModel

Rows = NDArray[np.intp]
Worst = Literal["max", "min", "abs"]

LENGTH, SECONDS, PAUSE = 0.5, 2.0, 2.0  # m and s of a segment at first; s that break the line
LIMIT = 1500  # segments; with four times as many a browser draws 1.6 times as long
#: Rows a segment beyond which rows are forgotten.
ROWS_EACH = 10


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Route:
    """S straight segments in flight order; neighbours share the row at which they meet."""

    start_ned: Floats  # (S, 3) m
    end_ned: Floats  # (S, 3) m
    first_row: Rows  # (S,) row of the track at which the segment starts
    last_row: Rows  # (S,) row at which it ends, included

    @property
    def count(self) -> int:
        return self.first_row.size

    def worst(self, values: Floats, worst: Worst) -> Floats:
        """Return the worst (S,) of `values` (T,) over each segment's rows; NaN if all are NaN.

        `max` and `min` keep the largest and smallest; `abs` the one furthest from zero, signed.
        """
        if worst == "abs":
            high, low = self.worst(values, "max"), self.worst(values, "min")
            return np.where(np.abs(high) >= np.abs(low), high, low)
        reduce = (np.fmax if worst == "max" else np.fmin).reduceat
        if self.count == 0:
            return np.empty(0)
        padded = np.append(np.asarray(values, dtype=np.float64), np.nan)
        bounds = np.column_stack([self.first_row, self.last_row + 1]).ravel()
        return reduce(padded, bounds)[::2]


class Trail:
    """The rows of one aircraft with K values each; `kinds` define the worst of each value."""

    def __init__(self, kinds: Sequence[Worst], limit: int = LIMIT) -> None:
        self._kinds, self._limit = tuple(kinds), limit
        self._rows = np.empty((0, 5 + len(self._kinds)))  # time, piece, north, east, down, values
        self._last_s = np.nan
        self._piece = 0

    def add(self, time_s: Floats, position_ned: Floats, values: Floats) -> None:
        """Append N rows in order of time: times (N,), s, places (N, 3), m NED, and values (N, K).

        A pause, a step back in time or a NaN place (whose row is dropped) begins a new piece of the
        path. Above a limit of rows the path is decimated.
        """
        gap = np.diff(time_s, prepend=self._last_s)
        placed = np.all(np.isfinite(position_ned), axis=1)
        piece = self._piece + np.cumsum(~((gap >= 0.0) & (gap <= PAUSE)) | ~placed)
        if time_s.size:
            self._last_s, self._piece = time_s[-1], piece[-1]
        rows = np.column_stack([time_s, piece, position_ned, values])[placed]
        self._rows = np.concatenate([self._rows, rows])
        if len(self._rows) > ROWS_EACH * self._limit:
            self._decimate()

    @property
    def route(self) -> Route:
        """Return the straight segments of the path flown so far.

        Each covers the same path length, or the same time where the vehicle hardly moves. They are
        lengthened by powers of 2 until there are about `limit` at most.
        """
        time_s, piece, position = self._rows[:, 0], self._rows[:, 1], self._rows[:, 2:5]
        moved = np.linalg.norm(np.diff(position, axis=0), axis=1) / LENGTH
        share = np.maximum(moved, np.diff(time_s) / SECONDS) * (np.diff(piece) == 0)
        travelled = np.cumsum(np.append(np.zeros(min(time_s.size, 1)), share))
        total = travelled[-1] if travelled.size else 0.0
        stretch = 2.0 ** np.ceil(np.log2(max(total / self._limit, 1.0)))
        part = np.column_stack([piece, np.floor(travelled / stretch)])
        begins = np.flatnonzero(np.any(np.diff(part, axis=0, prepend=np.nan) != 0.0, axis=1))
        ends = np.append(begins[1:], time_s.size - 1)[: begins.size]
        ends -= piece[ends] != piece[begins]  # not on into the next piece
        first, last = begins[ends > begins], ends[ends > begins]
        return Route(
            start_ned=position[first],
            end_ned=position[last],
            first_row=first,
            last_row=last,
        )

    def values(self, which: int) -> Floats:
        """Return value number `which` (T,) of the rows."""
        return self._rows[:, 5 + which]

    def _decimate(self) -> None:
        """Drop all rows but the segment ends and, for each value, its worst row per segment."""
        route = self.route
        segment = np.searchsorted(route.first_row, np.arange(len(self._rows)), side="right") - 1
        kept = [route.first_row, route.last_row]
        for which, kind in enumerate(self._kinds):
            worst = np.append(route.worst(self.values(which), kind), np.nan)
            worst_rows = np.flatnonzero(self.values(which) == worst[segment])
            kept.append(worst_rows[np.unique(segment[worst_rows], return_index=True)[1]])
        self._rows = self._rows[np.unique(np.concatenate(kept))]


#: m/s below which a mission speed is taken as unknown
SLOWEST = 0.2
#: s of the rest that are flown: about as long as a battery lasts.
LONGEST_S = 900.0
#: A planned route is no flight: it has no measurement that could contradict the airframe.
PLANNED = AirframeMatch()


@dataclass(frozen=True, kw_only=True, eq=False)
class Forecast:
    """The predicted remaining route, at ten rows a second."""

    analysis: FlightAnalysis  # of N predicted rows; time_s counts from now

    @property
    def margin(self) -> Floats:
        """Return the predicted thrust margin (N,) of the most used rotor; NaN if it cannot be
        predicted.
        """
        return np.min(self.analysis.margin_predicted, axis=1)

    @cached_property
    def lasting_margin(self) -> float:
        """Return the smallest lasting margin, 1 minus the largest lasting utilisation; NaN if
        unknown."""
        return 1.0 - thrust_use(self.analysis, 0.5).lasting_most


def remaining_route(
    plan: MissionPlan,
    item: int,
    position_ned: Floats,
    origin: Origin,
    *,
    parameters: Mapping[str, float],
    speed: float,
    spraying: bool = False,
) -> tuple[tuple[WayLeg, ...], FlightLimits]:
    """Return the legs from `position_ned` (3,) through the items from number `item` on, and the
    limits.

    The position, m, is about `origin`, the legs about the plan's home. No legs if no item remains
    or the rest cannot be flown. `parameters` are the autopilot's; `speed`, m/s, and `spraying` (the
    pump is on) apply until the mission changes them. Altitudes above ground count as above home.
    """
    limits = flight_limits(parameters, px4=plan.firmware == FIRMWARE_PX4)
    limits = replace(limits, speed=max(speed, SLOWEST))
    whole = plan_steps(plan, pump_output(parameters))
    first = next((k for k, step in enumerate(whole.steps) if step.item >= item), None)
    if first is None:
        return (), limits
    rest = tuple(
        step if step.pump is not None else replace(step, pump=spraying)
        for step in whole.steps[first:]
    )
    north, east, _ = pymap3d.geodetic2ned(
        origin.latitude_deg, origin.longitude_deg, 0.0, *plan.home[:2], 0.0
    )
    home = plan.home[2] if np.isfinite(plan.home[2]) else origin.altitude
    start = position_ned + np.array([float(north), float(east), home - origin.altitude])
    plan = replace(plan, home=(*plan.home[:2], home))
    try:
        return plan_legs(plan, replace(whole, steps=rest), limits, start=start), limits
    except PlanError:
        return (), limits


def forecast(
    legs: Sequence[WayLeg], limits: FlightLimits, model: RotorModel, given: PlanConditions
) -> Forecast | None:
    """Simulate and analyse the flight along `legs`, at most about its first LONGEST_S seconds.

    `given` are the present conditions; the battery's voltage counts as constant, NaN if unknown.
    Return None without a leg.
    """
    if not legs:
        return None
    ends = np.array([leg.end_s for leg in timed_legs(legs)])
    legs = legs[: int(np.searchsorted(ends, LONGEST_S)) + 1]

    def fly(way: Course) -> PlanFlight:
        return fly_plan("the rest of the route", way, model, given)

    flight = with_slower_yaw(fly(course(legs, limits)), model, partial(course, legs), fly)
    volts = np.full(flight.track.time_s.size, given.battery.voltage)
    analysis = analyse(
        replace(flight.track, voltage=volts), model, flight.density, airframe_match=PLANNED
    )
    return Forecast(analysis=analysis)


def margin_at_fill(
    model: RotorModel, given: PlanConditions, fill_kg: float, airspeed: float
) -> float:
    """Return the predicted thrust margin, a share, of the most used rotor with `fill_kg` in the
    tank; NaN if unknown.

    It is for steady level flight at `airspeed`, m/s, in the air and with the battery voltage of
    `given`.
    """
    volts = given.battery.voltage
    filled = steady_flight(model, given.density, volts, airspeed, np.array([fill_kg]))
    return float(np.min(filled.margin_predicted))
