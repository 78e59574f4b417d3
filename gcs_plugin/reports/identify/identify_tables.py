"""The tables that `identify` prints below its answer in words; they fit 80 columns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from thrustmargin.gcs_plugin.reports.identify.identify_sentences import found_name, where_from
from thrustmargin.gcs_plugin.wording.numbers import number
from thrustmargin.models.identification.result import Found, Identification
from thrustmargin.models.identification.unseen_errors import RotorErrors

if TYPE_CHECKING:
    from rich.table import Table

MOST_FLIGHTS = 4  # of which values of one flight are listed
LARGE = 30.0  # from which a decimal says nothing


def effects_table(found: Identification) -> Table:
    """Effects in the order accepted, with a line for each parameter below the name."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    trials = found.config.surrogates
    table = Table(
        title="Effects found, in the order accepted",
        caption=f"p: how often chance gives as much, with the whole search repeated on {trials} "
        f"surrogates; the least possible is {1 / (trials + 1):.2g}. RMSE: of {_left_out(found)}",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        show_edge=False,
        padding=(0, 1, 0, 0),
    )
    table.add_column("effect", overflow="fold")
    for name in ("value", "95 %", "p", "RMSE rpm"):
        table.add_column(name, justify="right", no_wrap=True)
    for one in found.reported:
        table.add_row(
            Text(found_name(one), style="bold"),
            "",
            "",
            "" if one in found.followed else f"{one.p_value:.2g}",
            _from_to(one.rmse_before_rpm, one.rmse_after_rpm),
        )
        for name, value, interval in parameter_rows(found, one):
            table.add_row(Text(f"  {name}"), value, interval, "", "")
    return table


def parameter_rows(
    found: Identification, one: Found, most: int = MOST_FLIGHTS
) -> list[tuple[str, str, str]]:
    """(name, value with unit, interval) of each parameter.

    Where flights have their own values, of the `most` flights in which they are largest.
    """
    parameters = one.term.effect.parameters
    own = [k for k, p in enumerate(parameters) if p.per_flight]
    size = np.abs(one.value[:, own[0]]) if own else np.zeros(one.value.shape[0])
    largest = np.argsort(-size, kind="stable")[:most]
    rows = []
    for k, p in enumerate(parameters):
        for f in largest if p.per_flight else [one.flight]:
            name = f"{p.name}, {found.problem.names[f]}" if p.per_flight else p.name
            value, low, high = (float(v[f, k]) for v in (one.value, one.lower, one.upper))
            unit = "" if p.unit == "1" else p.unit.replace("^2", "²")
            decimals = _decimals(low, high)
            ends = f"{number(low, '', decimals)} to {number(high, '', decimals)}"
            rows.append((name, number(value, unit, decimals), ends))
    return rows


def _decimals(low: float, high: float) -> int:
    """Decimals that show an interval with two digits that count, at most 8."""
    half = (high - low) / 2
    return min(8, max(0, 1 - math.floor(math.log10(half)))) if half > 0.0 else 3


def _left_out(found: Identification) -> str:
    return "flights left out in turn" if found.problem.flights > 1 else "fifths of the one flight"


def errors_table(found: Identification, errors: Sequence[RotorErrors]) -> Table:
    """Errors before and after of all rotors together and of each, with intervals."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(
        title="Measured minus predicted rotor speed, before and after, rpm",
        caption=f"On {where_from(found)}. Intervals: 95 %, from blocks of time within flights",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        show_edge=False,
        padding=(0, 1, 0, 0),
    )
    table.add_column("rotor", no_wrap=True)
    for name in ("RMSE before", "RMSE after", "bias", "R² after"):
        table.add_column(name, justify="right", no_wrap=True)
    names = found.model.airframe.rotor_names
    for one in errors:
        who = "all" if one.rotor is None else f"{one.rotor + 1} {names[one.rotor]}"
        table.add_row(
            Text(who),
            with_ends(one.before.rmse_rpm, one.before.rmse_ci95_rpm),
            with_ends(one.after.rmse_rpm, one.after.rmse_ci95_rpm),
            _from_to(one.before.bias_rpm, one.after.bias_rpm),
            number(one.after.r2, "", 3),
        )
    return table


def with_ends(value: float, ends: tuple[float, float]) -> str:
    """`12.3 (11.0 to 13.6)`; large ones without decimals."""
    decimals = 0 if abs(value) >= LARGE else 1
    low, high = (number(end, "", decimals) for end in ends)
    return f"{number(value, '', decimals)} ({low} to {high})"


def _from_to(before: float, after: float) -> str:
    def short(value: float) -> str:
        return number(value, "", 0 if abs(value) >= LARGE else 1)

    return f"{short(before)} -> {short(after)}"
