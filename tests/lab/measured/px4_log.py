"""Check of px4_ulog: a PX4 log with esc_status, through the project's own .ulg reader.

Source: github.com/PX4/pyulog, test/sample_px4_events.ulg, BSD-3-Clause; PX4's simulator, 31 s.
The log says six ESCs and four report.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import thrustmargin as tm
from tests.lab.measured.findings import Finding, Number
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.errors import DataError

FOLDER = "px4_ulog"
FILE = "sample_px4_events.ulg"


def find(folder: Path) -> Finding:
    """What the reader makes of the log. Raises LogError when it cannot be read."""
    path = folder / FILE
    if not path.exists():
        raise DataError(f"no file {path}")
    track = tm.read_log(path).track
    rotors = int(np.isfinite(track.rotor_speed_rpm).any(axis=0).sum())
    fastest = float(np.nanmax(track.rotor_speed_rpm)) if rotors else float("nan")
    return Finding(
        name=FOLDER,
        title="A PX4 log through the .ulg reader",
        numbers=(
            Number("rotors", rotors, "1", 4, "like", label="rotors that report (the log says 6)"),
            Number("fastest", fastest, "rpm", 3324, "like", label="fastest rotor speed"),
            Number("rows", track.time_s.size),
            Number("duration", track.duration, "s"),
        ),
        notes=tuple(map(statement_words, track.notes)),
    )
