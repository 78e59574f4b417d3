"""Check which flights may be fitted: plausible rotor speeds, enough rows, each flight once.

Rotor speeds in wrong motor order, electrical, in another unit or of another clock would be fitted
as a wrong effect, so they raise an error with the reason. Invalid readings were removed when the
log was read.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from typing import Protocol

from thrustmargin.models.checks.motor_order import check_motor_order
from thrustmargin.models.checks.speed_readings import late_speeds
from thrustmargin.models.errors import DataError, UnlikeFlightError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.rows.problem import LEAST_ROWS, assemble_flight
from thrustmargin.models.model.airframe_match import match_airframe
from thrustmargin.models.model.analysis import require_rotors
from thrustmargin.models.model.inferred.load_inference import LOAD_FROM_SPEEDS
from thrustmargin.models.model.rotor_model import RotorModel, identified_airframe
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.flight_phases import training_rows
from thrustmargin.models.provenance import Meaning
from thrustmargin.models.statement import Statement
from thrustmargin.models.vehicle_facts import VehicleFacts

ENDS = 5  # times LEAST_ROWS: with more rows, those lost to windows at the ends do not matter


class HasTrack(Protocol):
    """A log that was read: its flight, facts about the vehicle, and the autopilot's parameters."""

    @property
    def track(self) -> FlightTrack: ...
    @property
    def facts(self) -> VehicleFacts: ...
    @property
    def parameters(self) -> Mapping[str, float]: ...


Flown = FlightTrack | HasTrack


def require_airframe(flights: Sequence[Flown], model: RotorModel, *, given: bool) -> None:
    """Raise UnlikeFlightError with all reasons why flights are not of the model's aircraft.

    Without a `given` model, each flight must be recognised as of its airframe. Raises AirframeError
    for another number of rotors.
    """
    reasons: list[tuple[str, Statement]] = []
    for flown in flights:
        if isinstance(flown, FlightTrack):
            track, facts, parameters = flown, VehicleFacts(), {}
        else:
            track, facts, parameters = flown.track, flown.facts, flown.parameters
        require_rotors(track, model.airframe)
        airframe_match = match_airframe(
            track, identified_airframe(model), facts, parameters, given=given
        )
        wrong = airframe_match.no_verdict or [w for w in [wrong_speeds(track, model.airframe)] if w]
        reasons += [(track.name, one) for one in wrong]
    if reasons:
        raise UnlikeFlightError(reasons)


def wrong_speeds(track: FlightTrack, airframe: Airframe) -> Statement | None:
    """Report that a flight's rotor speeds are late or in the wrong motor order; None if neither is
    so.

    None for speeds from motor outputs too, which are commands, not readings.
    """
    if track.source("rotor_speed_rpm").meaning is Meaning.MOTOR_OUTPUTS:
        return None
    if late := late_speeds(track):
        return replace(late, clauses=("not fitted",))
    order = check_motor_order(track, airframe)
    if order.verdict == "differs":
        return replace(order.found, clauses=(*order.found.clauses, "not fitted in this order"))
    return None


def too_little(track: FlightTrack, model: RotorModel) -> str | None:
    """Explain why a flight has too few rows to fit or to validate on; None when it has enough.

    The reason is a load inferred from rotor speeds, missing channels, or the number of rows.
    """
    rows = int(training_rows(track, model.inputs).sum())
    if rows >= LEAST_ROWS:
        # A short flight may lack rows only because no window covers those next to its ends.
        return None if rows > ENDS * LEAST_ROWS else _too_few_to_assemble(track, model)
    if "tank_kg" in model.inputs and "tank_kg" in track.standard_errors:
        return LOAD_FROM_SPEEDS
    words = {"airspeed": "airspeed", "tank_kg": "tank level"}
    needed = {"rotor_speed_rpm": "rotor speeds", **{name: words[name] for name in model.inputs}}
    absent = [name for channel, name in needed.items() if not track.reports(channel)]
    if absent:
        return f"it reports no {' and no '.join(absent)}"
    return f"{rows} rows in steady flight with {', '.join(needed.values())}; needs {LEAST_ROWS}"


def _too_few_to_assemble(track: FlightTrack, model: RotorModel) -> str | None:
    """Return the error of `assemble_flight` without the flight's name; None without an error."""
    try:
        assemble_flight(model, track)
    except DataError as error:
        return str(error).removeprefix(f"{track.name}: ")
    return None


def require_distinct(tracks: Iterable[FlightTrack]) -> None:
    """Raise DataError when a flight is given twice, as it would confirm itself."""
    seen: dict[bytes, str] = {}
    for track in tracks:
        content = sha256(track.rotor_speed_rpm.tobytes()).digest()
        if content in seen:
            raise DataError(
                f"{track.name} and {seen[content]} are the same flight; give each flight once, "
                "either to fit or as --held-out"
            )
        seen[content] = track.name
