"""The route from above, coloured with the view's own scales."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

import numpy as np
import shapely

from thrustmargin.gcs_plugin.reports.shared import plot_style as style
from thrustmargin.gcs_plugin.wording.language import from_direction
from thrustmargin.gcs_plugin.wording.palette import ColourScale, css
from thrustmargin.mission.field import Field
from thrustmargin.models.flight import Floats

MAP_POINTS = 900
LEAST_WIND = 0.5  # m/s, below which its direction says nothing
_OUTLINE: dict[str, Any] = {
    "line": {"color": css((60, 120, 50)), "width": 2},
    "hoverinfo": "skip",
    "showlegend": True,
}


def route_map(
    place: tuple[Floats, Floats],
    time_s: Floats,
    coloured: Mapping[str, tuple[Floats, Floats]],
    scale: ColourScale,
    *,
    form: str,
    height: int,
    margin: Mapping[str, int],
) -> style.Figure:
    """Draw the route through `place`, (north (T,), east (T,)), m, with points coloured by values.

    `coloured` maps a name to (values, badness), both (T,). Each stretch of the route has a point at
    its row of largest badness. The first entry is visible; with several, each has a button. `scale`
    gives colours, `form` the number format of the hover text; `height` and `margin` are in pixels.
    """
    north, east = place
    placed = np.isfinite(north) & np.isfinite(east)
    axes = {"xaxis": style.titled("east, m"), "yaxis": style.titled("north, m", scaleanchor="x")}
    made = style.Figure({"template": style.STYLE, "height": height, "margin": dict(margin), **axes})
    flown = np.flatnonzero(placed)
    flown = flown[:: max(1, flown.size // MAP_POINTS)]
    way = {"line": {"color": style.GRID, "width": 2}, "hoverinfo": "skip", "showlegend": False}
    made.add([style.scatter(style.single(east[flown]), style.single(north[flown]), **way)])
    number = "%{marker.color:" + form + "}" + scale.unit
    for k, (values, badness) in enumerate(coloured.values()):
        kept = style.keep_worst(np.where(placed, badness, np.nan), MAP_POINTS)
        # Worst last, so that a later pass over the same place does not hide it.
        kept = kept[np.argsort(badness[kept], kind="stable")]
        marks = style.scatter(
            style.single(east[kept]),
            style.single(north[kept]),
            mode="markers",
            marker=_marker(values[kept], scale),
            customdata=style.milliseconds(time_s[kept]),
            hovertemplate="%{customdata|%M:%S}  " + number + "<extra></extra>",
            showlegend=False,
            visible=k == 0,
        )
        made.add([marks])
    if len(coloured) > 1:
        made.layout["updatemenus"] = [_buttons(list(coloured))]
    return made


def add_surroundings(
    made: style.Figure,
    place: tuple[Floats, Floats],
    field: Field | None,
    *,
    wind_speed: float,
    wind_from_deg: float,
) -> None:
    """Add the outline of `field`, the take-off, a scale bar, the wind and a legend to the map
    `made`.

    `place` is the route, (north (T,), east (T,)), m, with at least one finite point. The wind, m/s
    and the degrees it comes from, is left out if NaN. No background is fetched from a network.
    """
    placed = np.flatnonzero(np.isfinite(place[0]) & np.isfinite(place[1]))
    north, east = place[0][placed], place[1][placed]
    parts = () if field is None else field.ground.geoms
    rings = [shapely.get_coordinates(part.exterior) for part in parts]
    if rings:
        # One trace of all parts: a row of NaN between two breaks the line.
        outline = np.concatenate([np.append(ring, [[np.nan] * 2], axis=0) for ring in rings])
        outer = style.single(outline[:, 1]), style.single(outline[:, 0])
        made.add([style.scatter(*outer, name="sprayed field", **_OUTLINE)])
    mark = {"size": 15, "symbol": "square-x-open", "color": style.INK, "line": {"width": 3}}
    shown = {"hoverinfo": "skip", "showlegend": True}
    home = [float(east[0])], [float(north[0])]
    made.add([style.scatter(*home, mode="markers", marker=mark, name="take-off", **shown)])
    span = max(float(np.ptp(north)), float(np.ptp(east)), 5.0)
    bar = max(s for p in (1, 10, 100, 1000) for s in (p, 2 * p, 5 * p) if s <= max(0.4 * span, 1))
    left, low = float(east.min()), float(north.min()) - 0.12 * span
    line = {"color": style.INK, "width": 5}
    made.add([style.scatter([left, left + bar], [low, low], line=line, name=f"{bar} m", **shown)])
    if np.isfinite(wind_speed) and np.isfinite(wind_from_deg):
        to = np.radians(wind_from_deg + 180.0)
        text = f"<b>wind {wind_speed:.1f} m/s</b><br>{from_direction(wind_from_deg)}"
        paper = {"xref": "paper", "yref": "paper"}
        made.note(text, x=1, y=1, xanchor="right", yanchor="top", **paper)
        if wind_speed >= LEAST_WIND:
            tail = {"ax": -46 * float(np.sin(to)), "ay": 46 * float(np.cos(to))}
            arrow = {"showarrow": True, "arrowhead": 2, "arrowwidth": 4, "arrowcolor": style.INK}
            made.note("", x=0.88, y=0.72, **paper, **tail, **arrow)
    made.layout["legend"] = {"y": 0.0, "yanchor": "bottom", "x": 0.0}


def _buttons(names: list[str]) -> dict[str, Any]:
    """Return plotly's buttons, one per name, each showing one of the traces after the first.

    The first trace, the route's line, is always visible.
    """
    return {
        "type": "buttons",
        "direction": "right",
        "x": 0.0,
        "xanchor": "left",
        "y": -0.16,
        "yanchor": "top",
        "font": {"size": 16},
        "buttons": [
            {
                "label": name,
                "method": "restyle",
                "args": [{"visible": [True, *(other == name for other in names)]}],
            }
            for name in names
        ],
    }


def plotly_scale(scale: ColourScale) -> list[list[float | str]]:
    """Return the scale as plotly's pairs of 0..1 and colour; a jump is two pairs at one place."""
    span = scale.high - scale.low
    return [[(value - scale.low) / span, css(colour)] for value, colour in scale.stops]


def _marker(values: Floats, scale: ColourScale) -> dict[str, Any]:
    return {
        "size": 9,
        "color": style.single(values * scale.factor),
        "cmin": scale.low * scale.factor,
        "cmax": scale.high * scale.factor,
        "colorscale": plotly_scale(scale),
        "colorbar": {
            "orientation": "h",
            "thickness": 16,
            "y": 1.0,
            "yanchor": "bottom",
            "tickvals": [value * scale.factor for value, _ in scale.labels],
            "ticktext": [escape(text) for _, text in scale.labels],
            "tickfont": {"size": 15},
        },
    }
