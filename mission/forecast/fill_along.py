"""Compute the thrust utilisation along a planned flight, by stretch and at its largest.

The largest fill that keeps the limit, and the tank mass below which the loss of one rotor is
survived, follow from it. So do the places where thrust is short, or where there is next to none:

- A slope that the vehicle's climb or descent limit slows down, and one on which the rotors lack
  thrust.
- Braking or turning where all rotors together lack the thrust to lean and to hold the height.
- A descent in which a rotor is near idle: it cannot give less, so the vehicle cannot be steered.
- A way that leads into the ground.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
import pymap3d

from thrustmargin.mission.forecast.plan_flight import PlanConditions, PlanFlight
from thrustmargin.mission.forecast.way import Span, SpanKind, WayLeg
from thrustmargin.mission.terrain import Terrain
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.model.advice import Advised, FlightLevel
from thrustmargin.models.model.analysis import FlightAnalysis, worst_rotor
from thrustmargin.models.model.fill_limits import steady_flight
from thrustmargin.models.model.inferred.utilisation_error import INTERVAL
from thrustmargin.models.model.rotor_model import identified_airframe
from thrustmargin.models.physics.atmosphere import G0
from thrustmargin.models.physics.margin import ceiling

#: Standard error of a stretch's largest utilisation, as a share of it, by how it is flown: 4 to 5 %
#: at 3,000 m and 2 % elsewhere, by the command of docs/measured.md.
FLOWN_ERROR = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class LegForecast:
    """The forecast of one stretch of a planned flight; utilisations are of the most used rotor."""

    item: int
    kind: SpanKind
    seconds: float
    utilisation_mean: float
    utilisation_peak: float
    interval: tuple[float, float]  # 90 %, of the peak
    tank_end_kg: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Weakest:
    """The place of a planned flight with the largest utilisation, and the shares of it by cause.

    The shares are differences of utilisation between steady flights: with and without the cause.
    """

    item: int
    kind: SpanKind
    utilisation: float
    interval: tuple[float, float]
    tank_kg: float
    manoeuvre: float  # more than straight and level
    load: float  # more than with an empty tank
    wind: float  # more than in still air
    battery: float  # more than with the battery as at the start


def leg_forecast(span: Span, analysis: FlightAnalysis) -> LegForecast:
    """Return duration, utilisation and remaining liquid of the leg or turn `span` of a plan.

    `analysis` is that of the simulated flight.
    """
    rows = slice(span.first, span.last)
    use, reach = worst_use(analysis, rows)
    top = int(np.argmax(np.where(np.isfinite(use), use, -1.0)))
    track = analysis.track
    end = track.time_s[min(span.last, track.time_s.size - 1)]
    return LegForecast(
        item=span.item,
        kind=span.kind,
        seconds=float(end - track.time_s[span.first]),
        utilisation_mean=float(np.mean(use)),
        utilisation_peak=float(use[top]),
        interval=(float(use[top] - reach[top]), float(use[top] + reach[top])),
        tank_end_kg=float(track.tank_kg[span.last - 1]),
    )


def worst_use(analysis: FlightAnalysis, rows: slice) -> tuple[Floats, Floats]:
    """Return the largest predicted utilisation (N,) of any rotor, and half its 90 % interval (N,).

    N rows are selected by `rows`.
    """
    use = analysis.utilisation_predicted[rows]
    worst, which = worst_rotor(use)
    error = analysis.utilisation_error[rows]
    places = np.nan_to_num(which).astype(int)
    model_error = error[np.arange(worst.size), places]
    return worst, INTERVAL * np.hypot(model_error, FLOWN_ERROR * worst)


def weakest_place(flight: PlanFlight, analysis: FlightAnalysis) -> Weakest | None:
    """Return the place with the largest predicted utilisation, and the shares of it by cause.

    A share is the difference from steady flight: by the manoeuvre, the load, the wind and the
    emptier battery. None where nothing is predicted.
    """
    use, reach = worst_use(analysis, slice(None))
    if not np.isfinite(use).any():
        return None
    row = int(np.nanargmax(use))
    span = next(s for s in flight.course.spans if s.first <= row < s.last)
    track, model = flight.track, analysis.model
    speed = float(np.linalg.norm(track.velocity_ned[row]))
    tank, volts = float(track.tank_kg[row]), float(track.voltage[row])
    known = track.voltage[np.isfinite(track.voltage)]
    fresh = float(known.max()) if known.size else math.nan

    def level(kg: float, airspeed: float, voltage: float) -> float:
        prediction = steady_flight(model, flight.density[row], voltage, airspeed, np.array([kg]))
        return float(np.max(prediction.utilisation_predicted))

    steady = level(tank, float(track.airspeed[row]), volts)
    return Weakest(
        item=span.item,
        kind=span.kind,
        utilisation=float(use[row]),
        interval=(float(use[row] - reach[row]), float(use[row] + reach[row])),
        tank_kg=tank,
        manoeuvre=float(use[row]) - steady,
        load=steady - level(0.0, float(track.airspeed[row]), volts),
        wind=steady - level(tank, speed, volts),
        battery=steady - level(tank, float(track.airspeed[row]), fresh),
    )


TURNS = 6  # of the search for the largest fill
STEP_KG = 0.1  # by which a fill is rounded down
NUDGE_KG = 0.02  # to the safe side of a limit, so that the search closes in on it from both


def survivable_below(analysis: FlightAnalysis) -> float:
    """Return the tank mass, kg, below which the rest of the plan survives the loss of one rotor.

    Survival is by the lower end of the 90 % interval of the redundancy, yaw uncontrolled. If every
    row survives, return the largest tank mass of the plan; if none of the plan's tank masses is low
    enough, the smallest mass that would survive at every row (may be negative). NaN where a rotor
    is faulty or the redundancy is unknown.
    """
    craft, tank = identified_airframe(analysis.model), analysis.track.tank_kg
    sure = analysis.redundancy_yaw_uncontrolled * np.exp(-INTERVAL * analysis.redundancy_error)
    most = (craft.empty_mass + tank) * sure - craft.empty_mass
    if analysis.bad_part or not np.isfinite(most).all():
        return math.nan
    least = float(np.min(tank[tank > most], initial=math.inf))
    if math.isinf(least):
        return float(tank.max())
    return least if np.any(tank < least) else float(most.min())


def largest_fill(
    advised: Advised,
    given: PlanConditions,
    limit: float,
    flown: Callable[[PlanConditions], Advised],
) -> float:
    """Search for the largest tank mass at take-off, kg, with which the whole plan stays below
    `limit` and survives the loss of a rotor.

    `limit` is a share of a rotor's largest thrust. `flown` forecasts the plan under other
    conditions; `advised` is the forecast under `given`. The result is rounded down to 0.1 kg and at
    most what tank and take-off mass allow; 0 means not even an empty tank keeps the limit. NaN
    where the utilisation is unknown or a rotor is faulty. The search is by secant steps, because
    the mass left to the limit is nearly linear in the load.
    """
    craft = identified_airframe(advised.analysis.model)
    most = min(craft.tank_capacity_kg, craft.max_takeoff_mass - craft.empty_mass)
    kg, answer = given.fill_kg, advised
    known = math.isfinite(answer.advice.use.lasting_most) and math.isfinite(most)
    if not known or answer.advice.faults:
        return math.nan
    good, bad = 0.0, math.inf
    before: tuple[float, float] | None = None
    for _ in range(TURNS):
        if answer.advice.level is FlightLevel.UNDER:
            good = max(good, kg)
        else:
            bad = min(bad, kg)
        room = _room(answer, limit)
        close = answer.advice.level is FlightLevel.UNDER and room < STEP_KG
        if close or good >= most or bad - good <= STEP_KG:
            break
        slope = -1.0  # kg of room that a kg more in the tank takes
        if before is not None and kg != before[0]:
            slope = min((room - before[1]) / (kg - before[0]), -0.2)
        before = (kg, room)
        step = kg - room / slope - NUDGE_KG
        ceiling = min(bad, most + STEP_KG)
        kg = min(step if good < step < ceiling else 0.5 * (good + min(ceiling, most)), most)
        answer = flown(replace(given, fill_kg=kg))
    return math.floor(good / STEP_KG + 1e-6) * STEP_KG


def _room(advised: Advised, limit: float) -> float:
    """Return the extra mass, kg, with which the first row would reach a limit.

    Negative if a row exceeds a limit already. The limits are `limit` of lasting utilisation, and
    survival of the loss of one rotor, yaw uncontrolled, each with its error on the safe side.
    """
    analysis, use = advised.analysis, advised.advice.use
    mass = identified_airframe(analysis.model).empty_mass + analysis.track.tank_kg
    sure = analysis.redundancy_yaw_uncontrolled * np.exp(-INTERVAL * analysis.redundancy_error)
    by_use = mass * limit / (use.lasting + use.reach) - mass
    room = np.concatenate([by_use, mass * sure - mass])
    return float(np.nanmin(room))


PlaceKind = Literal[
    "slope slows", "slope beyond thrust", "loses height", "motors at idle", "into the ground"
]
#: Share of the ordered speed over ground below which a slope is reported to slow the vehicle.
SLOWED = 0.95
#: m of height lost in one stretch from which it is reported.
LEAST_LOST = 0.1
#: m/s of descent from which motors at idle are looked for; slower ones end by themselves.
DESCENDS = 0.5
#: MOT_SPIN_MIN and MPC_THR_MIN where nobody has set them: share of full output at idle.
SPIN_MIN, PX4_MIN = 0.15, 0.12


@dataclass(frozen=True, slots=True, kw_only=True)
class ThrustPlace:
    """A place of a plan where thrust is critical, with two figures that depend on its kind.

    "slope slows": m/s over ground flown, and ordered. "slope beyond thrust": utilisation, and m/s
    of climb. "loses height": m, and 0. "motors at idle": utilisation, and m/s of descent. "into the
    ground": m below it, and 0.
    """

    kind: PlaceKind
    item: int
    amount: float
    secondary: float = 0.0


def thrust_places(
    flight: PlanFlight,
    analysis: FlightAnalysis,
    idle: float,
    *,
    terrain: Terrain | None = None,
    home: tuple[float, float, float] = (math.nan, math.nan, math.nan),
) -> tuple[ThrustPlace, ...]:
    """Return the critical places of a simulated flight, at most one per kind and item, in flight
    order.

    Kinds: a slope that slows the vehicle, or needs more thrust than there is; height lost; motors
    at idle in a descent; a path into the ground. `idle` is the thrust utilisation of a rotor at
    idle. Only with `terrain` is the path compared with the ground below it; `home`, the origin of
    positions, is latitude and longitude, degrees, and m.
    """
    legs = tuple(timed.leg for timed in flight.course.legs)
    items = np.array([leg.item for leg in legs])[flight.course.active]
    climb = -flight.track.velocity_ned[:, 2]
    use = analysis.utilisation_predicted
    worst = np.max(use, axis=1)
    sloped = np.array([_slope(leg) for leg in legs])[flight.course.active]
    places = [
        ThrustPlace(kind="slope slows", item=leg.item, amount=flat, secondary=leg.level_speed)
        for leg in legs
        if _slope(leg) and (flat := _flat_speed(leg)) < SLOWED * leg.level_speed
    ]
    # Going up a slope; the turns at its ends are in the weakest place.
    too_steep = sloped & (climb > 0.0) & (worst > 1.0)
    places += [
        ThrustPlace(kind="slope beyond thrust", item=item, amount=most, secondary=rate)
        for item, most, rate in _most(items, too_steep, worst, climb)
    ]
    places += [
        ThrustPlace(kind="loses height", item=item, amount=lost)
        for item, lost in _height_lost(flight, analysis, items)
    ]
    resting = (climb < -DESCENDS) & (np.min(use, axis=1) <= idle)
    places += [
        ThrustPlace(kind="motors at idle", item=item, amount=-least, secondary=rate)
        for item, least, rate in _most(items, resting, -np.min(use, axis=1), -climb)
    ]
    if terrain is not None:
        below = _below_ground(flight, terrain, home)
        places += [
            ThrustPlace(kind="into the ground", item=item, amount=depth)
            for item, depth, _ in _most(items, below > 0.0, below, below)
        ]
    return _each_once(places)


def idle_use(parameters: Mapping[str, float], *, px4: bool) -> float:
    """Return the thrust utilisation of a rotor at the autopilot's least output.

    ArduPilot's MOT_SPIN_MIN is a share of full voltage, so of rotor speed; PX4's MPC_THR_MIN is one
    of thrust.
    """
    if px4:
        return parameters.get("MPC_THR_MIN", PX4_MIN)
    return parameters.get("MOT_SPIN_MIN", SPIN_MIN) ** 2


def _slope(leg: WayLeg) -> bool:
    """Return True if a leg leads forward and up or down at once."""
    return not leg.vertical and abs(float(leg.vector[2])) > 0.02 * leg.length


def _flat_speed(leg: WayLeg) -> float:
    """Return the horizontal part, m/s, of the speed along a leg."""
    return leg.speed * float(np.hypot(*leg.vector[:2])) / leg.length


def _most(
    items: Floats, rows: Bools, values: Floats, secondary: Floats
) -> list[tuple[int, float, float]]:
    """Return, for each item number with flagged rows, (item, its largest value, `secondary` in
    that row). All arrays are (T,)."""
    places = []
    for item in dict.fromkeys(items[rows].tolist()):
        of_item = np.flatnonzero(rows & (items == item))
        row = int(of_item[np.argmax(values[of_item])])
        places.append((int(item), float(values[row]), float(secondary[row])))
    return places


def _height_lost(
    flight: PlanFlight, analysis: FlightAnalysis, items: Floats
) -> list[tuple[int, float]]:
    """Return item and height, m, lost where all rotors together lack thrust, for each item with
    LEAST_LOST m or more.

    The thrust needed follows from weight and acceleration by Newton's law, not from the model. With
    the attitude kept, thrust that lacks a share d of the demand leaves a downward acceleration of d
    times the vertical part of the demand. It is integrated twice over consecutive rows that lack
    thrust, the largest such height of an item counts; height lost later, until the sinking is
    stopped, is not included. Vertical legs lose none: the vehicle climbs more slowly.
    """
    track, craft = flight.track, identified_airframe(analysis.model)
    upward = G0 - flight.course.gained_ned[:, 2]  # m/s²
    lean = np.prod(np.cos(track.attitude[:, :2]), axis=1)
    needed = (craft.empty_mass + track.tank_kg) * upward / np.maximum(lean, 1e-3)
    free = ceiling(craft, flight.density, track.voltage).free_thrust
    demand = np.nan_to_num(needed / (free * craft.rotor_effectiveness.sum()))
    # Straight up, a vehicle that lacks thrust only climbs slower.
    vertical = np.array([timed.leg.vertical for timed in flight.course.legs])[flight.course.active]
    lacking = np.where((demand > 1.0) & ~vertical, 1.0 - 1.0 / np.maximum(demand, 1.0), 0.0)
    down = lacking * upward
    step = np.diff(flight.track.time_s, append=flight.track.time_s[-1])
    edges = np.flatnonzero(np.diff(np.concatenate([[0], (lacking > 0.0).astype(int), [0]])))
    lost: dict[int, float] = {}
    for first, last in pairwise(edges.tolist()):
        if not lacking[first] > 0.0:
            continue
        rows = slice(first, last)
        sinking = np.cumsum(down[rows] * step[rows])
        item = int(items[first])
        lost[item] = max(lost.get(item, 0.0), float(np.sum(sinking * step[rows])))
    return [(item, height) for item, height in lost.items() if height >= LEAST_LOST]


def _below_ground(flight: PlanFlight, terrain: Terrain, home: tuple[float, float, float]) -> Floats:
    """Return the depth (T,), m, of the path below the ground, negative above it.

    NaN where the ground is unknown, and within 1 m of home.
    """
    north, east, down = flight.track.position_ned.T
    latitude, longitude, _ = pymap3d.ned2geodetic(north, east, 0.0, *home[:2], 0.0)
    at_home = float(terrain.height(np.array(home[:1]), np.array(home[1:2]))[0])
    ground = terrain.height(latitude, longitude) - at_home
    # Take-off and landing are on the ground.
    airborne = np.hypot(north, east) > 1.0
    return np.where(airborne, ground + down, np.nan)


def _each_once(places: list[ThrustPlace]) -> tuple[ThrustPlace, ...]:
    """Return the places with only the first of each kind and item."""
    once = {(place.kind, place.item): place for place in reversed(places)}
    return tuple(place for place in places if once[place.kind, place.item] is place)
