"""The plans of a forecast's sorties: each ends at the line end at which it is refilled."""

from __future__ import annotations

from thrustmargin.mission.ahead.plan_forecast import PlanForecast
from thrustmargin.mission.plan_items import MissionPlan
from thrustmargin.mission.sortie_plans import line_ends, split_plan
from thrustmargin.mission.steps import PumpOutput
from thrustmargin.models.errors import PlanError


def sortie_plans(made: PlanForecast, *, pump: PumpOutput | None = None) -> tuple[MissionPlan, ...]:
    """One plan for each sortie that the forecast counts, refilled at home.

    Raises PlanError where one line alone takes more than tank or battery gives, or where a part of
    the plan is not understood.
    """
    if made.needs.short_of:
        raise PlanError(
            f"one line alone takes more than the {made.needs.short_of} gives; shorten the lines"
        )
    ends, flown = line_ends(made.plan, made.steps), made.steps.steps
    cuts: list[int] = []
    for sortie in made.needs.sorties[:-1]:
        # By a jump the same item is flown to again: the next one is meant.
        after = cuts[-1] if cuts else -1
        cuts.append(next(k for k in ends if k > after and flown[k].item == sortie.last_item))
    return split_plan(made.plan, made.steps, cuts, pump=pump)
