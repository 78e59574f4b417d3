"""`thrustmargin install`: copy what goes into another program's folder."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from thrustmargin.gcs_plugin.commands.shared.options import Output, check_outputs
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.models.errors import DataError
from thrustmargin.models.whole_file import whole_file

#: What there is -> the files of it in the package, and what to do next.
FILES: dict[str, tuple[str, str]] = {
    "mission-planner": (
        "mission_planner/*.cs",
        "restart Mission Planner, which compiles it; figures come from monitor --announce",
    ),
    "vehicle-sender": (
        "on_vehicle/margin_inputs.lua",
        "copy it to APM/scripts of the vehicle's card and set SCR_ENABLE 1",
    ),
    "companion": (
        "companion/*",
        "docs/companion.md says how to build the container or start the service",
    ),
}


def install(
    what: Positional[Literal["mission-planner", "vehicle-sender", "companion"]],
    folder: Positional[Path],
    *,
    force: bool = False,
) -> None:
    """Copy what goes into another program: Mission Planner, the vehicle, a companion computer.

    Example: thrustmargin install vehicle-sender .

    Args:
        what: mission-planner, its plugin, for its folder `plugins`; vehicle-sender, the Lua script
            of rotor speeds for slow links; companion, container, BlueOS extension and service.
        folder: Folder to copy into.
        force: Replace files that are already there.
    """
    if not folder.is_dir():
        raise DataError(f"{folder} is no folder; name one that is there")
    pattern, then = FILES[what]
    under, _, name = pattern.partition("/")
    there = (resources.files("thrustmargin.gcs_plugin") / under).iterdir()
    found = sorted((p for p in there if Path(p.name).match(name)), key=lambda p: p.name)
    outputs = [Output("FOLDER", folder / p.name, keep=not force) for p in found]
    check_outputs(outputs, inputs=[])
    console = Terminal(soft_wrap=True)
    for source in found:
        target = folder / source.name
        with whole_file(target) as draft:
            draft.write_bytes(source.read_bytes())
        console.print(f"wrote {target}")
    console.print(f"next: {then}")
