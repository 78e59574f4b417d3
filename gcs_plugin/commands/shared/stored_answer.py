"""Keep the answer of a flight as data, of which words are made when somebody reads them.

A season is taken in by one person and read by another, perhaps in another language and by a later
version. So the store keeps the `Advice` and the facts that the report shows with it as JSON, and no
words.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from functools import lru_cache
from typing import Any, get_type_hints

import numpy as np

from thrustmargin.gcs_plugin.wording.advice_words import action_steps, suspects
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.json_values import from_json_values, to_json_values
from thrustmargin.models.model.advice import LEAST_FLIGHT_S, Advice, FlightLevel
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.analysis import ThrustUse
from thrustmargin.models.model.model_misfit import Caveat
from thrustmargin.models.model.utilisation_peaks import Activity, activities
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
    """The kind of reason for which a flight has no verdict."""

    NOT_KNOWN = "aircraft_not_known"
    CONTRADICTED = "airframe_contradicted"
    MISFIT = "model_contradicted"
    ALONE = "predicted_alone"
    TOO_SHORT = "too_short"
    NO_SPEED = "no_rotor_speed"
    NO_TANK = "no_tank_level"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StoredAnswer:
    """The advice of one stored flight with the data its sentences are made from, but no
    sentences."""

    advice: Advice  # of whose arrays only `any` is known
    reasons: tuple[NoVerdict, ...]  # empty where there is a verdict
    contradicted: tuple[str, ...]  # names of the comparisons that contradict the airframe
    doing: tuple[Activity, ...]  # at the worst moment
    sources: Mapping[str, Provenance]  # of the channels in SOURCES


def no_verdict_reasons(
    advice: Advice, airframe_match: AirframeMatch, track: FlightTrack
) -> tuple[NoVerdict, ...]:
    """Return the kinds of reasons why a flight has no verdict; empty if it has one.

    There is one, the first of: the airframe is contradicted or not known, too short, contradicted
    model, prediction alone; else the missing ones of rotor speed and tank level.
    """
    if advice.level is not FlightLevel.UNKNOWN:
        return ()
    if airframe_match.no_verdict:
        return (NoVerdict.CONTRADICTED if airframe_match.contradicted else NoVerdict.NOT_KNOWN,)
    if track.flying_s < LEAST_FLIGHT_S:
        return (NoVerdict.TOO_SHORT,)
    if Caveat.MODEL in advice.caveats:
        return (NoVerdict.MISFIT,)
    if advice.predicted_alone:
        return (NoVerdict.ALONE,)
    lacks = (("rotor_speed_rpm", NoVerdict.NO_SPEED), ("tank_kg", NoVerdict.NO_TANK))
    return tuple(kind for name, kind in lacks if not np.isfinite(getattr(track, name)).any())


def stored_answer(
    advice: Advice, airframe_match: AirframeMatch, track: FlightTrack, worst_time_s: float | None
) -> StoredAnswer:
    """Return a flight's assessment in the form in which it is stored.

    It has the reasons for no verdict, what the aircraft was doing at the worst peak, and sources of
    channels. `worst_time_s` is the time of that peak, s from the first row of `track`; None without
    one.
    """
    row = None if worst_time_s is None else int(np.argmin(np.abs(track.time_s - worst_time_s)))
    return StoredAnswer(
        advice=advice,
        reasons=no_verdict_reasons(advice, airframe_match, track),
        contradicted=airframe_match.contradicted,
        doing=() if row is None else activities(track, row),
        sources={
            name: replace(track.source(name), rejected=())
            for name in SOURCES
            if name in track.sources
        },
    )


def fault_rotors(advice: Advice) -> list[int]:
    """Return the rotor (1-based) of each fault, in their order."""
    return [one.fault.rotor + 1 for one in advice.faults]


def answer_columns(answer: StoredAnswer) -> dict[str, Any]:
    """Return the values for the columns of `schema.FLIGHTS` that contain the assessment, by name.

    `answer` is all of it as JSON; the other columns are lists of kinds and rotors, for queries.
    """
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
        "fault_rotors": fault_rotors(advice),
        "suspects": list(suspects(advice)),
        "reason_kinds": list(map(str, answer.reasons)),
        "doing_kinds": [one.kind for one in answer.doing],
    }


@lru_cache(maxsize=4096)
def read_answer(stored: str) -> StoredAnswer | None:
    """Return the stored assessment from its JSON.

    None if it cannot be read, as that of a version with other fields.
    """
    try:
        data = json.loads(stored)
        data["advice"] = _advice(data["advice"])
        kinds = get_type_hints(StoredAnswer)
        read = {n: from_json_values(kinds[n], one, n) for n, one in data.items() if n != "advice"}
        return StoredAnswer(advice=data["advice"], **read)
    except (ValueError, KeyError, TypeError, RecursionError):
        return None


def _advice(data: dict[str, Any]) -> Advice:
    """Return the Advice of its JSON values; `data` is changed. Arrays over the flight are empty.

    Raises ValueError, KeyError or TypeError for values of another version.
    """
    kinds, of_use = get_type_hints(Advice), get_type_hints(ThrustUse)
    use: dict[str, Any] = {
        name: np.array([value]) if name in _FLAGS else from_json_values(of_use[name], value, name)
        for name, value in data.pop("use").items()
    }
    use |= {name: np.empty(0) for name in _ROWS}
    return Advice(
        use=ThrustUse(**use), **{n: from_json_values(kinds[n], one, n) for n, one in data.items()}
    )
