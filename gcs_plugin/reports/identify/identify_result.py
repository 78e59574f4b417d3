"""The result of `identify` as its print-out, its JSON and its page show it: made once."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from thrustmargin.gcs_plugin.reports.shared import UnusedLog
from thrustmargin.gcs_plugin.wording.identify_answer import answer
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.margin_change import MarginChange, margin_changes
from thrustmargin.models.identification.model_update import ModelUpdate, update_model
from thrustmargin.models.identification.next_flight import NextFlight, following_flight
from thrustmargin.models.identification.result import Identification, unseen_residuals
from thrustmargin.models.identification.unseen_errors import (
    RotorErrors,
    Unseen,
    rotor_errors,
)
from thrustmargin.models.model.json_values import to_json_values


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Result:
    """An identification and everything that its print-out, JSON and page show of it."""

    found: Identification
    update: ModelUpdate
    tracks: tuple[FlightTrack, ...]  # the fitted flights, then the held-out ones
    not_used: tuple[UnusedLog, ...]
    unseen: tuple[Unseen, ...]  # the last one is that of the errors
    errors: tuple[RotorErrors, ...]  # all rotors, then each
    margins: tuple[MarginChange, ...]  # of each effect
    margin: MarginChange  # of all effects, worst rotor
    following: NextFlight | None
    answer: tuple[str, ...]
    model_in: str
    model_out: str
    mission: str  # file that the next flight is written to; empty for none
    date: str


def result_of(
    found: Identification,
    *,
    tracks: Sequence[FlightTrack],
    not_used: Sequence[UnusedLog] = (),
    model_in: str = "",
    model_out: str = "",
    mission: str = "",
    date: str = "",
) -> Result:
    """Everything that is shown of an identification; `tracks` are the flights it was given."""
    unseen = unseen_residuals(found)
    margins, margin = margin_changes(found)
    following = following_flight(found, tracks)
    mission = "" if following is None else mission
    return Result(
        found=found,
        update=update_model(found.model, found, date=date),
        tracks=tuple(tracks),
        not_used=tuple(not_used),
        unseen=unseen,
        errors=rotor_errors(unseen[-1]),
        margins=margins,
        margin=margin,
        following=following,
        answer=answer(found, margin, following, mission),
        model_in=model_in,
        model_out=model_out,
        mission=mission,
        date=date,
    )


def json_text(result: Result) -> str:
    """The schema "thrustmargin.identify/1"; after its own keys the margin, the answer in words.

    `margin` is the predicted thrust margin before and after, of all effects and of each in order.
    """
    whole: dict[str, Any] = result.found.to_json(
        model_in=result.model_in, model_out=result.model_out
    )
    whole["next_flight"] = None if result.following is None else _next_flight(result)
    whole["margin"] = {
        "all": _numbered(result.margin),
        "effects": [_numbered(m) for m in result.margins],
    }
    whole["answer"] = list(result.answer)
    whole["notes"] = list(result.update.notes)
    whole["not_used"] = [{"log": n.name, "reason": n.reason} for n in result.not_used]
    whole["date"] = result.date
    return json.dumps(whole, ensure_ascii=False, allow_nan=False, indent=1) + "\n"


def _next_flight(result: Result) -> dict[str, Any]:
    """Sets of effects by their names, the manoeuvre, and the mission's file if there is one."""
    following = result.following
    assert following is not None
    return to_json_values(
        {
            "separates": [[term.words for term in terms] for terms in following.separates],
            "manoeuvre": following.manoeuvre.words,
            "repeats": following.repeats,
            "minutes": following.minutes,
            "certainty": following.certainty,
            "mission": result.mission or None,
        }
    )


def _numbered(change: MarginChange) -> dict[str, Any]:
    """With the rotor counted from 1, as everywhere outside arrays."""
    return to_json_values(change) | {"rotor": None if change.rotor is None else change.rotor + 1}
