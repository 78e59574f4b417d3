"""The view in a real browser: it draws, it obeys the timeline, and its colours are the legend's."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.browser import open_page, screenshot_folder
from tests.gcs_plugin.view.view_flight import flight
from thrustmargin.gcs_plugin.view.replay_view import ReplayView
from thrustmargin.gcs_plugin.wording.palette import LOAD

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.browser
PATIENCE_MS = 60_000  # a browser without a graphics card on a busy machine


@pytest.fixture(scope="module")
def analysis():
    return flight()


@pytest.fixture(scope="module")
def opened(analysis) -> Iterator[tuple[ReplayView, Page]]:
    evil = [(0.0, "</div><script>window.hacked=1</script><img src=x onerror='window.hacked=1'>")]
    view = ReplayView(analysis, messages=evil, port=0, paused=True)
    view.start()
    try:
        with open_page(view.url, width=1500, height=850) as page:
            page.set_default_timeout(PATIENCE_MS)
            page.wait_for_selector('[data-gauge="worst"]')
            until(page, lambda: seen(page, LOAD.screen(analysis.utilisation.max())) > 50)
            yield view, page
    finally:
        view.stop()


def until(page: Page, done: Callable[[], bool]) -> None:
    """Give the page time until `done`."""
    for _ in range(PATIENCE_MS // 250):
        if done():
            return
        page.wait_for_timeout(250)
    raise AssertionError("the page did not get there in time")


def picture(page: Page) -> np.ndarray:
    """(H, W, 3) pixels of the scene between the panels."""
    from PIL import Image

    width = page.viewport_size["width"] if page.viewport_size else 0
    image = Image.open(io.BytesIO(page.screenshot(timeout=PATIENCE_MS))).convert("RGB")
    return np.asarray(image)[:, 400 : width - 420].astype(int)


def seen(page: Page, colour: np.ndarray, within: int = 6) -> int:
    """Pixels of the scene that show a colour."""
    return int(np.all(np.abs(picture(page) - colour.astype(int)) <= within, axis=-1).sum())


def gauge(page: Page, key: str) -> str:
    return page.inner_text(f'[data-gauge="{key}"]')


def test_the_route_is_drawn_in_the_colours_of_the_legend(opened):
    view, page = opened
    use = view._trail.route.worst(view._trail.values(0), "max")
    for value in (np.quantile(use, 0.1), np.quantile(use, 0.9)):
        assert seen(page, LOAD.screen(value)) > 30
    pixels = picture(page).reshape(-1, 3)
    assert len(np.unique(pixels, axis=0)) > 200
    assert "50 % limit" in page.inner_text(".tm-legend")
    assert "no data" in page.inner_text(".tm-legend")


def test_gauges_show_the_row_of_the_timeline_and_change_with_it(opened, analysis):
    view, page = opened
    texts = []
    for row in (30, 222):
        view.seek(float(analysis.track.time_s[row]))
        until(page, lambda r=row: f"{analysis.track.tank_kg[r]:.1f} kg" in gauge(page, "tank"))
        for i in range(4):
            assert f"{100 * analysis.margin[row, i]:.0f} %" in gauge(page, f"rotor-{i + 1}")
        assert "measured" in gauge(page, "worst")
        texts.append(gauge(page, "worst"))
    assert texts[0] != texts[1]


def test_the_slider_moves_the_aircraft_in_the_scene(opened, analysis):
    view, page = opened
    view.seek(0.0)
    until(page, lambda: page.inner_text(".tm-time").startswith("0:00"))
    before = picture(page)
    box = page.locator("input.mantine-NumberInput-input").first
    box.fill("25")
    box.press("Enter")
    until(page, lambda: page.inner_text(".tm-time").startswith("0:25"))
    assert view.clock.now() == 25.0
    assert f"{analysis.track.tank_kg[250]:.1f} kg" in gauge(page, "tank")
    until(page, lambda: np.mean(np.any(np.abs(picture(page) - before) > 40, axis=-1)) > 0.002)


def test_the_buttons_play_pause_and_go_to_the_worst_moment(opened, analysis):
    view, page = opened
    view.seek(1.0)
    page.get_by_role("button", name="Play", exact=True).click()
    until(page, lambda: view.clock.now() > 1.5)
    page.get_by_role("button", name="Pause", exact=True).click()
    until(page, lambda: not view.clock.playing)
    page.get_by_role("button", name="Go to the worst moment").click()
    worst = int(np.argmax(analysis.utilisation.max(axis=1)))
    until(page, lambda: abs(view.clock.now() - analysis.track.time_s[worst]) < 1e-6)
    least = f"{100 * analysis.margin.min():.0f} %"
    until(page, lambda: least in gauge(page, "worst"))


def test_the_switch_changes_the_legend_and_the_picture(opened):
    view, page = opened
    before = picture(page)
    view.set_overlay("Residual")
    until(page, lambda: "measured minus predicted" in page.inner_text(".tm-legend"))
    until(page, lambda: np.mean(np.any(np.abs(picture(page) - before) > 40, axis=-1)) > 0.002)
    view.set_overlay("Load")
    until(page, lambda: "thrust in use" in page.inner_text(".tm-legend"))


def test_four_charts_draw_measured_and_predicted_speed(opened):
    _, page = opened
    drawn = page.evaluate(
        """() => [...document.querySelectorAll('.uplot canvas')].map(c => {
            const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
            let ink = 0; for (let i = 3; i < d.length; i += 4) if (d[i] > 0) ink++;
            return ink;})"""
    )
    assert len(drawn) == 4
    assert min(drawn) > 500


def test_text_of_the_log_is_shown_and_never_run(opened):
    view, page = opened
    view.seek(0.0)
    until(page, lambda: page.locator('[data-gauge="message"]').count() == 1)
    assert "<script>" in gauge(page, "message")
    assert page.evaluate("window.hacked") is None


def test_a_screenshot_can_be_kept(opened, tmp_path):
    view, page = opened
    view.seek(22.0)
    until(page, lambda: page.inner_text(".tm-time").startswith("0:22"))
    page.evaluate("document.querySelector('.mantine-Notification-closeButton')?.click()")
    page.wait_for_timeout(500)
    path = screenshot_folder(tmp_path) / "view.png"
    page.screenshot(path=path, timeout=PATIENCE_MS)
    assert path.stat().st_size > 20_000
    assert re.match(r"\d+ %", gauge(page, "worst").split("\n")[1])
