"""An axis on paper: from values to pixels, and where its marks stand.

What a figure is drawn on: a rectangle of pixels on a page of PDF, or an SVG file.

x goes to the right and y down, in pixels; lengths, widths and sizes of type too. A colour is three
numbers of 0 to 255, and a fourth for how much it covers, of 0 to 1.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from html import escape
from importlib import resources
from typing import Any

import numpy as np
from fpdf import FPDF

from thrustmargin.models.flight import Floats

STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
SECONDS = (1, 2, 5, 10, 15, 20, 30, 60, 120, 300, 600, 900, 1200, 1800, 3600, 7200, 14400)
ROOM = 0.01  # of the values' span, left free at each end


@dataclass(frozen=True, slots=True)
class Axis:
    """An axis with the value `low` at pixel `begin` and `high` at pixel `end`; `low` and `high` are
    decades if it is "log"."""

    kind: str  # plotly's type: linear, date (ms, shown as time) or log
    low: float
    high: float
    begin: float
    end: float

    def at(self, values: Any) -> Floats:
        """Return the pixels at which `values`, of any shape and in the axis's unit, are drawn."""
        values = np.asarray(values, dtype=np.float64)
        if self.kind == "log":
            values = np.log10(values)
        share = (values - self.low) / (self.high - self.low)
        return self.begin + share * (self.end - self.begin)

    @property
    def scale(self) -> float:
        """Return the number of pixels per unit."""
        return abs(self.end - self.begin) / (self.high - self.low)

    def with_scale(self, scale: float) -> Axis:
        """Return this axis with the same centre and `scale` pixels per unit."""
        middle, half = 0.5 * (self.low + self.high), 0.5 * abs(self.end - self.begin) / scale
        return Axis(self.kind, middle - half, middle + half, self.begin, self.end)

    def marks(self, most: int) -> list[tuple[float, str]]:
        """Return (value, label) of the ticks of an axis, at about `most` round values.

        On a logarithmic axis they are powers of ten, or 1, 2 and 5 times these, however many; on a
        time axis (values in ms) the label is a clock time.
        """
        if self.kind == "log":
            decades = range(int(np.floor(self.low)), int(np.ceil(self.high)) + 1)
            inner = (1, 2, 5) if len(decades) < 4 else (1,)
            values = [m * 10.0**d for d in decades for m in inner]
            inside = [v for v in values if self.low <= np.log10(v) <= self.high]
            return [(v, f"{v:g}") for v in inside]
        if self.kind == "date":
            span = (self.high - self.low) / 1000.0
            step = 1000.0 * next((s for s in SECONDS if span / s <= most), SECONDS[-1])
            return [(value, clock(value)) for value in _multiples(step, self.low, self.high)]
        rough = (self.high - self.low) / max(most, 1)
        power = 10.0 ** np.floor(np.log10(rough))
        step = next(s * power for s in STEPS if s * power >= rough * (1.0 - 1e-9))
        return [(value, f"{value:.6g}") for value in _multiples(step, self.low, self.high)]


def axis_over(
    properties: Mapping[str, Any], values: Sequence[Any], begin: float, end: float
) -> Axis:
    """Return the axis from pixel `begin` to pixel `end` on which all `values` have room.

    `values` are arrays of any shape; NaN is ignored. `properties` are those of plotly: `type`, and
    `range`, which replaces the limits by `values`. On a "log" axis limits are log10 and values not
    above 0 are ignored. Without values and range it spans 0 to 1 with room at the ends.
    """
    kind = properties.get("type", "linear")
    known = np.concatenate([np.ravel(np.asarray(v, dtype=np.float64)) for v in (*values, [])])
    if kind == "log":
        known = np.log10(known[known > 0.0])
    known = known[np.isfinite(known)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    room = ROOM * (high - low) or 0.5
    low, high = properties.get("range") or (low - room, high + room)
    return Axis(kind, low, high, begin, end)


def _multiples(step: float, low: float, high: float) -> Floats:
    first, last = np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9)
    return step * (np.arange(first, last + 1) + 0.0)  # no nought below nought


def clock(milliseconds: float) -> str:
    """Return `MM:SS`, or `H:MM:SS` from an hour on, for a time in ms."""
    seconds = round(milliseconds / 1000.0)
    hours, minutes = seconds // 3600, seconds // 60 % 60
    tail = f"{minutes:02d}:{seconds % 60:02d}"
    return f"{hours}:{tail}" if hours else tail


Colour = tuple[float, ...]
Box = tuple[float, float, float, float]  # left, top, width, height
_FONTS = "thrustmargin.gcs_plugin.reports.paper"
ACROSS = {"left": 0.0, "center": 0.5, "right": 1.0}
DOWN = {"top": 0.76, "middle": 0.36, "bottom": -0.22}  # of the size, from there to the baseline
PIXEL = 25.4 / 140.0  # mm on paper: type of 16 pixels is 8 pt


@dataclass(frozen=True, slots=True)
class Lettering:
    """Style of a line of words, and its alignment to its place; turned text reads upwards."""

    size: float
    colour: Colour = (0, 0, 0)
    across: str = "left"
    down: str = "middle"
    bold: bool = False
    turned: bool = False


def with_fonts(pdf: FPDF) -> FPDF:
    """Embed the font family "body", plain and bold, and return the document."""
    for style, name in (("", "DejaVuSans.ttf"), ("B", "DejaVuSans-Bold.ttf")):
        with resources.as_file(resources.files(_FONTS) / name) as path:
            pdf.add_font("body", style, path)
    return pdf


class PdfCanvas:
    """A rectangle on a PDF page, with its top left corner in mm and `pixel` mm per pixel."""

    def __init__(self, pdf: FPDF, left_mm: float, top_mm: float, pixel: float) -> None:
        self._pdf, self._corner, self._pixel = pdf, np.array([left_mm, top_mm]), pixel

    def _mm(self, points: Floats) -> list[tuple[float, float]]:
        return [(x, y) for x, y in (np.asarray(points) * self._pixel + self._corner).tolist()]

    def line(self, points: Floats, colour: Colour, width: float, dash: Sequence[float]) -> None:
        """Draw a line through `points` (N, 2), pixels; `width` is in pixels too.

        `dash` is (length of a stroke, length of a gap), pixels; empty for a solid line.
        """
        pixel, pdf = self._pixel, self._pdf
        strokes = {"dash": dash[0] * pixel, "gap": dash[1] * pixel, "phase": 0.0} if dash else None
        with pdf.local_context(
            draw_color=_bytes(colour),
            line_width=width * pixel,
            stroke_join_style="round",
            dash_pattern=strokes,
        ):
            pdf.polyline(self._mm(points))

    def area(self, points: Floats, colour: Colour) -> None:
        """Fill the area that points (N, 2) enclose."""
        with self._pdf.local_context(fill_color=_bytes(colour), fill_opacity=(*colour, 1.0)[3]):
            self._pdf.polygon(self._mm(points), style="F")

    def discs(self, centres: Floats, colours: Sequence[Colour], size: float) -> None:
        """Draw filled circles of the diameter `size`, pixels, about centres (N, 2), pixels."""
        pdf, radius = self._pdf, 0.5 * size * self._pixel
        with pdf.local_context():
            for (x, y), colour in zip(self._mm(centres), colours, strict=True):
                pdf.set_fill_color(*_bytes(colour))
                pdf.circle(x, y, radius, style="F")

    def text(self, at: tuple[float, float], words: str, look: Lettering) -> None:
        """Draw one line of text at the point `at`, (x, y) in pixels.

        `look` is its size, colour and alignment to that point.
        """
        pdf = self._pdf
        ((x, y),) = self._mm(np.array([at]))
        with pdf.local_context(text_color=_bytes(look.colour)):
            self._set_type(look.size, look.bold)
            left = x - ACROSS[look.across] * pdf.get_string_width(words)
            low = y + DOWN[look.down] * look.size * self._pixel
            with pdf.rotation(90.0, x, y) if look.turned else nullcontext():
                pdf.text(left, low, words)

    def width(self, words: str, size: float) -> float:
        """Return the width of the words in plain type."""
        with self._pdf.local_context():
            self._set_type(size, bold=False)
            return self._pdf.get_string_width(words) / self._pixel

    def _set_type(self, size: float, bold: bool) -> None:
        points = size * self._pixel * 72.0 / 25.4
        self._pdf.set_font("body", "B" if bold else "", points)

    @contextmanager
    def clipped(self, box: Box) -> Iterator[None]:
        """Restrict drawing to `box` within the context."""
        (x, y), (w, h) = np.array(box[:2]) * self._pixel + self._corner, box[2:]
        with self._pdf.rect_clip(x, y, w * self._pixel, h * self._pixel):
            yield


class SvgCanvas:
    """An SVG image with the drawing methods of PdfCanvas."""

    def __init__(self, width: float, height: float) -> None:
        self._size, self._parts, self._clips = (width, height), list[str](), 0

    def document(self) -> str:
        """Return the drawing as the text of an SVG file; equal drawings give equal text."""
        wide, high = self._size
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {wide:g} {high:g}" '
            f'width="{wide:g}" height="{high:g}" '
            "font-family=\"'DejaVu Sans', Verdana, sans-serif\">\n"
            f'<rect width="100%" height="100%" fill="white"/>\n{"".join(self._parts)}</svg>\n'
        )

    def line(self, points: Floats, colour: Colour, width: float, dash: Sequence[float]) -> None:
        dashed = f' stroke-dasharray="{" ".join(f"{d:g}" for d in dash)}"' if dash else ""
        self._add(
            f'<polyline points="{_places(points)}" fill="none" stroke="{_css(colour)}" '
            f'stroke-width="{width:g}" stroke-linejoin="round"{dashed}/>'
        )

    def area(self, points: Floats, colour: Colour) -> None:
        through = f'fill="{_css(colour)}" fill-opacity="{(*colour, 1.0)[3]:g}"'
        self._add(f'<polygon points="{_places(points)}" {through}/>')

    def discs(self, centres: Floats, colours: Sequence[Colour], size: float) -> None:
        for (x, y), colour in zip(centres, colours, strict=True):
            place = f'cx="{x:.2f}" cy="{y:.2f}" r="{0.5 * size:g}"'
            self._add(f'<circle {place} fill="{_css(colour)}"/>')

    def text(self, at: tuple[float, float], words: str, look: Lettering) -> None:
        x, y = at
        low = y + DOWN[look.down] * look.size
        anchor = {"left": "start", "center": "middle", "right": "end"}[look.across]
        heavy = ' font-weight="bold"' if look.bold else ""
        turn = f' transform="rotate(-90 {x:.2f} {y:.2f})"' if look.turned else ""
        self._add(
            f'<text x="{x:.2f}" y="{low:.2f}" font-size="{look.size:g}" '
            f'text-anchor="{anchor}" fill="{_css(look.colour)}"{heavy}{turn}>'
            f"{escape(words)}</text>"
        )

    def width(self, words: str, size: float) -> float:
        return 0.58 * size * len(words)

    @contextmanager
    def clipped(self, box: Box) -> Iterator[None]:
        self._clips += 1
        x, y, w, h = (f"{value:.2f}" for value in box)
        self._add(
            f'<clipPath id="c{self._clips}"><rect x="{x}" y="{y}" width="{w}" height="{h}"/>'
            f'</clipPath><g clip-path="url(#c{self._clips})">'
        )
        yield
        self._add("</g>")

    def _add(self, element: str) -> None:
        self._parts.append(f"{element}\n")


Canvas = PdfCanvas | SvgCanvas


def _places(points: Floats) -> str:
    return " ".join(f"{x:.2f},{y:.2f}" for x, y in points)


def _bytes(colour: Colour) -> tuple[int, int, int]:
    red, green, blue = (round(part) for part in colour[:3])
    return red, green, blue


def _css(colour: Colour) -> str:
    return "#{:02x}{:02x}{:02x}".format(*_bytes(colour))
