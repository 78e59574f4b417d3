"""A plan in the scene of a replay, before it is flown: its forecast stands in for the flight."""

from __future__ import annotations

from typing import Any

from thrustmargin.gcs_plugin.view.replay_view import ReplayView
from thrustmargin.gcs_plugin.view.scene.overlays import planned_overlays
from thrustmargin.gcs_plugin.wording.answer import FlightAnswer
from thrustmargin.gcs_plugin.wording.plans.forecast_words import fill_words, verdict
from thrustmargin.mission.ahead.plan_forecast import PlanForecast


def planned_view(made: PlanForecast, **options: Any) -> ReplayView:
    """The view of a forecast; `options` are those of ReplayView."""
    advised = made.advised
    return ReplayView(
        advised.analysis,
        waypoints=made.plan.items,
        overlays=planned_overlays(advised.analysis, advised.advice.limit),
        whole=FlightAnswer(verdict(made), made.level, fill_words(made)),
        planned=True,
        **options,
    )
