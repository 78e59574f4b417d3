"""What the page of `identify` says in its tables, as text and numbers."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import zip_longest

import numpy as np

from thrustmargin.gcs_plugin.reports.identify.identify_result import Result
from thrustmargin.gcs_plugin.reports.identify.identify_sentences import (
    apart,
    found_name,
    margin_words,
    unexplained,
    where_from,
)
from thrustmargin.gcs_plugin.reports.identify.identify_tables import parameter_rows, with_ends
from thrustmargin.gcs_plugin.reports.identify.residual_rows import Rows, rows_of
from thrustmargin.gcs_plugin.reports.shared import UnusedLog
from thrustmargin.gcs_plugin.wording.numbers import number, percent
from thrustmargin.models.identification.result import Tried

MOST_FLIGHTS = 6  # that are drawn over time and on the route
MOST_TRIED = 6  # candidates of a look that are listed


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectRow:
    """An effect that was found."""

    name: str
    parameters: tuple[tuple[str, str, str], ...]  # name, value with unit, interval
    p_value: str
    rmse: str
    margin: str
    source: str
    tell: str  # empty when nothing else would do as well


@dataclass(frozen=True, slots=True, kw_only=True)
class TriedRow:
    """A candidate of one look."""

    name: str
    share: str  # of the held-out cost
    bar: float  # 0..100
    taken: bool
    p_value: str


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightRow:
    """A flight that was used."""

    name: str
    role: str
    rows: int
    seconds: float
    before: str
    after: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Content:
    """Everything on the page but the figures."""

    headline: str
    answer: tuple[str, ...]
    before: str
    after: str
    margin: str
    model: str
    model_in: str
    model_out: str
    notes: tuple[str, ...]
    effects: tuple[EffectRow, ...]
    looks: tuple[tuple[TriedRow, ...], ...]
    surrogates: int
    errors: tuple[
        tuple[str, ...], ...
    ]  # rotor, before, after, bias before, after, R² before, after
    errors_from: str
    floor: str
    noise: str
    unexplained: str
    flights: tuple[FlightRow, ...]
    not_used: tuple[UnusedLog, ...]
    rows: Rows
    shown_flights: tuple[int, ...]
    date: str


def content_of(result: Result) -> Content:
    """The page's content from a result."""
    found, rows = result.found, rows_of(result.unseen, result.tracks)
    names = found.model.airframe.rotor_names
    effects = tuple(
        EffectRow(
            name=found_name(f),
            parameters=tuple(parameter_rows(found, f, most=found.problem.flights)),
            p_value="" if m is None else f"{f.p_value:.2g}",
            rmse=f"{number(f.rmse_before_rpm, '', 1)} → {number(f.rmse_after_rpm, '', 1)}",
            margin="in the model already" if m is None else margin_words(m, names),
            source=f.term.effect.source,
            tell=apart(f) if f.indistinguishable_from else "",
        )
        for f, m in zip_longest(found.told, result.margins)
    )
    return Content(
        headline=_headline(result),
        answer=result.answer,
        before=number(found.before.rmse_rpm, "", 0),
        after=number(found.after.rmse_rpm, "", 0),
        margin=margin_words(result.margin, names),
        model=found.model.description,
        model_in=result.model_in,
        model_out=result.model_out,
        notes=result.closed.notes,
        effects=effects,
        looks=_looks(found.tried),
        surrogates=found.config.surrogates,
        errors=tuple(
            (
                "all" if e.rotor is None else f"{e.rotor + 1} {names[e.rotor]}",
                with_ends(e.before.rmse_rpm, e.before.rmse_ci95_rpm),
                with_ends(e.after.rmse_rpm, e.after.rmse_ci95_rpm),
                number(e.before.bias_rpm, "", 1),
                number(e.after.bias_rpm, "", 1),
                number(e.before.r2, "", 3),
                number(e.after.r2, "", 3),
            )
            for e in result.errors
        ),
        errors_from=where_from(found),
        floor=number(found.floor_rpm, "rpm", 1),
        noise=number(found.sensor_noise_rpm, "rpm", 1),
        unexplained=unexplained(found),
        flights=_flights(rows),
        not_used=result.not_used,
        rows=rows,
        shown_flights=tuple(rows.worst_first()[:MOST_FLIGHTS]),
        date=result.date,
    )


def _headline(result: Result) -> str:
    found = result.found
    if found.found:
        listed = [found_name(f) for f in found.found]
        missing = "; ".join(listed).upper()
        return f"MISSING: {missing}"
    left = found.unexplained()
    followed = "".join(f"{found_name(f).upper()}; " for f in found.followed)
    if left["mode"] is None:
        return f"{followed}NOTHING IS MISSING"
    share = percent(left["fraction_of_variance"], 1)
    return f"{followed}NO EFFECT OF THE TABLE; {share} UNEXPLAINED"


def _looks(tried: tuple[Tried, ...]) -> tuple[tuple[TriedRow, ...], ...]:
    looks = []
    for look in sorted({t.look for t in tried}):
        mine = [t for t in tried if t.look == look]
        top = max([t.share for t in mine if np.isfinite(t.share)], default=0.0)
        looks.append(tuple(_tried(t, top) for t in mine[:MOST_TRIED]))
    return tuple(looks)


def _tried(one: Tried, top: float) -> TriedRow:
    from thrustmargin.gcs_plugin.reports.identify.identify_sentences import effect_name

    term = one.term
    return TriedRow(
        name=effect_name(term.effect.name, term.rotor, term.effect.variant),
        share=percent(one.share, 1),
        bar=100.0 * max(0.0, one.share) / top if top > 0.0 else 0.0,
        taken=one.taken,
        p_value=f"{one.p_value:.2g}" if np.isfinite(one.p_value) else "",
    )


def _flights(rows: Rows) -> tuple[FlightRow, ...]:
    made = []
    for f, (name, role) in enumerate(zip(rows.names, rows.roles, strict=True)):
        mine = rows.of(f)
        before, after = rows.rmse_rpm(f)
        made.append(
            FlightRow(
                name=name,
                role="learnt from" if role == "fit" else "held out",
                rows=mine.size,
                seconds=float(rows.time_s[mine[-1]] - rows.time_s[mine[0]]),
                before=number(before, "", 1),
                after=number(after, "", 1),
            )
        )
    return tuple(made)
