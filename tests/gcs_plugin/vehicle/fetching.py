"""`thrustmargin fetch` and what it says, and logs for a vehicle to hold."""

import contextlib
import io
import random
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.vehicle import connection
from thrustmargin.gcs_plugin.vehicle.connection import Progress, VehicleLink
from thrustmargin.gcs_plugin.vehicle.downloads import download_mission
from thrustmargin.mission.plan import MissionPlan


@dataclass(frozen=True)
class Fetched:
    returncode: int
    stdout: str
    stderr: str


def fetch(*arguments: object) -> Fetched:
    """How the command ends, which waits for a second vehicle only as long as a test needs."""
    out, err = io.StringIO(), io.StringIO()
    with (
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        patch.object(connection, "SECOND_VEHICLE", 0.1),
    ):
        code = run(["fetch", *map(str, arguments)])
    return Fetched(code, out.getvalue(), err.getvalue())


def onboard_logs(folder: Path) -> dict[int, tuple[int, str]]:
    """Number -> Unix time and file of a log of random bytes.

    Three of them: 1000 B, 0.3 MB dated later, and an empty one without a date.
    """
    made = {}
    sizes = {1: (1_760_000_000, 1000), 2: (1_760_100_000, 300_017), 3: (0, 0)}
    for number, (unix, size) in sizes.items():
        path = folder / f"onboard{number}"
        path.write_bytes(random.Random(number).randbytes(size))
        made[number] = (unix, str(path))
    return made


def fetch_mission(
    url: str,
    timeout: float = 100.0,
    *,
    vehicle: int | None = 1,
    progress: Progress | None = None,
) -> MissionPlan:
    """The mission of a vehicle at `url`, or of the only one; `timeout` s to hear from it.

    Raises LinkError when the link or the vehicle does not answer, PlanError when it holds none.
    """
    with VehicleLink.open(url) as link:
        return download_mission(link, link.vehicle(vehicle, timeout=timeout), progress)
