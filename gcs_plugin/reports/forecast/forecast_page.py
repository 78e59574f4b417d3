"""A plan's forecast on one page, as HTML and on A4: answer, chart over time, stretches, assumed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from markupsafe import Markup

from thrustmargin.gcs_plugin.reports.shared import plot_style as style
from thrustmargin.gcs_plugin.reports.shared.page_shell import packed, page_text
from thrustmargin.gcs_plugin.wording.plans import forecast_words as words
from thrustmargin.gcs_plugin.wording.report_words import IN_USE
from thrustmargin.mission.ahead.plan_forecast import PlanForecast
from thrustmargin.mission.ahead.utilisation_along import LegForecast, worst_use

SHOWN = 8  # stretches on the page itself, that it stays one on paper
MOST = 500  # that are folded below it


def html_text(made: PlanForecast, name: str) -> str:
    """The page of the forecast of the plan called `name`; it asks nothing of any network."""
    return _page(made, name, {"use": packed(_chart(made).to_json())})


def pdf_bytes(made: PlanForecast, name: str) -> bytes:
    """The same on A4."""
    from thrustmargin.gcs_plugin.reports.paper import pdf_page

    figures = {"use": _chart(made)}
    return pdf_page.pdf_bytes(_page(made, name, dict.fromkeys(figures, Markup())), figures)


def _page(made: PlanForecast, name: str, figures: Mapping[str, Markup]) -> str:
    call, _, reason = words.verdict(made).partition(": ")
    context = {
        "name": name,
        "level": made.level.value,
        "call": call,
        "reason": reason,
        "first": (
            words.fill_words(made),
            words.weakest_words(made.weakest),
            words.survivable_words(made),
        ),
        "needs": [s.strip() for s in (*words.sortie_words(made), words.way_back_words(made))],
        "all_legs": made.legs,
        "shown": hardest(made.legs),
        "most": MOST,
        "kinds": words.STRETCHES,
        "assumed": words.assumed_words(made),
        "faults": words.plan_faults(made),
        "model": made.advised.analysis.model.description,
        "figures": figures,
    }
    return page_text(__name__.rpartition(".")[0], context)


def hardest(legs: Sequence[LegForecast]) -> Sequence[LegForecast]:
    """The stretches with the largest peaks, in the order of flight."""
    if len(legs) <= SHOWN:
        return legs
    peaks = np.nan_to_num([leg.utilisation_peak for leg in legs], nan=-1.0)
    kept = np.sort(np.argsort(-peaks, kind="stable")[:SHOWN])
    return [legs[k] for k in kept]


def _chart(made: PlanForecast) -> style.Figure:
    """Use of thrust over time above tank and battery."""
    track, limit = made.flight.track, made.advised.advice.limit
    time_s = track.time_s
    use, reach = (100.0 * part for part in worst_use(made.advised.analysis, slice(None)))
    traces = [
        style.above_limit(time_s, use, limit),
        style.band(time_s, use - reach, use + reach, color=style.BAND),
        style.line(time_s, use, color=style.PREDICTED, name="worst rotor"),
    ]
    high = max(float(np.nanmax(use + reach, initial=0.0)) * 1.08, 130.0 * limit)
    axis = style.titled(IN_USE, ticksuffix=" %", range=[0.0, high])
    tank = style.in_tank(time_s, track.tank_kg, track.spraying, "tank")
    full = {**style.titled("tank, kg"), "range": [0.0, 1.1 * float(track.tank_kg.max()) + 0.1]}
    panels = [
        style.Panel(traces=traces, axis=axis, height_px=180, limit=style.limit_across(limit)),
        style.Panel(traces=tank, axis=full, height_px=64),
    ]
    if np.isfinite(track.voltage).any():
        volts = style.line(time_s, track.voltage, color=style.INK, name="battery", width=2)
        panels.append(style.Panel(traces=[volts], axis=style.titled("V"), height_px=64))
    return style.over_time(panels, end_s=float(time_s[-1]))
