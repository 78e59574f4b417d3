"""One list of findings about a log, the gravest first, for inspect, report, replay and store."""

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
from thrustmargin.models.checks.loss_of_control import loss_of_control, recovered_signs


class Severity(StrEnum):
    """How grave a finding is."""

    GRAVE = "grave"
    WARNING = "warning"
    UNKNOWN = "unknown"
    OK = "ok"


class Spoils(StrEnum):
    """What a finding makes wrong in the answers about a flight."""

    NOTHING = "nothing"
    NUMBERS = "numbers"
    ROTOR_NAMES = "rotor names"


@dataclass(frozen=True, slots=True)
class Finding:
    """One answer: which check, how grave, when (None: of the whole log), and why in words.

    `values` are its numbers by name, times in s from the first row.
    """

    check: str
    level: Severity
    words: str
    time_s: float | None = None
    values: Mapping[str, float] = field(default_factory=dict)
    spoils: Spoils = Spoils.NOTHING


_ORDER = tuple(Severity)
_GRAVE = (
    *(EventKind.CRASH, EventKind.LOST_CONTROL, EventKind.TERMINATED, EventKind.ATTITUDE_FAILURE),
    *(EventKind.THRUST_LOSS, EventKind.YAW_IMBALANCE),
)
#: Said in the list of channels and times, and no fault.
_PLAIN = (EventKind.ARMED, EventKind.DISARMED, EventKind.RESOLVED)


def gravest_first(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """The findings by severity, each kind in the order given."""
    return tuple(sorted(findings, key=lambda one: _ORDER.index(one.level)))


def loss_findings(log: FlightLog) -> list[Finding]:
    """That control was lost, or nearly, with the signs of it."""
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


def event_findings(events: Iterable[VehicleEvent]) -> list[Finding]:
    """What the vehicle reported; of each kind and subject the first, and how often it came."""
    alike: dict[tuple[EventKind, str], list[VehicleEvent]] = {}
    for event in events:
        if event.kind not in _PLAIN:
            alike.setdefault((event.kind, event.subject), []).append(event)
    return [
        Finding(
            check="vehicle reported",
            level=Severity.GRAVE if kind in _GRAVE else Severity.WARNING,
            words=event_words(kind, subject, same[0].text, same[0].time_s, len(same)),
            time_s=same[0].time_s,
            values={"count": float(len(same))},
        )
        for (kind, subject), same in alike.items()
    ]


def repeated(findings: Iterable[Finding]) -> list[Finding]:
    """Those that a report says beside its verdict: grave ones, the vehicle's own, and those that
    make its rotor names or numbers wrong."""
    return [
        one
        for one in findings
        if one.level in (Severity.GRAVE, Severity.WARNING)
        and one.check != "control"
        and (one.time_s is not None or one.spoils is not Spoils.NOTHING)
    ]


def names_wrong(findings: Iterable[Finding]) -> list[str]:
    """Why the names of the rotors cannot be trusted, a sentence each; none where they can."""
    wrong = (one for one in findings if one.spoils is Spoils.ROTOR_NAMES)
    return [f"rotor names {NAMES_WRONG}{one.words}" for one in wrong]
