"""The events of a flight as JSON rows: run-ups, rotor alarms, reports of the vehicle, timeline.

Each has its words; rotors and motors count from 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from thrustmargin.gcs_plugin.logs.log_answer import statement_words
from thrustmargin.gcs_plugin.logs.vehicle_statements import VehicleStatement
from thrustmargin.gcs_plugin.reports.margin.data import JsonObject
from thrustmargin.gcs_plugin.telemetry.recording import EngineerNote
from thrustmargin.gcs_plugin.wording.actions import Phase
from thrustmargin.gcs_plugin.wording.alarm_words import fault_words
from thrustmargin.gcs_plugin.wording.flight_words import loss_words
from thrustmargin.gcs_plugin.wording.takeoff_words import check_line, finding_words
from thrustmargin.gcs_plugin.wording.vehicle_words import kind_words
from thrustmargin.models.checks.takeoff import TakeoffCheck, TakeoffFinding, takeoff_checks
from thrustmargin.models.model.advice import Advice
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.hover_arms import arms_against_model
from thrustmargin.models.model.output_faults import MisreadSpeed
from thrustmargin.models.model.rotor_faults import FaultEpisode
from thrustmargin.models.model.rotor_model import identified_airframe
from thrustmargin.models.physics.smoothing import known_least, known_median, moving_mean

#: s over which the yaw reserve is a mean: shorter than a gust it is the noise of the speeds.
YAW_MEAN_S = 1.0


def takeoff_rows(analysis: FlightAnalysis) -> tuple[JsonObject, ...]:
    """Return the check before each take-off as a dict for JSON, by time; motors count from 1."""
    airframe = None if analysis.no_verdict else identified_airframe(analysis.model)
    places = () if analysis.no_verdict else analysis.places
    arms = None if analysis.no_verdict else analysis.model.arms
    checks = takeoff_checks(analysis.track, airframe, arms)
    return tuple(_row(analysis, one, places) for one in checks)


def _row(analysis: FlightAnalysis, check: TakeoffCheck, places: Sequence[str]) -> JsonObject:
    """Return one check before take-off as a dict for JSON, with the field names of TakeoffCheck.

    `words` is the check as a sentence. Each motor, counted from 1, also has `over_model`, its speed
    in the first seconds of hover over the model's, with its interval. `places` are the motors'
    places, empty where unknown.
    """
    plain = {f.name: getattr(check, f.name) for f in fields(check)}
    arms = arms_against_model(analysis, check.lift_s)
    motors = [
        {
            "motor": number,
            "name": places[number - 1] if places else "",
            **{f.name: getattr(motor, f.name) for f in fields(motor)},
            "over_model": arm.ratio,
            "over_model_low": arm.low,
            "over_model_high": arm.high,
        }
        for number, (motor, arm) in enumerate(zip(check.motors, arms, strict=True), 1)
    ]
    found = [_finding(one, places) for one in check.findings]
    return plain | {"words": check_line(check), "motors": motors, "findings": found}


def _finding(finding: TakeoffFinding, places: Sequence[str]) -> JsonObject:
    """Return one finding of a take-off check as a dict for JSON, with its sentence.

    `places` are the motors' places, empty where unknown. `forbids`: it forbids the take-off.
    """
    plain = {f.name: getattr(finding, f.name) for f in fields(finding)}
    return plain | {
        "motors": [motor + 1 for motor in finding.motors],
        "forbids": finding.forbids,
        "words": finding_words(finding, places),
    }


def yaw_rows(analysis: FlightAnalysis) -> JsonObject:
    """Return the share of yaw authority left unused in flight, as a dict for JSON.

    `yaw_reserve_min` is the least 1 s mean, `yaw_reserve_min_time_s` its time, `yaw_reserve_median`
    the median. Rotor speeds are measured, or inferred from motor outputs. All are NaN if a rotor
    has neither throughout, or the aircraft is unknown.
    """
    track, reserve = analysis.track, analysis.yaw_reserve
    mean = moving_mean(track.time_s, np.where(track.flying, reserve, np.nan), YAW_MEAN_S)
    mean = np.where(track.flying & np.isfinite(reserve), mean, np.nan)
    known = np.isfinite(mean).any()
    return {
        "yaw_reserve_min": known_least(mean),
        "yaw_reserve_min_time_s": float(track.time_s[np.nanargmin(mean)]) if known else np.nan,
        "yaw_reserve_median": known_median(mean),
    }


def alarm_row(episode: FaultEpisode, names: Sequence[str]) -> JsonObject:
    """Return a fault of a rotor or motor as a dict for JSON, with the text of its alarm as `words`.

    `names` are the places of all rotors. Rotors count from 1; if several could be the faulty one,
    `rotor` is None and `rotors` lists them. `from_s` and `until_s` are s from the flight's start,
    `until_s` None for a fault that lasted; `size`, `size_low` and `size_high` are shares of thrust
    lost. A flag says if motor outputs show the fault too.
    """
    fault = episode.fault
    return {
        "kind": fault.kind,
        "rotor": None if fault.rotors else fault.rotor + 1,
        "rotors": [rotor + 1 for rotor in fault.rotors or (fault.rotor,)],
        "from_s": episode.begin_s,
        "until_s": episode.end_s,
        "size": fault.size,
        "size_low": fault.lower,
        "size_high": fault.upper,
        "witnessed_by_outputs": fault.witnessed,
        "words": fault_words(fault, names, Phase.RECORDED),
    }


def misread_row(misread: MisreadSpeed | None) -> JsonObject | None:
    """Return, as a dict for JSON, the `rotor` (from 1) whose ESC reports `factor` times its true
    speed.

    A flag states if the motor outputs contradict the reported speed. None without such a rotor.
    """
    if misread is None:
        return None
    return {
        "rotor": misread.rotor + 1,
        "factor": misread.factor,
        "witnessed_by_outputs": misread.witnessed,
    }


#: Who reported an entry, as the page and the JSON name it.
VEHICLE, NOTES, PROGRAM = "vehicle", "notes", "program"


def said_rows(statements: Sequence[VehicleStatement], advice: Advice) -> tuple[JsonObject, ...]:
    """Return the faults that the vehicle itself reported, one dict for JSON each.

    Keys: `kind`, `subject`, `text`, `times_s`, `motors` (named by the vehicle) and `found_motors`
    (faulty by the log), both from 1, `corroboration` (the degree of agreement), `value` (the
    compared number) and a sentence on the agreement as `words`.
    """
    return tuple(
        {
            "kind": one.kind,
            "subject": one.subject,
            "text": one.text,
            "times_s": one.times_s,
            "motors": [motor + 1 for motor in one.named],
            "corroboration": one.corroboration,
            "found_motors": [motor + 1 for motor in one.found],
            "value": one.value,
            "words": statement_words(one, advice),
        }
        for one in statements
    )


def timeline_rows(
    starts: Sequence[JsonObject],
    said: Sequence[JsonObject],
    notes: Sequence[EngineerNote],
    advice: Advice,
) -> tuple[JsonObject, ...]:
    """Return the events of a flight by time, as dicts: `time_s`, `source`, `text`, `corroboration`.

    The events are the findings of the take-off checks `starts`, the vehicle's reports `said` (as
    `said_rows` returns them), the engineer's `notes`, and faults and losses of control in `advice`.
    `corroboration` is a sentence on what the log shows of a vehicle's report, and empty for other
    events.
    """
    made = [
        _entry(time_s, VEHICLE, _text(one), one["words"])
        for one in said
        for time_s in one["times_s"]
    ]
    made += [_entry(note.time_s, NOTES, note.text) for note in notes]
    made += [
        _entry(found["time_s"], PROGRAM, found["words"])
        for start in starts
        for found in start["findings"]
    ]
    made += [
        _entry(one.begin_s, PROGRAM, fault_words(one.fault, advice.rotor_names, Phase.RECORDED))
        for one in advice.faults
    ]
    made += [_entry(one.time_s, PROGRAM, loss_words([one])) for one in advice.losses]
    return tuple(sorted(made, key=lambda one: one["time_s"]))


def _text(said: JsonObject) -> str:
    """Return the title of a vehicle's report, with its text, or if it has none with its subject."""
    title = kind_words(said["kind"])
    if said["text"]:
        return f"{title}: {said['text']}"
    return f"{title} {said['subject']}".rstrip()


def _entry(time_s: float, source: str, text: str, corroboration: str = "") -> JsonObject:
    return {"time_s": time_s, "source": source, "text": text, "corroboration": corroboration}
