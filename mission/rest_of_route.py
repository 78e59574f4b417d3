"""What lies ahead on a mission: tank and predicted thrust margin along the rest of the route.

The rest is flown as a plan is before take-off, by the vehicle's own limits, with its turns, climbs
and stops, from where the aircraft is, at rest. It sprays where the mission says so, at the flow
that it has now; air, wind and battery stay as they are now. Gusts are not in it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import pymap3d
from numpy.typing import NDArray

from thrustmargin.mission.ahead.battery import FlightBattery
from thrustmargin.mission.ahead.course import Course, course
from thrustmargin.mission.ahead.limits import FlightLimits, flight_limits
from thrustmargin.mission.ahead.plan_flight import PlanConditions, PlanFlight, fly_plan, giving_way
from thrustmargin.mission.ahead.plan_legs import plan_legs
from thrustmargin.mission.ahead.way import WayLeg, timed_legs
from thrustmargin.mission.plan_items import FIRMWARE_PX4, MissionPlan
from thrustmargin.mission.steps import plan_steps, pump_output
from thrustmargin.models.errors import PlanError
from thrustmargin.models.flight import Floats, Origin
from thrustmargin.models.model.airframe_claim import AirframeClaim
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
from thrustmargin.models.model.fill_limits import steady_flight
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.model.thrust_use import thrust_use

#: m/s below which a mission speed is taken as unknown
SLOWEST = 0.2
#: s of the rest that are flown: about as long as a battery lasts.
LONGEST_S = 900.0
#: A route ahead is no flight: there is nothing in it that could speak against the airframe.
AHEAD = AirframeClaim(words="a route ahead")


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """What is taken as it is now."""

    tank_kg: float
    flow: float  # kg/s while spraying
    density: float  # kg/m³
    voltage: float  # V; NaN unknown
    wind_ned: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Forecast:
    """The rest of the route, ten rows a second."""

    item: NDArray[np.intp]  # (N,) mission item being flown to
    analysis: FlightAnalysis  # of N predicted rows; time_s counts from now

    @property
    def margin(self) -> Floats:
        """(N,) predicted thrust margin of the worst rotor; NaN where nothing can be predicted."""
        return np.min(self.analysis.margin_predicted, axis=1)

    @property
    def least_margin(self) -> float:
        """The least of `margin`, turns and climbs included; NaN when none is known."""
        known = self.margin[np.isfinite(self.margin)]
        return float(np.min(known)) if known.size else float("nan")

    @cached_property
    def lasting_margin(self) -> float:
        """The least margin that lasts, as the answer to a flight counts it; NaN when unknown."""
        return 1.0 - thrust_use(self.analysis, 0.5).lasting_most


def route_ahead(
    plan: MissionPlan,
    item: int,
    position_ned: Floats,
    origin: Origin,
    *,
    parameters: Mapping[str, float],
    speed: float,
    spraying: bool = False,
) -> tuple[tuple[WayLeg, ...], FlightLimits]:
    """Legs from `position_ned` (3,) m through the items from number `item` on, about home, and the
    limits that they are flown by; () where nothing is left, or what is left cannot be flown.

    `parameters` are the autopilot's; `speed` m/s and `spraying` hold until the mission changes
    them. Altitudes above ground count as above home.
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
    legs: Sequence[WayLeg], limits: FlightLimits, model: RotorModel, now: Conditions
) -> Forecast | None:
    """The flight along `legs`, of a long one the first part; None where there is no way left."""
    if not legs:
        return None
    ends = np.array([leg.end_s for leg in timed_legs(legs)])
    legs = legs[: int(np.searchsorted(ends, LONGEST_S)) + 1]
    given = PlanConditions(
        fill_kg=now.tank_kg,
        density=now.density,
        flow=now.flow,
        wind_ned=now.wind_ned,
        battery=FlightBattery(voltage=now.voltage),
    )

    def fly(way: Course) -> PlanFlight:
        return fly_plan("the rest of the route", way, model, given)

    flight = giving_way(fly(course(legs, limits)), model, partial(course, legs), fly)
    volts = np.full(flight.track.time_s.size, now.voltage)
    analysis = analyse(replace(flight.track, voltage=volts), model, flight.density, claim=AHEAD)
    items = np.array([leg.item for leg in legs], dtype=np.intp)
    return Forecast(item=items[flight.course.active], analysis=analysis)


def margin_at_fill(model: RotorModel, now: Conditions, fill_kg: float, airspeed: float) -> float:
    """Predicted thrust margin of the worst rotor with `fill_kg` in the tank; NaN if unknown."""
    filled = steady_flight(model, now.density, now.voltage, airspeed, np.array([fill_kg]))
    return float(np.min(filled.margin_predicted))
