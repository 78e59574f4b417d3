"""Check of px4_ulog: a PX4 log with esc_status, through the project's own .ulg reader.

Source: github.com/PX4/pyulog, test/sample_px4_events.ulg, BSD-3-Clause; PX4's simulator, 31 s.
The log says six ESCs and four report.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.measured.findings import Finding, Number
from thrustmargin.models.errors import DataError

FOLDER = "px4_ulog"
FILE = "sample_px4_events.ulg"
SOURCE = "github.com/PX4/pyulog (BSD-3-Clause), test/sample_px4_events.ulg; simulated"


def find(folder: Path) -> Finding:
    """What the reader makes of the log. Raises LogError when it cannot be read."""
    from thrustmargin.gcs_plugin.logs import read_log

    path = folder / FILE
    if not path.exists():
        raise DataError(f"no file {path}")
    log = read_log(path)
    track = log.track
    rotors = int(np.isfinite(track.rotor_speed_rpm).any(axis=0).sum())
    fastest = float(np.nanmax(track.rotor_speed_rpm)) if rotors else float("nan")
    tank = "no tank level" if not track.reports("tank_kg") else "a tank level"
    return Finding(
        name=FOLDER,
        title="A PX4 log through the .ulg reader",
        source=SOURCE,
        answer=(
            f"Read as {log.format}: {track.time_s.size} rows over {track.duration:.0f} s, rotor "
            f"speeds of {rotors} rotors up to {fastest:.0f} rpm, {tank}.",
        ),
        numbers=(
            Number(
                name="rotors",
                label="rotors that report, where the log says 6",
                value=rotors,
                quoted=4,
                quoted_from="its source",
                aim="like",
            ),
            Number(
                name="fastest",
                label="fastest rotor speed",
                value=fastest,
                unit="rpm",
                quoted=3324,
                quoted_from="its source",
                aim="like",
            ),
            Number(name="rows", value=track.time_s.size),
            Number(name="duration", value=track.duration, unit="s"),
        ),
        notes=track.notes,
    )
