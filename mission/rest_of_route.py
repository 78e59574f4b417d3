"""What lies ahead on a mission: tank and predicted thrust margin along the rest of the route.

The aircraft flies straight from place to place at the mission's speed and sprays where the mission
says so, at the flow that it has now. Air and battery stay as they are now. Each moment is one of
straight and level flight: turns, climbs and gusts take more, so that this is no bound. Jumps back
(DO_JUMP) are not followed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pymap3d
from numpy.typing import NDArray

from thrustmargin.mission.plan import (
    CHANGE_SPEED,
    DO_SPRAYER,
    FRAME_AMSL,
    RETURN_TO_LAUNCH,
    MissionPlan,
    PlanItem,
)
from thrustmargin.models.flight import FlightTrack, Floats, Origin
from thrustmargin.models.model.airframe_claim import AirframeClaim
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
from thrustmargin.models.model.fill_limits import steady_flight
from thrustmargin.models.model.rotor_model import RotorModel

#: m/s below which a mission speed is taken as unknown
SLOWEST = 0.2
#: A route ahead is no flight: there is nothing in it that could speak against the airframe.
AHEAD = AirframeClaim(words="a route ahead")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Leg:
    """One straight piece of the route."""

    item: int  # number of the mission item that it leads to
    start_ned: Floats  # (3,) m
    end_ned: Floats  # (3,) m
    speed: float  # m/s over ground
    spraying: bool

    @property
    def seconds(self) -> float:
        return float(np.linalg.norm(self.end_ned - self.start_ned)) / self.speed


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """What is taken as it is now."""

    tank_kg: float
    flow: float  # kg/s while spraying
    density: float  # kg/m³
    voltage: float  # V; NaN unknown
    wind_ned: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Forecast:
    """The rest of the route at N moments, at the start, at each place, and between them."""

    item: NDArray[np.intp]  # (N,) mission item being flown to
    analysis: FlightAnalysis  # of N predicted rows; time_s counts from now

    @property
    def margin(self) -> Floats:
        """(N,) predicted thrust margin of the worst rotor; NaN where nothing can be predicted."""
        return np.min(self.analysis.margin_predicted, axis=1)

    @property
    def least_margin(self) -> float:
        """The least of `margin` in straight and level flight, no bound; NaN when none is known."""
        known = self.margin[np.isfinite(self.margin)]
        return float(np.min(known)) if known.size else float("nan")


def route_ahead(
    plan: MissionPlan,
    item: int,
    position_ned: Floats,
    origin: Origin,
    *,
    speed: float,
    spraying: bool = False,
) -> tuple[Leg, ...]:
    """Legs from `position_ned` (3,) m through the items from number `item` on.

    `speed` m/s and `spraying` hold until the mission changes them. Altitudes above ground count as
    above the origin.
    """
    at = np.asarray(position_ned, dtype=np.float64)
    legs: list[Leg] = []
    for step in plan.items:
        if step.command == CHANGE_SPEED and step.parameters[1] > SLOWEST:
            speed = step.parameters[1]
        if step.number < item:
            continue
        if step.command == DO_SPRAYER:
            spraying = step.parameters[0] > 0.5
        to = _place_ned(step, plan, origin, at)
        if to is None:
            continue
        if np.linalg.norm(to - at) > 0.1:
            legs.append(
                Leg(
                    item=step.number,
                    start_ned=at,
                    end_ned=to,
                    speed=max(speed, SLOWEST),
                    spraying=spraying,
                )
            )
        at = to
    return tuple(legs)


def _place_ned(item: PlanItem, plan: MissionPlan, origin: Origin, at: Floats) -> Floats | None:
    place = item.place
    if item.command == RETURN_TO_LAUNCH:
        place = (plan.home[0], plan.home[1], -float(at[2]))
    if place is None:
        return None
    latitude, longitude, altitude = place
    amsl = altitude if item.frame == FRAME_AMSL else origin.altitude + altitude
    return np.array(
        pymap3d.geodetic2ned(
            latitude,
            longitude,
            amsl,
            origin.latitude_deg,
            origin.longitude_deg,
            origin.altitude,
        )
    )


def forecast(
    legs: Sequence[Leg], model: RotorModel, now: Conditions, *, step: float = 5.0
) -> Forecast | None:
    """The flight along `legs` with rows at most `step` s apart; None where there is no way left."""
    rows: list[tuple[float, Floats, float, float, int]] = []
    time_s, tank = 0.0, now.tank_kg
    wind = np.asarray(now.wind_ned, dtype=np.float64)
    for leg in legs:
        over_ground = (leg.end_ned - leg.start_ned) / leg.seconds
        airspeed = float(np.linalg.norm(over_ground - wind))
        pieces = max(math.ceil(leg.seconds / step), 1)
        for share in np.linspace(0.0, 1.0, pieces + 1)[0 if not rows else 1 :]:
            used = now.flow * leg.seconds * share if leg.spraying else 0.0
            place = leg.start_ned + share * (leg.end_ned - leg.start_ned)
            rows.append(
                (time_s + share * leg.seconds, place, max(tank - used, 0.0), airspeed, leg.item)
            )
        time_s, tank = rows[-1][0], rows[-1][2]
    if not rows:
        return None
    count = len(rows)
    track = FlightTrack.of(
        name="the rest of the route",
        time_s=np.array([r[0] for r in rows]),
        rotor_count=model.airframe.rotor_count,
        position_ned=np.array([r[1] for r in rows]),
        tank_kg=np.array([r[2] for r in rows]),
        airspeed=np.array([r[3] for r in rows]),
        voltage=np.full(count, now.voltage),
    )
    analysis = analyse(track, model, np.full(count, now.density), claim=AHEAD)
    return Forecast(item=np.array([r[4] for r in rows], dtype=np.intp), analysis=analysis)


def margin_at_fill(model: RotorModel, now: Conditions, fill_kg: float, airspeed: float) -> float:
    """Predicted thrust margin of the worst rotor with `fill_kg` in the tank; NaN if unknown."""
    filled = steady_flight(model, now.density, now.voltage, airspeed, np.array([fill_kg]))
    return float(np.min(filled.margin_predicted))
