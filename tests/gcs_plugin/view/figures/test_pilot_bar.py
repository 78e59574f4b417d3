"""The bar of the live page: its state, its door, and what a pilot sees of it at every width."""

import http.client
import io
import math
import re
import time
from dataclasses import replace

import numpy as np
import pytest

from tests.browser import open_page, screenshot_folder
from tests.gcs_plugin.live.alarms.test_alarms import hover
from tests.gcs_plugin.live.live_vehicle import Vehicle
from tests.gcs_plugin.live.monitored import MODEL
from tests.gcs_plugin.view.live_flight import flying
from thrustmargin.gcs_plugin.live.alarms.alarm import (
    CRITICAL,
    NOTICE,
    WARNING,
    Alarm,
    AlarmEvent,
    AlarmState,
)
from thrustmargin.gcs_plugin.view.figures.live_html import Standing
from thrustmargin.gcs_plugin.view.figures.pilot_bar import ACKNOWLEDGE, STATE, PilotBar
from thrustmargin.gcs_plugin.view.page.guard import guarded_server, stop_server
from thrustmargin.gcs_plugin.view.scene.shown_row import ShownRow
from thrustmargin.gcs_plugin.wording.palette import MARGIN, css
from thrustmargin.gcs_plugin.wording.view_words import WORST_ROTOR
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.airframe_claim import AirframeClaim
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.rotor_model import RotorModel

LOW = Alarm("margin", None, CRITICAL, "Margin 12 %, limit 50 %", 40.0)
TANK = Alarm("tank", None, WARNING, "Tank gauge and pump disagree", 41.0)
NOTE = Alarm("esc", 2, NOTICE, "ESC 2 silent", 42.0)
ONE = Standing(number=1, margin=0.27, coloured=0.27, flying=True, age=0.3, alarms=(TANK, NOTE))


def bar_of(*standing: Standing) -> PilotBar:
    return PilotBar(lambda: standing)


def token_of(bar: PilotBar) -> str:
    found = re.search(r'token = "([^"]+)"', bar.insert.decode())
    assert found
    return found[1]


def status_of(bar: PilotBar, target: str) -> int:
    answer = bar.answer(target)
    assert answer is not None
    return answer[0]


def test_the_gravest_alarm_comes_first_whose_ever_it_is():
    other = replace(ONE, number=2, alarms=(LOW,))
    state = bar_of(ONE, other).state()
    assert [a["text"] for a in state["alarms"]] == [
        "Vehicle 2: Margin 12 %, limit 50 %",
        "Vehicle 1: Tank gauge and pump disagree",
        "Vehicle 1: ESC 2 silent",
    ]
    assert [a["loud"] for a in state["alarms"]] == [True, True, False]


def test_every_grave_alarm_is_named_and_the_rest_are_counted():
    lost = Alarm("telemetry", None, CRITICAL, "Telemetry lost in flight: fly by sight", 39.0)
    state = bar_of(replace(ONE, alarms=(lost, LOW, TANK, NOTE))).state()
    assert state["named"] == "Telemetry lost in flight · Margin 12 %, limit 50 %"
    assert state["unnamed"] == 2
    calm = bar_of(ONE).state()
    assert (calm["named"], calm["unnamed"]) == ("Tank gauge and pump disagree", 1)
    assert bar_of(replace(ONE, alarms=())).state()["named"] == ""


def test_a_margin_is_shown_in_flight_only_and_with_its_age():
    (shown,) = bar_of(ONE).state()["vehicles"]
    assert (shown["margin"], shown["age"], shown["old"]) == ("27 %", 0.3, False)
    (ground,) = bar_of(replace(ONE, flying=False)).state()["vehicles"]
    assert ground["margin"] == "on the ground"
    (unsure,) = bar_of(replace(ONE, problem="another aircraft")).state()["vehicles"]
    assert (unsure["margin"], unsure["caption"]) == ("no verdict", "another aircraft")
    assert bar_of(replace(ONE, age=2.0)).state()["vehicles"][0]["old"]
    assert bar_of(replace(ONE, gone=True)).state()["vehicles"] == []


@pytest.mark.parametrize(("margin", "calm"), [(0.5, True), (0.49, False), (math.nan, False)])
def test_no_alarm_is_green_only_over_a_margin_that_is_enough(margin: float, calm: bool):
    quiet = replace(ONE, margin=margin, coloured=margin, alarms=())
    assert bar_of(quiet).state()["vehicles"][0]["watched"] is calm
    assert bar_of(replace(quiet, flying=False)).state()["vehicles"][0]["watched"]


def standing_of(track: FlightTrack, model: RotorModel = MODEL, **options) -> Standing:
    """The aircraft at the last row of a track, as a monitor that gets it has it."""
    row = ShownRow(analyse(track, model, **options), -1)
    return replace(
        ONE, margin=row.worst[0], coloured=row.coloured_margin, rests_on=row.rests_on, alarms=()
    )


def test_a_margin_that_was_not_measured_says_so_and_gets_no_colour_of_enough_thrust():
    light = hover(2.0, tank=0.0)
    (sure,) = bar_of(standing_of(light)).state()["vehicles"]
    assert (sure["caption"], sure["watched"]) == (WORST_ROTOR, True)
    silent = light.rotor_speed_rpm * [1.0, np.nan, 1.0, 1.0]
    (part,) = bar_of(standing_of(replace(light, rotor_speed_rpm=silent))).state()["vehicles"]
    assert part["caption"] == f"{WORST_ROTOR}, 1 rotor not measured"
    nothing = replace(light, rotor_speed_rpm=silent * np.nan)
    (predicted,) = bar_of(standing_of(nothing)).state()["vehicles"]
    assert predicted["caption"].startswith("worst rotor, predicted")
    assert predicted["margin"] == sure["margin"]
    grey = css(MARGIN.screen(float("nan")))
    assert part["paper"] == predicted["paper"] == grey != sure["paper"]
    assert not part["watched"]
    assert not predicted["watched"]
    # Too little is coloured whatever it rests on.
    heavy = hover(2.0, tank=16.0)
    low = standing_of(replace(heavy, rotor_speed_rpm=heavy.rotor_speed_rpm * np.nan))
    assert bar_of(low).state()["vehicles"][0]["paper"] not in (grey, sure["paper"])


def test_without_a_verdict_the_bar_says_why():
    claim = AirframeClaim(withheld=("airframe not known yet: hover 5 s",))
    (shown,) = bar_of(standing_of(hover(2.0), claim=claim)).state()["vehicles"]
    assert (shown["margin"], shown["caption"]) == ("no verdict", claim.withheld[0])
    assert not shown["watched"]


def test_an_acknowledgement_is_of_what_stands_and_is_kept():
    heard = []
    standing = [ONE]
    bar = PilotBar(lambda: standing, acknowledged=lambda number, a: heard.append((number, a.name)))
    bar.on_event(1, AlarmEvent(TANK, AlarmState.CLEARED, 41.0))
    bar.acknowledge()
    bar.acknowledge()
    assert heard == [(1, "tank"), (1, "esc")]
    assert all(a["acknowledged"] for a in bar.state()["alarms"])
    standing[0] = replace(ONE, alarms=(replace(TANK, since_s=90.0),))
    assert not bar.state()["alarms"][0]["acknowledged"]
    lines = [re.sub(r"^[\d:]{8} ", "", line) for line in bar.state()["history"]]
    assert lines == [
        "vehicle 1, acknowledged: ESC 2 silent",
        "vehicle 1, acknowledged: Tank gauge and pump disagree",
        "vehicle 1, raised: Tank gauge and pump disagree",
    ]


def test_only_the_page_itself_may_acknowledge():
    bar = bar_of(ONE)
    assert bar.answer("/index.html") is None
    for target in (ACKNOWLEDGE, f"{ACKNOWLEDGE}?token=", f"{ACKNOWLEDGE}?token=ü"):
        assert status_of(bar, target) == 403
    assert not bar.state()["alarms"][0]["acknowledged"]
    assert status_of(bar, f"{ACKNOWLEDGE}?token={token_of(bar)}") == 200
    assert bar.state()["alarms"][0]["acknowledged"]
    assert status_of(bar, STATE) == 200


def test_the_page_is_whole_for_a_client_of_any_encoding():
    bar = bar_of(ONE)
    server = guarded_server(port=0, addition=bar)
    try:
        for headers in ({}, {"Accept-Encoding": "gzip"}):
            ask = http.client.HTTPConnection("127.0.0.1", server.get_port(), timeout=30)
            ask.putrequest("GET", "/", skip_accept_encoding=True)
            for name, value in headers.items():
                ask.putheader(name, value)
            ask.endheaders()
            reply = ask.getresponse()
            page = reply.read()
            assert reply.status == 200
            assert page.count(bar.insert) == 1
            assert page.rstrip().endswith(b"</html>")
    finally:
        stop_server(server)


def test_a_silent_page_has_no_sound():
    assert b"silent = true" in PilotBar(list, silent=True).insert
    assert b"silent = false" in PilotBar(list).insert


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


def contrast(picture: bytes) -> float:
    """Of the darkest and the lightest pixel, as WCAG 2 has it."""
    from PIL import Image

    pixels = np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")).reshape(-1, 3)
    colours, counts = np.unique(pixels, axis=0, return_counts=True)
    share = colours[counts > 10] / 255.0
    linear = np.where(share <= 0.03928, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    light = linear @ (0.2126, 0.7152, 0.0722)
    return float((light.max() + 0.05) / (light.min() + 0.05))


@pytest.mark.browser
@pytest.mark.slow
def test_at_every_width_margin_age_and_alarm_stay_in_sight(tmp_path):
    folder = screenshot_folder(tmp_path)
    with flying() as live:
        vehicle = Vehicle(1)
        live.fly(3.0, vehicle)
        with open_page(live.view.url, width=390, height=844, script=SPY) as page:
            page.get_by_text("Sound off").click()
            live.fly(4.0, vehicle, rpm=2400)
            page.wait_for_function("document.title.startsWith('!')", timeout=20_000)
            assert page.evaluate("window.sounds") >= 6  # the try-out, and the alarm
            assert page.evaluate("window.spoken.length") >= 1
            for width, height in ((390, 844), (820, 1180), (1024, 768), (1366, 768), (1920, 1080)):
                page.set_viewport_size({"width": width, "height": height})
                live.fly(1.0, vehicle, rpm=2400)
                for selector in (".tm-one", "#tm-alarm", "#tm-ack"):
                    box = page.locator(selector).first.bounding_box()
                    assert box, (width, selector)
                    assert box["x"] >= 0
                    assert box["x"] + box["width"] <= width
                    assert box["y"] >= 0
                    assert box["y"] + box["height"] <= 0.4 * height
                    assert box["height"] >= 44
                page.wait_for_function(
                    "document.querySelector('.tm-one').innerText.includes('%')", timeout=10_000
                )
                assert contrast(page.locator("#tm-alarm").screenshot()) >= 4.5
                assert contrast(page.locator(".tm-one").screenshot()) >= 4.5
                page.screenshot(path=folder / f"live-{width}.png")
            page.locator("#tm-ack").click()
            page.get_by_text("History").click()
            page.wait_for_function(
                "document.getElementById('tm-history').innerText.includes('acknowledged')",
                timeout=10_000,
            )
            time.sleep(3.0)  # nothing is sent any more
            page.wait_for_function(
                "document.querySelector('.tm-one b').innerText.startsWith('OLD')", timeout=10_000
            )
            page.screenshot(path=folder / "live-old-1920.png")
            live.view.stop()
            page.wait_for_function(
                "document.getElementById('tm-alarm').innerText.includes('NO CONNECTION')",
                timeout=15_000,
            )


@pytest.mark.browser
def test_on_a_phone_the_map_is_in_sight_until_the_controls_are_asked_for():
    with flying() as live:
        live.fly(1.0, Vehicle())
        with open_page(live.view.url, width=390, height=844) as page:
            camera = page.get_by_text("Camera", exact=True)
            camera.wait_for(state="attached")
            camera.wait_for(state="hidden")
            page.get_by_text("thrustmargin", exact=True).click()
            camera.wait_for(state="visible")
