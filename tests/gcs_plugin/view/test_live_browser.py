"""The page of aircraft that fly now, fed through the whole monitor: one browser, one monitor."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from tests.browser import open_page, screenshot_folder
from tests.gcs_plugin.live.live_vehicle import Vehicle
from tests.gcs_plugin.view.live_flight import Live, flying

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.browser
LONG_MS = 100_000  # for a page that other programs keep from being drawn
SIZES = ((390, 664), (390, 844), (820, 1180), (1024, 768), (1366, 768), (1920, 1080))
#: In one look, for every report draws them anew.
BOXES = """["#tm-headline", "#tm-age", "button#tm-ack", "button#tm-sound", "[data-rotor='2']",
  "[data-card=tank]", "[data-card=lost]", "[data-card=battery]"]
  .map((one) => [one, document.querySelector(one).getBoundingClientRect().toJSON()])"""
SPY = """
window.sounds = 0; window.spoken = [];
window.AudioContext = class { constructor() { this.currentTime = 0; this.destination = {}; }
  createGain() { return {connect() {}}; }
  createOscillator() {
    return {frequency: {}, connect() {}, start() { window.sounds++; }, stop() {}}; } };
Object.defineProperty(window, "speechSynthesis",
  {value: {speak: (said) => window.spoken.push(said.text)}});
window.SpeechSynthesisUtterance = class { constructor(text) { this.text = text; } };
"""


@pytest.fixture(scope="module")
def opened() -> Iterator[tuple[Live, Page]]:
    with flying() as live, open_page(live.view.url, width=390, height=844, script=SPY) as page:
        yield live, page


def says(page: Page, selector: str, text: str) -> None:
    from playwright.sync_api import expect

    expect(page.locator(selector).first).to_contain_text(text, timeout=LONG_MS)


def left(rpm: int) -> str:
    """50 V by the ESCs: the ceiling is 3000 * 50/58.8 rpm."""
    return f"{math.floor(100 * (1 - (rpm * 58.8 / 50 / 3000) ** 2))} %"


def test_from_nothing_heard_to_an_alarm_that_is_known_and_back(opened, tmp_path):
    live, page = opened
    says(page, "#tm-headline", "No vehicle heard yet")
    says(page, "#tm-more", "messages")
    vehicle = Vehicle(7)
    with live.flown(vehicle) as throttle:
        says(page, "[data-left='3']", left(1700))
        says(page, "#tm-age", "live")
        page.click("#tm-sound")
        throttle.rpm, vehicle.height = 2300, 8.0  # what has so much more thrust climbs, or is held
        says(page, "#tm-headline", "FLY GENTLY")
        says(page, "#tm-because", "below 50%")
        says(page, "[data-left='3']", left(2300))
        page.wait_for_function("window.sounds >= 6 && window.spoken.length >= 1")
        folder = screenshot_folder(tmp_path)
        for width, height in SIZES:
            page.set_viewport_size({"width": width, "height": height})
            page.wait_for_timeout(400)
            page.screenshot(path=folder / f"live-{width}x{height}.png", timeout=LONG_MS)
            for selector, box in page.evaluate(BOXES):
                assert min(box["left"], box["top"]) >= 0, (width, selector)
                assert box["right"] <= width, (width, selector)
                assert box["bottom"] <= height, (width, selector)
                assert box["height"] >= (44 if "button" in selector else 10), (width, selector)
        page.set_viewport_size({"width": 390, "height": 844})
        page.click("#tm-ack")
        page.wait_for_selector("#tm-ack", state="hidden")
        page.click("#tm-tabs [data-pane=alarms]")
        says(page, "#tm-now", "(known)")
        says(page, "#tm-past", "known to the pilot")
        page.click("#tm-tabs [data-pane=charts]")
        says(page, "#tm-charts-state", "Charts: live")
        page.locator("#tm-back").fill("5")
        says(page, "#tm-charts-state", "NOT LIVE: 5 s ago")
        page.click("#tm-live")
        says(page, "#tm-charts-state", "Charts: live")
        throttle.rpm = None
        says(page, "#tm-headline", "Telemetry lost")
        says(page, "#tm-age", "Nothing heard for")
        says(page, "#tm-charts-state", "NOT LIVE: nothing new for")
        page.wait_for_selector(".tm-old")
        throttle.rpm = 1700
        says(page, "#tm-headline", "NEXT FILL")  # by the flight so far
        page.click("#tm-tabs [data-pane=aircraft]")
        says(page, "[data-left='3']", left(1700))
        page.set_viewport_size({"width": 390, "height": 664})
        page.wait_for_timeout(400)
        page.screenshot(path=folder / "live-so-far-390x664.png", timeout=LONG_MS)
        (lost,) = [box for one, box in page.evaluate(BOXES) if one == "[data-card=lost]"]
        assert lost["bottom"] <= 664


def test_of_two_vehicles_the_gravest_is_named_and_each_can_be_looked_at(opened):
    live, page = opened
    one, two = Vehicle(7), Vehicle(8)
    one.clock_s += 60.0  # later than before, or it would be another flight
    with live.flown(one, two):
        page.wait_for_selector("[data-vehicle='8']")
        box = page.locator("[data-vehicle='8']").bounding_box()
        assert box
        assert box["height"] >= 44
        page.click("[data-vehicle='8']")
        page.wait_for_selector("[data-vehicle='8'][aria-pressed=true]")
        says(page, "#tm-age", "Vehicle 8")


def test_a_page_whose_program_is_gone_says_so(opened):
    live, page = opened
    live.view.stop()
    says(page, "#tm-headline", "No connection for")
    assert page.get_attribute("#tm-head", "data-level") == "red"
