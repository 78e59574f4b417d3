"""Which aircraft flew, by what the log says: serial number, board number, system id."""

from __future__ import annotations

import re
from dataclasses import dataclass

from thrustmargin.gcs_plugin.telemetry.recording import FlightLog
from thrustmargin.gcs_plugin.telemetry.settings.parameter_values import whole_number
from thrustmargin.gcs_plugin.telemetry.settings.reported_airframe import reported_airframe
from thrustmargin.models.errors import AirframeError, DataError

#: What ArduPilot says when it starts: its board, and its serial number in three words.
_BOARD = re.compile(r"^\S.* ([0-9A-F]{8}) ([0-9A-F]{8}) ([0-9A-F]{8})$")
#: What it says of its program, as "ArduCopter V4.5.7 (2a3dc4b7)".
_PROGRAM = re.compile(r"^((?:Ardu|APM:)\w+ V\S+(?: \([0-9a-f]+\))?)")
_NAME = re.compile(r"[\w.-]{1,80}")


@dataclass(frozen=True, slots=True)
class AircraftIdentity:
    """The name of an aircraft in the store, and what it rests on."""

    name: str
    by: str  # "given", "serial", "board number", "system id", "not known"


def checked_aircraft(name: str) -> str:
    """The name as given. Raises DataError where it cannot be that of a folder everywhere."""
    if not _NAME.fullmatch(name) or not name.strip("."):
        raise DataError(f"--aircraft {name!r}: give letters, digits and . _ - such as sprayer-7")
    return name


def aircraft_identity(log: FlightLog, given: str | None = None) -> AircraftIdentity:
    """Who flew. The system id alone is that of many aircraft: 1 unless somebody set another."""
    if given is not None:
        return AircraftIdentity(given, "given")
    serial = log.hardware_id or _serial_of_texts(log)
    if serial:
        return AircraftIdentity(f"serial-{serial}", "serial")
    if board := whole_number(log.parameters, "BRD_SERIAL_NUM"):
        return AircraftIdentity(f"board-{board}", "board number")
    if not log.vehicles:
        return AircraftIdentity("unknown", "not known")
    return AircraftIdentity(f"sysid-{log.vehicle}", "system id")


def board(log: FlightLog) -> str | None:
    """The autopilot that flew, by its serial number or its board number."""
    number = whole_number(log.parameters, "BRD_SERIAL_NUM")
    return log.hardware_id or _serial_of_texts(log) or (str(number) if number else None)


def layout(log: FlightLog) -> str | None:
    """The motor layout that the autopilot reports; None where it does not, or it is not known."""
    texts = [text for _, text in log.messages]
    try:
        return reported_airframe(log.parameters, facts=log.facts, texts=texts).layout
    except AirframeError:
        return None


def _serial_of_texts(log: FlightLog) -> str:
    for _, text in log.messages:
        if found := _BOARD.match(text.strip()):
            # Each word is printed from its last byte to its first.
            return "".join(bytes.fromhex(word)[::-1].hex() for word in found.groups())
    return ""


def firmware(log: FlightLog) -> str | None:
    """The autopilot's program as it says; None where it does not."""
    programs = (found[1] for _, text in log.messages if (found := _PROGRAM.match(text.strip())))
    return log.firmware or next(programs, None)
