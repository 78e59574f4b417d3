"""`thrustmargin fetch` as a process, and logs for a vehicle to hold."""

import random
import subprocess
import sys
from pathlib import Path

from thrustmargin.gcs_plugin.vehicle.connection import Progress, VehicleLink
from thrustmargin.gcs_plugin.vehicle.downloads import download_mission
from thrustmargin.mission.plan import MissionPlan

RUN = "import sys; from thrustmargin.gcs_plugin.cli import main; main(['fetch', *sys.argv[1:]])"


def fetch(
    *arguments: object, timeout: float = 40.0, cwd: Path | None = None
) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, "-c", RUN, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
        cwd=cwd,
    )


def onboard_logs(folder: Path) -> dict[int, tuple[int, str]]:
    """Number -> Unix time and file of a log of random bytes.

    Three of them: 1000 B, 1.2 MB dated later, and an empty one without a date.
    """
    made = {}
    sizes = {1: (1_760_000_000, 1000), 2: (1_760_100_000, 1_200_017), 3: (0, 0)}
    for number, (unix, size) in sizes.items():
        path = folder / f"onboard{number}"
        path.write_bytes(random.Random(number).randbytes(size))
        made[number] = (unix, str(path))
    return made


def fetch_mission(
    url: str,
    timeout: float = 10.0,
    *,
    vehicle: int | None = None,
    progress: Progress | None = None,
) -> MissionPlan:
    """The mission of the vehicle at `url`; `timeout` s to hear from it.

    Raises LinkError when the link or the vehicle does not answer, PlanError when it holds none.
    """
    with VehicleLink.open(url) as link:
        return download_mission(link, link.vehicle(vehicle, timeout=timeout), progress)
