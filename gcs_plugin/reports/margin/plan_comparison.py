"""Compare a flight with the forecast of its plan, made with what was assumed before the take-off.

Without that it is still and standard air at home's height, the battery that the parameters name,
full, and the fill that the log has at take-off. What the flight shows of the day is compared.
"""

from __future__ import annotations

import math
from dataclasses import asdict, replace

from thrustmargin.gcs_plugin.logs import FlightLog
from thrustmargin.gcs_plugin.reports.margin.data import JsonObject
from thrustmargin.gcs_plugin.wording.plan_words import comparison_words
from thrustmargin.mission.forecast.plan_flight import PlanConditions
from thrustmargin.mission.plan_items import MissionPlan
from thrustmargin.mission.plan_tracking.blame import Off, shown_day, which_was_off
from thrustmargin.mission.plan_tracking.stretches import (
    PlanToFly,
    conditions_before_take_off,
    flown_way,
    yaw_before,
)
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.flight_day import day_before_take_off
from thrustmargin.models.model.flight_lessons import flight_power
from thrustmargin.models.physics.electric_power import power_law


def plan_comparison(
    analysis: FlightAnalysis,
    log: FlightLog,
    plan: MissionPlan,
    assumed: PlanConditions | None = None,
) -> JsonObject:
    """Return, as a dict for JSON, how the flight differed from the forecast of `plan`, leg by leg.

    The forecast is under `assumed`; if None, under the conditions before take-off. It uses the
    power that this flight measured, if it did. Keys: `words`, `left_at` (the mission item at which
    the plan was left, or None), `off` (the wrong assumptions), `assumed` (fill, kg, density, wind,
    limits) and `stretches`. Raise PlanError if the plan flies nowhere.
    """
    measured = flight_power(analysis, log.name)
    model = analysis.model
    if measured is not None:
        model = replace(model, power=power_law([measured]))
    to_fly = PlanToFly.from_plan(plan, log.parameters, model, start_yaw=yaw_before(log.track))
    way = flown_way(analysis, plan.home)
    found = shown_day(analysis)
    origin = log.track.origin
    ground = math.nan if origin is None else origin.altitude
    given = assumed or conditions_before_take_off(
        log.parameters,
        model.airframe,
        fill_kg=found.fill_kg,
        altitude=plan.home[2] if math.isfinite(plan.home[2]) else ground,
        density=found.density,
        rest_voltage=day_before_take_off(analysis).battery_voltage.value,
    )
    made = to_fly.compare(given, way)
    off: tuple[Off, ...] = ()
    if made.stretches:
        off = which_was_off(lambda changed: to_fly.compare(changed, way), given, found)
    return {
        "words": comparison_words(off, made.stretches, left_at=made.left_at),
        "left_at": made.left_at,
        "off": [
            {"what": o.what, **asdict(o.amount), "item": o.item, "mattered": o.mattered}
            for o in off
        ],
        "assumed": {
            "tank_start_kg": given.fill_kg,
            "density": given.density,
            "wind": math.hypot(*given.wind_ned),
            "limits": list(to_fly.course.limits.assumed),
        },
        "stretches": made.stretches,
    }
