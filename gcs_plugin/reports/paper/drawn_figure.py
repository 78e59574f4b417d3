"""A figure drawn on a canvas, for paper: the same tables that plotly.js draws on the page.

Only what this project's figures use is known: panels of lines and areas over time or any number,
maps of coloured marks, limits across, texts, arrows and a key. Anything else is an error.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from html import unescape
from typing import Any

import numpy as np
from fpdf import FPDF

from thrustmargin.gcs_plugin.reports.paper.canvas import (
    PIXEL,
    Axis,
    Box,
    Canvas,
    Colour,
    Lettering,
    PdfCanvas,
    SvgCanvas,
    axis_over,
    with_fonts,
)
from thrustmargin.gcs_plugin.reports.shared.plot_style import Figure, Trace
from thrustmargin.models.flight import Floats

WIDTH_PX = 1000.0  # of a figure; two maps are drawn side by side
TYPE, SMALL = 16.0, 15.0  # pixels, as on the page
INK, GRID = (0.0, 0.0, 0.0), (208.0, 208.0, 208.0)
_DASHES = {"dash": (9.0, 5.0), "dot": (2.5, 4.0)}
_OPEN = {"square-x-open", "circle-open", "square-open"}


@dataclass(frozen=True, slots=True)
class PlotArea:
    """A pair of axes with plotly's properties of each."""

    x: Axis
    y: Axis
    across: Mapping[str, Any]
    upright: Mapping[str, Any]

    @property
    def box(self) -> Box:
        return self.x.begin, self.y.end, self.x.end - self.x.begin, self.y.begin - self.y.end

    def points(self, x: Any, y: Any) -> Floats:
        """Return the pixels (N, 2) of data values `x` and `y` (N,)."""
        return np.column_stack([self.x.at(x), self.y.at(y)])


def size(made: Figure) -> tuple[float, float]:
    """Return width and height, in pixels, of a figure on paper.

    A map is half as wide as the page. Space for buttons below the figure is cut, as paper has none.
    """
    layout = made.layout
    on_map = "scaleanchor" in layout["yaxis"]
    # Buttons, which need room below on the page, are none on paper.
    unused = max(layout["margin"]["b"] - 90.0, 0.0) if "updatemenus" in layout else 0.0
    return (0.5 if on_map else 1.0) * WIDTH_PX, layout["height"] - unused


def draw(made: Figure, canvas: Canvas) -> None:
    """Draw the whole figure on the canvas, from its top left corner to the figure's `size`."""
    panels = _panels(made)
    for panel in panels.values():
        _axes(panel, canvas)
    key: dict[str, Trace] = {}
    for trace in made.data:
        if trace.get("visible", True):
            panel = panels[trace.get("yaxis", "y")]
            with canvas.clipped(panel.box):
                _trace(trace, panel, canvas)
            if trace.get("showlegend", True) and trace.get("name"):
                key.setdefault(_plain(trace["name"]), trace)
            if "colorbar" in trace.get("marker", {}):
                _colour_bar(trace["marker"], panel, canvas)
    for shape in made.layout.get("shapes", ()):
        panel, line = panels[shape["yref"]], shape["line"]
        left, _, wide, _ = panel.box
        y = float(panel.y.at(shape["y0"]))
        ends = np.array([[left, y], [left + wide, y]])
        dash = _DASHES.get(line.get("dash", ""), ())
        canvas.line(ends, colour_of(line["color"]), line["width"], dash)
    for note in made.layout.get("annotations", ()):
        _note(note, panels, _whole(made), canvas)
    _key(key, made, canvas)


def file_bytes(made: Figure, ending: str) -> bytes:
    """Return the figure as the content of a file: SVG for the `ending` .svg, else PDF.

    Equal figures give equal bytes.
    """
    wide, high = size(made)
    if ending == ".svg":
        drawing = SvgCanvas(wide, high)
        draw(made, drawing)
        return drawing.document().encode("utf-8", "replace")
    pdf = with_fonts(FPDF(unit="mm", format=(wide * PIXEL, high * PIXEL)))
    pdf.set_creation_date(datetime.fromtimestamp(0, UTC))
    pdf.add_page()
    draw(made, PdfCanvas(pdf, 0.0, 0.0, PIXEL))
    return bytes(pdf.output())


def _whole(made: Figure) -> Box:
    """Return the rectangle within the margins: left, top, width, height, pixels."""
    margin = made.layout["margin"]
    wide, high = size(made)[0], made.layout["height"]
    inner = wide - margin["l"] - margin["r"], high - margin["t"] - margin["b"]
    return margin["l"], margin["t"], *inner


def _panels(made: Figure) -> dict[str, PlotArea]:
    """Return the figure's plot areas by the name of their vertical axis in traces: y, y2, ..."""
    layout, (left, top, wide, high) = made.layout, _whole(made)
    found = {}
    for name in [n for n in layout if re.fullmatch(r"yaxis\d*", n)]:
        upright, key = layout[name], name.replace("axis", "")
        side = upright.get("anchor", "x")
        across = layout.get(f"xaxis{side[1:]}", {})
        group = across.get("matches", side)
        drawn = [t for t in made.data if t.get("visible", True)]
        alike = {side} | {
            f"x{n[5:]}"
            for n, a in layout.items()
            if re.fullmatch(r"xaxis\d*", n) and a.get("matches", f"x{n[5:]}") == group
        }
        x = axis_over(
            across, [t["x"] for t in drawn if t.get("xaxis", "x") in alike], left, left + wide
        )
        low, upper = upright.get("domain", (0.0, 1.0))
        begin, end = top + (1.0 - low) * high, top + (1.0 - upper) * high
        y = axis_over(upright, [t["y"] for t in drawn if t.get("yaxis", "y") == key], begin, end)
        if "scaleanchor" in upright:
            scale = 0.94 * min(x.scale, y.scale)
            x, y = x.with_scale(scale), y.with_scale(scale)
        found[key] = PlotArea(x, y, across, upright)
    return found


def _axes(panel: PlotArea, canvas: Canvas) -> None:
    """Draw the grid, axis lines, tick labels and titles of one plot area."""
    left, top, wide, high = panel.box
    right, low = left + wide, top + high
    second_axis = panel.upright.get("side") == "right"  # a second axis of the same panel
    edge, out, align = (right, 6.0, "left") if second_axis else (left, -6.0, "right")
    most = max(2, int(panel.upright.get("nticks", 7)) - 1)
    widest = 0.0
    for value, words in panel.y.marks(most):
        words += panel.upright.get("ticksuffix", "")
        y = float(panel.y.at(value))
        if not second_axis:
            canvas.line(np.array([[left, y], [right, y]]), GRID, 0.8, ())
        canvas.text((edge + out, y), words, Lettering(SMALL, across=align))
        widest = max(widest, canvas.width(words, SMALL))
    labelled = panel.across.get("showticklabels", True) and not second_axis
    for value, words in [] if second_axis else panel.x.marks(8 if wide > 600.0 else 6):
        x = float(panel.x.at(value))
        canvas.line(np.array([[x, top], [x, low]]), GRID, 0.8, ())
        if labelled:
            canvas.text((x, low + 7.0), words, Lettering(SMALL, across="center", down="top"))
    canvas.line(np.array([[edge, top], [edge, low]]), INK, 1.4, ())
    if not second_axis:
        canvas.line(np.array([[left, low], [right, low]]), INK, 1.4, ())
    place = edge + np.sign(out) * (widest + 24.0)
    if title := _title(panel.upright):
        look = Lettering(TYPE, across="center", turned=True)
        canvas.text((place, 0.5 * (top + low)), title, look)
    if labelled and (title := _title(panel.across)):
        look = Lettering(TYPE, across="center", down="top")
        canvas.text((0.5 * (left + right), low + 27.0), title, look)


def _trace(trace: Trace, panel: PlotArea, canvas: Canvas) -> None:
    if trace["type"] != "scatter":
        raise ValueError(f"a trace of type {trace['type']} is not drawn on paper")
    points, line = panel.points(trace["x"], trace["y"]), trace.get("line", {})
    if trace.get("fill") == "toself":
        canvas.area(points, colour_of(trace["fillcolor"]))
        return
    mode = trace["mode"]
    if "lines" in mode:
        known = np.isfinite(points).all(axis=1)
        breaks = np.flatnonzero(np.diff(known.astype(np.int8), prepend=0, append=0))
        for begin, end in breaks.reshape(-1, 2):
            if end - begin > 1:
                dash = _DASHES.get(line.get("dash", ""), ())
                width = line.get("width", 2.0)
                canvas.line(points[begin:end], colour_of(line["color"]), width, dash)
    if "markers" in mode:
        _marks(trace["marker"], points, canvas)
    if "text" in mode:
        for (x, y), words in zip(points, trace["text"], strict=True):
            look = Lettering(TYPE, across="center", down="bottom", bold=True)
            canvas.text((x, y - 14.0), _plain(words), look)


def _marks(marker: Mapping[str, Any], points: Floats, canvas: Canvas) -> None:
    colour, across = marker.get("color", "#000000"), float(np.max(marker.get("size", 6.0)))
    if "colorscale" in marker:
        share = (np.asarray(colour) - marker["cmin"]) / (marker["cmax"] - marker["cmin"])
        canvas.discs(points, _shades(marker["colorscale"], share), 0.75 * across)
        return
    form, shade = marker.get("symbol", "circle"), colour_of(colour)
    turn = np.linspace(0.0, 2.0 * np.pi, 5 if form.startswith("square") else 33)
    turn = turn + np.pi / 4.0 * form.startswith("square")
    ring = 0.4 * across * np.column_stack([np.cos(turn), np.sin(turn)])
    for point in points[np.isfinite(points).all(axis=1)]:
        if form in _OPEN:
            canvas.line(point + ring, shade, marker.get("line", {}).get("width", 2.0), ())
        else:
            canvas.area(point + ring, shade)


def _colour_bar(marker: Mapping[str, Any], panel: PlotArea, canvas: Canvas) -> None:
    left, top, wide, _ = panel.box
    scale = Axis("linear", marker["cmin"], marker["cmax"], left, left + 0.96 * wide)
    y, thick, parts = top - 26.0, 14.0, 120
    edges = np.linspace(scale.begin, scale.end, parts + 1)
    middles = (np.arange(parts) + 0.5) / parts
    for begin, end, shade in zip(
        edges, edges[1:], _shades(marker["colorscale"], middles), strict=False
    ):
        corners = [[begin, y], [end + 0.3, y], [end + 0.3, y + thick], [begin, y + thick]]
        canvas.area(np.array(corners), shade)
    bar = marker["colorbar"]
    for value, words in zip(bar["tickvals"], bar["ticktext"], strict=True):
        x = float(scale.at(value))
        canvas.line(np.array([[x, y - 4.0], [x, y + thick]]), INK, 1.0, ())
        canvas.text((x, y - 6.0), _plain(words), Lettering(SMALL, across="center", down="bottom"))


def _note(
    note: Mapping[str, Any], panels: Mapping[str, PlotArea], whole: Box, canvas: Canvas
) -> None:
    """Draw an annotation of plotly's layout, with an arrow from the text to its point if it has
    one.

    `whole` is the box of all plot areas, which positions relative to the paper refer to.
    """
    x = _place(note["x"], note.get("xref", "x"), panels, whole, upright=False)
    y = _place(note["y"], note.get("yref", "y"), panels, whole, upright=True)
    x, y = x + note.get("xshift", 0.0), y - note.get("yshift", 0.0)
    font, words = note.get("font", {}), note["text"]
    down = note.get("yanchor", "top" if note.get("yref") == "paper" else "middle")
    if note["showarrow"]:
        tail, head = np.array([x + note["ax"], y + note["ay"]]), np.array([x, y])
        along = (head - tail) / max(float(np.hypot(*(head - tail))), 1e-9)
        side = np.array([-along[1], along[0]])
        neck = head - 12.0 * along
        canvas.line(np.stack([tail, neck]), INK, note["arrowwidth"], ())
        canvas.area(np.stack([head, neck + 6.0 * side, neck - 6.0 * side]), INK)
        x, y, down = *tail.tolist(), "bottom"
        y -= 3.0
    lines = _plain(words).split("\n")
    step = 1.2 * TYPE
    y -= {"top": 0.0, "middle": 0.5, "bottom": 1.0}[down] * (len(lines) - 1) * step
    colour, across = colour_of(font.get("color", "#000000")), note.get("xanchor", "center")
    look = Lettering(font.get("size", TYPE), colour, across, down, bold="<b>" in words)
    for k, line in enumerate(lines):
        canvas.text((x, y + k * step), line, look)


def _place(
    value: float, reference: str, panels: Mapping[str, PlotArea], whole: Box, *, upright: bool
) -> float:
    """Return the pixel of an annotation's coordinate `value`, vertical if `upright`.

    By `reference`, as in plotly, it is a value on an axis ("x2"), a share of that axis's plot area
    ("x2 domain"), or a share of the box `whole` ("paper").
    """
    name, _, domain = reference.partition(" ")
    box = whole
    if name != "paper":
        panel = next(p for key, p in panels.items() if name in (key, f"x{key[1:]}"))
        if not domain:
            return float((panel.y if upright else panel.x).at(value))
        box = panel.box
    left, top, wide, high = box
    return top + (1.0 - value) * high if upright else left + value * wide


def _key(shown: Mapping[str, Trace], made: Figure, canvas: Canvas) -> None:
    """Draw the legend, with name and sample of each trace in `shown`.

    It is at the top, or where the figure's layout has it.
    """
    left, top, wide, high = _whole(made)
    own = made.layout.get("legend", {})
    x, y, line = left, 12.0, 22.0
    if own.get("orientation") == "v":
        x, y = left + own["x"] * wide, top + (1.0 - own["y"]) * high
    elif own:
        y = top + high + 58.0
    begin = x
    if heading := own.get("title", {}).get("text"):
        canvas.text((x, y), _plain(heading), Lettering(SMALL))
        y += line
    for k, (name, trace) in enumerate(shown.items()):
        across = canvas.width(name, SMALL) + 74.0
        stacked = own.get("orientation") == "v"
        if k and (stacked or x + across - 24.0 > left + wide + made.layout["margin"]["r"]):
            x, y = begin, y + line
        sample = {k: v for k, v in trace.items() if k not in ("text", "visible")}
        _sample(sample, (x, y), canvas)
        canvas.text((x + 42.0, y), name, Lettering(SMALL))
        x += across


def _sample(trace: Trace, at: tuple[float, float], canvas: Canvas) -> None:
    """Draw the sample of a trace for the legend, with its left end at `at` (x, y), pixels."""
    x, y = at
    span = Axis("linear", 0.0, 1.0, x, x + 34.0), Axis("linear", 0.0, 1.0, y + 6.0, y - 6.0)
    panel = PlotArea(*span, {}, {})
    if trace.get("fill") == "toself":
        corners = {"x": np.array([0.0, 1.0, 1.0, 0.0]), "y": np.array([0.0, 0.0, 1.0, 1.0])}
        _trace(trace | corners, panel, canvas)
        return
    mode = trace["mode"].replace("+text", "")
    if "lines" in mode:
        _trace(trace | {"mode": "lines", "x": [0.0, 1.0], "y": [0.5, 0.5]}, panel, canvas)
    if "markers" in mode:
        _trace(trace | {"mode": "markers", "x": [0.5], "y": [0.5]}, panel, canvas)


def _shades(stops: Sequence[Sequence[Any]], shares: Floats) -> list[Colour]:
    """Return the colours at shares (N,) of a scale whose stops are pairs of 0..1 and a colour."""
    at = np.array([float(place) for place, _ in stops])
    rgb = np.array([colour_of(colour) for _, colour in stops])
    return list(zip(*(np.interp(shares, at, part).tolist() for part in rgb.T), strict=True))


def colour_of(css: str) -> Colour:
    """Parse a CSS colour: #rrggbb, rgb(...) or rgba(...).

    Return red, green and blue, 0 to 255, and the opacity, 0 to 1, if the text has one. Raises
    ValueError for another text.
    """
    if re.fullmatch(r"#[0-9a-fA-F]{6}", css):
        return tuple(float(int(css[k : k + 2], 16)) for k in (1, 3, 5))
    found = re.fullmatch(r"rgba?\(([\d., ]+)\)", css)
    if found is None:
        raise ValueError(f"{css!r} is no colour that is drawn on paper")
    return tuple(float(part) for part in found[1].split(","))


def _title(properties: Mapping[str, Any]) -> str:
    return _plain(properties.get("title", {}).get("text", ""))


def _plain(text: str) -> str:
    """Return the text without markup and unprintable characters."""
    shown = unescape(re.sub(r"<[^>]+>", "", text.replace("<br>", "\n")))
    return "".join(letter for letter in shown if letter.isprintable() or letter == "\n")
