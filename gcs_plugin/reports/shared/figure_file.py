"""One figure as a file of its own: SVG, or a page of PDF of its size."""

from __future__ import annotations

from datetime import UTC, datetime

from fpdf import FPDF

from thrustmargin.gcs_plugin.reports.shared.canvas import PdfCanvas, SvgCanvas, with_fonts
from thrustmargin.gcs_plugin.reports.shared.drawn_figure import draw, size
from thrustmargin.gcs_plugin.reports.shared.figure import Figure

PIXEL = 25.4 / 140.0  # mm: type of 16 pixels is 8 pt


def file_bytes(made: Figure, ending: str) -> bytes:
    """The figure as .svg or .pdf; the same figure makes the same bytes."""
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
