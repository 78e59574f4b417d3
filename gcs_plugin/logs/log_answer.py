"""Answer one log: its findings, the answer of its flight, and the estimates for an unknown
aircraft.

Report, replay and live share this function.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from thrustmargin.gcs_plugin.logs.findings import REPORTED, Finding, Severity, names_wrong
from thrustmargin.gcs_plugin.logs.inspection import inspect_log
from thrustmargin.gcs_plugin.logs.vehicle_statements import VehicleStatement, vehicle_statements
from thrustmargin.gcs_plugin.telemetry.first_contact import first_contact
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
from thrustmargin.gcs_plugin.wording.flight_words import event_words, loss_words
from thrustmargin.gcs_plugin.wording.report_words import FirstContact
from thrustmargin.gcs_plugin.wording.vehicle_words import beside_words
from thrustmargin.models.model.advice import Advice, Advised, advise
from thrustmargin.models.model.airframe_claim import AirframeClaim
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.model_misfit import Caveat


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LogAnswer:
    """The findings and the answer of one sortie."""

    findings: tuple[Finding, ...]  # the gravest first
    made: Advised
    contact: FirstContact | None  # None of an aircraft that is known
    statements: tuple[VehicleStatement, ...] = ()  # of the vehicle, beside what the log shows


def answer_log(log: FlightLog, analysis: FlightAnalysis, limit: float) -> LogAnswer:
    """Return the answer of a log's analysed flight; `limit` is the share of a rotor's thrust for
    lasting use.
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
    """Return the findings with what the log shows behind each report of the vehicle; `advice` is
    None where no verdict is given."""
    beside = {
        event_words(one.kind, one.subject, one.text, one.times_s[0], len(one.times_s)): words
        for one in statements
        if (words := statement_words(one, advice))
    }
    return tuple(
        replace(one, words=f"{one.words}: {beside[one.words]}")
        if one.check == REPORTED and one.words in beside
        else one
        for one in findings
    )


def statement_words(one: VehicleStatement, advice: Advice | None) -> str:
    """Return how the log stands beside a report of the vehicle; empty where there is no view."""
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
    """Return what the report of a flight says, for `inspect`: its first line and what to do, bad
    rotors, an ESC that misreads, a model that the speeds contradict.
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
    return first_contact(log.track, claim, log.parameters, log.facts, **options)
