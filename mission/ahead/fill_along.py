"""How much may be filled for a plan, and with how much left one lost rotor is survived."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from thrustmargin.mission.ahead.plan_flight import PlanConditions
from thrustmargin.models.model.advice import Advised, FlightLevel
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.inferred.utilisation_error import INTERVAL
from thrustmargin.models.model.predict import identified_airframe

TURNS = 6  # of the search for the largest fill
STEP_KG = 0.1  # by which a fill is rounded down
NUDGE_KG = 0.02  # to the safe side of a limit, so that the search closes in on it from both


def survivable_below(analysis: FlightAnalysis) -> float:
    """kg in the tank below which one lost rotor is surely survived wherever the plan has so little.

    Where it never has, below what it is survived anywhere; NaN unknown, as with a bad rotor.
    """
    craft, tank = identified_airframe(analysis.model), analysis.track.tank_kg
    sure = analysis.redundancy_yaw_uncontrolled * np.exp(-INTERVAL * analysis.redundancy_error)
    most = (craft.empty_mass + tank) * sure - craft.empty_mass
    if analysis.bad_part or not np.isfinite(most).all():
        return math.nan
    least = float(np.min(tank[tank > most], initial=math.inf))
    return least if math.isfinite(least) and np.any(tank < least) else float(most.min())


def largest_fill(
    advised: Advised,
    given: PlanConditions,
    limit: float,
    flown: Callable[[PlanConditions], Advised],
) -> float:
    """kg with which the answer is that all stays below the limit; 0: not even empty. NaN where it
    is not known, as with a bad rotor.

    Load and limit go together nearly as a line does, so few flights are needed.
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
    """kg more, or less than nothing, with which some moment meets its limit."""
    analysis, use = advised.analysis, advised.advice.use
    mass = identified_airframe(analysis.model).empty_mass + analysis.track.tank_kg
    sure = analysis.redundancy_yaw_uncontrolled * np.exp(-INTERVAL * analysis.redundancy_error)
    by_use = mass * limit / (use.lasting + use.reach) - mass
    found = np.concatenate([by_use, mass * sure - mass])
    return float(np.nanmin(found))
