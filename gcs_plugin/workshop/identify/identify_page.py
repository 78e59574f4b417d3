"""Draw an identification as one HTML page: the residual by mode, along channels, over time and on
the route.

No row was used to fit the values that predict it: fitted flights are cross-validated. Orange is
before, blue is after. Axes of one kind share a scale, so that panels can be compared.
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

#: Range of a channel over its median, below which no dependence on it can be seen.
LEAST_VARIATION = 0.02


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rows:
    """T rows of F flights with R rotors, from fitted and held-out flights.

    Channels are in the units of CHANNEL_WORDS. Channels that are not reported throughout, or hardly
    vary, are missing.
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

    def flight_rows(self, flight: int) -> NDArray[np.intp]:
        """Return the indices of the rows of one flight (0-based)."""
        return np.flatnonzero(self.flight == flight)

    def rmse_rpm(self, flight: int) -> tuple[float, float]:
        """Return the RMSE of one flight over all rotors, rpm, before and after adding the effects.

        `flight` counts from 0.
        """
        mine = self.flight_rows(flight)
        return _rms(self.before_rpm[mine]), _rms(self.after_rpm[mine])

    def flights_by_error(self) -> list[int]:
        """Return the flights (0-based) by their RMSE before, the largest first."""
        sizes = [self.rmse_rpm(f)[0] for f in range(len(self.names))]
        return sorted(range(len(self.names)), key=lambda f: -sizes[f])


def _rms(values: Floats) -> float:
    """Return the root mean square of all values."""
    return float(np.sqrt(np.mean(values**2)))


def residual_rows(unseen: Sequence[HeldOutResidual], tracks: Sequence[FlightTrack]) -> Rows:
    """Concatenate the residuals of fitted and held-out flights, with positions from their `tracks`.

    `tracks` are in the order of the flights in `unseen`. Channels that are not finite everywhere,
    or hardly vary, are left out.
    """
    first = unseen[0].problem
    offsets = np.cumsum([0, *(u.problem.flights for u in unseen)])
    before = np.concatenate([u.before_rpm for u in unseen])
    after = np.concatenate([u.after_rpm for u in unseen])
    places = [
        _row_positions(u.problem, tracks[offset : offset + u.problem.flights])
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


def _row_positions(problem: Problem, tracks: Sequence[FlightTrack]) -> tuple[Floats, Floats]:
    """Return north (N,) and east (N,), m, of a problem's N rows, looked up in the tracks by time.

    `tracks` are the problem's flights, in its order.
    """
    north, east = (np.full(problem.flight.size, np.nan) for _ in range(2))
    for f, track in enumerate(tracks):
        mine = np.flatnonzero(problem.flight == f)
        since = track.time_s - track.time_s[0]
        at = np.searchsorted(since, problem.channels.time_s[mine] - 1e-6)
        north[mine], east[mine] = track.position_ned[at, 0], track.position_ned[at, 1]
    return north, east


LONGEST_STEP_S = 1.0  # longest gap that a line crosses
BANDS = {"before": "rgba(213, 94, 0, 0.20)", "after": "rgba(0, 66, 157, 0.22)"}
BINS, FEWEST_IN_BIN = 24, 8
#: Share of the rows beyond each end of the bins.
TAIL = 0.002
MOST_CHANNELS, ACROSS = 4, 2  # panels of a mode, and side by side: two fit a phone
PANEL_PX, UNDER_PX = 180, 66  # of a panel, and of its axis below


def time_figure(rows: Rows, flight: int) -> style.Figure:
    """Draw each rotor's residual, rpm, over time in one flight, before and after adding the
    effects.

    `flight` is the index of the flight; a rotor has a panel of its own.
    """
    mine = rows.flight_rows(flight)
    time_s, before, after = _break_at_gaps(
        rows.time_s[mine], rows.before_rpm[mine], rows.after_rpm[mine]
    )
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


def _break_at_gaps(time_s: Floats, *tables: Floats) -> tuple[Floats, ...]:
    """Insert a row of NaN into each time gap longer than LONGEST_STEP_S, so that no line crosses
    it."""
    gaps = np.flatnonzero(np.diff(time_s) > LONGEST_STEP_S) + 1
    middle = (time_s[gaps - 1] + time_s[gaps]) / 2 if gaps.size else np.empty(0)
    return (np.insert(time_s, gaps, middle), *(np.insert(t, gaps, np.nan, axis=0) for t in tables))


def modes_figure(rows: Rows) -> style.Figure:
    """Draw bars of the RMS residual, rpm, of each rotor speed mode (collective, roll, pitch, yaw).

    Each mode has two bars: before and after adding the reported effects to the model.
    """
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
    """Draw the residual of each rotor speed mode over the channels that explain it best.

    Return a figure per mode, by the mode's index; modes without a channel are missing. A channel's
    panel has the medians of bins, with the middle 80 % as a band, before and after adding the
    effects.
    """
    drawn = {
        mode: [
            (channel, _bin_quantiles(rows, channel, mode))
            for channel in _strongest_channels(rows, mode)
        ]
        for mode in range(len(rows.mode_names))
    }
    every = [np.abs(y).max() for made in drawn.values() for _, binned in made for *_, y in binned]
    reach = float(max(every, default=1.0))
    return {mode: _panels(made, 1.06 * reach) for mode, made in drawn.items() if made}


def _panels(made: list[tuple[str, list[tuple[str, Floats, Floats]]]], reach: float) -> style.Figure:
    """Draw the panels of one mode, one for each channel in `made`.

    `made` lists (channel, bins as `_bin_quantiles` returns them). The residual axes reach from
    -reach to `reach`, rpm.
    """
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
        axis_title = {"title": first} if column == 0 else {"showticklabels": False}
        look = {"range": [-reach, reach], "zeroline": True, **({"matches": "y"} if k else {})}
        figure.layout[f"yaxis{axes}"] = {**place, **look, **axis_title, **small}
    return figure


def _bin_quantiles(rows: Rows, channel: str, mode: int) -> list[tuple[str, Floats, Floats]]:
    """Bin a mode's residual by a channel; return ("before" or "after", centres, quantiles) tuples.

    "before" and "after" are the residuals before and after adding the effects. Centres are (B,) in
    the channel's unit, quantiles (B, 3) the 10, 50 and 90 % ones, rpm. Bins with fewer than
    FEWEST_IN_BIN rows are left out, and a tuple without any bin.
    """
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
    """Divide a channel's values (N,) into BINS equal bins between its tails.

    Return the bin's index for each row, the lower end of the first bin, and the bins' width.
    """
    low, high = np.quantile(channel, [TAIL, 1.0 - TAIL])
    width = max(float(high - low), 1e-12) / BINS
    index = np.clip(((channel - low) / width).astype(np.intp), 0, BINS - 1)
    return index, float(low), width


def _strongest_channels(rows: Rows, mode: int) -> list[str]:
    """Return up to MOST_CHANNELS channel names, by the variance that their bin means explain.

    The variance is that of a mode's residual before adding the effects; the strongest channel is
    first.
    """
    about = rows.before_modes[:, mode] - rows.before_modes[:, mode].mean()

    def explained(channel: Floats) -> float:
        """Return the sum of squares that the bin means of a channel explain."""
        index, _, _ = _bins(channel)
        count = np.maximum(np.bincount(index, minlength=BINS), 1)
        return float(np.sum(np.bincount(index, about, minlength=BINS) ** 2 / count))

    return sorted(rows.channels, key=lambda name: -explained(rows.channels[name]))[:MOST_CHANNELS]


def map_limit(rows: Rows) -> float:
    """Return the residual, rpm, at the ends of the maps' colour scale; at least 1.

    It is the 98 % quantile of its absolute value before adding the effects.
    """
    worst = np.abs(rows.before_rpm).max(axis=1)
    return float(max(1.0, np.quantile(worst, 0.98)))


def map_figure(
    rows: Rows, flight: int, residual_rpm: Floats, limit_rpm: float
) -> style.Figure | None:
    """Draw the route of one flight from above, coloured by the residual of the worst rotor.

    `residual_rpm` (N, R) is of the rows of all flights, of which those of index `flight` are drawn.
    The colour scale is -limit_rpm to `limit_rpm`. None without positions.
    """
    mine = rows.flight_rows(flight)
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


def flight_figures(rows: Rows, chosen: Sequence[int]) -> dict[str, style.Figure]:
    """Return figures of the flights with the indices `chosen`, by name.

    Of flight 0 they are `time_0` (residual over time), `map_before_0` and `map_after_0` (routes,
    before and after adding the effects). Maps are missing where positions are.
    """
    limit = map_limit(rows)
    made: dict[str, style.Figure] = {}
    for f in chosen:
        made[f"time_{f}"] = time_figure(rows, f)
        for which, table in (("before", rows.before_rpm), ("after", rows.after_rpm)):
            drawn = map_figure(rows, f, table, limit)
            if drawn is not None:
                made[f"map_{which}_{f}"] = drawn
    return made


MOST_FLIGHTS = 6  # flights drawn over time and on the route


def html_text(result: results.Result) -> str:
    """Return the result's page as HTML; the browser draws each figure when it scrolls into view."""
    rows = residual_rows(result.unseen, result.tracks)
    shown = rows.flights_by_error()[:MOST_FLIGHTS]
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
        "error_rows_words": answers.error_rows_words,
    }
    return page_text(__name__.rpartition(".")[0], context)


def figures(rows: Rows, shown: list[int]) -> dict[str, style.Figure]:
    """Return all figures by name; those over time and on the route only for the flights `shown`."""
    channels = {f"channels_{m}": figure for m, figure in channels_figures(rows).items()}
    return {"modes": modes_figure(rows), **channels, **flight_figures(rows, shown)}
