"""An identification as one HTML page that asks nothing of any network."""

from __future__ import annotations

from thrustmargin.gcs_plugin.reports.identify.identify_result import (
    Result,
    effect_rows,
    error_rows,
    set_rows,
)
from thrustmargin.gcs_plugin.reports.identify.residual_figures import (
    Rows,
    channels_figures,
    modes_figure,
    per_flight,
    rows_of,
)
from thrustmargin.gcs_plugin.reports.shared.page_shell import packed, page_text
from thrustmargin.gcs_plugin.reports.shared.plotly_figure import Figure
from thrustmargin.gcs_plugin.wording.loop.effect_sentences import effect_thing
from thrustmargin.gcs_plugin.wording.loop.identify_answer import (
    excluded_rows,
    margin_words,
    where_from,
)

MOST_FLIGHTS = 6  # that are drawn over time and on the route


def html_text(result: Result) -> str:
    """The page; figures are drawn when they come into view."""
    rows = rows_of(result.unseen, result.tracks)
    shown = rows.worst_first()[:MOST_FLIGHTS]
    made = {n: packed(f.to_json()) for n, f in figures(rows, shown).items()}
    context = {
        "result": result,
        "found": result.found,
        "rotor_names": result.found.model.airframe.rotor_names,
        "rows": rows,
        "shown": shown,
        "figures": made,
        "effect_rows": effect_rows,
        "error_rows": error_rows,
        "set_rows": set_rows,
        "effect_thing": effect_thing,
        "excluded_rows": excluded_rows,
        "margin_words": margin_words,
        "where_from": where_from,
    }
    return page_text(__name__.rpartition(".")[0], context)


def figures(rows: Rows, shown: list[int]) -> dict[str, Figure]:
    """Name -> figure; over time and on the route those of the flights `shown`."""
    channels = {f"channels_{m}": figure for m, figure in channels_figures(rows).items()}
    return {"modes": modes_figure(rows), **channels, **per_flight(rows, shown)}
