"""Store the answer of a flight as data, and make its words when somebody reads them.

A season is taken in by one person and read by another, perhaps in another language and by a later
version. So the store keeps the `Advice` and what stands beside it as JSON, and this module makes
the words of both in the reader's language. Rows of older versions have texts instead, which are
shown as the texts of the day on which they were taken in.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from functools import lru_cache
from typing import Any, get_type_hints

import numpy as np

from thrustmargin.gcs_plugin.reports.margin.moments import Activity, activities
from thrustmargin.gcs_plugin.wording.actions import Action, Phase
from thrustmargin.gcs_plugin.wording.advice_words import (
    PREDICTED_ALONE,
    action,
    action_steps,
    damage_words,
    headline,
    misfit_words,
    suspects,
)
from thrustmargin.gcs_plugin.wording.alarm_words import fault_words
from thrustmargin.gcs_plugin.wording.flight_words import too_short
from thrustmargin.gcs_plugin.wording.language import say, sentence
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.json_values import from_json_values, to_json_values
from thrustmargin.models.model.advice import LEAST_FLIGHT_S, Advice, FlightLevel
from thrustmargin.models.model.airframe_claim import AirframeClaim
from thrustmargin.models.model.analysis import ThrustUse
from thrustmargin.models.model.model_misfit import Caveat
from thrustmargin.models.provenance import Provenance

#: Version of the rows of `flights`: 2 since words are made when they are read.
ROW_VERSION = 2
#: Channels whose source is stored -> the column of its words.
SOURCES = {
    "tank_kg": "tank_source",
    "rotor_speed_rpm": "speed_source",
    "airspeed": "airspeed_source",
}
#: Fields of ThrustUse that are arrays over the flight; stored as whether any row is true.
_ROWS, _FLAGS = ("lasting", "reach"), ("surely_above", "maybe_above")


class NoVerdict(StrEnum):
    """The kind of reason why a flight has no verdict."""

    NOT_KNOWN = "aircraft_not_known"
    CONTRADICTED = "airframe_contradicted"
    MISFIT = "model_contradicted"
    ALONE = "predicted_alone"
    TOO_SHORT = "too_short"
    NO_SPEED = "no_rotor_speed"
    NO_TANK = "no_tank_level"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StoredAnswer:
    """The answer of one stored flight: what its words are made of, and no words."""

    advice: Advice  # of whose arrays only `any` is known
    reasons: tuple[NoVerdict, ...]  # empty where there is a verdict
    contradicted: tuple[str, ...]  # names of the comparisons that contradict the airframe
    doing: tuple[Activity, ...]  # at the worst moment
    sources: Mapping[str, Provenance]  # of the channels in SOURCES

    @property
    def reason_words(self) -> str:
        """Return why there is no verdict, or else the headline of the verdict."""
        said = {
            NoVerdict.NOT_KNOWN: lambda: say("this aircraft is not known: no airframe was given"),
            NoVerdict.CONTRADICTED: lambda: say(
                "the flight contradicts the airframe: {checks}",
                checks=", ".join(map(say, self.contradicted)),
            ),
            NoVerdict.MISFIT: lambda: misfit_words(self.advice),
            NoVerdict.ALONE: lambda: say(PREDICTED_ALONE),
            NoVerdict.TOO_SHORT: lambda: too_short(self.advice.airborne_s),
            NoVerdict.NO_SPEED: lambda: say("no rotor speed"),
            NoVerdict.NO_TANK: lambda: say("no tank level"),
        }
        return "; ".join(said[kind]() for kind in self.reasons) or headline(self.advice)

    @property
    def alarms(self) -> list[str]:
        """Return the words of the live alarms of its bad rotors and motors, in order of time."""
        names = self.advice.rotor_names
        return [fault_words(one.fault, names, Phase.RECORDED) for one in self.advice.faults]

    @property
    def doing_words(self) -> str:
        """Return what the aircraft was doing at the worst moment; empty where unknown."""
        return ", ".join(one.words for one in self.doing)


def no_verdict_reasons(
    advice: Advice, claim: AirframeClaim, track: FlightTrack
) -> tuple[NoVerdict, ...]:
    """Return the kinds of reasons why a flight has no verdict; empty where it has one."""
    if advice.level is not FlightLevel.UNKNOWN:
        return ()
    if claim.withheld:
        return (NoVerdict.CONTRADICTED if claim.contradicted else NoVerdict.NOT_KNOWN,)
    if track.flying_s < LEAST_FLIGHT_S:
        return (NoVerdict.TOO_SHORT,)
    if Caveat.MODEL in advice.caveats:
        return (NoVerdict.MISFIT,)
    if advice.predicted_alone:
        return (NoVerdict.ALONE,)
    lacks = (("rotor_speed_rpm", NoVerdict.NO_SPEED), ("tank_kg", NoVerdict.NO_TANK))
    return tuple(kind for name, kind in lacks if not np.isfinite(getattr(track, name)).any())


def stored_answer(
    advice: Advice, claim: AirframeClaim, track: FlightTrack, worst_time_s: float | None
) -> StoredAnswer:
    """Return the answer of a flight to be stored.

    `worst_time_s` is the time of its worst moment, s from the first row of `track`, if it has one.
    """
    row = None if worst_time_s is None else int(np.argmin(np.abs(track.time_s - worst_time_s)))
    return StoredAnswer(
        advice=advice,
        reasons=no_verdict_reasons(advice, claim, track),
        contradicted=claim.contradicted,
        doing=() if row is None else activities(track, row),
        sources={
            name: replace(track.source(name), rejected=())
            for name in SOURCES
            if name in track.sources
        },
    )


def answer_columns(answer: StoredAnswer) -> dict[str, Any]:
    """Return the columns of `schema.FLIGHTS` that contain an answer: as JSON, and by kinds."""
    advice, use = answer.advice, answer.advice.use
    kept: dict[str, Any] = {
        f.name: getattr(advice, f.name) for f in fields(advice) if f.name != "use"
    }
    kept["use"] = {f.name: getattr(use, f.name) for f in fields(use) if f.name not in _ROWS}
    kept["use"] |= {name: bool(np.any(getattr(use, name))) for name in _FLAGS}
    whole = {f.name: getattr(answer, f.name) for f in fields(answer)} | {"advice": kept}
    return {
        "row_version": ROW_VERSION,
        "answer": json.dumps(to_json_values(whole), default=lambda number: number.item()),
        "levels": list(map(str, advice.levels)),
        "action_kinds": [str(kind) for kind, _ in action_steps(advice)],
        "fault_kinds": [one.fault.kind for one in advice.faults],
        "suspects": list(suspects(advice)),
        "reason_kinds": list(map(str, answer.reasons)),
        "doing_kinds": [one.kind for one in answer.doing],
    }


@lru_cache(maxsize=4096)
def read_answer(stored: str) -> StoredAnswer | None:
    """Return an answer from its JSON; None for one of a version with other fields."""
    try:
        data = json.loads(stored)
        data["advice"] = _advice(data["advice"])
        kinds = get_type_hints(StoredAnswer)
        read = {n: from_json_values(kinds[n], one, n) for n, one in data.items() if n != "advice"}
        return StoredAnswer(advice=data["advice"], **read)
    except (ValueError, KeyError, TypeError, RecursionError):
        return None


def _advice(data: dict[str, Any]) -> Advice:
    """Return an Advice from its JSON values. Raises ValueError, KeyError or TypeError."""
    kinds, of_use = get_type_hints(Advice), get_type_hints(ThrustUse)
    use: dict[str, Any] = {
        name: np.array([value]) if name in _FLAGS else from_json_values(of_use[name], value, name)
        for name, value in data.pop("use").items()
    }
    use |= {name: np.empty(0) for name in _ROWS}
    return Advice(
        use=ThrustUse(**use), **{n: from_json_values(kinds[n], one, n) for n, one in data.items()}
    )


def _stored(flight: Mapping[str, Any]) -> StoredAnswer | None:
    """Return the answer in a row of `flights`; None in older rows and if it cannot be read."""
    stored = flight.get("answer")
    return None if stored is None else read_answer(stored)


def mark_old_text(text: str) -> str:
    """Return a stored text, marked as the words of the day on which its log was taken in.

    Empty for an empty text.
    """
    return say("{words} (in the words of the day it was taken in)", words=text) if text else ""


def flight_action(flight: Mapping[str, Any], by_kind: Action | None = None) -> str:
    """Return what to do after a flight of the store; empty if neither its row nor `by_kind` has it.

    `by_kind` is the action for the flight's verdict. It stands before the text of an older row,
    which may be in another language, and replaces an action that is missing or cannot be read.
    """
    answer, kind = _stored(flight), by_kind.text if by_kind else ""
    if answer:
        return action(answer.advice) or kind
    return "; ".join(filter(None, (kind, mark_old_text(flight["action"] or ""))))


def flight_caveats(flight: Mapping[str, Any]) -> tuple[Caveat, ...]:
    """Return what a flight of the store with a verdict left open; empty for an older row."""
    answer = _stored(flight)
    known = answer is not None and answer.advice.level is not FlightLevel.UNKNOWN
    return answer.advice.caveats if answer is not None and known else ()


def flight_alarms(flight: Mapping[str, Any]) -> list[str]:
    """Return the words of each live alarm of rotors and motors in a flight of the store."""
    answer = _stored(flight)
    return answer.alarms if answer else [mark_old_text(text) for text in flight["alarms"] or ()]


def flight_damage(flight: Mapping[str, Any]) -> str:
    """Return which rotors or motors were bad and by how much; an alarm would also say "land"."""
    answer = _stored(flight)
    return sentence(damage_words(answer.advice)) if answer else "; ".join(flight_alarms(flight))


def flight_reason(flight: Mapping[str, Any]) -> str:
    """Return why a flight of the store has no verdict; "not known why" where its row is silent."""
    answer = _stored(flight)
    if answer:
        return answer.reason_words
    return mark_old_text(flight["verdict_reason"] or "") or say("not known why")


def flight_doing(flight: Mapping[str, Any]) -> str:
    """Return what the aircraft was doing at the worst moment; empty where unknown."""
    answer = _stored(flight)
    return answer.doing_words if answer else mark_old_text(flight["worst_doing"] or "")


def _column(words: Callable[[StoredAnswer], Any]) -> Callable[[str], Any]:
    """Return a function from the stored JSON to words, null for an answer that cannot be read."""

    def made(stored: str) -> Any:
        answer = read_answer(stored)
        return None if answer is None else words(answer)

    return made


def _source_column(channel: str) -> Callable[[str], Any]:
    """Return a function from the stored JSON to the words of a channel's source."""
    return _column(lambda a: a.sources[channel].words if channel in a.sources else None)


#: Columns that SQL shows in the reader's language -> how they are made of the column `answer`.
SQL_WORDS: Mapping[str, Callable[[str], Any]] = {
    "action": _column(lambda a: action(a.advice) or None),
    "alarms": _column(lambda a: a.alarms),
    "verdict_reason": _column(lambda a: a.reason_words),
    "worst_doing": _column(lambda a: a.doing_words or None),
    **{column: _source_column(channel) for channel, column in SOURCES.items()},
}
