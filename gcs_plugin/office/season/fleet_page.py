"""Show a fleet's season as one page, as JSON, as CSV and as the lines of a table."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from thrustmargin.gcs_plugin.office.season import aircraft_season as seasons
from thrustmargin.gcs_plugin.office.season import fleet_words as words
from thrustmargin.gcs_plugin.office.season.stored_words import flight_doing, flight_reason
from thrustmargin.gcs_plugin.reports.shared.page_shell import (
    csv_text,
    json_text,
    page_text,
    software_version,
)
from thrustmargin.gcs_plugin.wording.language import known as finite
from thrustmargin.gcs_plugin.wording.language import number, say
from thrustmargin.gcs_plugin.wording.thrust_left import left_words
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.season.season_changes import Trend

COLOURS = {
    seasons.FIRST: "critical",
    seasons.LOAD: "over",
    seasons.ACT: "over",
    seasons.NONE: "unknown",
    seasons.CHECK: "unknown",
    seasons.WATCH: "unknown",
    seasons.FINE: "under",
}
MOST_LISTED = 20
WIDE, HIGH = 520.0, 96.0  # size of a small chart, in its own units
HEADS = ("aircraft", "look", "flights", "hours", "least thrust left", "to act on", "why", "do")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FleetSeason:
    """All aircraft of a store, the most urgent first."""

    store: str
    aircraft: tuple[seasons.AircraftSeason, ...]
    rejected: int  # number of logs of which no flight was made

    @property
    def flights(self) -> int:
        """Return the number of flights of all aircraft."""
        return sum(len(a.flights) for a in self.aircraft)

    @property
    def call(self) -> str:
        """Return the sentence at the head of the page: the first aircraft and its action."""
        first = self.aircraft[0] if self.aircraft else None
        if first is None:
            return say("no flights in the store")
        if not first.findings or first.level in (seasons.FINE, seasons.WATCH):
            return say("no aircraft has to be looked at")
        return f"{first.name}: {first.findings[0].action.split(';')[0]}"

    @property
    def level(self) -> str:
        """Return the level of the most urgent aircraft; WATCH without any."""
        return self.aircraft[0].level if self.aircraft else seasons.WATCH

    @property
    def drawn(self) -> list[seasons.AircraftSeason]:
        """Return the aircraft whose values the page draws.

        They are all of up to MOST_LISTED aircraft, else the first MOST_LISTED with findings.
        """
        few = len(self.aircraft) <= MOST_LISTED
        return [a for a in self.aircraft if few or a.findings][:MOST_LISTED]

    @property
    def days(self) -> str:
        """Return the first and the last day of flying; one day alone where they are equal."""
        known = [f["started_unix_s"] for a in self.aircraft for f in a.flights]
        known = [s for s in known if finite(s)]
        if not known:
            return say("no dates")
        first, last = words.day(min(known)), words.day(max(known))
        return first if first == last else f"{first} {say('to')} {last}"

    @property
    def reasons(self) -> list[tuple[str, int]]:
        """Return the reasons why flights have no verdict and their counts, the commonest first."""
        without = [f for a in self.aircraft for f in a.without_verdict]
        return Counter(flight_reason(f) for f in without).most_common()

    @property
    def above_limit(self) -> list[tuple[str, Any]]:
        """Return (aircraft's name, row of a flight) for flights graded OVER or graver.

        They are sorted by their smallest margin; flights without a known margin, such as those that
        lost control, come first. At most MOST_LISTED are returned.
        """
        found = [(a.name, f) for a in self.aircraft for f in a.above_limit]

        def margin(one: tuple[str, Any]) -> float:
            known = one[1]["worst_margin"]
            return known if finite(known) else -math.inf

        return sorted(found, key=margin)[:MOST_LISTED]


def rank_aircraft(
    store: str, aircraft: Sequence[seasons.AircraftSeason], rejected: int = 0
) -> FleetSeason:
    """Return the fleet with its aircraft in order of urgency.

    They are sorted by level, then by the weight of the first finding, then by name. `store` is the
    store's address to display, `rejected` the number of rejected logs.
    """

    def urgency(one: seasons.AircraftSeason) -> tuple[int, float, str]:
        weight = one.findings[0].weight if one.findings else 0.0
        return seasons.LEVELS.index(one.level), -weight, one.name

    order = tuple(sorted(aircraft, key=urgency))
    return FleetSeason(store=store, aircraft=order, rejected=rejected)


def cells(one: seasons.AircraftSeason) -> tuple[str, ...]:
    """Return the texts of an aircraft's row in the fleet's table, one for each of HEADS."""
    top = one.findings[0] if one.findings and one.level != seasons.FINE else None
    worst = one.worst
    return (
        one.name,
        say(one.level),
        str(len(one.flights)),
        number(one.hours, "", 1),
        left_words(worst["worst_margin"]) if worst else say("none measured"),
        str(len(one.above_limit)),
        top.sentence if top else one.no_changes or say(words.HEALTHY),
        top.action if top else "",
    )


def html_text(fleet: FleetSeason, *, alone: bool = False) -> str:
    """Return the page on the fleet as HTML.

    `alone`: the fleet is one aircraft, and the page has a table of all its flights.
    """
    context = {
        "fleet": fleet,
        "alone": alone,
        "drawn": fleet.aircraft if alone else fleet.drawn,
        "heads": HEADS,
        "colours": COLOURS,
        "cells": cells,
        "left": left_words,
        "day": words.day,
        "chart": chart,
        "title": lambda trend: words.value_words(trend.name).title,
        "now": present_value,
        "least_loss": words.least_loss,
        "second_recordings": words.second_recordings,
        "listed": drawn_trends,
        "finite": finite,
        "flight_doing": flight_doing,
    }
    return page_text("thrustmargin.gcs_plugin.office.season", context, draws=False)


def drawn_trends(one: seasons.AircraftSeason) -> list[Trend]:
    """Return the trends that the page draws: the rotors', then changed and usual values."""
    trends = one.changes.trends if one.changes else ()
    more = [t for t in trends if t not in one.rotors and (t.changes or t.name in words.TRENDS)]
    return [*one.rotors, *more]


def present_value(trend: Trend) -> str:
    """Return the curve's value at the last known flight, and that flight's 95 % half width."""
    known = np.flatnonzero(np.isfinite(trend.value) & np.isfinite(trend.error))
    if not known.size:
        return "unknown"
    spoken = words.value_words(trend.name)
    value, half = float(trend.curve[known[-1]]), 1.96 * float(trend.error[known[-1]])
    return f"{spoken.amount(value)} (last flight \N{PLUS-MINUS SIGN} {spoken.amount(half)})"


def chart(trend: Trend) -> Markup:
    """Return an SVG of a value over flights, with 95 % intervals, smooth curve and changes.

    Empty with fewer than two known values.
    """
    known = np.flatnonzero(np.isfinite(trend.value) & np.isfinite(trend.error))
    if known.size < 2:
        return Markup("")
    value, error = trend.value[known], 1.96 * trend.error[known]
    low = min(0.0, float(np.quantile(value - error, 0.02)))
    high = max(0.0, float(np.quantile(value + error, 0.98)))
    span = max(high - low, 1e-12)

    def x(k: float) -> str:
        return f"{4.0 + (WIDE - 8.0) * k / max(trend.value.size - 1, 1):.1f}"

    def y(values: Floats) -> list[str]:
        at = 4.0 + (HIGH - 8.0) * (1.0 - (np.clip(values, low, high) - low) / span)
        return [f"{v:.1f}" for v in at.tolist()]

    every = slice(None, None, max(1, known.size // 150))
    ends = [y(v[every]) for v in (value, value - error, value + error)]
    bars = "".join(
        f'<path d="M{at} {below}V{above}"/><circle cx="{at}" cy="{middle}" r="2"/>'
        for at, middle, below, above in zip(map(x, known[every].tolist()), *ends, strict=True)
    )
    line = " ".join(f"{x(k)},{at}" for k, at in enumerate(y(trend.curve)))
    marks = "".join(f'<path class="at" d="M{x(e.flight)} 0V{HIGH}"/>' for e in trend.changes)
    label = words.value_words(trend.name).title
    return Markup(
        '<svg viewBox="0 0 {w} {h}" role="img" aria-label="{label}">'
        '<path class="zero" d="M0 {zero}H{w}"/>{bars}{marks}<polyline points="{line}"/></svg>'
    ).format(
        w=WIDE, h=HIGH, label=label, zero=y(np.zeros(1))[0],
        bars=Markup(bars), marks=Markup(marks), line=line,
    )  # fmt: skip


def as_json(fleet: FleetSeason) -> str:
    """Return the seasons of all aircraft as JSON, schema thrustmargin.fleet/1.

    Unknown numbers are null.
    """
    made = {
        "schema": "thrustmargin.fleet/1",
        "store": fleet.store,
        "call": fleet.call,
        "flights": fleet.flights,
        "aircraft": [_json(a) for a in fleet.aircraft],
        "without_verdict": [{"reason": r, "flights": n} for r, n in fleet.reasons],
        "software": software_version(),
    }
    return json_text(made, digits=6)


def _json(one: seasons.AircraftSeason) -> dict[str, Any]:
    """Return one aircraft's season as a dict for JSON; NaN where unknown.

    It has counts (flights, flights above the limit or without a verdict), sums (hours, area,
    litres), `worst_margin` (None if unknown), `findings`, `trends` (also those of the parts'
    batteries) and `parts`; parts without a name are left out.
    """
    trends = [] if one.changes is None else list(one.changes.trends)
    return {
        "aircraft": one.name,
        "level": one.level,
        "flights": len(one.flights),
        "hours": one.hours,
        **_hectares(one.flights),
        "litres": seasons.known_sum(one.flights, "litres"),
        "worst_margin": one.worst["worst_margin"] if one.worst else None,
        "above_limit": len(one.above_limit),
        "without_verdict": len(one.without_verdict),
        "smallest_loss_seen": one.least_seen,
        "no_changes": one.no_changes or None,
        "findings": one.findings,
        "trends": [
            {
                "name": t.name,
                "now": t.now,
                "least_seen": t.least_seen,
                "changes": t.changes,
                "instead": list(t.instead),
                "value": t.value.tolist(),
                "error": t.error.tolist(),
            }
            for t in (*trends, *(p.battery for p in one.parts if p.battery))
        ],
        "parts": [
            {
                "part": p.name,
                "position": p.position,
                "aircraft": list(p.stays),
                "flights": p.flights,
                "hours": p.hours,
                "loss": p.loss,
                "loss_error": p.loss_error,
                "battery_ohm": p.battery.now if p.battery else None,
            }
            for p in one.parts
            if p.name
        ],
    }


def _hectares(flights: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return the area sprayed in all flights, ha, as `hectares` and `hectares_at_least`.

    If the area of each flight is wholly known, `hectares` has the sum and the other is NaN. Else
    `hectares_at_least` has the sum of what is known, and `hectares` is NaN.
    """
    whole = all(finite(f["hectares"]) or f["spraying_s"] == 0.0 for f in flights)
    known = sum(seasons.known_sum(flights, name) for name in ("hectares", "hectares_at_least"))
    nan = float("nan")
    return {"hectares": known if whole else nan, "hectares_at_least": nan if whole else known}


def as_csv(fleet: FleetSeason) -> str:
    """Return one row per aircraft as CSV; heads, levels and numbers are English in any language."""
    own = ((one, cells(one)) for one in fleet.aircraft)
    rows = [(*c[:1], one.level, c[2], f"{one.hours:.1f}", *c[4:]) for one, c in own]
    return csv_text(HEADS, rows)
