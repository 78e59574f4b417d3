"""An identification as one HTML page, and its figures: the residual by mode, along channels, over
time and on the route.

Every row is one that its values were not found on: fitted flights are cross-validated.
Orange is before, blue is after. Axes of one meaning have one scale: all modes along their channels,
all flights over time, all maps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.reports.shared import plot_style as style
from thrustmargin.gcs_plugin.reports.shared.page_shell import packed, page_text
from thrustmargin.gcs_plugin.reports.shared.route_map import route_map
from thrustmargin.gcs_plugin.wording.effect_sentences import effect_thing
from thrustmargin.gcs_plugin.wording.language import CHANNEL_WORDS, channel_title
from thrustmargin.gcs_plugin.wording.palette import residual_scale
from thrustmargin.gcs_plugin.workshop.identify import identify_result as results
from thrustmargin.gcs_plugin.workshop.identify import identify_words as answers
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.identification.answer.held_out_errors import HeldOutResidual
from thrustmargin.models.identification.rows.problem import Problem

LEAST_VARIATION = 0.02  # of its median, below which nothing can be seen to go with a channel


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rows:
    """T rows of F flights and R rotors.

    Channels are in the units of CHANNEL_WORDS; those not reported throughout or that hardly vary
    are left out.
    """

    names: tuple[str, ...]  # (F,)
    roles: tuple[str, ...]  # (F,) "fit" or "held_out"
    flight: NDArray[np.intp]  # (T,)
    time_s: Floats  # (T,) since the start of the log
    north: Floats  # (T,) m, NaN unknown
    east: Floats  # (T,)
    before_rpm: Floats  # (T, R)
    after_rpm: Floats  # (T, R)
    before_modes: Floats  # (T, R) rpm
    after_modes: Floats  # (T, R)
    mode_names: tuple[str, ...]
    rotor_names: tuple[str, ...]
    channels: Mapping[str, Floats]

    def of(self, flight: int) -> NDArray[np.intp]:
        return np.flatnonzero(self.flight == flight)

    def rmse_rpm(self, flight: int) -> tuple[float, float]:
        """Before and after, of one flight."""
        mine = self.of(flight)
        return _rms(self.before_rpm[mine]), _rms(self.after_rpm[mine])

    def worst_first(self) -> list[int]:
        """Flights by their error before, the largest first."""
        sizes = [self.rmse_rpm(f)[0] for f in range(len(self.names))]
        return sorted(range(len(self.names)), key=lambda f: -sizes[f])


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def rows_of(unseen: Sequence[HeldOutResidual], tracks: Sequence[FlightTrack]) -> Rows:
    """Put the residuals of fitted and held-out flights under each other, with their places."""
    first = unseen[0].problem
    offsets = np.cumsum([0, *(u.problem.flights for u in unseen)])
    before = np.concatenate([u.before_rpm for u in unseen])
    after = np.concatenate([u.after_rpm for u in unseen])
    places = [
        _places(u.problem, tracks[offset : offset + u.problem.flights])
        for u, offset in zip(unseen, offsets[:-1], strict=True)
    ]
    directions = first.modes.directions
    channels = {}
    for name, (_, _, factor) in CHANNEL_WORDS.items():
        values = np.concatenate([np.asarray(getattr(u.problem.channels, name)) for u in unseen])
        if not np.isfinite(values).all():
            continue
        low, middle, high = np.quantile(values, [0.01, 0.5, 0.99])
        if high - low > max(LEAST_VARIATION * abs(middle), 1e-9):
            channels[name] = values * factor
    return Rows(
        names=tuple(n for u in unseen for n in u.problem.names),
        roles=tuple(u.role for u in unseen for _ in u.problem.names),
        flight=np.concatenate(
            [u.problem.flight + k for u, k in zip(unseen, offsets[:-1], strict=True)]
        ),
        time_s=np.concatenate([u.problem.channels.time_s for u in unseen]),
        north=np.concatenate([p[0] for p in places]),
        east=np.concatenate([p[1] for p in places]),
        before_rpm=before,
        after_rpm=after,
        before_modes=before @ directions,
        after_modes=after @ directions,
        mode_names=first.modes.names,
        rotor_names=first.model.airframe.rotor_names,
        channels=channels,
    )


def _places(problem: Problem, tracks: Sequence[FlightTrack]) -> tuple[Floats, Floats]:
    """North and east of a problem's rows, found again in the tracks by their time."""
    north, east = (np.full(problem.flight.size, np.nan) for _ in range(2))
    for f, track in enumerate(tracks):
        mine = np.flatnonzero(problem.flight == f)
        since = track.time_s - track.time_s[0]
        at = np.searchsorted(since, problem.channels.time_s[mine] - 1e-6)
        north[mine], east[mine] = track.position_ned[at, 0], track.position_ned[at, 1]
    return north, east


LONGEST_STEP_S = 1.0  # beyond which a line is broken
BANDS = {"before": "rgba(213, 94, 0, 0.20)", "after": "rgba(0, 66, 157, 0.22)"}
BINS, FEWEST_IN_BIN = 24, 8
#: Part of the rows, at each end of a channel, that the bins leave out.
TAIL = 0.002
MOST_CHANNELS, ACROSS = 4, 2  # panels of a mode, and in a line of them: two fit a phone
PANEL_PX, UNDER_PX = 180, 66  # of a panel, and of its axis below


def time_figure(rows: Rows, flight: int) -> style.Figure:
    """Residual of each rotor of one flight over time, before and after."""
    mine = rows.of(flight)
    time_s, before, after = _broken(rows.time_s[mine], rows.before_rpm[mine], rows.after_rpm[mine])
    reach = float(np.nanmax(np.abs(rows.before_rpm))) * 1.08
    panels = style.rotor_panels(
        rows.rotor_names,
        lambda k, legend: [
            style.line(time_s, table[:, k], color=color, name=name, width=1.5, legend=legend)
            for name, color, table in (
                ("before", style.BEFORE, before),
                ("after", style.AFTER, after),
            )
        ],
        axis=style.titled("rpm", range=[-reach, reach]),
    )
    return style.over_time(panels, end_s=float(time_s[-1]))


def _broken(time_s: Floats, *tables: Floats) -> tuple[Floats, ...]:
    """With a row of NaN in each pause, so that no line is drawn across it."""
    gaps = np.flatnonzero(np.diff(time_s) > LONGEST_STEP_S) + 1
    middle = (time_s[gaps - 1] + time_s[gaps]) / 2 if gaps.size else np.empty(0)
    return (np.insert(time_s, gaps, middle), *(np.insert(t, gaps, np.nan, axis=0) for t in tables))


def modes_figure(rows: Rows) -> style.Figure:
    """RMS of each mode before and after."""
    margin = {"l": 80, "r": 20, "t": 40, "b": 40}
    y = style.titled("RMS, rpm", rangemode="tozero")
    made = style.Figure({"template": style.STYLE, "height": 340, "margin": margin, "yaxis": y})
    for which, table, colour in (
        ("before", rows.before_modes, style.BEFORE),
        ("after", rows.after_modes, style.AFTER),
    ):
        bars = {
            "type": "bar",
            "name": which,
            "x": rows.mode_names,
            "y": np.sqrt(np.mean(table**2, axis=0)).tolist(),
            "marker": {"color": colour},
            "texttemplate": "%{y:.0f}",
            "textposition": "outside",
            "cliponaxis": False,
            "hovertemplate": "%{x}: %{y:.1f} rpm<extra>" + which + "</extra>",
        }
        made.add([bars])
    return made


def channels_figures(rows: Rows) -> dict[int, style.Figure]:
    """Each mode against the channels that it went with most: medians of bins, middle 80 % as a
    band."""
    drawn = {
        mode: [(channel, _binned(rows, channel, mode)) for channel in _strongest(rows, mode)]
        for mode in range(len(rows.mode_names))
    }
    every = [np.abs(y).max() for made in drawn.values() for _, binned in made for *_, y in binned]
    reach = float(max(every, default=1.0))
    return {mode: _panels(made, 1.06 * reach) for mode, made in drawn.items() if made}


def _panels(made: list[tuple[str, list[tuple[str, Floats, Floats]]]], reach: float) -> style.Figure:
    lines = -(-len(made) // ACROSS)
    height = lines * (PANEL_PX + UNDER_PX) - UNDER_PX
    margin = {"l": 70, "r": 10, "t": 40, "b": UNDER_PX}
    whole = height + margin["t"] + margin["b"]
    figure = style.Figure({"template": style.STYLE, "height": whole, "margin": margin})
    small, wide = {"tickfont": {"size": 13}}, (1.0 - 0.04 * (ACROSS - 1)) / ACROSS
    for k, (channel, binned) in enumerate(made):
        row, column = divmod(k, ACROSS)
        axes = "" if k == 0 else str(k + 1)
        for which, x, y in binned:
            median = style.scatter(
                style.single(x),
                style.single(y[:, 1]),
                mode="lines+markers",
                line={"color": style.BEFORE if which == "before" else style.AFTER, "width": 2.5},
                marker={"size": 5},
                name=which,
                legendgroup=which,
                showlegend=k == 0,
                hovertemplate="%{x:.3g}: %{y:.1f} rpm<extra>" + which + "</extra>",
            )
            band = style.filled(x, y[:, 0], y[:, 2], color=BANDS[which], legendgroup=which)
            figure.add([band, median], axes)
        left, top = column * (wide + 0.04), 1.0 - row * (PANEL_PX + UNDER_PX) / height
        title = {"text": escape(channel_title(channel)), "font": {"size": 14}, "standoff": 4}
        place = {"anchor": f"y{axes}", "domain": [left, left + wide]}
        look = {"title": title, "nticks": 5, "tickangle": 0}
        figure.layout[f"xaxis{axes}"] = {**place, **look, **small}
        place = {"anchor": f"x{axes}", "domain": [max(top - PANEL_PX / height, 0.0), top]}
        first = {"text": "rpm", "font": {"size": 14}}
        beside = {"title": first} if column == 0 else {"showticklabels": False}
        look = {"range": [-reach, reach], "zeroline": True, **({"matches": "y"} if k else {})}
        figure.layout[f"yaxis{axes}"] = {**place, **look, **beside, **small}
    return figure


def _binned(rows: Rows, channel: str, mode: int) -> list[tuple[str, Floats, Floats]]:
    """(which, centres (B,), lower, median and upper (B, 3)) of a mode in bins of a channel."""
    values = rows.channels[channel]
    index, low, width = _bins(values)
    inside = (values >= low) & (values <= low + BINS * width)
    made = []
    for which, table in (("before", rows.before_modes), ("after", rows.after_modes)):
        groups = [table[inside & (index == b), mode] for b in range(BINS)]
        full = [b for b, own in enumerate(groups) if own.size >= FEWEST_IN_BIN]
        if full:
            ends = np.array([np.quantile(groups[b], [0.1, 0.5, 0.9]) for b in full])
            made.append((which, low + (np.array(full) + 0.5) * width, ends))
    return made


def _bins(channel: Floats) -> tuple[NDArray[np.intp], float, float]:
    """Bin of each row in BINS of equal width but for the TAIL, their low end and their width."""
    low, high = np.quantile(channel, [TAIL, 1.0 - TAIL])
    width = max(float(high - low), 1e-12) / BINS
    index = np.clip(((channel - low) / width).astype(np.intp), 0, BINS - 1)
    return index, float(low), width


def _strongest(rows: Rows, mode: int) -> list[str]:
    """The channels with the most of a mode's square about its mean before, by means of bins."""
    about = rows.before_modes[:, mode] - rows.before_modes[:, mode].mean()

    def explained(channel: Floats) -> float:
        index, _, _ = _bins(channel)
        count = np.maximum(np.bincount(index, minlength=BINS), 1)
        return float(np.sum(np.bincount(index, about, minlength=BINS) ** 2 / count))

    return sorted(rows.channels, key=lambda name: -explained(rows.channels[name]))[:MOST_CHANNELS]


def map_limit(rows: Rows) -> float:
    """rpm at which the colours of the maps end: all but 2 % of the rows before are within."""
    worst = np.abs(rows.before_rpm).max(axis=1)
    return float(max(1.0, np.quantile(worst, 0.98)))


def map_figure(
    rows: Rows, flight: int, residual_rpm: Floats, limit_rpm: float
) -> style.Figure | None:
    """The route of a flight from above, coloured by the residual of the rotor that is furthest off.

    None when the log has no positions.
    """
    mine = rows.of(flight)
    north, east, time_s = rows.north[mine], rows.east[mine], rows.time_s[mine]
    if not np.any(np.isfinite(north) & np.isfinite(east)):
        return None
    own = residual_rpm[mine]
    worst = own[np.arange(own.shape[0]), np.argmax(np.abs(own), axis=1)]
    return route_map(
        (north, east),
        time_s,
        {"residual": (worst, np.abs(worst))},
        residual_scale(limit_rpm),
        form="+.0f",
        height=480,
        margin={"l": 70, "r": 50, "t": 80, "b": 60},
    )


def per_flight(rows: Rows, chosen: Sequence[int]) -> dict[str, style.Figure]:
    """Name -> figure over time and maps before and after, of the chosen flights."""
    limit = map_limit(rows)
    made: dict[str, style.Figure] = {}
    for f in chosen:
        made[f"time_{f}"] = time_figure(rows, f)
        for which, table in (("before", rows.before_rpm), ("after", rows.after_rpm)):
            drawn = map_figure(rows, f, table, limit)
            if drawn is not None:
                made[f"map_{which}_{f}"] = drawn
    return made


MOST_FLIGHTS = 6  # that are drawn over time and on the route


def html_text(result: results.Result) -> str:
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
        "effect_rows": results.effect_rows,
        "error_rows": results.error_rows,
        "set_rows": results.set_rows,
        "effect_thing": effect_thing,
        "excluded_rows": answers.excluded_rows,
        "margin_words": answers.margin_words,
        "where_from": answers.where_from,
    }
    return page_text(__name__.rpartition(".")[0], context)


def figures(rows: Rows, shown: list[int]) -> dict[str, style.Figure]:
    """Name -> figure; over time and on the route those of the flights `shown`."""
    channels = {f"channels_{m}": figure for m, figure in channels_figures(rows).items()}
    return {"modes": modes_figure(rows), **channels, **per_flight(rows, shown)}
