"""Answer one log: its findings, the answer of its flight, and the estimates for an unknown
aircraft.

Report, replay and live share this function.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from thrustmargin.gcs_plugin.logs.findings import Finding, Severity, names_wrong
from thrustmargin.gcs_plugin.logs.inspection import inspect_log
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
from thrustmargin.gcs_plugin.wording.report_words import FirstContact
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


def answer_log(log: FlightLog, analysis: FlightAnalysis, limit: float) -> LogAnswer:
    """Return the answer of a log's analysed flight; `limit` is the share of a rotor's thrust for
    lasting use.
    """
    inspection = inspect_log(log, analysis.model.airframe, analysis.claim)
    found, order = inspection.findings, inspection.motor_order
    claim = replace(
        analysis.claim,
        other_order=bool(names_wrong(found)),
        open_pairs=() if order is None else order.open_pairs,
    )
    return LogAnswer(
        findings=found,
        made=advise(replace(analysis, claim=claim), limit=limit),
        contact=first_contact_of(log, analysis.claim),
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
    found = [
        Finding("rotors", Severity.GRAVE, fault_found(advice, episode)) for episode in advice.faults
    ]
    if advice.misread is not None:
        found.append(Finding("ESC speed", Severity.WARNING, misread_words(advice.misread)))
    if Caveat.MODEL in advice.caveats:
        found.append(Finding("model", Severity.WARNING, misfit_words(advice)))
    urgency = urgency_of(advice.level, left_open=bool(advice.caveats))
    if urgency is Urgency.NOTHING and not found:
        return (Finding("rotors", Severity.OK, headline(advice)),)
    if urgency is None or advice.withheld:
        return tuple(found)
    severity = _SEVERITIES[urgency]
    if not advice.faults:
        found.append(Finding("flight", severity, headline(advice)))
    return (*found, Finding("what to do", severity, action(advice)))


def first_contact_of(log: FlightLog, claim: AirframeClaim) -> FirstContact | None:
    """Return the estimates from the whole log of an unknown aircraft; None for a known one."""
    texts = [*log.earlier_texts, *(text for _, text in log.messages)]
    options = {"texts": texts, "autopilot": log.autopilot}
    return first_contact(log.track, claim, log.parameters, log.facts, **options)
