"""The result of `identify`, computed once for console, JSON and page, with its JSON and its
tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from thrustmargin.gcs_plugin.reports.shared import UnusedLog, page_shell
from thrustmargin.gcs_plugin.wording.alarm_words import place_words
from thrustmargin.gcs_plugin.wording.arm_words import arm_sentences
from thrustmargin.gcs_plugin.wording.effect_sentences import effect_thing
from thrustmargin.gcs_plugin.wording.language import chance, number, say, shown_unit, within
from thrustmargin.gcs_plugin.workshop.identify import identify_words as answers
from thrustmargin.gcs_plugin.workshop.identify.asked_words import requested_actions
from thrustmargin.gcs_plugin.workshop.identify.identify_words import answer
from thrustmargin.models.checks.arms.arm_json import answer_json
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.answer import held_out_errors
from thrustmargin.models.identification.answer.model_update import (
    MarginChange,
    ModelUpdate,
    margin_changes,
    update_model,
)
from thrustmargin.models.identification.answer.result import (
    Identification,
    ReportedEffect,
    weak_rotors,
)
from thrustmargin.models.identification.next_flight.next_flight import NextFlight, plan_next_flight
from thrustmargin.models.json_values import to_json_values

if TYPE_CHECKING:
    from rich.table import Table


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Result:
    """An identification with the new model, margins, sentences and the command's options."""

    found: Identification
    update: ModelUpdate
    tracks: Sequence[FlightTrack]  # the fitted flights, then the held-out ones
    not_used: tuple[UnusedLog, ...]
    unseen: tuple[held_out_errors.HeldOutResidual, ...]  # the errors are of the last one
    errors: tuple[held_out_errors.RotorErrors, ...]  # all rotors, then each
    margins: tuple[MarginChange, ...]  # of each effect
    margin: MarginChange  # of all effects, worst rotor
    following: NextFlight | None
    answer: tuple[str, ...]
    model_in: str
    model_out: str
    mission: str  # file that the next flight is written to; empty for none
    date: str


def make_result(
    found: Identification,
    *,
    tracks: Sequence[FlightTrack],
    not_used: Sequence[UnusedLog] = (),
    model_in: str = "",
    model_out: str = "",
    mission: str = "",
    date: str = "",
) -> Result:
    """Return the result of an identification: new model, margins, next flight and sentences.

    `tracks` are the fitted flights, then the held-out ones. `model_in`, `model_out` and `mission`
    are file names to be named in the result; `mission` is dropped if there is no next flight.
    """
    unseen = found.unseen
    margins, margin = margin_changes(found)
    following = plan_next_flight(found, tracks)
    mission = "" if following is None else mission
    return Result(
        found=found,
        update=update_model(found.model, found, date=date),
        tracks=tracks,
        not_used=tuple(not_used),
        unseen=unseen,
        errors=held_out_errors.rotor_errors(unseen[-1]),
        margins=margins,
        margin=margin,
        following=following,
        answer=answer_sentences(found, answer(found, margin, following, mission)),
        model_in=model_in,
        model_out=model_out,
        mission=mission,
        date=date,
    )


def json_text(result: Result) -> str:
    """Return the result as JSON, schema "thrustmargin.identify/1".

    The keys of `Identification.to_json` are followed by `next_flight`, `margin`, `arms`, `answer`,
    `actions`, `notes`, `not_used` and `date`. `margin` is the predicted thrust margin before and
    after adding all effects, and each effect alone.
    """
    whole: dict[str, Any] = result.found.to_json(
        model_in=result.model_in, model_out=result.model_out
    )
    whole["next_flight"] = None if result.following is None else _next_flight_json(result)
    whole["margin"] = {
        "all": _margin_json(result.margin),
        "effects": [_margin_json(m) for m in result.margins],
    }
    whole["arms"] = answer_json(result.found.arms)
    whole["answer"] = list(result.answer)
    whole["actions"] = requested_actions(result.found)
    whole["notes"] = list(result.update.notes)
    whole["not_used"] = [{"log": n.name, "reason": n.reason} for n in result.not_used]
    whole["date"] = result.date
    return page_shell.json_text(whole)


def _next_flight_json(result: Result) -> dict[str, Any]:
    """Return the next flight as a dict for JSON: manoeuvre, repeats, duration in minutes, mission
    file.

    `separates` are the two sets of effects that it distinguishes, `certainty` the probability that
    it does. The result must have a next flight.
    """
    following = result.following
    assert following is not None
    return {
        "separates": [[term.words for term in terms] for terms in following.separates],
        "manoeuvre": answers.manoeuvre_words(following.manoeuvre),
        "repeats": following.repeats,
        "minutes": following.minutes,
        "certainty": following.certainty,
        "mission": result.mission or None,
    }


def _margin_json(change: MarginChange) -> dict[str, Any]:
    """Return a change of margin as JSON, its rotor counted from 1; None for the worst rotor."""
    return to_json_values(change) | {"rotor": None if change.rotor is None else change.rotor + 1}


MOST_FLIGHTS = 4  # flights listed for a parameter that differs by flight
MOST_SETS = 5  # sets of effects listed


def effect_rows(found: Identification) -> list[tuple[str, str, str, str]]:
    """Return table rows (name, value, 95 % interval, probability) of all reported effects.

    An effect has a row with name and probability alone, then one for each parameter without a
    probability. Amounts of one unit are all displayed in the same, possibly smaller, unit.
    """
    rows = []
    largest: dict[str, float] = {}
    for one in found.found:
        for k, p in enumerate(one.term.effect.parameters):
            factor, unit = shown_unit(p.unit, p.name)
            ends = np.abs(factor * np.stack([v[:, k] for v in (one.value, one.lower, one.upper)]))
            most = float(np.nanmax(ends, initial=0.0))
            largest[unit] = max(largest.get(unit, 0.0), most)
    for one in found.found:
        thing = effect_thing(one.term, found.model.airframe.rotor_names, found.gaining)
        rows.append((thing, "", "", chance(one.probability)))
        rows += [(*row, "") for row in _parameter_rows(found, one, largest)]
    return rows


def answer_sentences(found: Identification, of_effects: Sequence[str]) -> tuple[str, ...]:
    """Return the sentences of an answer: of the effects, and of each arm's own figures.

    An arm with something wrong, or a shaken aircraft, comes first. Where a rotor is reported as
    weak, its sentence, which forbids the next flight, stands before that of its arm.
    """
    if found.arms is None:
        return tuple(of_effects)
    weak, shaken = weak_rotors(found.found), found.arms.shaken
    of_weak = tuple(one for one in found.arms.findings if one.arm in weak)
    others = tuple(one for one in found.arms.findings if one.arm not in weak)
    return (
        *arm_sentences(replace(found.arms, findings=others, shaken=None if weak else shaken)),
        *of_effects,
        *arm_sentences(
            replace(found.arms, findings=of_weak, shaken=shaken if weak else None), weak
        ),
    )


def _parameter_rows(
    found: Identification, one: ReportedEffect, largest: Mapping[str, float]
) -> list[tuple[str, str, str]]:
    """Return (name, value with unit, interval) as texts for each parameter of one effect.

    A parameter with a value for each flight has a row for each of the MOST_FLIGHTS flights with the
    largest effect. `largest` is the table's largest amount in each unit, by which a smaller unit is
    chosen.
    """
    parameters = one.term.effect.parameters
    own = [k for k, p in enumerate(parameters) if p.per_flight]
    size = np.abs(one.value[:, own[0]]) if own else np.zeros(one.value.shape[0])
    flights = np.argsort(-size, kind="stable")[:MOST_FLIGHTS]
    rows = []
    for k, p in enumerate(parameters):
        name = say(p.name.replace("_", " "))
        factor, unit = shown_unit(p.unit, p.name)
        for f in flights if p.per_flight else [one.flight]:
            value, low, high = (float(v[f, k]) for v in (one.value, one.lower, one.upper))
            where = f", {found.problem.names[f]}" if p.per_flight else ""
            shown = within(
                value, low, high, unit, factor=factor, most=6, table_largest=largest.get(unit, 0.0)
            )
            rows.append((name + where, *shown))
    return rows


def set_rows(found: Identification) -> list[tuple[str, float]]:
    """Return the MOST_SETS most probable sets of effects, in words, with their probabilities."""
    names = found.model.airframe.rotor_names
    return [
        (answers.set_words(s.terms, names, found.gaining), s.probability)
        for s in found.alternatives[:MOST_SETS]
    ]


def error_rows(result: Result) -> list[tuple[str, str, str, str]]:
    """Return table rows (rotor, RMSE before, RMSE after, mean residual after) as texts, rpm.

    RMSE have intervals. The first row is for all rotors together.
    """
    names = result.found.model.airframe.rotor_names
    return [
        (
            say("all") if e.rotor is None else f"{e.rotor + 1} {place_words(names[e.rotor])}",
            answers.rmse_words(e.before, ""),
            answers.rmse_words(e.after, ""),
            number(e.after.bias_rpm, "", 1),
        )
        for e in result.errors
    ]


def printed_tables(result: Result) -> list[Table]:
    """Return the tables that the console prints below the sentences; each fits 80 columns.

    They are reported effects, explanations, excluded effects and errors; without content a table is
    left out.
    """
    found = result.found
    flights = found.problem.flights
    by = say("by {count} flights" if flights > 1 else "by {count} flight", count=flights)
    made = []
    if found.found:
        rows = [("  " * (not sure) + name, *row, sure) for name, *row, sure in effect_rows(found)]
        made.append(
            page_shell.grid((say("found"), say("value"), "95 %", f"{say('sure')} {by}"), rows)
        )
    if len(found.alternatives) > 1:
        sets = [(words, chance(p)) for words, p in set_rows(found)]
        made.append(page_shell.grid((say("explanations"), f"{say('probability')} {by}"), sets))
    if found.excluded:
        heads = map(say, ("not seen", "excluded at 95 %"))
        made.append(page_shell.grid(tuple(heads), answers.excluded_rows(found)))
    words = "Measured minus predicted rotor speed, rpm, on {flights}"
    title = say(words, flights=answers.error_rows_words(found))
    heads = map(say, ("rotor", "RMSE before", "RMSE after", "mean after"))
    made.append(page_shell.grid(tuple(heads), error_rows(result), title=title))
    return made
