"""How much thrust a spraying multirotor has left, and why.

    import thrustmargin as tm

    log = tm.read_log("sitl_logs/campaign/v4_m16_q2.5.tlog")
    analysis = tm.analyse(log.track, tm.load_model())

Names are loaded when they are first used, so that importing this package is light.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.live.monitor import Monitor as LiveMonitor
    from thrustmargin.gcs_plugin.logs import read_log
    from thrustmargin.models.identification.identify import identify
    from thrustmargin.models.model.analysis import analyse
    from thrustmargin.models.model.rotor_model import load_model

_HOMES = {
    "LiveMonitor": ("thrustmargin.gcs_plugin.live.monitor", "Monitor"),
    "analyse": ("thrustmargin.models.model.analysis", "analyse"),
    "identify": ("thrustmargin.models.identification.identify", "identify"),
    "load_model": ("thrustmargin.models.model.rotor_model", "load_model"),
    "read_log": ("thrustmargin.gcs_plugin.logs", "read_log"),
}

__all__ = ["LiveMonitor", "analyse", "identify", "load_model", "read_log"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'thrustmargin' has no attribute {name!r}")
    module, attribute = _HOMES[name]
    return getattr(import_module(module), attribute)


def __dir__() -> list[str]:
    return __all__
