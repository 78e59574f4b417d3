"""`thrustmargin install`: copy plug-ins and services into another program's folder."""

from __future__ import annotations

from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from thrustmargin.gcs_plugin.commands.shared.options import OutputFile, check_outputs
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.models.errors import DataError
from thrustmargin.models.whole_file import whole_file

_HERE = "thrustmargin.gcs_plugin.office.stations"
#: Name of what can be installed -> its files, as (package, pattern), and the next step.
FILES: dict[str, tuple[tuple[tuple[str, str], ...], str]] = {
    "mission-planner": (
        ((f"{_HERE}.mission_planner", "*.cs"),),
        "restart Mission Planner, which compiles it; figures come from monitor --announce",
    ),
    "vehicle-sender": (
        ((f"{_HERE}.on_vehicle", "margin_inputs.lua"),),
        "copy it to APM/scripts of the vehicle's card and set SCR_ENABLE 1",
    ),
    "vehicle-check": (
        ((f"{_HERE}.on_vehicle", "takeoff_check.lua"),),
        "copy it to APM/scripts of the vehicle's card and set SCR_ENABLE 1",
    ),
    "companion": (
        ((f"{_HERE}.companion", "*"), ("thrustmargin.gcs_plugin.live.bar", "*")),
        "docs/companion.md says how to build the container or start the service",
    ),
}


def install(
    what: Positional[Literal["mission-planner", "vehicle-sender", "vehicle-check", "companion"]],
    folder: Positional[Path],
    *,
    force: bool = False,
) -> None:
    """Copy what goes into another program: Mission Planner, the vehicle, a companion computer.

    Example: thrustmargin install vehicle-sender .

    Args:
        what: mission-planner, its plugin, for its folder `plugins`; vehicle-sender, the Lua script
            of rotor speeds for slow links; vehicle-check, the check before take-off as a Lua
            script; companion, container, BlueOS extension and service.
        folder: Folder to copy into.
        force: Replace files that are already there.
    """
    if not folder.is_dir():
        raise DataError(f"{folder} is no folder; name one that is there")
    places, then = FILES[what]
    files = sorted(
        (
            file
            for package, pattern in places
            for file in _folder(package).iterdir()
            if Path(file.name).match(pattern)
        ),
        key=lambda file: file.name,
    )
    outputs = [OutputFile("FOLDER", folder / p.name, keep=not force) for p in files]
    check_outputs(outputs, inputs=[])
    console = Terminal(soft_wrap=True)
    for source in files:
        target = folder / source.name
        with whole_file(target) as draft:
            draft.write_bytes(source.read_bytes())
        console.print(f"wrote {target}")
    console.print(f"next: {then}")


def _folder(package: str) -> Traversable:
    """Return the folder of a dotted name, which may be a folder without modules."""
    above, _, name = package.rpartition(".")
    return resources.files(above) / name
