"""The live view without a browser: what the monitor hears is drawn, and what the page is told."""

import json
import re
import socket
from typing import Any

import numpy as np
import pytest

from tests.gcs_plugin.live.live_vehicle import Vehicle
from tests.gcs_plugin.view.live_flight import AIRFRAME
from tests.gcs_plugin.wording.seen_colours import seen_for
from tests.waiting import until
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.view.live_view import LiveView
from thrustmargin.gcs_plugin.view.page import view_page
from thrustmargin.gcs_plugin.wording.palette import thrust_left
from thrustmargin.models.errors import LinkError
from thrustmargin.models.model.rotor_model import physics_model

NO_DATA = (165, 165, 165)  # grey
CHARTS = "/screen/charts.json"


class Heard:
    """A view of vehicles whose messages reach it without a link."""

    def __init__(self, *vehicles: Vehicle) -> None:
        self.fleet, self.vehicles = Fleet(physics_model(AIRFRAME)), vehicles
        self.view = LiveView(AIRFRAME, port=0, status=lambda: ["7 messages"])

    def fly(self, *rpm: int, ticks: int = 60) -> None:
        for _ in range(ticks):
            for vehicle, speed in zip(self.vehicles, rpm, strict=True):
                self.fleet.take(list(vehicle.tick(rpm=(speed,) * 4)))
            for update in self.fleet.updates():
                self.view.on_update(update)
        self.later(0.0)

    def later(self, seconds: float) -> None:
        """A look at the ages, with nothing heard since."""
        last = (watch.last for watch in self.fleet.vehicles.values())
        now_us = max(int(update.stamp_us[-1]) for update in last if update is not None)
        self.view.on_round(self.fleet, now_us + round(seconds * 1e6))

    def node(self, name: str) -> Any:
        return self.view._scene._api.get_handle_by_name(name)


@pytest.fixture
def heard():
    made = Heard(Vehicle(1), Vehicle(2))
    made.view.start()
    yield made
    made.view.stop()


@pytest.mark.slow
def test_what_is_heard_is_drawn_and_greyed_out_when_it_is_old(heard):
    view = heard.view
    heard.fly(1700, 1700)
    heard.fly(2400, 1700)
    until(lambda: heard.node("/world/route_1") is not None)
    until(lambda: heard.node("/world/vehicle_1/discs") is not None)
    view._colour_trail(view._aircraft[1], view._tabs.shared)
    trail = view._aircraft[1].trail
    left = trail.route.worst(trail.values(0), "min")
    assert left.min() == pytest.approx(1 - (2400 * 58.8 / 50 / 3000) ** 2, rel=1e-3)
    wanted = thrust_left().screen(left).astype(int)
    drawn = seen_for(heard.node("/world/route_1").colors[:, 0]).astype(int)
    assert np.abs(drawn - wanted).max() <= 4

    def discs() -> np.ndarray:
        return seen_for(heard.node("/world/vehicle_1/discs").batched_colors).astype(int)

    assert np.abs(discs() - NO_DATA).max() > 40
    heard.later(7.0)
    until(lambda: np.abs(discs() - NO_DATA).max() <= 4)
    shown = view._screen.state()["vehicles"][0]
    assert shown["old"]
    assert shown["age"] == pytest.approx(7.0, abs=0.2)


@pytest.mark.slow
def test_the_page_is_told_of_all_and_the_gravest_is_its_first_line(heard):
    heard.fly(2400, 1700, ticks=100)
    state = heard.view._screen.state()
    one, two = (v["figures"] for v in state["vehicles"])
    # 50 V by the ESCs: the ceiling is 3000 * 50/58.8 rpm.
    for figures, rpm in ((one, 2400), (two, 1700)):
        left = 1 - (rpm * 58.8 / 50 / 3000) ** 2
        assert [r["left"] for r in figures["rotors"]] == pytest.approx([left] * 4, abs=1e-3)
        assert f"airframe {AIRFRAME.name}, given" in figures["airframe_match"]
    assert state["first"]["vehicle"] == 1
    assert state["first"]["headline"] == "FLY GENTLY"
    assert state["status"] == ["7 messages"]
    assert "tank by NAMED_VALUE_FLOAT TANK" in " ".join(one["remarks"])
    json.dumps(state, allow_nan=False)


def test_charts_are_of_the_aircraft_asked_for_and_say_how_far_they_look_back(heard):
    heard.fly(1700, 1700)

    def charts(query: str) -> dict:
        answer = heard.view._screen.answer(f"{CHARTS}?{query}")
        assert answer is not None
        assert answer[0] == 200
        return json.loads(answer[1])

    now = charts("vehicle=2&back=0")
    assert [one["place"] for one in now["charts"]] == list(AIRFRAME.rotor_names)
    assert (now["back"], now["age"]) == (0.0, 0.0)
    assert charts("vehicle=2&back=3")["back"] == pytest.approx(3.0, abs=0.5)
    heard.later(9.0)
    assert charts("vehicle=2&back=0")["age"] == pytest.approx(9.0, abs=0.5)
    assert charts("vehicle=7&back=0") == {"charts": []}


def test_colour_camera_and_aircraft_can_be_chosen_and_nonsense_is_refused(heard):
    heard.fly(1700, 1700)
    until(lambda: len(heard.view._aircraft) == 2)
    acts = heard.view._screen._acts
    acts["colour"]("Residual", "")
    acts["camera"]("Follow, north up", "")
    acts["follow"]("2", "")
    until(lambda: heard.view._screen.state()["field"]["colour"] == "Residual")
    until(lambda: heard.view._screen.state()["field"]["camera"] == "Follow, north up")
    until(lambda: heard.view._screen.state()["follow"] == 2)
    acts["colour"]("<script>", "")
    acts["follow"]("9", "")
    for name, wrong in (("camera", "<script>"), ("follow", "x")):
        with pytest.raises(ValueError, match=r"."):
            acts[name](wrong, "")
    assert heard.view._screen.state()["follow"] == 2


@pytest.mark.slow
def test_an_aircraft_that_was_switched_off_leaves_the_page_and_may_return(heard, monkeypatch):
    monkeypatch.setattr("thrustmargin.gcs_plugin.live.watch.vehicle_monitor.GONE", 2.0)
    heard.fly(1700, 1700)
    until(lambda: len(heard.view._aircraft) == 2)
    monkeypatch.setattr(
        type(heard.fleet.vehicles[2]), "has_left", lambda self, _: self.system == 2, raising=True
    )
    heard.later(0.1)
    until(lambda: not heard.node("/world/vehicle_2").visible)
    assert [v["number"] for v in heard.view._screen.state()["vehicles"]] == [1]
    monkeypatch.undo()
    heard.fly(1700, 1700)
    until(lambda: heard.node("/world/vehicle_2").visible)
    assert len(heard.view._screen.state()["vehicles"]) == 2


def test_a_taken_port_is_an_error():
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(LinkError, match="port"):
        LiveView(AIRFRAME, port=taken.getsockname()[1]).start()


def test_the_colour_that_one_browser_chose_is_its_own(heard):
    heard.fly(1700, 1700)
    screen = heard.view._screen
    screen._acts["colour"]("Residual", "laptop")
    screen._acts["camera"]("Follow, nose ahead", "laptop")
    until(lambda: screen.state("laptop")["field"]["colour"] == "Residual")
    until(lambda: screen.state("laptop")["field"]["camera"] == "Follow, nose ahead")
    for tab in ("phone", ""):
        field = screen.state(tab)["field"]
        assert (field["colour"], field["camera"]) == ("Thrust left", "Whole field")


def waiting(**options) -> dict[str, Any]:
    """What the page is told before the first message."""
    view = LiveView(AIRFRAME, port=0, listens=("udpin:0.0.0.0:14550",), **options)
    view.start()
    try:
        return view._screen.state()["waiting"]
    finally:
        view.stop()


def test_before_the_first_message_the_page_says_where_it_listens_and_how_a_phone_opens_it(
    monkeypatch,
):
    alone = waiting()
    assert list(alone["listens"]) == ["udpin:0.0.0.0:14550"]
    assert (alone["page"], alone["open"], alone["option"]) == (None, False, "--host 0.0.0.0")
    monkeypatch.setattr(view_page, "network_address", lambda _: "192.0.2.7")
    shown = waiting(host="0.0.0.0", token="of-this-link")["page"]
    assert re.fullmatch(r"http://192\.0\.2\.7:\d+/\?token=of-this-link", shown["url"])
    assert shown["code"].startswith("<svg")
    monkeypatch.setattr(view_page, "network_address", lambda _: None)
    nowhere = waiting(host="0.0.0.0", token="of-this-link")
    assert (nowhere["page"], nowhere["open"]) == (None, True)


def test_once_a_vehicle_is_heard_nobody_needs_the_code(heard):
    heard.fly(1700, 1700)
    assert "waiting" not in heard.view._screen.state()
