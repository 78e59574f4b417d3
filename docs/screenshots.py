"""The README's pictures: `python docs/screenshots.py` writes docs/view.png and docs/report.png.

Needs Chromium or Chrome and the test extra (playwright). Nothing leaves this computer.
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

LOG = ROOT / "sitl_logs" / "campaign" / "v4_m16_q2.5.tlog"
MOMENT_S = 92.0
LIMIT_BYTES = 400_000


def main() -> None:
    """Replay the bundled flight and photograph the page; then its report, where there is one."""
    from tests.browser import open_page
    from thrustmargin.gcs_plugin.commands.flight.replay import replay_view
    from thrustmargin.gcs_plugin.commands.flight.report import report
    from thrustmargin.models.model.model_file import shipped_model

    view = replay_view(LOG, shipped_model(), port=0, paused=True)
    view.start()
    view.seek(MOMENT_S)
    try:
        with open_page(view.url, width=1500, height=850) as page:
            page.wait_for_selector("[data-rotor]")
            page.wait_for_timeout(8000)
            small_png(page.screenshot(), ROOT / "docs" / "view.png")
    finally:
        view.stop()
    photograph_report(report)


def photograph_report(report) -> None:
    """Write the report of the same flight and photograph the top of its page."""
    import tempfile

    from tests.browser import open_page

    with tempfile.TemporaryDirectory() as folder:
        page_file = Path(folder) / "report.html"
        report((LOG,), out=page_file)
        with open_page(page_file.as_uri(), width=1200, height=1500) as page:
            page.wait_for_timeout(3000)
            small_png(page.screenshot(), ROOT / "docs" / "report.png")


def small_png(picture: bytes, path: Path) -> None:
    """Write a PNG of at most LIMIT_BYTES, by fewer colours where that is needed."""
    import io

    from PIL import Image

    image = Image.open(io.BytesIO(picture)).convert("RGB")
    for colours in (None, 256, 128, 64):
        shown = image if colours is None else image.quantize(colours)
        buffer = io.BytesIO()
        shown.save(buffer, "PNG", optimize=True)
        if buffer.tell() <= LIMIT_BYTES:
            path.write_bytes(buffer.getvalue())
            print(f"wrote {path.relative_to(ROOT)}, {buffer.tell() // 1000} kB")
            return
    raise SystemExit(f"{path.name} is over {LIMIT_BYTES // 1000} kB even in 64 colours")


if __name__ == "__main__":
    main()
