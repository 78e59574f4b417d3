"""`thrustmargin fetch` as a process, and logs for a vehicle to hold."""

import random
import subprocess
import sys
from pathlib import Path

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
