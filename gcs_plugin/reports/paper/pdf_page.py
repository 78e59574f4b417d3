"""A report's page as PDF on A4, made from its HTML: the same words and figures, no browser.

Known are the elements that the report's template uses; asides (folded on the page) and figures for
the screen alone stay out. All text of logs arrives as characters, never as markup, and fonts are
embedded.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from fpdf import FPDF
from fpdf.enums import TableBordersLayout
from fpdf.fonts import FontFace
from lxml.html import HtmlElement, document_fromstring

from thrustmargin.gcs_plugin.reports.paper.canvas import PIXEL, PdfCanvas, with_fonts
from thrustmargin.gcs_plugin.reports.paper.drawn_figure import draw, size
from thrustmargin.gcs_plugin.reports.shared.plot_style import Figure
from thrustmargin.gcs_plugin.wording.report_words import boxes

MARGIN = 12.0  # mm
TILES = 4  # in a row
FLIGHT_MM = 120.0  # that a flight in brief needs
LEAST_SCALE = 0.7  # to which a figure shrinks before it goes to the next page
#: paper and ink of a verdict, as on the page
LEVELS = {
    "under": ((0, 81, 45), (255, 255, 255)),
    "near": ((255, 176, 0), (0, 0, 0)),
    "over": ((255, 176, 0), (0, 0, 0)),
    "order": ((255, 176, 0), (0, 0, 0)),
    **dict.fromkeys(
        ("critical", "lost", "damaged", "battery", "no_thrust"), ((163, 0, 0), (255, 255, 255))
    ),
    "unknown": ((68, 68, 68), (255, 255, 255)),
}
BOX = "\N{WHITE SQUARE}"  # in the place of a letter that cannot be printed
SILENT = {"script", "style", "noscript", "title"}


def inside(node: HtmlElement) -> Iterator[HtmlElement | str]:
    """Yield the texts and child elements of a node in order, without the white space between
    lines of the template."""
    for one in (node.text, *(part for child in node for part in (child, child.tail))):
        if (not isinstance(one, str) and one is not None) or (one and (one.strip() or one == " ")):
            yield one


def text_of(node: HtmlElement) -> str:
    """Return all text in a node on one line."""
    parts = (one if isinstance(one, str) else f" {text_of(one)} " for one in inside(node))
    return "".join(parts).replace("\n", " ").strip()


def pdf_bytes(html: str, figures: Mapping[str, Figure], *, brief: bool = False) -> bytes:
    """Return the page `html` as a PDF; `figures`, by name, are drawn at their places in it.

    `brief` leaves out elements of class "more", and puts several flights on a page.
    """
    paper = _Paper(figures, brief)
    paper.block(document_fromstring(_printable(html, paper.pdf)))
    return bytes(paper.pdf.output())


def _printable(html: str, pdf: FPDF) -> str:
    """Replace characters that the PDF's fonts lack by a box, and append a list of them to the page.

    The list prevents that a name with a missing character is taken for another name.
    """
    cmaps = [getattr(font, "cmap", {}) for font in pdf.fonts.values()]
    lacking = {c for c in set(html) if not c.isspace() and any(ord(c) not in m for m in cmaps)}
    if not lacking:
        return html
    boxed = html.translate({ord(letter): BOX for letter in lacking})
    end = boxed.rfind("</body>")
    end = len(boxed) if end < 0 else end
    return f"{boxed[:end]}<p>{boxes(BOX, sorted(lacking))}</p>{boxed[end:]}"


class _Paper:
    def __init__(self, figures: Mapping[str, Figure], brief: bool) -> None:
        self._figures, self._brief = figures, brief
        self.pdf = pdf = with_fonts(FPDF(format="A4"))
        pdf.set_margin(MARGIN)
        pdf.set_auto_page_break(True, MARGIN)
        pdf.add_page()
        self._flights = 0
        self._left: tuple[int, float] | None = (
            None  # page and top of a figure with room to its right
        )

    def block(self, node: HtmlElement) -> None:
        """Write one HTML element, with its children, to the PDF.

        Elements that are for screens only are skipped, in the brief form also details. A further
        flight begins on a new page; in the brief form only if it does not fit.
        """
        classes = node.classes
        hidden = {"aside", "bar", "strip", "screen", *(("more",) if self._brief else ())}
        if node.tag in SILENT or hidden & set(classes):
            return
        if node.tag == "section" and "flight" in classes:
            self._flights += 1
            if self._flights > 1 and (not self._brief or self.pdf.will_page_break(FLIGHT_MM)):
                self.pdf.add_page()
            if self._brief:
                self._heading(node.attrib.get("data-name", ""), 12)
        act = {
            "h1": lambda: self._words(text_of(node), 13, bold=True),
            "h2": lambda: self._heading(text_of(node), 12),
            "h3": lambda: self._heading(text_of(node), 10),
            "p": lambda: self._words(text_of(node), 8),
            "ul": lambda: [
                self._words(f"• {text_of(item)}", 8) for item in node.iterdescendants("li")
            ],
            "summary": lambda: None,
            "dl": lambda: self._named(node),
            "table": lambda: self._table(node),
            "figure": lambda: self._figure(node),
            "footer": lambda: self._words(text_of(node), 6.5),
        }.get(node.tag)
        if "verdict" in classes:
            self._verdict(node, next(c for c in classes if c in LEVELS))
        elif "tiles" in classes:
            self._tiles(node)
        elif act is not None:
            act()
        else:
            for one in inside(node):
                if isinstance(one, HtmlElement):
                    self.block(one)
                elif one.strip():
                    self._words(one.strip(), 8)

    def _words(self, text: str, size: float, *, bold: bool = False, fill: bool = False) -> None:
        self.pdf.set_font("body", "B" if bold else "", size)
        self.pdf.multi_cell(
            self.pdf.epw, 0.46 * size, text, fill=fill, align="L", new_x="LMARGIN", new_y="NEXT"
        )

    def _named(self, node: HtmlElement) -> None:
        """Lay out the <dt> and <dd> of a list as `name: text`, a line each."""
        for name, text in zip(node.iterdescendants("dt"), node.iterdescendants("dd"), strict=True):
            self._words(f"{text_of(name)}: {text_of(text)}", 8)
        self.pdf.ln(1.0)

    def _heading(self, text: str, size: float) -> None:
        # Never alone at the foot of a page.
        if self.pdf.will_page_break(40.0):
            self.pdf.add_page()
        self.pdf.ln(2.5)
        self._words(text, size, bold=True)
        self.pdf.line(MARGIN, self.pdf.y, MARGIN + self.pdf.epw, self.pdf.y)
        self.pdf.ln(1.0)

    def _verdict(self, node: HtmlElement, level: str) -> None:
        pdf, (paper, ink) = self.pdf, LEVELS[level]
        pdf.set_fill_color(*paper)
        pdf.set_text_color(*ink)
        for one in inside(node):
            if not isinstance(one, HtmlElement):
                continue
            if one.tag == "dl":
                for name, text in zip(
                    one.iterdescendants("dt"), one.iterdescendants("dd"), strict=True
                ):
                    self._words(f"{text_of(name)}: {text_of(text)}", 8.5, fill=True)
            elif "figures" in one.classes:
                joined = "   ·   ".join(text_of(part) for part in one.iterdescendants("div"))
                self._words(joined, 14, bold=True, fill=True)
            elif one.tag == "p":
                self._words(text_of(one), 19 if "call" in one.classes else 11, bold=True, fill=True)
        pdf.set_text_color(0)
        pdf.set_fill_color(255)
        pdf.ln(2.0)

    def _tiles(self, node: HtmlElement) -> None:
        tiles = [one for one in inside(node) if isinstance(one, HtmlElement)]
        with self.pdf.table(
            borders_layout="NONE",
            first_row_as_headings=False,
            padding=0.6,
            line_height=3.4,
            text_align="LEFT",
            v_align="TOP",
        ) as table:
            self.pdf.set_font("body", "", 7.5)
            for begin in range(0, len(tiles), TILES):
                row = table.row()
                for tile in tiles[begin : begin + TILES]:
                    (value,) = tile.iterdescendants("dd")
                    small = " ".join(text_of(one) for one in value.iterdescendants("small"))
                    main = "".join(o for o in inside(value) if isinstance(o, str)).strip()
                    (name,) = tile.iterdescendants("dt")
                    row.cell(f"{text_of(name)}\n{main}" + (f"\n{small}" if small else ""))
                for _ in range(TILES - len(tiles[begin : begin + TILES])):
                    row.cell("")
        self.pdf.ln(1.0)

    def _table(self, node: HtmlElement) -> None:
        pdf = self.pdf
        for caption in node.iterdescendants("caption"):
            self._words(text_of(caption), 7)
        rows = [
            [cell for cell in inside(row) if isinstance(cell, HtmlElement)]
            for row in node.iterdescendants("tr")
        ]
        pdf.set_font("body", "", 7)
        width = [4.0] * len(rows[0])
        for row in rows:
            for k, cell in enumerate(row):
                whole = [text_of(cell)] if cell.tag == "td" else text_of(cell).split()
                longest = max(whole, key=len, default="")
                width[k] = max(width[k], min(pdf.get_string_width(longest) + 3.0, 55.0))
        with pdf.table(
            borders_layout=TableBordersLayout.HORIZONTAL_LINES,
            col_widths=tuple(width),
            headings_style=FontFace(emphasis="BOLD"),
            line_height=3.4,
            padding=0.5,
            text_align="LEFT",
            first_row_as_headings=node.find(".//th") is not None,
        ) as table:
            for row in rows:
                made = table.row()
                for cell in row:
                    strong = FontFace(emphasis="BOLD") if "strong" in cell.classes else None
                    made.cell(text_of(cell), style=strong)
        pdf.ln(1.5)

    def _figure(self, node: HtmlElement) -> None:
        name = next(one.attrib["data-figure"] for one in node.iterdescendants("div"))
        made = self._figures[name.removeprefix("figure-")]
        pdf, half = self.pdf, 0.5 * self.pdf.epw
        width, height = (PIXEL * pixels for pixels in size(made))
        scale = min(1.0, pdf.epw / width, (pdf.eph - 12.0) / height)
        half_width = width * scale <= half + 1.0
        if half_width and self._left is not None and self._left[0] == pdf.page:
            x, pdf.y = MARGIN + half, self._left[1]
            self._left = None
        else:
            room = (pdf.page_break_trigger - pdf.y - 8.0) / (height * scale)
            if room < LEAST_SCALE:
                pdf.add_page()
            else:
                scale *= min(1.0, room)
            x = MARGIN
            self._left = (pdf.page, pdf.y) if half_width else None
        pdf.set_font("body", "", 7)
        for caption in node.iterdescendants("figcaption"):
            pdf.set_x(x)
            wide = half - 2.0 if half_width else pdf.epw
            pdf.multi_cell(wide, 3.2, text_of(caption), align="L", new_x="LMARGIN", new_y="NEXT")
        draw(made, PdfCanvas(pdf, x, pdf.y, PIXEL * scale))
        pdf.y += height * scale
