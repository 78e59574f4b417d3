"""The report in a real browser: every plot is drawn, nothing is asked of a network."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.browser import open_page, screenshot_folder
from tests.gcs_plugin.reports.margin.report_flight import HOSTILE, flight, log
from thrustmargin.gcs_plugin.reports.margin import build_report
from thrustmargin.gcs_plugin.reports.margin.data import Report
from thrustmargin.gcs_plugin.reports.margin.render import write_report

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Dialog, Page

pytestmark = pytest.mark.browser

#: Traces in each figure's place, in the order of the page.
DRAWN = (
    "[...document.querySelectorAll('[data-figure]')]"
    ".map(b => b.querySelectorAll('.scatterlayer .trace').length)"
)
#: Lengths of the drawn paths of lines.
LINES = "[...document.querySelectorAll('.js-line')].map(l => l.getAttribute('d').length)"
WIDTHS = "[...document.querySelectorAll('.main-svg')].map(s => s.getBoundingClientRect().width)"
LARGEST = "parseFloat(getComputedStyle(document.querySelector('.figures b')).fontSize)"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One browser for the module; each test opens its own page in it."""
    with open_page("about:blank") as first:
        assert first.context.browser is not None
        yield first.context.browser


@contextmanager
def shown(browser: Browser, report: Report, folder: Path, width: int = 1280) -> Iterator[Page]:
    """The report's page from disk; fails on any console error or request but the file itself."""
    out = write_report(report, folder / "report.html").html
    said: list[str] = []
    asked: list[str] = []

    def dismissed(dialog: Dialog) -> None:
        said.append(f"dialog: {dialog.message}")
        dialog.dismiss()

    page = browser.new_page(viewport={"width": width, "height": 900})
    page.on("console", lambda m: said.append(f"{m.type}: {m.text}"))
    page.on("pageerror", lambda e: said.append(f"error: {e}"))
    page.on("dialog", dismissed)
    page.on("request", lambda r: asked.append(r.url))
    page.goto(out.as_uri())
    yield page
    page.close()
    assert [text for text in said if text.startswith(("error", "warning", "dialog"))] == []
    assert [url for url in asked if not url.startswith(("data:", "blob:"))] == [out.as_uri()]


def draw_all(page: Page) -> None:
    """Scroll through the page as a reader does, so that every plot comes into view."""
    page.evaluate("document.querySelectorAll('details').forEach(d => { d.open = true; })")
    boxes = page.locator("[data-figure]")
    for k in range(boxes.count()):
        boxes.nth(k).scroll_into_view_if_needed()
        boxes.nth(k).locator(".main-svg").first.wait_for()


@pytest.fixture(scope="module")
def page(browser, tmp_path_factory) -> Iterator[Page]:
    """One flight's report, open for the tests that only look at it."""
    with shown(browser, build_report([flight()]), tmp_path_factory.mktemp("report")) as page:
        yield page


def test_the_verdict_is_above_the_fold_and_large(page):
    box = page.locator(".verdict").bounding_box()
    assert box is not None
    assert box["y"] + box["height"] < 900
    assert page.evaluate(LARGEST) > 100


WORDS = "e => e.innerText.split(/\\s+/).filter(Boolean).length"


@pytest.mark.parametrize("width", [390, 820, 1366])
def test_a_card_and_three_figures_come_first_and_nothing_is_cut_off(browser, tmp_path, width):
    """By hand: a card of 60 words, 250 words before the details, four screens of a phone."""
    with shown(browser, build_report([flight()]), tmp_path, width) as page:
        page.locator(".main-svg").first.wait_for()
        assert page.locator(".flight .verdict").evaluate(WORDS) <= 60
        plots = page.locator(".plot").evaluate_all(
            f"all => all.map({WORDS}).reduce((a, b) => a + b)"
        )
        assert page.locator("main").evaluate(WORDS) - plots <= 250
        wide = "document.documentElement.scrollWidth"
        assert page.evaluate(wide) <= width
        visible = (
            "[...document.querySelectorAll('[data-figure]')].filter(e => e.offsetHeight).length"
        )
        assert page.evaluate(visible) == 3
        assert page.evaluate("document.documentElement.scrollHeight") <= 4 * 900
        page.locator("details.more > summary").click()
        assert page.evaluate(wide) <= width
        cut = "e => e.filter(one => one.scrollWidth > one.clientWidth + 1).length"
        if width == 390:
            assert page.locator(".scroll").evaluate_all(cut) == 0


def test_every_plot_is_drawn_when_it_comes_into_view(page, tmp_path):
    draw_all(page)
    drawn = page.evaluate(DRAWN)
    assert len(drawn) == 6
    assert min(drawn) > 0
    lines = page.evaluate(LINES)
    assert len(lines) > 20
    assert max(lines) > 5000
    colours = page.evaluate(
        "new Set([...document.querySelectorAll('.points path')].map(p => p.style.fill)).size"
    )
    assert colours > 20
    folder = screenshot_folder(tmp_path)
    page.screenshot(path=folder / "report_page.png", full_page=True)
    page.evaluate("scrollTo(0, 0)")
    page.screenshot(path=folder / "report.png")


def test_the_buttons_switch_the_map_between_yaw_uncontrolled_and_controlled(page):
    draw_all(page)
    fills = (
        "[...document.querySelector('[data-figure*=map_redundancy]')"
        ".querySelectorAll('.points path')].slice(0, 5).map(p => p.style.fill).join()"
    )
    before = page.evaluate(fills)
    page.locator("[data-figure*=map_redundancy] .updatemenu-button").nth(1).click()
    page.wait_for_function(f"{fills} !== '{before}'")


def test_printing_draws_every_plot_on_the_paper(page, tmp_path):
    paper = page.pdf(path=tmp_path / "report.pdf", prefer_css_page_size=True)
    assert len(re.findall(rb"/Type\s*/Page\b", paper)) <= 5
    assert (tmp_path / "report.pdf").stat().st_size > 50_000
    assert min(page.evaluate(DRAWN)) > 0
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert max(page.evaluate(WIDTHS)) < 710  # A4 less its margins, at 96 px an inch
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    page.wait_for_function(f"Math.max(...{WIDTHS}) > 1000")


def test_a_hostile_log_runs_no_script_and_its_text_is_shown(browser, tmp_path):
    track = replace(log().track, name=HOSTILE)
    analysis, recorded = flight(track=track, messages=((1.0, HOSTILE),))
    names = tuple(HOSTILE for _ in range(4))
    model = replace(analysis.model, airframe=replace(analysis.model.airframe, rotor_names=names))
    report = build_report([(replace(analysis, model=model), recorded)])
    with shown(browser, report, tmp_path) as page:
        draw_all(page)
        assert "alert(1)" in page.locator("h1").inner_text()
        assert page.locator("img").count() == 0


def test_the_policy_stops_a_script_that_is_not_the_pages_own(browser, tmp_path):
    out = write_report(build_report([flight()]), tmp_path / "r.html").html
    text = out.read_text("utf-8").replace("</main>", "<script>window.ran = 1</script></main>")
    out.write_text(text, encoding="utf-8")
    page = browser.new_page()
    page.goto(out.as_uri())
    assert page.evaluate("window.ran") is None
    assert page.evaluate("typeof Plotly") == "object"
    page.close()


def test_a_phone_needs_no_sideways_scrolling(browser, tmp_path):
    with shown(browser, build_report([flight(), flight()]), tmp_path, width=400) as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= 400
        page.screenshot(path=screenshot_folder(tmp_path) / "report_phone.png")
