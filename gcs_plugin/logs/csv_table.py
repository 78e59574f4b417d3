"""A flight as CSV with the project's own column names: read, and write so that it reads back.

One row a time. Columns, in SI but for rpm, all but `time_s` optional, empty where unknown:
`time_s`; `position_north/_east/_down`; `velocity_north/_east/_down`; `roll`, `pitch`, `yaw`
(rad); `roll_rate`, `pitch_rate`, `yaw_rate` (rad/s); `specific_force_forward/_right/_down`
(m/s², (0, 0, -9.81) at rest); `airspeed`; `wind_north/_east/_down` (the way the air moves);
`tank_kg`; `rotor_speed_rpm_1` to `_R` and `throttle_1` to `_R` in motor order; `voltage`,
`current`, `pressure` (Pa), `temperature` (K), `altitude` (m AMSL), `height_agl` (m),
`spraying` (1 or 0), `flying` (1 or 0). A first line `# {...}` holds what has no column: the place
of zero, the start in Unix time, where each channel came from.
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.mavlink.text import clean
from thrustmargin.models.errors import LogError
from thrustmargin.models.flight import TRACK_CHANNELS, FlightTrack, Floats, Origin
from thrustmargin.models.model.json_values import from_json_values, to_json_values
from thrustmargin.models.whole_file import whole_file

_NED = ("north", "east", "down")
_FRD = ("forward", "right", "down")
#: channel -> its columns, without those numbered by rotor
COLUMNS: Mapping[str, tuple[str, ...]] = {
    "position_ned": tuple(f"position_{a}" for a in _NED),
    "velocity_ned": tuple(f"velocity_{a}" for a in _NED),
    "attitude": ("roll", "pitch", "yaw"),
    "angular_rate_frd": ("roll_rate", "pitch_rate", "yaw_rate"),
    "specific_force_frd": tuple(f"specific_force_{a}" for a in _FRD),
    "wind_ned": tuple(f"wind_{a}" for a in _NED),
    **{name: (name,) for name, c in TRACK_CHANNELS.items() if not (c.axes or c.per_rotor)},
}
_ROTOR = re.compile(r"(rotor_speed_rpm|throttle)_([1-9][0-9]?)")


def write_csv(track: FlightTrack, path: Path) -> None:
    """Write the track so that `read_csv` gives it back to the last digit.

    The file appears whole or not at all.
    """
    about = {
        "name": track.name,
        "origin": to_json_values(track.origin),
        "start_unix_s": track.start_unix_s,
        "sources": dict(track.sources),
        "notes": list(track.notes),
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
    with whole_file(path) as draft:
        draft.write_text(out.getvalue(), encoding="utf-8", newline="")


def read_csv(path: Path, *, rotor_count: int = 0) -> FlightTrack:
    """The track of a CSV file; `rotor_count` is for a file without columns of rotors.

    Raises LogError naming the column or row that is wrong.
    """
    import pyarrow as pa
    from pyarrow import csv

    data = path.read_bytes()
    about, body = _about(data, path)
    header = body.split(b"\n", 1)[0].decode("utf-8", "replace").strip().lstrip("\ufeff")
    names = [name.strip() for name in header.split(",")]
    if "time_s" not in names:
        raise LogError(f"{path.name}: its first line names no column time_s; found {header[:60]!r}")
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise LogError(f"{path.name}: column {twice!r} is there twice; keep one")
    try:
        table = csv.read_csv(
            io.BytesIO(body),
            read_options=csv.ReadOptions(column_names=names, skip_rows=1),
            convert_options=csv.ConvertOptions(
                column_types={n: pa.float64() for n in names if _known(n)},
                include_columns=[n for n in names if _known(n)],
                null_values=["", "nan", "NaN", "null"],
            ),
        )
    except (pa.ArrowInvalid, pa.ArrowKeyError) as error:
        reason = clean(" ".join(str(error).split())[:160])
        raise LogError(f"{path.name}: not a table of numbers: {reason}") from error
    found = {name: table[name].to_numpy(zero_copy_only=False) for name in table.column_names}
    unused = [name for name in names if not _known(name)]
    return _track(path, found, unused, about, rotor_count)


def _known(name: str) -> bool:
    fixed = any(name in columns for columns in COLUMNS.values())
    return fixed or name in ("time_s", "flying") or _ROTOR.fullmatch(name) is not None


def _about(data: bytes, path: Path) -> tuple[dict[str, Any], bytes]:
    """The comment line as a table, and the file without its comment lines."""
    about: dict[str, Any] = {}
    body = data.removeprefix(b"\xef\xbb\xbf")
    while body.startswith(b"#"):
        line, _, body = body.partition(b"\n")
        text = line[1:].decode("utf-8", "replace").strip()
        if text.startswith("{"):
            try:
                about = json.loads(text)
            except ValueError as error:
                raise LogError(f"{path.name}: its comment line is not JSON: {error}") from error
    return about, body


def _track(
    path: Path,
    found: Mapping[str, Floats],
    unused: list[str],
    about: Mapping[str, Any],
    rotor_count: int,
) -> FlightTrack:
    time_s = found["time_s"]
    if time_s.size == 0:
        raise LogError(f"{path.name}: a header and no rows; there is no flight to show")
    wrong = np.flatnonzero(~np.isfinite(time_s) | (np.diff(time_s, prepend=-np.inf) <= 0))
    if wrong.size:
        raise LogError(
            f"{path.name}: time_s must grow from row to row; row {wrong[0] + 1} has "
            f"{time_s[wrong[0]]:g}"
        )
    numbers = [int(m[2]) for m in map(_ROTOR.fullmatch, found) if m]
    rotors = max(numbers, default=rotor_count)
    channels: dict[str, Floats] = {}
    nothing = np.full(time_s.size, np.nan)
    for channel, names in COLUMNS.items():
        if any(name in found for name in names):
            parts = [found.get(name, nothing) for name in names]
            channels[channel] = parts[0] if len(parts) == 1 else np.stack(parts, axis=-1)
    for channel in ("rotor_speed_rpm", "throttle"):
        names = [f"{channel}_{k + 1}" for k in range(rotors)]
        if any(name in found for name in names):
            channels[channel] = np.stack([found.get(n, nothing) for n in names], axis=-1)
    if not channels:
        raise LogError(f"{path.name}: no column but time_s is known; see the README for the names")
    flying = found.get("flying")
    stated = about.get("sources")
    stated = stated if isinstance(stated, dict) else {}
    written = about.get("notes")
    notes = tuple(clean(str(n)) for n in written) if isinstance(written, list) else ()
    if unused:
        notes += (clean(f"columns not used: {', '.join(unused)[:200]}"),)
    sources = {name: f"{path.name} column {COLUMNS.get(name, (name,))[0]}" for name in channels}
    return FlightTrack.of(
        name=clean(str(about.get("name", path.name))),
        time_s=time_s,
        rotor_count=rotors,
        flying=np.ones(time_s.size, dtype=np.bool_) if flying is None else flying > 0.5,
        origin=_origin(path, about.get("origin")),
        start_unix_s=_start(about.get("start_unix_s")),
        sources=sources | {clean(str(k)): clean(str(v)) for k, v in stated.items()},
        notes=notes,
        **channels,
    )


def _origin(path: Path, given: Any) -> Origin | None:
    if given is None:
        return None
    try:
        return from_json_values(Origin, given, "origin")
    except ValueError as error:
        wanted = "give latitude_deg, longitude_deg and altitude"
        raise LogError(f"{path.name}: in its comment line {error}; {wanted}") from error


def _start(given: Any) -> float | None:
    return float(given) if isinstance(given, (int, float)) else None
