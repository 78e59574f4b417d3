"""Read a log as flights that are matched with an airframe, and answer each of them.

Every command that analyses a file reads it by `matched_flights`; report, replay and live share
`answer_log`: findings, the answer of the flight, and the estimates for an unknown aircraft.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from thrustmargin.gcs_plugin.logs.findings import Finding, Severity, names_wrong
from thrustmargin.gcs_plugin.logs.inspection import inspect_log
from thrustmargin.gcs_plugin.logs.read import read_sorties
from thrustmargin.gcs_plugin.logs.vehicle_statements import VehicleStatement, vehicle_statements
from thrustmargin.gcs_plugin.telemetry.first_contact import first_contact
from thrustmargin.gcs_plugin.telemetry.flight_log import with_track
from thrustmargin.gcs_plugin.telemetry.recording import FlightLog
from thrustmargin.gcs_plugin.wording.actions import Urgency, urgency_of
from thrustmargin.gcs_plugin.wording.advice_words import (
    action,
    fault_found,
    headline,
    misfit_words,
    misread_words,
)
from thrustmargin.gcs_plugin.wording.arm_words import arm_sentences
from thrustmargin.gcs_plugin.wording.flight_words import loss_words
from thrustmargin.gcs_plugin.wording.report_words import FirstContact
from thrustmargin.gcs_plugin.wording.vehicle_words import corroboration_words
from thrustmargin.models.checks.instruments import without_frozen
from thrustmargin.models.errors import AirframeError
from thrustmargin.models.model.advice import Advice, Advised, advise
from thrustmargin.models.model.airframe_match import AirframeMatch, match_airframe
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.inferred.load_inference import fill_channels
from thrustmargin.models.model.model_misfit import Caveat
from thrustmargin.models.model.rotor_model import RotorModel, identified_airframe


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LogAnswer(Advised):
    """The answer of one sortie (advice, analysis, fill), with the findings on its log."""

    findings: tuple[Finding, ...]  # the gravest first
    contact: FirstContact | None  # None of an aircraft that is known
    statements: tuple[VehicleStatement, ...] = ()  # of the vehicle, with what the log shows of each


def matched_flights(
    path: Path, model: RotorModel, *, given: bool, **options: Any
) -> list[tuple[FlightLog, AirframeMatch]]:
    """Return every sortie of a log with its match: whether it was flown by the model's airframe.

    `given` is True if the user stated the airframe; `options` are those of `read_sorties`. A sortie
    that matches has inferred channels filled in; one of an unknown aircraft is read without an
    airframe. Raise the errors of `read_sorties`.
    """
    craft = identified_airframe(model)

    def airframe_matches(logs: Iterable[FlightLog]) -> list[AirframeMatch]:
        matches = (
            match_airframe(log.track, craft, log.facts, log.parameters, given=given) for log in logs
        )
        return [
            replace(airframe_match, source=shlex.quote(str(path))) for airframe_match in matches
        ]

    def read(**airframe: Any) -> list[FlightLog]:
        logs = read_sorties(path, sought=given, **airframe, **options)
        return [
            replace(log, track=without_frozen(log.track, craft, log.parameters)) for log in logs
        ]

    try:
        logs, fits = read(airframe=model.airframe), True
    except AirframeError:  # another number of rotors, which the match reports
        logs, fits = read(), False
    matches = airframe_matches(logs)
    if fits and any(airframe_match.basis == "not known" for airframe_match in matches):
        bare = read()
        if len(bare) == len(logs):
            unmatched = [airframe_match.basis == "not known" for airframe_match in matches]
            logs = [b if none else log for log, b, none in zip(logs, bare, unmatched, strict=True)]
        else:  # the airframe's tank or speeds divided them otherwise
            logs, matches = bare, airframe_matches(bare)
    return [
        (
            log
            if airframe_match.basis == "not known" or airframe_match.no_verdict
            else with_track(log, fill_channels(log.track, craft, log.parameters)),
            airframe_match,
        )
        for log, airframe_match in zip(logs, matches, strict=True)
    ]


def answer_log(log: FlightLog, analysis: FlightAnalysis, limit: float) -> LogAnswer:
    """Return the answer of a log's analysed flight, with the findings on the log.

    `limit` is the share of a rotor's largest thrust that may last.
    """
    inspection = inspect_log(log, analysis.model.airframe, analysis.airframe_match)
    findings, order = inspection.findings, inspection.motor_order
    airframe_match = replace(
        analysis.airframe_match,
        other_order=bool(names_wrong(findings)),
        open_pairs=() if order is None else order.open_pairs,
    )
    advised = advise(replace(analysis, airframe_match=airframe_match), limit=limit)
    statements = vehicle_statements(
        log.events,
        log.track,
        faults=advised.advice.faults,
        losses=advised.advice.losses,
        yaw_reserve=None if analysis.no_verdict else analysis.yaw_reserve,
    )
    return LogAnswer(
        **{one.name: getattr(advised, one.name) for one in fields(advised)},
        findings=with_statements(findings, statements, advised.advice),
        contact=first_contact_of(log, analysis.airframe_match),
        statements=statements,
    )


def with_statements(
    findings: Sequence[Finding], statements: Sequence[VehicleStatement], advice: Advice | None
) -> tuple[Finding, ...]:
    """Append to each finding on a vehicle's report what the log shows of the reported fault.

    Other findings are returned unchanged. `advice` is None where no verdict is given.
    """
    log_shows = {
        (one.kind, one.subject): words
        for one in statements
        if (words := statement_words(one, advice))
    }
    return tuple(
        replace(one, words=f"{one.words}: {log_shows[one.event]}")
        if one.event in log_shows
        else one
        for one in findings
    )


def statement_words(one: VehicleStatement, advice: Advice | None) -> str:
    """Return what the log shows of a fault that the vehicle reported, in words; empty if nothing.

    `advice` is None where no verdict is given.
    """
    return corroboration_words(
        one.corroboration,
        named=one.named,
        found=one.found,
        value=one.value,
        losses="" if advice is None else loss_words(advice.losses),
        places=() if advice is None or advice.no_verdict else advice.rotor_names,
    )


#: How soon a flight asks for something -> the severity of its finding.
_SEVERITIES = {
    Urgency.STOP: Severity.GRAVE,
    Urgency.BEFORE_NEXT: Severity.WARNING,
    Urgency.NOTHING: Severity.OK,
}


def verdict_findings(advice: Advice) -> tuple[Finding, ...]:
    """Return a flight's verdict as findings, for `inspect`.

    They are the report's first line and action, bad rotors and arms, an ESC that misreads, and a
    model that the speeds contradict. Severity OK if nothing is to do.
    """
    findings = [
        Finding("rotors", Severity.GRAVE, fault_found(advice, episode)) for episode in advice.faults
    ]
    if advice.misread is not None:
        findings.append(Finding("ESC speed", Severity.WARNING, misread_words(advice.misread)))
    findings += [Finding("arm", Severity.WARNING, words) for words in arm_sentences(advice.arms)]
    if Caveat.MODEL in advice.caveats:
        findings.append(Finding("model", Severity.WARNING, misfit_words(advice)))
    urgency = urgency_of(advice.level, left_open=bool(advice.caveats))
    if urgency is Urgency.NOTHING and not findings:
        return (Finding("rotors", Severity.OK, headline(advice)),)
    if urgency is None or advice.no_verdict:
        return tuple(findings)
    severity = _SEVERITIES[urgency]
    if not advice.faults:
        findings.append(Finding("flight", severity, headline(advice)))
    return (*findings, Finding("what to do", severity, action(advice)))


def first_contact_of(log: FlightLog, airframe_match: AirframeMatch) -> FirstContact | None:
    """Return the estimates from the whole log of an unknown aircraft; None for a known one."""
    texts = [*log.earlier_texts, *(text for _, text in log.messages)]
    options = {"texts": texts, "autopilot": log.autopilot}
    recorded = airframe_match.source == shlex.quote(
        str(log.path)
    )  # else heard on a link and read again
    return first_contact(
        log.track, airframe_match, log.parameters, log.facts, recorded=recorded, **options
    )
