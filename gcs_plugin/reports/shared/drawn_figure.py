"""A report's plotly figure drawn by matplotlib, for paper: no browser, the same data and colours.

Only what plot_style and route_map make is known: panels of lines and areas over time, and maps of
coloured marks. A pixel of the page is PIXEL of paper.
"""

from __future__ import annotations

import io
import re
from typing import Any

import numpy as np
from plotly.graph_objects import Figure

WIDTH_PX, PIXEL = 1000.0, 1 / 140.0  # inch a pixel: type of 16 pixels is 8 pt
RESOLUTION = 170  # dots an inch
_DASHES = {"dash": "--", "dot": ":", "dashdot": "-."}
_MARKS = {"square-x-open": "s", "circle-open": "o"}


def png(made: Figure) -> tuple[bytes, float, float]:
    """The figure as PNG, and its width and height in mm."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure as Canvas

    layout: Any = made.layout  # plotly makes its properties at run time
    margin = layout.margin
    height_px = float(layout.height or 450)
    on_map = bool(layout.yaxis.scaleanchor)
    width_px = 0.5 * WIDTH_PX if on_map else WIDTH_PX  # two maps stand beside each other
    paper = Canvas((width_px * PIXEL, height_px * PIXEL), dpi=RESOLUTION)
    FigureCanvasAgg(paper)
    left, bottom = (margin.l or 60) / width_px, (margin.b or 50) / height_px
    wide = 1.0 - left - (margin.r or 40) / width_px
    high = 1.0 - bottom - (margin.t or 60) / height_px
    axes = {}
    panels = [name for name in ("yaxis", *(f"yaxis{k}" for k in range(2, 40))) if name in layout]
    for name in panels:
        axis, across = layout[name], layout["x" + name[1:]]
        low, top = axis.domain or (0.0, 1.0)
        ax = paper.add_axes((left, bottom + low * high, wide, (top - low) * high))
        axes["y" + name.removeprefix("yaxis")] = ax
        _style(ax, axis, across, bare=name != panels[-1] and len(panels) > 1)
    shown: dict[str, Any] = {}
    traces: Any = made.data
    for trace in traces:
        if trace.visible is not False:
            handle = _trace(axes[trace.yaxis or "y"], trace, paper)
            if trace.showlegend is not False and trace.name and handle is not None:
                shown.setdefault(trace.name, handle)
    for shape in layout.shapes:
        axes[shape.yref.split()[0]].axhline(shape.y0, color=shape.line.color, linewidth=1.5)
    area = (left, bottom, wide, high)
    for note in layout.annotations:
        _annotate(axes, note, area, width_px, height_px)
    for name in panels:
        ax, axis = axes["y" + name.removeprefix("yaxis")], layout[name]
        if axis.scaleanchor:
            ax.set_aspect("equal", adjustable="datalim")
        if axis.range is not None:
            ax.set_ylim(*axis.range)
    if shown:
        place = "lower left" if on_map else "upper left"
        columns = 2 if on_map or max(map(len, shown)) > 30 else 4
        key = {"loc": place, "bbox_to_anchor": (left, bottom if on_map else 1.0)}
        look = {"ncols": columns, "fontsize": 7.5, "frameon": on_map, "framealpha": 0.8}
        paper.legend(shown.values(), shown.keys(), **key, **look)
    buffer = io.BytesIO()
    paper.savefig(buffer, format="png")
    return buffer.getvalue(), width_px * PIXEL * 25.4, height_px * PIXEL * 25.4


def _style(ax: Any, axis: Any, across: Any, *, bare: bool) -> None:
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    ax.grid(color="#d0d0d0", linewidth=0.6)
    ax.set_axisbelow(True)
    ax.tick_params(labelsize=7.5, labelbottom=not bare)
    ax.spines[["top", "right"]].set_visible(False)
    ax.margins(x=0.01)
    ax.set_ylabel(_plain(axis.title.text or ""), fontsize=8)
    ax.set_xlabel("" if bare else _plain(across.title.text or ""), fontsize=8)
    suffix = axis.ticksuffix or ""
    ax.yaxis.set_major_locator(MaxNLocator(max(2, int(axis.nticks or 6) - 1)))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}{suffix}"))
    if across.type == "date":
        ax.xaxis.set_major_locator(MaxNLocator(9, steps=[1.2, 1.8, 3, 6, 10]))
        ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: _clock(value)))


def _trace(ax: Any, trace: Any, paper: Any) -> Any:
    x, y = (np.asarray(values, dtype=float) for values in (trace.x, trace.y))
    if trace.fill == "toself":
        return ax.fill(x, y, color=_colour(trace.fillcolor), linewidth=0)[0]
    mode = trace.mode or "lines"
    if "markers" not in mode:
        line = trace.line
        style, width = _DASHES.get(line.dash, "-"), 0.5 * (line.width or 2.0)
        return ax.plot(x, y, style, color=_colour(line.color), linewidth=width)[0]
    marker = trace.marker
    if marker.colorscale is None or np.ndim(marker.color) == 0:
        form, colour = _MARKS.get(marker.symbol, "o"), _colour(marker.color or "#000")
        hollow = "none" if str(marker.symbol).endswith("open") else colour
        size = 0.5 * (np.max(marker.size) if marker.size is not None else 6)
        return ax.plot(x, y, form, color=colour, markersize=size, markerfacecolor=hollow)[0]
    from matplotlib.colors import LinearSegmentedColormap, Normalize

    stops = [(place, _colour(colour)) for place, colour in marker.colorscale]
    scale = LinearSegmentedColormap.from_list("scale", stops, N=1024)
    drawn = ax.scatter(
        x, y, c=np.asarray(marker.color, dtype=float), s=14, cmap=scale,
        norm=Normalize(marker.cmin, marker.cmax), linewidths=0, zorder=3,
    )  # fmt: skip
    place = ax.get_position()
    bar = paper.add_axes((place.x0, place.y1 + 0.012, 0.95 * place.width, 0.02))
    key = paper.colorbar(drawn, cax=bar, orientation="horizontal")
    key.set_ticks(list(marker.colorbar.tickvals), labels=[*map(_plain, marker.colorbar.ticktext)])
    bar.tick_params(labelsize=7.5, top=True, labeltop=True, bottom=False, labelbottom=False)
    return None


def _annotate(axes: Any, note: Any, area: Any, width_px: float, height_px: float) -> None:
    left, bottom, wide, high = area
    xref, yref = str(note.xref or "paper"), str(note.yref or "paper")
    x, y = note.x, note.y
    if yref.split()[0] in axes and yref != "paper":
        ax = axes[yref.split()[0]]
        whole = ax.get_xaxis_transform() if "domain" in yref else ax.transData
        across = ax.get_yaxis_transform() if "domain" in xref else whole
        place = {"xy": (x, y), "xycoords": across}
    else:
        place = {
            "xy": (left + x * wide, bottom + y * high),
            "xycoords": "figure fraction",
        }
        ax = next(iter(axes.values()))
    if note.showarrow:
        tail = place["xy"][0] + note.ax / width_px, place["xy"][1] - note.ay / height_px
        arrow = {"arrowstyle": "-|>", "linewidth": 2.2, "color": "black", "shrinkB": 0}
        ax.annotate(
            "", **place, xytext=tail, textcoords=place["xycoords"], arrowprops=arrow,
            annotation_clip=False,
        )  # fmt: skip
        return
    ax.annotate(
        _plain(note.text or ""),
        **place,
        ha={"left": "left", "right": "right"}.get(note.xanchor, "center"),
        # Left to itself plotly hangs what is at the top from there.
        va={"middle": "center", "bottom": "bottom"}.get(note.yanchor, "top"),
        fontsize=8,
        fontweight="bold" if "<b>" in (note.text or "") else "normal",
        color=_colour(note.font.color or "#000"),
        annotation_clip=False,
    )


def _plain(text: str) -> str:
    """The text without markup; a dollar sign is no formula."""
    from html import unescape

    return unescape(re.sub(r"<[^>]+>", "", text.replace("<br>", "\n"))).replace("$", r"\$")


def _colour(css: str) -> Any:
    """matplotlib's form of a CSS colour."""
    if not css.startswith("rgb"):
        return css
    parts = [float(part) for part in re.findall(r"[\d.]+", css)]
    return (*(part / 255.0 for part in parts[:3]), *parts[3:])


def _clock(milliseconds: float) -> str:
    seconds = round(milliseconds / 1000.0)
    hours, minutes = seconds // 3600, seconds // 60 % 60
    tail = f"{minutes:02d}:{seconds % 60:02d}"
    return f"{hours}:{tail}" if hours else tail
