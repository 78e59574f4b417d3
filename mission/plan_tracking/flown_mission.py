"""Compare a flown mission of a known aircraft with the forecast made before it, in few numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from thrustmargin.mission.forecast.battery import FlightBattery
from thrustmargin.mission.forecast.experience import FlownMission, SaidFlown
from thrustmargin.mission.forecast.limits import flight_limits
from thrustmargin.mission.forecast.way import course, plan_legs, timed_legs
from thrustmargin.mission.plan_items import FIRMWARE_PX4, MissionPlan
from thrustmargin.mission.plan_tracking.blame import shown_day
from thrustmargin.mission.plan_tracking.stretches import (
    PlanToFly,
    StretchComparison,
    compare_with_plan,
    conditions_before_take_off,
    flown_way,
    stretch_ends,
    yaw_before,
)
from thrustmargin.mission.steps import plan_steps, pump_output
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.physics.smoothing import known_mean

#: Times that a flight may take less than its forecast, and s that it may be late.
LONGER, LATE_S = 1.5, 30.0
FEWEST_STRETCHES = 3  # flown as planned, below which a flight is no evidence about the plan


def flown_mission(
    plan: MissionPlan,
    parameters: Mapping[str, float],
    model: RotorModel,
    analysis: FlightAnalysis,
    battery: FlightBattery,
) -> FlownMission | None:
    """Compare the analysed flight of `plan` with its forecast by `model`, as it was before the
    flight.

    The forecast uses fill, air and `battery` at take-off, and no wind. None where fewer than
    FEWEST_STRETCHES were flown as planned. Raises PlanError where the plan flies nowhere.
    """
    way, day = flown_way(analysis, plan.home), shown_day(analysis)
    if not way.time_s.size:
        return None
    px4 = plan.firmware == FIRMWARE_PX4
    limits = flight_limits(parameters, px4=px4, model=model)
    nose, steps = yaw_before(analysis.track), plan_steps(plan, pump_output(parameters))
    legs = plan_legs(plan, steps, limits, start_yaw=nose)
    # Of a plan for many batteries only the part is forecast that one flight can have flown.
    longest_s = LONGER * float(way.time_s[-1] - way.time_s[0]) + LATE_S
    count = max(sum(timed.end_s <= longest_s for timed in timed_legs(legs)), 1)
    way_planned = course(legs[:count], limits, start_yaw=nose)
    to_fly = PlanToFly(course=way_planned, model=model, home=plan.home, start_yaw=nose)
    given = conditions_before_take_off(
        parameters, model.airframe, fill_kg=day.fill_kg, altitude=plan.home[2]
    )
    given = replace(
        given,
        battery=replace(battery, capacity_ah=given.battery.capacity_ah),
        density=day.density if np.isfinite(day.density) else given.density,
    )
    flight, forecast = to_fly.fly(given)
    ends = stretch_ends(flight, way)
    tracked = compare_with_plan(flight, forecast, way)
    if len(tracked.stretches) < FEWEST_STRETCHES:
        return None
    begun, ended = way.time_s[0], way.time_s[ends[-1]]
    last = flight.course.spans[len(ends) - 1].last - 1
    track = analysis.track
    rows = track.flying & (track.time_s >= begun) & (track.time_s <= ended)
    watts = (track.voltage * track.current)[rows]
    return FlownMission(
        stretches=len(tracked.stretches),
        complete=tracked.left_at is None and count == len(legs),
        seconds=SaidFlown(float(flight.track.time_s[last]), float(ended - begun)),
        energy_wh=SaidFlown(
            float(flight.energy_wh[last]), known_mean(watts) * float(ended - begun) / 3600.0
        ),
        leg_use=_leg_use([one for one in tracked.stretches if one.kind == "leg"]),
        peak_use=_peak(tracked.stretches),
    )


def _leg_use(legs: Sequence[StretchComparison]) -> SaidFlown:
    """Return the mean utilisation on level legs, forecast and flown, weighted by the time as
    flown."""
    known = [one for one in legs if np.isfinite(one.utilisation_mean.off)]
    if not known:
        return SaidFlown()
    weight = [one.seconds.flown for one in known]
    pairs = [(one.utilisation_mean.forecast, one.utilisation_mean.flown) for one in known]
    forecast_use, flown = np.average(pairs, axis=0, weights=weight)
    return SaidFlown(float(forecast_use), float(flown))


def _peak(stretches: Sequence[StretchComparison]) -> SaidFlown:
    """Return the largest utilisation of all stretches, as forecast and as flown."""
    known = [one for one in stretches if np.isfinite(one.utilisation_peak.off)]
    if not known:
        return SaidFlown()
    return SaidFlown(
        max(one.utilisation_peak.forecast for one in known),
        max(one.utilisation_peak.flown for one in known),
    )
