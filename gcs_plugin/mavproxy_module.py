"""The name under which users load MAVProxy's module, which is part of the extra `stations`.

MAVProxy imports a module by the name that is typed in its console: see docs/live.md.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any


def init(mpstate: Any, **options: Any) -> Any:
    """Make the module; called by MAVProxy. Raises ImportError without the extra or its options."""
    # By name: the core imports no extra, and works without its folder.
    stations = "thrustmargin.gcs_plugin.office.stations"
    return import_module(f"{stations}.mavproxy_margin").init(mpstate, **options)
