"""Flights written as tables that the reader of CSV knows."""

import io
import json
from pathlib import Path

import numpy as np

from thrustmargin.gcs_plugin.logs.csv_table import COLUMNS
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.flight import TRACK_CHANNELS, FlightTrack
from thrustmargin.models.json_values import to_json_values


def write_csv(track: FlightTrack, path: Path) -> None:
    """Write the track so that `read_csv` gives it back to the last digit."""
    about = {
        "name": track.name,
        "origin": to_json_values(track.origin),
        "start_unix_s": track.start_unix_s,
        "sources": {name: to_json_values(p) for name, p in track.sources.items()},
        "notes": list(map(statement_words, track.notes)),
    }
    names, columns = ["time_s"], [track.time_s]
    for channel, wanted in TRACK_CHANNELS.items():
        if not track.reports(channel):
            continue
        values = getattr(track, channel)
        names += COLUMNS.get(channel) or wanted.column_names(channel, track.rotor_count)
        columns += list(values[:, None].T if values.ndim == 1 else values.T)
    names.append("flying")
    columns.append(track.flying.astype(np.float64))
    out = io.StringIO()
    # ASCII keeps the comment line one line whatever a log put into a text.
    out.write(f"# {json.dumps(about)}\n{','.join(names)}\n")
    for row in zip(*(column.tolist() for column in columns), strict=True):
        out.write(",".join("" if v != v else repr(v) for v in row) + "\n")
    path.write_text(out.getvalue(), encoding="utf-8", newline="")
