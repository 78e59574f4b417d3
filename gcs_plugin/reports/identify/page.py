"""An identification as one HTML page that asks nothing of any network."""

from __future__ import annotations

from itertools import zip_longest

import numpy as np
from plotly.graph_objects import Figure

from thrustmargin.gcs_plugin.reports.identify import identify_sentences as sentences
from thrustmargin.gcs_plugin.reports.identify.channel_figures import channels_figure, shares_figure
from thrustmargin.gcs_plugin.reports.identify.identify_result import Result
from thrustmargin.gcs_plugin.reports.identify.identify_tables import parameter_rows, with_ends
from thrustmargin.gcs_plugin.reports.identify.residual_figures import (
    curve_figure,
    modes_figure,
    per_flight,
)
from thrustmargin.gcs_plugin.reports.identify.residual_rows import Rows, rows_of
from thrustmargin.gcs_plugin.reports.shared.page_shell import (
    page_text,
    script_safe,
    software_version,
)
from thrustmargin.gcs_plugin.wording.numbers import number, percent
from thrustmargin.models.identification.result import Tried

MOST_FLIGHTS = 6  # that are drawn over time and on the route
MOST_TRIED = 6  # candidates of a look that are listed
#: What the template may call.
_WORDS = {
    function.__name__: function
    for function in (
        number,
        percent,
        with_ends,
        parameter_rows,
        sentences.found_name,
        sentences.term_name,
        sentences.how_to_distinguish,
        sentences.margin_words,
        sentences.unexplained,
        sentences.where_from,
    )
}


def html_text(result: Result) -> str:
    """The page; figures are drawn when they come into view."""
    rows = rows_of(result.unseen, result.tracks)
    shown = rows.worst_first()[:MOST_FLIGHTS]
    made = {n: script_safe(f.to_json()) for n, f in figures(result, rows, shown).items()}
    context = {
        "result": result,
        "found": result.found,
        "rotor_names": result.found.model.airframe.rotor_names,
        "headline": headline(result),
        "effects": list(zip_longest(result.found.reported, result.margins)),
        "looks": looks(result.found.tried),
        "rows": rows,
        "shown": shown,
        "figures": made,
        "version": software_version(),
    }
    package = __name__.rpartition(".")[0]
    return page_text(package, context, functions=_WORDS, own_style=True)


def figures(result: Result, rows: Rows, shown: list[int]) -> dict[str, Figure]:
    """Name -> plotly figure; over time and on the route those of the flights `shown`."""
    curve = result.found.curve
    made = {
        "modes": modes_figure(rows),
        "shares": shares_figure(rows),
        **{f"channels_{m}": channels_figure(rows, m) for m in range(len(rows.mode_names))},
        **per_flight(rows, shown),
    }
    if curve is not None:
        made["curve"] = curve_figure(curve, rows.mode_names[curve.mode])
    return made


def headline(result: Result) -> str:
    """What is missing, in capitals."""
    found = result.found
    if found.found:
        return f"MISSING: {'; '.join(sentences.found_name(f) for f in found.found).upper()}"
    left = found.unexplained()
    followed = "".join(f"{sentences.found_name(f).upper()}; " for f in found.followed)
    if left["mode"] is None:
        return f"{followed}NOTHING IS MISSING"
    share = percent(left["fraction_of_variance"], 1)
    return f"{followed}NO EFFECT OF THE TABLE; {share} UNEXPLAINED"


def looks(tried: tuple[Tried, ...]) -> list[list[tuple[Tried, float]]]:
    """The candidates of each look, best first, with their share of the best one's gain, 0..1."""
    listed = []
    for look in sorted({t.look for t in tried}):
        own = [t for t in tried if t.look == look]
        top = max([t.share for t in own if np.isfinite(t.share)], default=0.0)
        listed.append(
            [(t, max(0.0, t.share) / top if top > 0.0 else 0.0) for t in own[:MOST_TRIED]]
        )
    return listed
