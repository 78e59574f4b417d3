"""Which flights may be fitted: rotor speeds that can be believed, enough rows, each flight once.

Rotor speeds that are swapped, electrical or in another unit are no matter of physics: fitted, they
would come out as a wrong effect, so they end the work with one sentence. Readings that are no
measurement were left out when the log was read.
"""

from __future__ import annotations

from collections.abc import Sequence

from thrustmargin.models.checks.motor_order import check_motor_order
from thrustmargin.models.checks.speed_scale import check_speed_scale
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.problem import LEAST_ROWS
from thrustmargin.models.model.load_inference import LOAD_FROM_SPEEDS
from thrustmargin.models.model.output_speed import FROM_OUTPUTS
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.flight_phases import training_rows


def wrong_speeds(track: FlightTrack, airframe: Airframe) -> str | None:
    """Why the rotor speeds of a flight are not those of its rotors, and what to do; else None.

    Speeds from motor outputs are what the autopilot asked for, not what a sensor says.
    """
    if FROM_OUTPUTS in track.sources.get("rotor_speed_rpm", ""):
        return None
    order = check_motor_order(track, airframe)
    if order.verdict == "differs":
        return (
            f"{order.words}; nothing was fitted: put the rotor speeds in motor order, or give the "
            "right --airframe"
        )
    scale = check_speed_scale(track, airframe)
    if scale.verdict in ("electrical", "unit", "odd"):
        return f"{scale.words}; nothing was fitted: it is not for physics to explain"
    return None


def too_little(track: FlightTrack, model: RotorModel) -> str | None:
    """Why a flight has too few rows to fit or to validate on; None when it has enough."""
    rows = int(training_rows(track, model.inputs).sum())
    if rows >= LEAST_ROWS:
        return None
    if "tank_kg" in model.inputs and "tank_kg" in track.standard_errors:
        return LOAD_FROM_SPEEDS
    words = {"airspeed": "airspeed", "tank_kg": "tank level"}
    needed = {"rotor_speed_rpm": "rotor speeds", **{name: words[name] for name in model.inputs}}
    absent = [name for channel, name in needed.items() if not track.reports(channel)]
    if absent:
        return f"it reports no {' and no '.join(absent)}"
    return f"{rows} rows in steady flight with {', '.join(needed.values())}; needs {LEAST_ROWS}"


def require_distinct(tracks: Sequence[FlightTrack]) -> None:
    """Raise DataError when a flight is given twice: it would confirm itself."""
    seen: dict[bytes, str] = {}
    for track in tracks:
        content = track.rotor_speed_rpm.tobytes()
        if content in seen:
            raise DataError(
                f"{track.name} and {seen[content]} are the same flight; give each flight once, "
                "either to fit or as --held-out"
            )
        seen[content] = track.name
