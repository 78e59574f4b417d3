"""The commands, by subject: one module a subcommand, which holds a function of its name.

`extras` finds those of workshop and office. An extra registers in its `__init__`: `COMMANDS` names
its subcommands, `OUTPUTS` its outputs of the monitor. After a flight of a known aircraft the core
calls `explain_change` (the physical cause of a change) and `keep_flights`, and where a flight is
forgotten `forget_flight`. An extra whose folder is deleted is not missed.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType

HERE = "thrustmargin.gcs_plugin"
#: Folders of `gcs_plugin` whose folders are extras.
DOORS = ("workshop", "office")


def extras() -> Iterator[ModuleType]:
    """Yield the package of each installed extra."""
    root = Path(__file__).parents[1]
    for door in DOORS:
        for extra in iter_modules([str(root / door)], f"{HERE}.{door}."):
            yield import_module(extra.name)
