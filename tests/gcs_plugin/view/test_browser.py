"""The page of a recorded flight as its reader has it, from a phone to a wide screen."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.browser import open_page, screenshot_folder
from tests.gcs_plugin.view.view_flight import flight
from thrustmargin.gcs_plugin.view.figures.charts import ReplayClock
from thrustmargin.gcs_plugin.view.replay_view import ReplayView
from thrustmargin.gcs_plugin.wording.answer import FlightAnswer
from thrustmargin.gcs_plugin.wording.palette import thrust_left
from thrustmargin.models.model.advice import FlightLevel
from thrustmargin.models.model.fault_test import RotorFault

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.browser
PATIENCE_MS = 100_000  # a browser without a graphics card on a busy machine
EVIL = "</script><script>window.hacked=1</script><img src=x onerror='window.hacked=1'>"
SIZES = ((390, 664), (390, 844), (820, 1180), (1024, 768), (1366, 768), (1920, 1080))
#: Of what a finger must hit: those that are in sight and too small.
SMALL = """[...document.querySelectorAll('#tm button, #tm select, #tm input')]
  .filter((one) => one.offsetParent).map((one) => [one.id || one.textContent,
    one.getBoundingClientRect()]).filter(([, box]) => Math.min(box.width, box.height) < 44)
  .map(([name]) => name)"""


@pytest.fixture(scope="module")
def analysis():
    return flight(name="square <b>1</b>.tlog")


@pytest.fixture(scope="module")
def opened(analysis) -> Iterator[tuple[ReplayView, Page]]:
    whole = FlightAnswer("THRUST LEFT BELOW THE 50 % LIMIT FOR 3 MIN", FlightLevel.OVER)
    view = ReplayView(analysis, messages=[(0.0, EVIL)], port=0, paused=True, whole=whole)
    view.start()
    try:
        with open_page(view.url, width=1366, height=768) as page:
            page.wait_for_selector("[data-rotor]")
            until(page, lambda: seen(page, thrust_left().screen(analysis.margin.min())) > 50)
            yield view, page
    finally:
        view.stop()


def clock(view: ReplayView) -> ReplayClock:
    """The clock of the page that asked last."""
    return view._tabs.all[-1].clock


def until(page: Page, done: Callable[[], bool]) -> None:
    """Give the page time until `done`."""
    for _ in range(PATIENCE_MS // 250):
        if done():
            return
        page.wait_for_timeout(250)
    raise AssertionError("the page did not get there in time")


def picture(page: Page) -> np.ndarray:
    """(H, W, 3) pixels of the scene."""
    from PIL import Image

    shot = page.locator("#root").screenshot(timeout=PATIENCE_MS)
    return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB")).astype(int)


def alike(page: Page, colour: np.ndarray, within: int = 6) -> np.ndarray:
    """(N, 2) row and column of the pixels of the scene that show a colour."""
    return np.argwhere(np.all(np.abs(picture(page) - colour.astype(int)) <= within, axis=-1))


def seen(page: Page, colour: np.ndarray) -> int:
    return len(alike(page, colour))


def left(page: Page, rotor: int) -> str | None:
    return page.text_content(f'[data-left="{rotor}"]')


def shown(margin: float) -> str:
    """A margin as the page shows it: what is below a limit also reads below it."""
    return f"{np.floor(100 * margin + 1e-6):.0f} %"


def show(page: Page, pane: str) -> None:
    """Press a tab; the widest screen shows all panes and has none."""
    page.locator(f"#tm-tabs [data-pane={pane}]").evaluate("one => one.click()")


def box_of(page: Page, selector: str) -> dict[str, float]:
    box = page.locator(selector).first.bounding_box()
    assert box, selector
    return {key: float(value) for key, value in box.items()}  # type: ignore[arg-type]


def test_screen_one_has_what_to_do_the_aircraft_and_the_tank_at_every_size(opened, tmp_path):
    view, page = opened
    view.ask(view._to_worst)
    folder = screenshot_folder(tmp_path)
    try:
        for width, height in SIZES:
            page.set_viewport_size({"width": width, "height": height})
            show(page, "aircraft" if width < 820 else "field")
            page.wait_for_timeout(300)
            cards = [f'[data-card="{key}"]' for key in ("tank", "empty", "lost", "battery")]
            rotors = [f'[data-rotor="{number}"]' for number in (1, 2, 3, 4)]
            for selector in ("#tm-headline", *rotors, *cards, "#tm-track"):
                box = box_of(page, selector)
                assert min(box["x"], box["y"]) >= 0, (width, selector)
                assert box["x"] + box["width"] <= width, (width, selector)
                assert box["y"] + box["height"] <= height, (width, selector)
            # Nothing lies over the last of them.
            low, floor = box_of(page, cards[2]), box_of(page, "#tm-time")["y"]
            assert low["y"] + low["height"] <= floor, width
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            assert page.evaluate(SMALL) == [], width
            page.screenshot(path=folder / f"replay-{width}x{height}.png", timeout=PATIENCE_MS)
            if width >= 820:
                scene, craft = box_of(page, "#root"), box_of(page, "#tm-aircraft")
                assert scene["x"] >= craft["x"] + craft["width"] - 1
                assert scene["width"] * scene["height"] > 0.2 * width * height
        page.set_viewport_size({"width": 390, "height": 844})
        show(page, "field")
        page.wait_for_timeout(300)
        scene = box_of(page, "#root")
        assert (scene["x"], scene["width"]) == (0, 390)
        assert scene["height"] > 300
        # viser's own panel is for who writes programs, and nothing here opens it.
        assert page.locator("#root .mantine-Paper-root:visible").count() == 0
        page.keyboard.press("Control+k")
        page.wait_for_timeout(300)
        assert page.get_by_text("Reset View").locator("visible=true").count() == 0
    finally:
        page.set_viewport_size({"width": 1366, "height": 768})
        show(page, "field")


def test_rotors_and_cards_are_of_the_row_of_the_timeline(opened, analysis):
    view, page = opened
    assert "kg at 1 kg/L" not in page.inner_text("[data-card=tank]")
    page.click("[data-card=tank]")  # bases and intervals are for who asks for them
    for row in (30, 222):
        view.seek(float(analysis.track.time_s[row]))
        until(
            page, lambda r=row: f"{analysis.track.tank_kg[r]:.1f} L" in page.inner_text("#tm-cards")
        )
        for i in range(4):
            assert left(page, i + 1) == shown(analysis.margin[row, i])
        assert "kg at 1 kg/L" in page.inner_text("[data-card=tank]")
        assert "3.70 V a cell" in page.inner_text("[data-card=battery]")
        worst = int(np.argmin(analysis.margin[row])) + 1
        assert f"worst {worst} " in page.inner_text("#tm-under")
    page.click("[data-card=tank]")
    assert "kg at 1 kg/L" not in page.inner_text("[data-card=tank]")
    above = page.get_attribute("#tm-above", "aria-label")
    assert above
    assert "Rotor 3, front left" in above


def test_the_timeline_keys_and_buttons_move_the_clock(opened, analysis):
    view, page = opened
    track = box_of(page, "#tm-track")
    page.mouse.click(track["x"] + 0.75 * track["width"], track["y"] + 22)
    until(page, lambda: abs(clock(view).now() - 0.75 * 39.9) < 1.0)
    view.seek(15.0)
    until(page, lambda: page.inner_text("#tm-time b") == "0:15")
    page.locator("#tm-aircraft").focus()
    page.keyboard.press("ArrowRight")
    until(page, lambda: abs(clock(view).now() - 25.0) < 0.1)
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("ArrowLeft")
    until(page, lambda: abs(clock(view).now() - 5.0) < 0.1)
    page.keyboard.press(" ")
    until(page, lambda: clock(view).playing)
    page.keyboard.press(" ")
    until(page, lambda: not clock(view).playing)
    page.select_option("#tm-speed", "5")
    until(page, lambda: clock(view).speed == 5)
    page.click("#tm-start")
    until(page, lambda: clock(view).playing)
    page.click("#tm-to-worst")
    worst = int(np.argmin(analysis.margin.min(axis=1)))
    until(page, lambda: abs(clock(view).now() - analysis.track.time_s[worst]) < 1e-6)
    assert not clock(view).playing
    rotor = int(np.argmin(analysis.margin[worst])) + 1
    until(page, lambda: left(page, rotor) == shown(analysis.margin.min()))


def test_an_answer_asked_before_a_key_was_pressed_does_not_undo_it(opened):
    view, page = opened
    view.seek(8.0)  # no time that the page showed before: it has this answer
    until(page, lambda: page.inner_text("#tm-time b") == "0:08")
    asked = []
    page.route("**/screen.json*", lambda route: asked.append((route, route.fetch())))
    try:
        until(page, lambda: len(asked) > 0)
        page.locator("#tm-aircraft").focus()
        page.keyboard.press("ArrowRight")
        until(page, lambda: len(asked) > 1)  # asked again once the press is done
        route, before_the_press = asked.pop(0)
        route.fulfill(response=before_the_press)
        page.wait_for_timeout(250)
        page.keyboard.press("ArrowRight")
        until(page, lambda: abs(clock(view).now() - 28.0) < 0.1)
    finally:
        page.unroute_all(behavior="ignoreErrors")
        page.reload()
    page.wait_for_selector("#tm-cards .tm-card")


def test_the_route_has_the_colours_of_the_legend_and_a_click_on_it_goes_to_its_time(
    opened, analysis
):
    view, page = opened
    view.seek(0.0)
    least = view._trail.route.worst(view._trail.values(0), "min")
    for value in np.quantile(least, [0.1, 0.9]):
        assert seen(page, thrust_left().screen(value)) > 30
    assert "50 % limit" in page.inner_text("#tm-legend")
    assert "no data" in page.inner_text("#tm-legend")
    scene = box_of(page, "#root")
    spots = alike(page, thrust_left().screen(np.quantile(least, 0.9)), within=3)
    row, column = spots[len(spots) // 2]
    page.mouse.click(float(scene["x"] + column), float(scene["y"] + row))
    until(page, lambda: clock(view).now() > 0.0)
    there = round(clock(view).now() / 0.1)
    assert analysis.margin[there].min() == pytest.approx(np.quantile(least, 0.9), abs=0.03)


def test_colours_and_cameras_can_be_chosen(opened):
    view, page = opened
    before = picture(page)
    page.select_option("#tm-colour", "Residual")
    until(page, lambda: "as predicted" in page.inner_text("#tm-legend"))
    until(page, lambda: np.mean(np.any(np.abs(picture(page) - before) > 40, axis=-1)) > 0.002)
    page.select_option("#tm-colour", "Thrust left")
    page.select_option("#tm-camera", "Follow, nose ahead")
    until(page, lambda: view._tabs.all[-1].scene.camera == "Follow, nose ahead")
    page.select_option("#tm-camera", "Whole field")
    until(page, lambda: "50 % limit" in page.inner_text("#tm-legend"))


def test_charts_draw_measured_and_predicted_speed(opened):
    view, page = opened
    view.seek(20.0)
    show(page, "charts")
    page.wait_for_selector("#tm-drawn figure:nth-child(4) svg")
    for line in ("measured", "predicted", "now"):
        drawn = page.locator(f"#tm-drawn .{line}")
        assert drawn.count() == 4
        assert "M" in (drawn.nth(2).get_attribute("d") or "")
    assert "3 front left" in page.inner_text("#tm-drawn")
    show(page, "field")


def test_names_and_texts_of_the_log_are_shown_and_never_run(opened):
    view, page = opened
    view.seek(0.0)
    until(page, lambda: EVIL in page.inner_text("#tm-more"))
    assert "square <b>1</b>.tlog" in page.inner_text("#tm-more")
    assert page.evaluate("window.hacked") is None


def test_a_rotor_found_bad_is_the_first_line_and_has_its_mark(opened):
    view, page = opened
    fault = RotorFault(kind="propeller", rotor=1, size=0.12, lower=0.09, upper=0.15)
    view._faults, view._fault_times = [(20.0, (fault,))], np.array([20.0])
    view.seek(25.0)
    until(page, lambda: "alarm then: rotor 2 rear left" in page.inner_text("#tm-headline"))
    assert page.get_attribute("#tm-head", "data-level") == "red"
    assert "BELOW THE 50" in page.inner_text("#tm-because")
    until(page, lambda: page.get_by_text("!", exact=True).count() == 1)
    view.seek(10.0)
    until(page, lambda: "BELOW" in page.inner_text("#tm-headline"))
    view._faults, view._fault_times = [], np.empty(0)


def test_at_night_and_in_german_it_says_the_same(opened):
    view, page = opened
    assert not page.evaluate("document.documentElement.hasAttribute('data-night')")
    page.emulate_media(color_scheme="dark")
    until(page, lambda: page.evaluate("document.documentElement.hasAttribute('data-night')"))
    page.emulate_media(color_scheme="light")
    page.click("#tm-night")
    assert page.evaluate("document.documentElement.hasAttribute('data-night')")
    page.goto(view.url + "/?lang=de")
    page.wait_for_selector("[data-rotor]")
    assert page.evaluate("document.documentElement.lang") == "de"
    assert page.evaluate("document.documentElement.hasAttribute('data-night')")
    assert "Ein Rotor darf ausfallen" in page.inner_text("#tm-cards")
    page.click("[data-card=tank]")
    assert "kg bei 1 kg/L" in page.inner_text("[data-card=tank]")
    above = page.get_attribute("#tm-above", "aria-label")
    assert above
    assert "Rotor 3, vorn links" in above


def test_a_laptop_does_not_move_the_pilots_phone(opened):
    """Neither the time nor the 3D scene: each browser has its own of both."""
    view, page = opened
    page.goto(view.url + "/?lang=en")  # the tab keeps the language of the test before
    page.wait_for_selector("[data-rotor]")
    view.seek(5.0)
    until(page, lambda: page.inner_text("#tm-time b") == "0:05")
    page.wait_for_function("window.tmClient !== undefined")
    page.wait_for_timeout(1500)
    before = picture(page)
    browser = page.context.browser
    assert browser is not None
    laptop = browser.new_page(viewport={"width": 1366, "height": 768})
    laptop.goto(view.url)
    laptop.wait_for_selector("[data-rotor]")
    laptop.wait_for_function("window.tmClient !== undefined")
    until(laptop, lambda: view._tabs.all[-1].scene is not None)
    laptop.select_option("#tm-colour", "Residual")
    laptop.select_option("#tm-camera", "Follow, nose ahead")
    laptop.locator("#tm-track input").fill("25")
    until(laptop, lambda: laptop.inner_text("#tm-time b") == "0:25")
    until(laptop, lambda: "as predicted" in laptop.inner_text("#tm-legend"))
    laptop.wait_for_timeout(1500)
    apart = np.any(np.abs(picture(laptop) - before) > 40, axis=-1)
    laptop.close()
    assert apart.mean() > 0.02  # it shows what it chose
    assert page.inner_text("#tm-time b") == "0:05"
    assert "50 % limit" in page.inner_text("#tm-legend")
    same = np.any(np.abs(picture(page) - before) > 40, axis=-1)
    assert same.mean() < 0.001
