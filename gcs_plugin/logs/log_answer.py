"""Read a log as flights that are matched with an airframe, and answer each of them.

Every command that analyses a file reads it by `claimed_flights`; report, replay and live share
`answer_log`: findings, the answer of the flight, and the estimates for an unknown aircraft.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
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
from thrustmargin.gcs_plugin.wording.vehicle_words import beside_words
from thrustmargin.models.checks.instruments import without_frozen
from thrustmargin.models.errors import AirframeError
from thrustmargin.models.model.advice import Advice, Advised, advise
from thrustmargin.models.model.airframe_claim import AirframeClaim, airframe_claim
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.inferred.prepared import fill_channels
from thrustmargin.models.model.model_misfit import Caveat
from thrustmargin.models.model.rotor_model import RotorModel, identified_airframe


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LogAnswer:
    """The findings on one sortie and its answer (advice, analysis, fill)."""

    findings: tuple[Finding, ...]  # the gravest first
    made: Advised
    contact: FirstContact | None  # None of an aircraft that is known
    statements: tuple[VehicleStatement, ...] = ()  # of the vehicle, with what the log shows of each


def claimed_flights(
    path: Path, model: RotorModel, *, given: bool, **options: Any
) -> list[tuple[FlightLog, AirframeClaim]]:
    """Return every sortie of a log, with inferred channels, and the decision if it is the
    airframe's.

    `given` is True if the user stated the airframe; `options` are those of `read_sorties`. A log
    that does not match is read without an airframe. Raise the errors of `read_sorties`.
    """
    craft = identified_airframe(model)

    def claims_of(logs: Iterable[FlightLog]) -> list[AirframeClaim]:
        claims = (
            airframe_claim(log.track, craft, log.facts, log.parameters, given=given) for log in logs
        )
        return [replace(claim, source=shlex.quote(str(path))) for claim in claims]

    def read(**airframe: Any) -> list[FlightLog]:
        logs = read_sorties(path, sought=given, **airframe, **options)
        return [
            replace(log, track=without_frozen(log.track, craft, log.parameters)) for log in logs
        ]

    try:
        logs, fits = read(airframe=model.airframe), True
    except AirframeError:  # another number of rotors, which the claim will say
        logs, fits = read(), False
    claims = claims_of(logs)
    if fits and any(claim.basis == "not known" for claim in claims):
        bare = read()
        if len(bare) == len(logs):
            unclaimed = [claim.basis == "not known" for claim in claims]
            logs = [b if none else log for log, b, none in zip(logs, bare, unclaimed, strict=True)]
        else:  # the airframe's tank or speeds divided them otherwise
            logs, claims = bare, claims_of(bare)
    return [
        (
            log
            if claim.basis == "not known" or claim.withheld
            else with_track(log, fill_channels(log.track, craft, log.parameters)),
            claim,
        )
        for log, claim in zip(logs, claims, strict=True)
    ]


def answer_log(log: FlightLog, analysis: FlightAnalysis, limit: float) -> LogAnswer:
    """Return the answer of a log's analysed flight, with the findings on the log.

    `limit` is the share of a rotor's largest thrust that may last.
    """
    inspection = inspect_log(log, analysis.model.airframe, analysis.claim)
    findings, order = inspection.findings, inspection.motor_order
    claim = replace(
        analysis.claim,
        other_order=bool(names_wrong(findings)),
        open_pairs=() if order is None else order.open_pairs,
    )
    made = advise(replace(analysis, claim=claim), limit=limit)
    said = vehicle_statements(
        log.events,
        log.track,
        faults=made.advice.faults,
        losses=made.advice.losses,
        yaw_reserve=None if analysis.withheld else analysis.yaw_reserve,
    )
    return LogAnswer(
        findings=with_statements(findings, said, made.advice),
        made=made,
        contact=first_contact_of(log, analysis.claim),
        statements=said,
    )


def with_statements(
    findings: Sequence[Finding], statements: Sequence[VehicleStatement], advice: Advice | None
) -> tuple[Finding, ...]:
    """Append to each finding of a vehicle's report what the log shows of the reported fault.

    `advice` is None where no verdict is given.
    """
    beside = {
        (one.kind, one.subject): words
        for one in statements
        if (words := statement_words(one, advice))
    }
    return tuple(
        replace(one, words=f"{one.words}: {beside[one.event]}") if one.event in beside else one
        for one in findings
    )


def statement_words(one: VehicleStatement, advice: Advice | None) -> str:
    """Return in words if the log confirms a report of the vehicle; empty if it shows nothing of
    it."""
    return beside_words(
        one.beside,
        named=one.named,
        found=one.found,
        value=one.value,
        losses="" if advice is None else loss_words(advice.losses),
        places=() if advice is None or advice.withheld else advice.rotor_names,
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
    if urgency is None or advice.withheld:
        return tuple(findings)
    severity = _SEVERITIES[urgency]
    if not advice.faults:
        findings.append(Finding("flight", severity, headline(advice)))
    return (*findings, Finding("what to do", severity, action(advice)))


def first_contact_of(log: FlightLog, claim: AirframeClaim) -> FirstContact | None:
    """Return the estimates from the whole log of an unknown aircraft; None for a known one."""
    texts = [*log.earlier_texts, *(text for _, text in log.messages)]
    options = {"texts": texts, "autopilot": log.autopilot}
    recorded = claim.source == shlex.quote(str(log.path))  # else heard on a link and read again
    return first_contact(log.track, claim, log.parameters, log.facts, recorded=recorded, **options)
