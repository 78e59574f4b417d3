"""Recognise the aircraft of a log by its autopilot, its sensors and their calibration.

The device ids of sensors state a bus and a type, so autopilots of one make share them; a serial
number belongs to one autopilot, and calibrated offsets to one set of sensors until they are
calibrated anew. An autopilot may move to another airframe, and a parameter file may be copied to
another autopilot: where the marks contradict each other the aircraft is not assumed but asked for.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from thrustmargin.gcs_plugin.telemetry.recording import FlightLog
from thrustmargin.gcs_plugin.telemetry.settings.pulse_range import whole_number
from thrustmargin.gcs_plugin.telemetry.settings.reported_airframe import reported_airframe
from thrustmargin.models.errors import AirframeError

#: Device ids. ArduPilot: INS_ACC_ID, INS_GYR2_ID, COMPASS_DEV_ID, BARO1_DEVID; PX4: CAL_ACC0_ID.
_IDS = re.compile(
    r"(INS_(ACC|GYR)\d?_ID|COMPASS_DEV_ID\d?|BARO\d_DEVID|CAL_(ACC|GYRO|MAG|BARO)\d_ID)"
)
#: Calibrated offsets and scales of accelerometers and compasses, which no two sets share.
_ACCELEROMETER = re.compile(r"(INS_ACC\d?(OFFS|SCAL)_[XYZ]|CAL_ACC\d_[XYZ](OFF|SCALE))")
_COMPASS = re.compile(r"(COMPASS_OFS\d?_[XYZ]|CAL_MAG\d_[XYZ]OFF)")
#: What an autopilot reports when it starts: its board and its serial number in three words.
_BOARD = re.compile(r"^\S.* ([0-9A-F]{8}) ([0-9A-F]{8}) ([0-9A-F]{8})$")
FEWEST_VALUES = 3  # of a calibration that both logs must have
FEWEST_SENSORS = 2  # likewise of device ids


@dataclass(frozen=True, slots=True, kw_only=True)
class Marks:
    """Values in a log that identify its aircraft, such as serial number, sensor ids and
    calibration; empty if missing."""

    board: str = ""  # serial number of the autopilot
    vehicle: int = 0  # MAVLink system id; 0 unknown
    layout: str = ""  # of the motors, as the autopilot reports it
    sensors: Mapping[str, float] = field(default_factory=dict)  # device ids
    accelerometer: Mapping[str, float] = field(default_factory=dict)  # calibration
    compass: Mapping[str, float] = field(default_factory=dict)


class MarksMatch(StrEnum):
    """Result of comparing the marks of a log with those of a known aircraft."""

    SAME = "same"
    # Of these the user must choose: the marks contradict each other, or do not suffice.
    OTHER_LAYOUT = "same autopilot, other motor layout"
    COPIED = "same calibration, other autopilot"
    RECALIBRATED = "same sensors and system id, other calibration"
    UNMARKED = "same system id and motor layout, and the log shows no more of it"
    OTHER = "other"


@dataclass(frozen=True, slots=True, kw_only=True)
class Recognition:
    """Which known aircraft flew a log: `name`, or None and in `open` the (name, MarksMatch) among
    which the user must choose. Both empty for a new aircraft."""

    name: str | None = None
    open: tuple[tuple[str, MarksMatch], ...] = ()


def marks_of(log: FlightLog) -> Marks:
    """Return a log's marks, by which its aircraft is recognised.

    They are serial number, system id, motor layout, device ids and calibrations; empty where
    missing.
    """
    parameters = log.parameters
    number = whole_number(parameters, "BRD_SERIAL_NUM")
    try:
        texts = [text for _, text in log.messages]
        layout = reported_airframe(parameters, facts=log.facts, texts=texts).layout
    except AirframeError:
        layout = None

    def chosen(pattern: re.Pattern[str], *, neutral: tuple[float, ...]) -> dict[str, float]:
        """Return the parameters whose names match `pattern` and whose values are not in
        `neutral`."""
        return {
            name: float(value)
            for name, value in sorted(parameters.items())
            if pattern.fullmatch(name) and float(value) not in neutral
        }

    return Marks(
        board=log.hardware_id or serial_of_texts(log) or (str(number) if number else ""),
        vehicle=log.vehicle if log.vehicles else 0,
        layout=layout or "",
        sensors=chosen(_IDS, neutral=(0.0,)),
        accelerometer=chosen(_ACCELEROMETER, neutral=(0.0, 1.0)),
        compass=chosen(_COMPASS, neutral=(0.0,)),
    )


def serial_of_texts(log: FlightLog) -> str:
    """Return the serial number in the texts that an autopilot sends when it starts; else empty."""
    for _, text in log.messages:
        if found := _BOARD.match(text.strip()):
            # Each word is printed from its last byte to its first.
            return "".join(bytes.fromhex(word)[::-1].hex() for word in found.groups())
    return ""


def match(log: Marks, known: Marks) -> MarksMatch:
    """Compare the marks of a log with the marks of an earlier log of a known aircraft.

    SAME: equal serial number or calibration. OTHER: another aircraft. In the other cases the user
    must choose: COPIED (equal calibration, another serial number), RECALIBRATED (equal sensors,
    another calibration), OTHER_LAYOUT, UNMARKED (nothing to compare).
    """
    boards = log.board and known.board
    layouts = log.layout and known.layout and log.layout != known.layout
    calibrated = [
        _equal(log.accelerometer, known.accelerometer),
        _equal(log.compass, known.compass),
    ]
    same_calibration = True in calibrated
    if boards and log.board != known.board:
        return (
            MarksMatch.COPIED
            if same_calibration and _equal(log.sensors, known.sensors)
            else MarksMatch.OTHER
        )
    if boards or same_calibration:
        return MarksMatch.OTHER_LAYOUT if layouts else MarksMatch.SAME
    sensors = _equal(log.sensors, known.sensors, fewest=FEWEST_SENSORS)
    if layouts or sensors is False or log.vehicle != known.vehicle:
        return MarksMatch.OTHER
    return MarksMatch.RECALIBRATED if sensors else MarksMatch.UNMARKED


def _equal(
    one: Mapping[str, float], other: Mapping[str, float], *, fewest: int = FEWEST_VALUES
) -> bool | None:
    """Return True if the values that both mappings have under a name are equal within 1e-6 of the
    value of `other`, else False.

    None if they share fewer than `fewest` names.
    """
    shared = one.keys() & other.keys()
    if len(shared) < fewest:
        return None
    return all(abs(one[name] - other[name]) <= 1e-6 * abs(other[name]) for name in shared)


def recognise(log: Marks, known: Iterable[tuple[str, tuple[Marks, ...]]]) -> Recognition:
    """Return which of the known aircraft a log's marks belong to.

    `known` gives each aircraft's name and the marks of its logs, of which the best match counts. If
    exactly one aircraft matches as SAME, its name is returned. Else all that match are returned as
    `open`, for the user to choose from; if none does, the aircraft is new.
    """
    found: dict[str, MarksMatch] = {}
    for name, marks in known:
        matches = (match(log, one) for one in marks)
        best = min(matches, key=list(MarksMatch).index, default=MarksMatch.OTHER)
        if best is not MarksMatch.OTHER:
            found[name] = best
    same = [name for name, best in found.items() if best is MarksMatch.SAME]
    if len(same) == 1:
        return Recognition(name=same[0])
    return Recognition(open=tuple(sorted(found.items())))
