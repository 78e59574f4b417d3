"""The live view in a real browser, fed through the whole monitor; and the trail that it draws."""

import re
import socket
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.browser import open_page
from tests.gcs_plugin.live.live_vehicle import Vehicle
from tests.gcs_plugin.view.live_flight import AIRFRAME, Live, flying
from thrustmargin.gcs_plugin.live.alarms.alarm import CRITICAL, WARNING, Alarm
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.live.watch.outlook import Outlook
from thrustmargin.gcs_plugin.view.figures.live_html import (
    Standing,
    alarms_html,
    fleet_html,
    outlook_html,
    status_html,
)
from thrustmargin.gcs_plugin.view.live_view import LiveView
from thrustmargin.gcs_plugin.wording.palette import LOAD, seen_for
from thrustmargin.models.errors import LinkError
from thrustmargin.models.model.rotor_model import physics_model

if TYPE_CHECKING:
    from playwright.sync_api import Page

LONG_MS = 30_000  # for a page that other programs keep from being drawn


def shown(page: "Page", selector: str, timeout: float = 10.0) -> str:
    return page.locator(selector).first.inner_text(timeout=timeout * 1000)


def until(page: "Page", selector: str, words: str, live: Live, *vehicles: Vehicle, rpm: int) -> str:
    """Fly on until the page says `words`."""
    text = ""
    for _ in range(40):
        live.fly(0.3, *vehicles, rpm=rpm)
        if page.locator(selector).count():
            text = shown(page, selector)
            if words in text:
                return text
    raise AssertionError(f"{selector} never said {words!r}, but {text!r}")


@pytest.mark.browser
def test_the_page_follows_the_flight_and_says_when_it_is_old():
    from playwright.sync_api import expect

    def says(selector: str, text: str) -> None:
        box = page.locator(selector).first
        expect(box).to_contain_text(text, timeout=LONG_MS, use_inner_text=True)

    def number_of(selector: str, count: int) -> None:
        expect(page.locator(selector)).to_have_count(count, timeout=LONG_MS)

    vehicle = Vehicle(7)
    # 50 V by the ESCs: the ceiling is 3000 * 50/58.8 rpm.
    left = [round(100 * (1 - (rpm * 58.8 / 50 / 3000) ** 2)) for rpm in (1700, 2300)]
    with flying() as live, open_page(live.view.url) as page, live.flown(vehicle) as throttle:
        says('[data-gauge="worst"]', f"{left[0]} %")
        number_of("[data-alarm]", 0)
        assert "vehicle 7" in page.inner_text("body").lower()
        says("[data-remarks]", "tank by NAMED_VALUE_FLOAT TANK")
        says("[data-remarks]", "motor n taken to be on output n")
        throttle.rpm = 2300
        says('[data-gauge="worst"]', f"{left[1]} %")
        says("[data-alarm]", "below 50%")
        number_of("[data-old]", 0)
        throttle.rpm = None
        says("[data-age]", "no data for")
        number_of("[data-old]", 1)
        says("body", "Telemetry lost")
        throttle.rpm = 1700
        says('[data-gauge="worst"]', f"{left[0]} %")
        number_of("[data-old]", 0)


@pytest.mark.browser
def test_two_vehicles_have_a_tab_each_and_stand_where_they_are():
    with flying() as live, open_page(live.view.url) as page:
        one, two = Vehicle(1), Vehicle(2)
        live.fly(3.0, one, two)
        tab = page.get_by_role("tab", name="Vehicle 2").first
        box = tab.bounding_box()
        assert box is not None
        assert box["height"] >= 40  # px: for a gloved finger
        tab.click()
        until(page, "body", "· vehicle 2", live, one, two, rpm=1700)
        assert page.locator("[data-fleet]").count() == 2
        # The other one loses thrust: reported on this page too.
        for _ in range(40):
            for vehicle, rpm in ((one, 2300), (two, 1700)):
                for frame in vehicle.tick(rpm=(rpm,) * 4):
                    live.socket.sendto(frame.data, live.address)
            time.sleep(0.1)
        assert "Vehicle 1: Thrust margin" in page.inner_text("body")
        assert "messages" in shown(page, "[data-status]")


@pytest.mark.slow
@pytest.mark.browser
def test_an_aircraft_that_was_switched_off_leaves_the_page_and_may_return(monkeypatch):
    monkeypatch.setattr("thrustmargin.gcs_plugin.live.watch.vehicle_monitor.GONE", 2.0)
    with flying() as live, open_page(live.view.url) as page:
        one, two = Vehicle(1), Vehicle(2)
        live.fly(2.0, one, two)
        page.get_by_role("tab", name="Vehicle 2").first.wait_for()
        # Away from the full second, in which its next message would say that it flies.
        two.clock_s = round(two.clock_s) + 0.3
        live.socket.sendto(two.landed(1), live.address)
        live.fly(0.3, one, two, rpm=0)
        live.fly(5.0, one)
        page.wait_for_timeout(1000)
        assert page.get_by_role("tab", name="Vehicle 2").count() == 0
        assert page.get_by_role("tab", name="Vehicle 1").count() == 1
        two.clock_s += 5.0
        for _ in range(30):
            live.socket.sendto(two.landed(2), live.address)
            live.fly(0.1, one, two)
        page.get_by_role("tab", name="Vehicle 2").first.wait_for()


def test_what_is_heard_is_drawn_and_greyed_out_when_it_is_old():
    """Without a browser: rows, alarms of all and the trail in its overlay's colours."""
    fleet, one, two = Fleet(physics_model(AIRFRAME)), Vehicle(1), Vehicle(2)
    view = LiveView(AIRFRAME, port=0)
    view.start()

    def fly(rpm: int) -> None:
        for _ in range(60):
            for vehicle, speed in ((one, rpm), (two, 1700)):
                fleet.take(list(vehicle.tick(rpm=(speed,) * 4)))
            for update in fleet.updates():
                view.on_update(update)
        view.on_round(fleet, max(int(u.stamp_us[-1]) for u in stamps()))

    def stamps():
        return [watch.last for watch in fleet.vehicles.values() if watch.last is not None]

    def shows(number: int, words: str) -> None:
        end = time.monotonic() + 5.0
        while words not in getattr(
            getattr(view._aircraft.get(number), "gauges", None), "content", ""
        ):
            assert time.monotonic() < end, words
            time.sleep(0.02)

    try:
        fly(1700)
        shows(1, "· vehicle 1")
        fly(2400)
        shows(1, "Thrust margin")
        shows(2, "Vehicle 1: Thrust margin")
        assert "data-old" not in view._aircraft[1].gauges.content
        end = time.monotonic() + 5.0
        line: Any = None
        while not (line := view._scene._api.get_handle_by_name("/world/route_1")):
            assert time.monotonic() < end
            time.sleep(0.02)
        view._colour_trail(view._aircraft[1])
        trail = view._aircraft[1].trail
        load = trail.route.worst(trail.values(0), "max")
        assert load.max() == pytest.approx((2400 * 58.8 / 50 / 3000) ** 2, rel=1e-3)
        wanted = LOAD.screen(load).astype(int)
        assert np.abs(seen_for(line.colors[:, 0]).astype(int) - wanted).max() <= 4
        view.on_round(fleet, max(int(u.stamp_us[-1]) for u in stamps()) + 7_000_000)
        shows(1, "no data for 7 s")
        shows(1, "data-old")
    finally:
        view.stop()


def test_the_bar_says_what_the_gauges_say_and_the_airframe_is_named_once(monkeypatch):
    fleet, vehicle = Fleet(physics_model(AIRFRAME)), Vehicle(1)
    view = LiveView(AIRFRAME, port=0)

    def fly(rpm: int) -> None:
        for _ in range(30):
            fleet.take(list(vehicle.tick(rpm=(rpm,) * 4)))
            for update in fleet.updates():
                view.on_update(update)
        view.on_round(fleet, vehicle.stamp_us)

    def margins() -> tuple[str, str]:
        gauge = re.search(r'data-gauge="worst".*?class="big">([^<]*)<', gauges(), re.DOTALL)
        assert gauge
        return gauge[1], view._bar.state()["vehicles"][0]["margin"]

    def gauges() -> str:
        return getattr(getattr(view._aircraft.get(1), "gauges", None), "content", "")

    view.start()
    try:
        fly(1700)
        end = time.monotonic() + 5.0
        while "data-gauge" not in gauges():
            assert time.monotonic() < end
            time.sleep(0.02)
        time.sleep(0.3)
        assert gauges().count(f"airframe {AIRFRAME.name}, given") == 1
        monkeypatch.setattr(view, "_show", lambda *_: None)  # drawing is late
        before = margins()
        assert before[0] == before[1]
        fly(2400)
        assert margins() == before
        assert view._bar.state()["vehicles"][0]["age"] == pytest.approx(3.0, abs=0.2)
    finally:
        view.stop()


COMPARE = """() => {
  window.seen = [];
  const look = () => {
    const bar = document.querySelector('.tm-one b');
    const gauge = document.querySelector('[data-gauge="worst"] .big');
    if (bar && gauge) window.seen.push([bar.textContent, gauge.textContent]);
    requestAnimationFrame(look);
  };
  requestAnimationFrame(look);
}"""


@pytest.mark.browser
def test_bar_and_gauge_have_one_margin_in_every_frame_of_the_page():
    with flying() as live, open_page(live.view.url) as page:
        vehicle = Vehicle(7)
        until(page, '[data-gauge="worst"]', "%", live, vehicle, rpm=1700)
        until(page, ".tm-one", "%", live, vehicle, rpm=1700)
        page.evaluate(COMPARE)
        for turn in range(30):
            live.fly(0.2, vehicle, rpm=1700 + 20 * turn)
        seen = page.evaluate("window.seen")
    assert len({gauge for _, gauge in seen}) > 3
    assert [bar.removeprefix("OLD: ") for bar, _ in seen] == [gauge for _, gauge in seen]


def test_a_taken_port_is_an_error():
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(LinkError, match="port"):
        LiveView(AIRFRAME, port=taken.getsockname()[1]).start()


def test_text_of_alarms_and_status_is_never_markup():
    nasty = "<img src=x onerror=alert(1)>"
    alarm = Alarm("margin", None, WARNING, nasty, 0.0)
    fleet = [Standing(number=1, alarms=(alarm,), problem=nasty)]
    for html in (alarms_html(1, fleet), status_html([nasty])):
        assert "<img" not in html
        assert "&lt;img" in html


def test_the_page_of_one_aircraft_shows_the_alarms_of_all_gravest_first():
    """A pilot sees one tab; a bad propeller of another aircraft must not hide behind it."""
    margin = Alarm("margin", None, WARNING, "Thrust margin 46% below 50%: rotor 2", 0.0)
    rotor = Alarm("rotor", 3, CRITICAL, "Rotor 3 makes 10% less thrust", 0.0)
    fleet = [Standing(number=1, alarms=(rotor,)), Standing(number=2, alarms=(margin,))]
    html = alarms_html(2, fleet)
    assert html.index("Vehicle 1: Rotor 3") < html.index("Thrust margin 46%")
    assert "Vehicle 2" not in html
    left = [replace(fleet[0], gone=True), fleet[1]]
    assert "Rotor 3" not in alarms_html(2, left)


def test_many_alarms_leave_room_for_the_numbers_and_the_gravest_are_kept():
    alarms = [
        Alarm("rotor", k, CRITICAL if k == 6 else WARNING, f"alarm {k}", 0.0) for k in range(7)
    ]
    html = alarms_html(1, [Standing(number=1, alarms=tuple(alarms))])
    assert html.count("data-alarm") == 4
    assert "alarm 6" in html
    assert "and 3 more" in html


def test_each_aircraft_has_a_bar_with_its_margin_unless_that_is_old():
    one = Standing(number=1, margin=0.534, tank_kg=9.0, flying=True)
    two = Standing(number=2, margin=0.1, flying=True, age=7.0, silent=7.0)
    three = Standing(number=3, margin=1.0, tank_kg=4.0)
    assert fleet_html([one]) == ""
    html = fleet_html([one, two, three])
    bars = [words_of(part) for part in html.split("data-fleet=")[1:]]
    assert "53 %" in bars[0]
    assert "9.0 kg" in bars[0]
    assert "no data 7 s" in bars[1]
    assert "10 %" not in bars[1]
    late = fleet_html([one, replace(two, silent=0.1)])
    assert "7 s old" in words_of(late)
    assert "no data" not in words_of(late)
    # Rotors at rest have all their thrust left, which says nothing.
    assert "on ground" in bars[2]
    assert "100 %" not in bars[2]
    shared = replace(one, problem="two vehicles send as system 1")
    assert "no margin" in fleet_html([shared, two])
    assert "Vehicle 1: two vehicles send" in alarms_html(2, [shared, two])
    assert 'data-fleet="3"' not in fleet_html([one, two, replace(three, gone=True)])


def words_of(html: str) -> str:
    return re.sub(r"<[^>]*>", " ", html)


def test_a_recording_that_fails_is_shouted():
    quiet, loud = status_html(["7 messages"]), status_html(["NOT RECORDING: No space left"])
    assert "background" not in quiet
    assert "background" in loud


def test_unknown_outlooks_are_left_out_and_not_made_up():
    assert "empty" not in outlook_html(Outlook())
    assert "margin" not in outlook_html(Outlook())
    known = outlook_html(Outlook(seconds_to_empty=125.0, full=lambda: 0.43))
    assert "empty in 2:05" in known
    assert "&lt;i>" in outlook_html(Outlook(), "", ["tank by <i>"]).replace("&gt;", ">")
    assert "43 %" in known
