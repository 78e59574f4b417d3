"""The pilot's bar as another program reads it, over HTTP."""

import http.client
import json
import re
import socket

import pytest

from tests.browser import open_page
from tests.gcs_plugin.live.live_vehicle import Vehicle
from thrustmargin.gcs_plugin.live.alarms.alarm import Alarm
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.live.pilot_bar import PilotBar
from thrustmargin.models.errors import LinkError
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

WARNING = 4  # MAV_SEVERITY
MODEL = physics_model(load_airframe("topxgun-f16-sitl"))


class Ground:
    """A monitored flight of one vehicle with rotor 3 hardest at work, and the bar of it."""

    def __init__(self) -> None:
        self.now_us = 0
        self.fleet, vehicle = Fleet(MODEL), Vehicle()
        for _ in range(30):
            self.fleet.take(vehicle.tick(rpm=(2000, 2000, 2300, 2000)))
            self.fleet.updates()
        alarm = Alarm("margin", None, WARNING, "Thrust left 18% below 50%, rotor 3", 0.0)
        self.fleet.vehicles[1].alarms.listed[alarm.key] = alarm
        self.heard_us = vehicle.stamp_us
        self.now_us = self.heard_us + 400_000
        self.bar = PilotBar(lambda: self.now_us, limit=0.5, port=0, host="127.0.0.1")
        self.bar.start()

    def get(self, path: str, method: str = "GET") -> tuple[int, dict[str, str], bytes]:
        connection = http.client.HTTPConnection("127.0.0.1", self.bar.port, timeout=100)
        connection.request(method, path)
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read()


@pytest.fixture(scope="module")
def ground():
    made = Ground()
    yield made
    made.bar.close()


def test_before_anything_is_heard_there_is_no_vehicle():
    assert PilotBar(lambda: 0, limit=0.5, port=0, host="127.0.0.1").content()["vehicles"] == []


def test_margin_rotor_action_and_age(ground: Ground):
    ground.now_us = ground.heard_us + 400_000
    ground.bar.on_round(ground.fleet, ground.now_us)
    whole = json.loads(ground.get("/bar.json")[2])
    assert whole["limit"] == 50.0  # %
    (one,) = whole["vehicles"]
    # 3000 rpm at 58.8 V, and the ESCs report 50 V.
    assert one["margin"] == pytest.approx(100 * (1 - (2300 / (3000 * 50 / 58.8)) ** 2), abs=0.1)
    assert (one["rotor"], one["action"], one["age_s"]) == (3, "fly gently", 0.4)


def test_the_bar_keeps_the_colour_of_too_little_until_three_points_above_the_limit():
    fleet, vehicle = Fleet(MODEL), Vehicle()
    bar = PilotBar(lambda: vehicle.stamp_us, limit=0.5, port=0, host="127.0.0.1")
    shown = []
    for rpm in (1767, 1830, 1767, 1730, 1767):  # 52, 48, 52, 54 and 52 % left of 2551 rpm
        for _ in range(15):
            fleet.take(vehicle.tick(rpm=(rpm,) * 4))
            fleet.updates()
        bar.on_round(fleet, vehicle.stamp_us)
        (one,) = bar.content()["vehicles"]
        shown.append((round(one["margin"]), one["low"]))
    assert shown == [(52, False), (49, True), (52, True), (54, False), (52, False)]


def test_what_is_old_is_no_margin(ground: Ground):
    ground.bar.on_round(ground.fleet, ground.now_us)
    ground.now_us = ground.heard_us + 3_100_000
    (one,) = json.loads(ground.get("/bar.json")[2])["vehicles"]
    assert (one["margin"], one["predicted"], one["rotor"], one["action"]) == (None, None, None, "")
    assert one["age_s"] == pytest.approx(3.1)
    assert one["last_margin"] > 0.0


def test_blueos_finds_the_service_and_cockpit_its_widget(ground: Ground):
    status, headers, body = ground.get("/register_service")
    service = json.loads(body)
    assert (status, headers["Content-Type"]) == (200, "application/json")
    assert {"name", "description", "icon", "company", "version", "webpage", "api"} <= set(service)
    assert service["extras"] == {"cockpit": "/cockpit_extras.json"}
    extras = json.loads(ground.get(service["extras"]["cockpit"])[2])
    assert {"targetSystem", "targetCockpitApiVersion", "widgets", "actions"} <= set(extras)
    assert extras["targetSystem"] == "Cockpit"
    (widget,) = extras["widgets"]
    for path in (widget["iframeUrl"], widget["iframeIcon"]):
        assert ground.get(path)[0] == 200
    assert "X-Frame-Options" not in ground.get("/")[1]  # Cockpit shows it in a frame
    assert "VERSION" not in widget["version"]


@pytest.mark.parametrize("path", ["/..%2fDockerfile", "/Dockerfile", "/../bar.html", "/x"])
def test_nothing_else_is_served_and_nothing_is_taken(ground: Ground, path: str):
    assert ground.get(path)[0] == 404
    assert ground.get("/bar.json", "POST")[0] == 501


def test_a_taken_port_is_one_line():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        bar = PilotBar(lambda: 0, limit=0.5, port=taken.getsockname()[1], host="127.0.0.1")
        with pytest.raises(LinkError, match="give another port"):
            bar.start()


@pytest.mark.browser
def test_the_widget_shows_the_bar_and_turns_grey_when_nothing_comes():
    ground = Ground()
    ground.bar.on_round(ground.fleet, ground.now_us)
    with open_page(f"http://127.0.0.1:{ground.bar.port}/") as page:
        page.wait_for_selector(".low .fill")
        # A busy machine draws it late.
        assert re.search(r"Thrust left 18%, rotor 3 \(\d+ s old\)", page.inner_text(".one"))
        assert page.inner_text(".action") == "fly gently"
        # In one go: the page draws itself anew four times a second.
        share = page.evaluate(
            "() => document.querySelector('.fill').offsetWidth"
            " / document.querySelector('.bar').clientWidth"
        )
        assert share == pytest.approx(0.187, abs=0.01)
        ground.bar.close()  # the monitor's computer is gone
        page.wait_for_selector(".stale", timeout=8000)
        assert "Thrust left unknown, was 18%" in page.inner_text(".one")
        assert page.locator(".fill").count() == 0
