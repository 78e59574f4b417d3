"""A flight beside the forecast of its plan, made with what was assumed before the take-off.

Without that it is still and standard air at home's height, the battery that the parameters name,
full, and the fill that the log has at take-off. What the flight shows of the day is compared.
"""

from __future__ import annotations

import math
from dataclasses import asdict

from thrustmargin.gcs_plugin.logs import FlightLog
from thrustmargin.gcs_plugin.reports.margin.data import JsonObject
from thrustmargin.gcs_plugin.wording.plans.plan_words import beside_words
from thrustmargin.mission.ahead.plan_flight import PlanConditions
from thrustmargin.mission.beside.blame import Off, shown_day, which_was_off
from thrustmargin.mission.beside.plan_to_fly import PlanToFly, known_before
from thrustmargin.mission.beside.stretches import flown_way
from thrustmargin.mission.plan_items import MissionPlan
from thrustmargin.models.model.analysis import FlightAnalysis


def plan_beside(
    analysis: FlightAnalysis,
    log: FlightLog,
    plan: MissionPlan,
    assumed: PlanConditions | None = None,
) -> JsonObject:
    """The stretches of `plan` as forecast and as flown, and which of what was `assumed` was off.

    Raises PlanError when the plan flies nowhere.
    """
    model = analysis.model
    to_fly = PlanToFly.of(plan, log.parameters, model)
    way = flown_way(analysis, plan.home)
    found = shown_day(analysis)
    origin = log.track.origin
    ground = math.nan if origin is None else origin.altitude
    given = assumed or known_before(
        log.parameters,
        model.airframe,
        fill_kg=found.fill_kg,
        altitude=plan.home[2] if math.isfinite(plan.home[2]) else ground,
    )
    made = to_fly.beside(given, way)
    off: tuple[Off, ...] = ()
    if made.stretches:
        off = which_was_off(lambda changed: to_fly.beside(changed, way), given, found)
    return {
        "words": beside_words(off, made.stretches, left_at=made.left_at),
        "left_at": made.left_at,
        "off": [
            {"what": o.what, **asdict(o.amount), "item": o.item, "mattered": o.mattered}
            for o in off
        ],
        "assumed": {
            "fill_kg": given.fill_kg,
            "density": given.density,
            "wind": math.hypot(*given.wind_ned),
            "limits": list(to_fly.course.limits.assumed),
        },
        "stretches": made.stretches,
    }
