"""Collect the findings about a log in one list, most severe first, for inspect, report, replay
and store.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from thrustmargin.gcs_plugin.telemetry.recording import FlightLog
from thrustmargin.gcs_plugin.telemetry.vehicle_events import EventKind, VehicleEvent
from thrustmargin.gcs_plugin.wording.flight_words import (
    NAMES_WRONG,
    event_words,
    loss_words,
    recovered_words,
)
from thrustmargin.gcs_plugin.wording.takeoff_words import check_line, finding_words
from thrustmargin.models.checks.loss_of_control import loss_of_control, recovered_signs
from thrustmargin.models.checks.takeoff import TakeoffKind, takeoff_checks
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.json_values import NOT_IN_JSON
from thrustmargin.models.physics.airframe import Airframe


class Severity(StrEnum):
    """The severity of a finding."""

    GRAVE = "grave"
    WARNING = "warning"
    UNKNOWN = "unknown"
    OK = "ok"


class Spoils(StrEnum):
    """The part of a flight's results that a finding makes wrong."""

    NOTHING = "nothing"
    NUMBERS = "numbers"
    ROTOR_NAMES = "rotor names"


@dataclass(frozen=True, slots=True)
class Finding:
    """One result of a check: its name, severity, time (None: the whole log), and description.

    `values` are its numbers by name; times are s from the first row. `event` are kind and subject
    of the vehicle's own report that it repeats; None for any other finding.
    """

    check: str
    level: Severity
    words: str
    time_s: float | None = None
    values: Mapping[str, float] = field(default_factory=dict)
    spoils: Spoils = Spoils.NOTHING
    event: tuple[EventKind, str] | None = field(default=None, metadata=NOT_IN_JSON)


#: Check of the findings that repeat what the vehicle reported.
REPORTED = "vehicle reported"
_ORDER = tuple(Severity)
_GRAVE = (
    *(EventKind.CRASH, EventKind.LOST_CONTROL, EventKind.TERMINATED, EventKind.ATTITUDE_FAILURE),
    *(EventKind.THRUST_LOSS, EventKind.YAW_IMBALANCE),
    *(EventKind.MOTOR_FAILURE, EventKind.ESC_FAILURE),
)
#: Reported in the list of channels and times, and no fault.
_PLAIN = (EventKind.ARMED, EventKind.DISARMED, EventKind.RESOLVED)


def gravest_first(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Sort findings by severity, keeping the order given within each."""
    return tuple(sorted(findings, key=lambda one: _ORDER.index(one.level)))


def loss_findings(log: FlightLog) -> list[Finding]:
    """Return a finding of lost control and one of control nearly lost, each if there are signs.

    `values` has time and value of each sign, an attitude or a rate.
    """
    kinds = (
        ("control", Severity.GRAVE, loss_of_control(log.track), loss_words),
        ("recovered", Severity.WARNING, recovered_signs(log.track), recovered_words),
    )
    return [
        Finding(
            check=check,
            level=level,
            words=words(signs),
            time_s=signs[0].time_s,
            values={f"{s.kind} {name}": getattr(s, name) for s in signs for name in _OF_LOSS},
        )
        for check, level, signs, words in kinds
        if signs
    ]


_OF_LOSS = ("time_s", "value")


def takeoff_findings(track: FlightTrack, airframe: Airframe | None) -> list[Finding]:
    """Return the findings of every run-up of a flight; one without deviations is a finding too.

    If `airframe` is None only the rotors are compared with each other. UNKNOWN is the severity of a
    motor that reports nothing.
    """
    places = () if airframe is None else airframe.rotor_names
    made = []
    for check in takeoff_checks(track, airframe):
        for one in check.findings:
            level = Severity.GRAVE if one.forbids else Severity.WARNING
            level = Severity.UNKNOWN if one.kind is TakeoffKind.SILENT else level
            values = {"value": one.value, "reference": one.reference}
            words = finding_words(one, places)
            made.append(Finding("take-off", level, words, one.time_s, values))
        if not check.findings:
            level = Severity.OK if check.reporting else Severity.UNKNOWN
            made.append(Finding("take-off", level, check_line(check), check.begin_s))
    return made


def event_findings(events: Iterable[VehicleEvent]) -> list[Finding]:
    """Return one finding for each kind and subject of the vehicle's events.

    It has the time of the first, and the count of all. Arming and resolved faults are left out.
    """
    equal_events: dict[tuple[EventKind, str], list[VehicleEvent]] = {}
    for event in events:
        if event.kind not in _PLAIN:
            equal_events.setdefault((event.kind, event.subject), []).append(event)
    return [
        Finding(
            check=REPORTED,
            level=Severity.GRAVE if kind in _GRAVE else Severity.WARNING,
            words=event_words(kind, subject, same[0].text, same[0].time_s, len(same)),
            time_s=same[0].time_s,
            values={"count": float(len(same))},
            event=(kind, subject),
        )
        for (kind, subject), same in equal_events.items()
    ]


def report_findings(findings: Iterable[Finding]) -> list[Finding]:
    """Return the findings to show next to a report's verdict: grave ones and warnings.

    They must have a time, or make rotor names or numbers wrong; lost control is excluded, since the
    verdict says it.
    """
    return [
        one
        for one in findings
        if one.level in (Severity.GRAVE, Severity.WARNING)
        and one.check != "control"
        and (one.time_s is not None or one.spoils is not Spoils.NOTHING)
    ]


def names_wrong(findings: Iterable[Finding]) -> list[str]:
    """List the reasons, one sentence each, why rotor names are unreliable; empty if they are
    reliable.
    """
    wrong = (one for one in findings if one.spoils is Spoils.ROTOR_NAMES)
    return [f"rotor names {NAMES_WRONG}{one.words}" for one in wrong]
