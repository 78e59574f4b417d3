"""Compute the thrust utilisation along a planned flight, by stretch and at its largest.

The largest fill that keeps the limit, and the tank mass below which the loss of one rotor is
survived, follow from it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.mission.forecast.plan_flight import PlanConditions, PlanFlight
from thrustmargin.mission.forecast.way import Span, SpanKind
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.advice import Advised, FlightLevel
from thrustmargin.models.model.analysis import FlightAnalysis, worst_rotor
from thrustmargin.models.model.fill_limits import steady_flight
from thrustmargin.models.model.inferred.utilisation_error import INTERVAL
from thrustmargin.models.model.rotor_model import identified_airframe

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
    """Return the worst rotor's predicted utilisation (N,) in each of `rows`, and half its 90 %
    interval (N,)."""
    use = analysis.utilisation_predicted[rows]
    worst, which = worst_rotor(use)
    error = analysis.utilisation_error[rows]
    places = np.nan_to_num(which).astype(int)
    model_error = error[np.arange(worst.size), places]
    return worst, INTERVAL * np.hypot(model_error, FLOWN_ERROR * worst)


def weakest_place(flight: PlanFlight, analysis: FlightAnalysis) -> Weakest | None:
    """Return the place with the largest predicted utilisation; None where nothing is predicted."""
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
    """Return the tank mass, kg, from which on the plan survives the loss of one rotor to its end.

    The bound is the lower end of the 90 % interval of the redundancy, without control of yaw. Where
    every row survives, return the largest tank mass of the plan; where the tank never gets low
    enough, the smallest tank mass that survives at every row. NaN where a rotor is faulty or the
    redundancy is unknown.
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
    `limit`.

    `flown` forecasts the plan under other conditions; `advised` is the forecast under `given`. The
    result is rounded down to 0.1 kg; 0 means not even an empty tank keeps the limit. NaN where the
    utilisation is unknown or a rotor is faulty. The search is by secant steps, because the mass
    left to the limit is nearly linear in the load.
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
    """Return the extra mass, kg, with which the first row would reach a limit; negative if it
    exceeds it.

    The limits are `limit` of utilisation, and that of redundancy (see `Advised`).
    """
    analysis, use = advised.analysis, advised.advice.use
    mass = identified_airframe(analysis.model).empty_mass + analysis.track.tank_kg
    sure = analysis.redundancy_yaw_uncontrolled * np.exp(-INTERVAL * analysis.redundancy_error)
    by_use = mass * limit / (use.lasting + use.reach) - mass
    room = np.concatenate([by_use, mass * sure - mass])
    return float(np.nanmin(room))
