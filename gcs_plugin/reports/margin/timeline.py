"""List the reports about a flight in order of time: by vehicle, by engineer, by this program."""

from __future__ import annotations

from collections.abc import Sequence

from thrustmargin.gcs_plugin.logs.log_answer import statement_words
from thrustmargin.gcs_plugin.logs.vehicle_statements import VehicleStatement
from thrustmargin.gcs_plugin.reports.margin.data import JsonObject
from thrustmargin.gcs_plugin.telemetry.recording import EngineerNote
from thrustmargin.gcs_plugin.wording.actions import Phase
from thrustmargin.gcs_plugin.wording.alarm_words import fault_words
from thrustmargin.gcs_plugin.wording.flight_words import loss_words
from thrustmargin.gcs_plugin.wording.vehicle_words import kind_words
from thrustmargin.models.model.advice import Advice

#: Who reported an entry, as the page and the JSON name it.
VEHICLE, NOTES, PROGRAM = "vehicle", "notes", "program"


def said_rows(statements: Sequence[VehicleStatement], advice: Advice) -> tuple[JsonObject, ...]:
    """Return the reports of the vehicle beside what the log shows; motors count from 1."""
    return tuple(
        {
            "kind": one.kind,
            "subject": one.subject,
            "text": one.text,
            "times_s": one.times_s,
            "motors": [motor + 1 for motor in one.named],
            "beside": one.beside,
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
    """Return all entries in order of time: `time_s`, `source`, `text`, and `beside` in words."""
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
    """Return a report's own text, else its kind and subject."""
    title = kind_words(said["kind"])
    if said["text"]:
        return f"{title}: {said['text']}"
    return f"{title} {said['subject']}".rstrip()


def _entry(time_s: float, source: str, text: str, beside: str = "") -> JsonObject:
    return {"time_s": time_s, "source": source, "text": text, "beside": beside}
