"""Make the words of a stored answer when somebody reads them, in the reader's language.

Rows of older versions have texts instead, which are shown as the texts of the day on which they
were taken in.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from thrustmargin.gcs_plugin.commands.shared.stored_answer import (
    SOURCES,
    NoVerdict,
    StoredAnswer,
    fault_rotors,
    read_answer,
)
from thrustmargin.gcs_plugin.wording.actions import Action, Phase
from thrustmargin.gcs_plugin.wording.advice_words import (
    PREDICTED_ALONE,
    action,
    damage_words,
    headline,
    misfit_words,
    suspects,
)
from thrustmargin.gcs_plugin.wording.alarm_words import fault_words
from thrustmargin.gcs_plugin.wording.check_words import in_english
from thrustmargin.gcs_plugin.wording.flight_words import doing_words, too_short
from thrustmargin.gcs_plugin.wording.language import say, sentence
from thrustmargin.models.model.advice import FlightLevel
from thrustmargin.models.model.model_misfit import Caveat


def reason_words(answer: StoredAnswer) -> str:
    """Return the reasons why a stored flight has no verdict; if it has one, its headline."""
    said = {
        NoVerdict.NOT_KNOWN: lambda: say("this aircraft is not known: no airframe was given"),
        NoVerdict.CONTRADICTED: lambda: say(
            "the flight contradicts the airframe: {checks}",
            checks=", ".join(map(say, answer.contradicted)),
        ),
        NoVerdict.MISFIT: lambda: misfit_words(answer.advice),
        NoVerdict.ALONE: lambda: say(PREDICTED_ALONE),
        NoVerdict.TOO_SHORT: lambda: too_short(answer.advice.airborne_s),
        NoVerdict.NO_SPEED: lambda: say("no rotor speed"),
        NoVerdict.NO_TANK: lambda: say("no tank level"),
    }
    return "; ".join(said[kind]() for kind in answer.reasons) or headline(answer.advice)


def alarm_words(answer: StoredAnswer) -> list[str]:
    """Return the words of the live alarms of its bad rotors and motors, in order of time."""
    names = answer.advice.rotor_names
    return [fault_words(one.fault, names, Phase.RECORDED) for one in answer.advice.faults]


def _stored(flight: Mapping[str, Any]) -> StoredAnswer | None:
    """Return the stored advice in a row of `flights`; None in older rows and if it cannot be
    read."""
    stored = flight.get("answer")
    return None if stored is None else read_answer(stored)


def mark_old_text(text: str) -> str:
    """Return a stored text, marked as worded on the day when its log was taken in.

    Empty for an empty text.
    """
    return say("{words} (in the words of the day it was taken in)", words=text) if text else ""


def flight_action(flight: Mapping[str, Any], by_kind: Action | None = None) -> str:
    """Return what to do after a stored flight, from its row of the store.

    A row of an older version has a text, perhaps in another language; `by_kind`, the action for its
    verdict, is put before the text. It also replaces an action that cannot be read. Empty without
    any.
    """
    answer, kind = _stored(flight), by_kind.text if by_kind else ""
    if answer:
        return action(answer.advice) or kind
    return "; ".join(filter(None, (kind, mark_old_text(flight["action"] or ""))))


def flight_caveats(flight: Mapping[str, Any]) -> tuple[Caveat, ...]:
    """Return the caveats of a flight of the store with a verdict; empty for an older row."""
    answer = _stored(flight)
    known = answer is not None and answer.advice.level is not FlightLevel.UNKNOWN
    return answer.advice.caveats if answer is not None and known else ()


def flight_alarms(flight: Mapping[str, Any]) -> list[str]:
    """Return the words of each live alarm of rotors and motors in a flight of the store."""
    answer = _stored(flight)
    return (
        alarm_words(answer) if answer else [mark_old_text(text) for text in flight["alarms"] or ()]
    )


def flight_damage(flight: Mapping[str, Any]) -> str:
    """Return which rotors or motors were bad and by how much; an alarm would also say "land"."""
    answer = _stored(flight)
    return sentence(damage_words(answer.advice)) if answer else "; ".join(flight_alarms(flight))


def flight_reason(flight: Mapping[str, Any]) -> str:
    """Return why a flight of the store has no verdict; "not known why" where its row is silent."""
    answer = _stored(flight)
    if answer:
        return reason_words(answer)
    return mark_old_text(flight["verdict_reason"] or "") or say("not known why")


def flight_doing(flight: Mapping[str, Any]) -> str:
    """Return the aircraft's activities at the worst row, in words; empty where unknown."""
    answer = _stored(flight)
    return doing_words(answer.doing) if answer else mark_old_text(flight["worst_doing"] or "")


def _column(words: Callable[[StoredAnswer], Any]) -> Callable[[str], Any]:
    """Return a function of the stored JSON that returns `words` of it, and None if it cannot be
    read.
    """

    def made(stored: str) -> Any:
        answer = read_answer(stored)
        return None if answer is None else words(answer)

    return made


def _source_column(channel: str) -> Callable[[str], Any]:
    """Return a function from the stored JSON to the words of a channel's source."""
    return _column(lambda a: in_english(a.sources[channel]) if channel in a.sources else None)


#: Columns that SQL shows in the reader's language, or of which older rows hold something else ->
#: how they are made of the column `answer`.
SQL_WORDS: Mapping[str, Callable[[str], Any]] = {
    "action": _column(lambda a: action(a.advice) or None),
    "alarms": _column(alarm_words),
    "verdict_reason": _column(reason_words),
    # Earlier versions kept one rotor of each fault in `suspects` of a known aircraft.
    "fault_rotors": _column(lambda a: fault_rotors(a.advice)),
    "suspects": _column(lambda a: list(suspects(a.advice))),
    "worst_doing": _column(lambda a: doing_words(a.doing) or None),
    **{column: _source_column(channel) for channel, column in SOURCES.items()},
}
