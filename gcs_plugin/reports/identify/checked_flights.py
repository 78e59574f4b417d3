"""Flights for `identify`: read, checked before anything is fitted, and each used once.

Rotor speeds that are swapped, electrical, in another unit or of a sensor that sticks are no matter
of physics: fitted, they would come out as a wrong effect, so they end the work with one sentence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.wording.progress import each_log
from thrustmargin.models.checks.motor_order import check_motor_order
from thrustmargin.models.checks.speed_scale import check_speed_scale
from thrustmargin.models.checks.stuck_sensor import check_stuck_sensor
from thrustmargin.models.errors import DataError, LogError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.problem import LEAST_ROWS
from thrustmargin.models.network.training_rows import training_rows
from thrustmargin.models.physics.airframe import Airframe

if TYPE_CHECKING:
    from rich.console import Console


@dataclass(frozen=True, slots=True, kw_only=True)
class NotUsed:
    """A log that took no part, and why."""

    name: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Flights:
    """The flights of one role, and the logs that could not serve."""

    tracks: tuple[FlightTrack, ...]
    not_used: tuple[NotUsed, ...]


def read_flights(
    logs: Sequence[Path], airframe: Airframe, vehicle: int | None, console: Console
) -> Flights:
    """Read and check logs in their order.

    Logs that cannot be read or hold too little flight are left out and named. Raises DataError when
    the rotor speeds of one cannot be what they are taken for, AirframeError for a wrong number of
    rotors.
    """
    from thrustmargin.gcs_plugin.logs import read_log

    tracks: list[FlightTrack] = []
    not_used: list[NotUsed] = []
    for path in each_log(logs, console):
        try:
            track = read_log(path, vehicle=vehicle, airframe=airframe).track
        except LogError as error:
            reason = str(error).removeprefix(f"{path.name}: ")
            not_used.append(NotUsed(name=path.name, reason=reason))
            continue
        wrong = wrong_speeds(track, airframe)
        if wrong is not None:
            raise DataError(f"{path.name}: {wrong}")
        lacking = too_little(track)
        if lacking is not None:
            not_used.append(NotUsed(name=path.name, reason=lacking))
            continue
        tracks.append(track)
    return Flights(tracks=tuple(tracks), not_used=tuple(not_used))


def wrong_speeds(track: FlightTrack, airframe: Airframe) -> str | None:
    """Why the rotor speeds of a flight are not those of its rotors, and what to do; else None."""
    order = check_motor_order(track, airframe)
    if order.verdict == "differs":
        return (
            f"{order.words}; nothing was fitted: put the rotor speeds in motor order, or give the "
            "right --airframe"
        )
    scale = check_speed_scale(track, airframe)
    if scale.verdict in ("electrical", "unit", "odd"):
        return f"{scale.words}; nothing was fitted: it is not for physics to explain"
    stuck = check_stuck_sensor(track)
    if stuck.verdict in ("sticks", "stale"):
        return f"{stuck.words}; nothing was fitted: mend it, or leave this log out"
    return None


def too_little(track: FlightTrack) -> str | None:
    """Why a flight has too few rows to fit or to judge by; None when it has enough."""
    rows = int(training_rows(track).sum())
    if rows >= LEAST_ROWS:
        return None
    words = {
        "rotor_speed_rpm": "rotor speeds",
        "airspeed": "airspeed",
        "tank_kg": "tank level",
    }
    absent = [said for channel, said in words.items() if not track.reports(channel)]
    if absent:
        return f"it reports no {' and no '.join(absent)}"
    return f"{rows} rows in steady flight with rotor speeds, airspeed and tank; needs {LEAST_ROWS}"


def require_distinct(tracks: Sequence[FlightTrack]) -> None:
    """Raise DataError when a flight is there twice: it would vouch for itself."""
    seen: dict[bytes, str] = {}
    for track in tracks:
        content = track.rotor_speed_rpm.tobytes()
        if content in seen:
            raise DataError(
                f"{track.name} and {seen[content]} are the same flight; give each flight once, "
                "either to fit or as --held-out"
            )
        seen[content] = track.name
