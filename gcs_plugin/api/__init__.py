"""Compute how much thrust a spraying multirotor has left, and why: the functions for programs.

    import thrustmargin as tm

    model = tm.load_model()                                    # or a model file of yours
    log = tm.read_log("sitl_logs/dev/worn_prop_1.tlog")
    flight = tm.analyse(log.track, model)
    print(flight)                                              # margin and redundancy by row
    print(tm.advise(flight).advice.levels)                     # what that means, the gravest first
    print(tm.identify(log, model))                             # what the model lacks
    print(tm.read_plan("field.plan").items)                    # what a vehicle is to do
    with tm.LiveMonitor(model, "udpin:127.0.0.1:14550") as live:
        print(live.wait(10.0))                                 # newest rows of each vehicle

Each name is loaded when it is first used, so that importing this package is light.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.commands.shared.plan_source import read_plan
    from thrustmargin.gcs_plugin.live.live_monitor import LiveMonitor
    from thrustmargin.gcs_plugin.logs import read_log, read_sorties
    from thrustmargin.mission.forecast.plan_forecast import forecast
    from thrustmargin.models.identification.loop import identify
    from thrustmargin.models.model.advice import advise
    from thrustmargin.models.model.analysis import analyse
    from thrustmargin.models.model.model_file import load_model

_HOMES = {
    "LiveMonitor": "thrustmargin.gcs_plugin.live.live_monitor",
    "advise": "thrustmargin.models.model.advice",
    "analyse": "thrustmargin.models.model.analysis",
    "forecast": "thrustmargin.mission.forecast.plan_forecast",
    "identify": "thrustmargin.gcs_plugin.workshop.identify.explain",
    "load_model": "thrustmargin.models.model.model_file",
    "read_log": "thrustmargin.gcs_plugin.logs",
    "read_plan": "thrustmargin.gcs_plugin.commands.shared.plan_source",
    "read_sorties": "thrustmargin.gcs_plugin.logs",
}

__all__ = [
    "LiveMonitor",
    "advise",
    "analyse",
    "forecast",
    "identify",
    "load_model",
    "read_log",
    "read_plan",
    "read_sorties",
]


if not TYPE_CHECKING:  # a type checker would take any name for one that is here

    def __getattr__(name: str) -> Any:
        if name not in _HOMES:
            raise AttributeError(f"module 'thrustmargin' has no attribute {name!r}")
        return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return __all__
