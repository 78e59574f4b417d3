"""The tables of numbers that the print-out and the page of `identify` share."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from thrustmargin.gcs_plugin.reports.identify.identify_result import Result
from thrustmargin.gcs_plugin.wording.effect_sentences import effect_thing
from thrustmargin.gcs_plugin.wording.identify_answer import (
    chance,
    excluded_rows,
    set_words,
    where_from,
)
from thrustmargin.gcs_plugin.wording.numbers import joined, number, within
from thrustmargin.models.identification.result import Found, Identification
from thrustmargin.models.identification.unseen_errors import Errors

if TYPE_CHECKING:
    from rich.table import Table

MOST_FLIGHTS = 4  # of which values of one flight are listed
MOST_SETS = 5  # of effects that are listed


def effect_rows(found: Identification) -> list[tuple[str, str, str, str]]:
    """What was found, how sure, and below each its parameters with value and interval.

    A row of an effect has neither; one of a parameter has no probability.
    """
    rows = []
    for one in found.found:
        thing = effect_thing(one.term, found.model.airframe.rotor_names)
        rows.append((thing, "", "", chance(one.probability)))
        rows += [(*row, "") for row in _parameter_rows(found, one)]
    return rows


def _parameter_rows(found: Identification, one: Found) -> list[tuple[str, str, str]]:
    """Name, value with unit and interval; values of single flights where they are largest."""
    parameters = one.term.effect.parameters
    own = [k for k, p in enumerate(parameters) if p.per_flight]
    size = np.abs(one.value[:, own[0]]) if own else np.zeros(one.value.shape[0])
    largest = np.argsort(-size, kind="stable")[:MOST_FLIGHTS]
    rows = []
    for k, p in enumerate(parameters):
        name = p.name.replace("_", " ")
        unit = "" if p.unit == "1" else p.unit.replace("^2", "²")
        for f in largest if p.per_flight else [one.flight]:
            value, low, high = (float(v[f, k]) for v in (one.value, one.lower, one.upper))
            where = f", {found.problem.names[f]}" if p.per_flight else ""
            rows.append((name + where, *within(value, low, high, unit, most=6)))
    return rows


def set_rows(found: Identification) -> list[tuple[str, float]]:
    """Sets of effects that explain the flights, likeliest first, with their probabilities."""
    names = found.model.airframe.rotor_names
    return [(set_words(s.terms, names), s.probability) for s in found.alternatives[:MOST_SETS]]


def error_rows(result: Result) -> list[tuple[str, str, str, str]]:
    """Rotor, RMSE before and after with their intervals, and the mean after."""
    names = result.found.model.airframe.rotor_names
    return [
        (
            "all" if e.rotor is None else f"{e.rotor + 1} {names[e.rotor]}",
            _rmse(e.before),
            _rmse(e.after),
            number(e.after.bias_rpm, "", 1),
        )
        for e in result.errors
    ]


def _rmse(errors: Errors) -> str:
    return joined(within(errors.rmse_rpm, *errors.rmse_ci95_rpm, most=1))


def printed_tables(result: Result) -> list[Table]:
    """What the print-out shows below its sentences; all fit 80 columns."""
    found = result.found
    made = []
    if found.found:
        rows = [("  " * (not sure) + name, *row, sure) for name, *row, sure in effect_rows(found)]
        made.append(_table("", ("found", "value", "95 %", "sure"), rows))
    if len(found.alternatives) > 1:
        sets = [(words, chance(p)) for words, p in set_rows(found)]
        made.append(_table("", ("explanations", "probability"), sets))
    if found.excluded:
        made.append(_table("", ("not seen", "excluded at 95 %"), excluded_rows(found)))
    title = f"Measured minus predicted rotor speed, rpm, on {where_from(found)}"
    heads = ("rotor", "RMSE before", "RMSE after", "mean after")
    made.append(_table(title, heads, error_rows(result)))
    return made


def _table(title: str, heads: tuple[str, ...], rows: list) -> Table:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    made = Table(
        title=title or None,
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        show_edge=False,
        padding=(0, 2, 0, 0),
    )
    made.add_column(heads[0], overflow="fold")
    for head in heads[1:]:
        made.add_column(head, justify="right", no_wrap=True)
    for row in rows:
        made.add_row(Text(row[0]), *row[1:])
    return made
