"""The page's state and its door: alarms and first line, ages, acknowledgement, what it may ask."""

import http.client
import json
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.gcs_plugin.live.alarms.test_alarms import hover
from tests.gcs_plugin.live.monitored import MODEL
from thrustmargin.gcs_plugin.live.alarms.alarm import Alarm, AlarmEvent, AlarmState, Missing
from thrustmargin.gcs_plugin.view.figures.screen import PageState, finite
from thrustmargin.gcs_plugin.view.figures.vehicle_summary import VehicleSummary
from thrustmargin.gcs_plugin.view.page.guard import guarded_server, stop_server
from thrustmargin.gcs_plugin.view.scene.shown_row import ShownRow
from thrustmargin.gcs_plugin.wording.answer import FlightAnswer
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.advice import FlightLevel
from thrustmargin.models.model.airframe_claim import AirframeClaim
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.rotor_model import RotorModel

#: As the code has them, written down by hand: a change there is to be seen here.
CRITICAL = 2
NOTICE = 5
WARNING = 4

STATE, CHARTS, ACT = "/screen.json", "/screen/charts.json", "/screen/act"
LOW = Alarm("margin", None, CRITICAL, "Margin 12 %, limit 50 %", 40.0)
TANK = Alarm("tank", None, WARNING, "Tank gauge and pump disagree", 41.0)
NOTE = Alarm("esc", 2, NOTICE, "ESC 2 silent", 42.0)
ONE = VehicleSummary(number=1, age=0.3, alarms=(TANK, NOTE))


def screen_of(*standing: VehicleSummary, **options) -> PageState:
    return PageState(lambda: list(standing), **options)


def given(screen: PageState) -> dict:
    """What the page's script is given when it is served."""
    found = re.search(r"spoken} = ({.*});", screen.insert.decode())
    assert found
    return json.loads(found[1])


def status_of(screen: PageState, target: str) -> int:
    answer = screen.answer(target)
    assert answer is not None
    return answer[0]


def standing_of(track: FlightTrack, model: RotorModel = MODEL, **options) -> VehicleSummary:
    """The aircraft at the last row of a track, as a monitor that gets it has it."""
    row = ShownRow(analyse(track, model, **options), -1)
    return replace(ONE, row=row, alarms=())


def test_the_gravest_alarm_comes_first_whose_ever_it_is():
    state = screen_of(ONE, replace(ONE, number=2, alarms=(LOW,))).state()
    assert [(a["vehicle"], a["text"]) for a in state["alarms"]] == [
        (2, "Margin 12 %, limit 50 %"),
        (1, "Tank gauge and pump disagree"),
        (1, "ESC 2 silent"),
    ]
    assert [a["loud"] for a in state["alarms"]] == [True, True, False]
    assert [a["level"] for a in state["alarms"]] == ["red", "amber", "grey"]
    first = {"vehicle": 2, "headline": LOW.text, "because": "", "level": "red"}
    assert state["first"] == first


def test_every_grave_alarm_is_named_in_the_first_line():
    lost = Alarm("telemetry", None, CRITICAL, "Telemetry lost in flight", 39.0)
    grave = replace(ONE, alarms=(lost, LOW, TANK, NOTE))
    assert grave.first_line == (lost.text, LOW.text, "red")
    assert ONE.first_line == (TANK.text, "", "amber")
    unconfirmed = replace(TANK, state=AlarmState.UNCONFIRMED, missing=Missing.GAUGE)
    assert replace(ONE, alarms=(unconfirmed,)).first_line[1] == unconfirmed.line


@pytest.mark.parametrize(
    ("verdict", "level"),
    [
        ("damaged", "red"),
        ("lost", "red"),
        ("battery", "red"),
        ("no_thrust", "red"),
        ("critical", "red"),
        ("over", "amber"),
        ("near", "amber"),
        ("under", "green"),
    ],
)
def test_a_verdict_is_the_first_line_until_an_alarm_is(verdict: str, level: str):
    whole = FlightAnswer("The verdict", FlightLevel(verdict), "do this")
    quiet = replace(ONE, alarms=(), whole=whole)
    assert quiet.first_line == ("The verdict", "Do this", level)
    assert replace(quiet, alarms=(LOW,)).first_line == (LOW.text, "", "red")
    sought = replace(quiet, pending="being sought").first_line
    assert sought == ("The verdict", "Do this", "grey" if level == "green" else level)


@pytest.mark.parametrize("doubt", [{}, {"age": 4.0}, {"pending": "being sought"}])
def test_what_was_found_in_the_flight_does_not_end_with_a_gap_in_the_telemetry(doubt: dict):
    bad = FlightAnswer("ROTOR 4 IS BAD", FlightLevel.DAMAGED, "land", brief="Do not fly")
    update: Any = SimpleNamespace(answer=bad)
    late = replace(standing_of(hover(2.0, tank=0.0)), update=update, **doubt)
    assert late.first_line == ("ROTOR 4 IS BAD", "Do not fly", "red")


def test_no_alarm_is_green_only_over_thrust_that_is_measured_and_enough():
    light = hover(2.0, tank=0.0)
    sure = standing_of(light)
    assert sure.first_line == ("", "", "green")
    silent = light.rotor_speed_rpm * [1.0, np.nan, 1.0, 1.0]
    assert standing_of(replace(light, rotor_speed_rpm=silent)).first_line[2] == "grey"
    assert standing_of(replace(light, rotor_speed_rpm=silent * np.nan)).first_line[2] == "grey"
    assert standing_of(hover(2.0, tank=16.0)).first_line[2] == "grey"
    for doubt in ({"age": 2.0}, {"problem": "two send as one"}, {"pending": "being sought"}):
        assert replace(sure, **doubt).first_line[2] == "grey"
    assert ONE_WITHOUT_ROWS.first_line[2] == "grey"


ONE_WITHOUT_ROWS = replace(ONE, alarms=())


def test_without_a_verdict_the_page_is_told_why():
    claim = AirframeClaim(withheld=("airframe not known yet: hover 5 s",))
    standing = standing_of(hover(2.0), claim=claim)
    (shown,) = screen_of(standing).state()["vehicles"]
    assert shown["figures"]["withheld"] == [claim.withheld[0]]
    assert shown["figures"]["why"] == claim.withheld[0]
    assert shown["figures"]["remedy"] == claim.remedy
    assert standing.first_line[2] == "grey"


def test_ages_are_of_what_flies_and_those_that_left_are_gone():
    (shown,) = screen_of(ONE).state()["vehicles"]
    assert (shown["age"], shown["old"]) == (0.3, False)
    assert screen_of(replace(ONE, age=2.0)).state()["vehicles"][0]["old"]
    assert screen_of(ONE, recorded=True).state()["vehicles"][0]["age"] is None
    assert screen_of(replace(ONE, gone=True)).state()["vehicles"] == []
    assert screen_of(replace(ONE, gone=True)).state()["first"] is None


def test_a_line_of_the_plan_stands_in_the_history():
    screen = screen_of(ONE)
    screen.note(1, "plan", "leg to item 5: 23 s (22 s)")
    line = screen.state()["history"][0]
    assert (line["vehicle"], line["kind"]) == (1, "plan")
    assert line["text"] == "leg to item 5: 23 s (22 s)"


def test_an_acknowledgement_is_of_what_stands_and_is_kept():
    heard = []
    standing = [ONE]
    screen = PageState(
        lambda: standing, acknowledged=lambda number, a: heard.append((number, a.name))
    )
    screen.on_event(1, AlarmEvent(TANK, AlarmState.CLEARED, 41.0))
    screen.acknowledge()
    screen.acknowledge()
    assert heard == [(1, "tank"), (1, "esc")]
    assert all(a["acknowledged"] for a in screen.state()["alarms"])
    standing[0] = replace(ONE, alarms=(replace(TANK, since_s=90.0),))
    assert not screen.state()["alarms"][0]["acknowledged"]
    lines = [(one["vehicle"], one["kind"], one["text"]) for one in screen.state()["history"]]
    assert lines == [
        (1, "acknowledged", "ESC 2 silent"),
        (1, "acknowledged", "Tank gauge and pump disagree"),
        (1, "raised", "Tank gauge and pump disagree"),
    ]


def test_only_the_page_itself_may_act_and_only_as_it_can():
    done = []
    screen = screen_of(ONE, acts={"seek": lambda text: done.append(finite(text))})
    assert screen.answer("/index.html") is None
    for token in ("", "token=&", "token=ü&"):
        assert status_of(screen, f"{ACT}?{token}do=acknowledge") == 403
    assert not screen.state()["alarms"][0]["acknowledged"]
    may = f"{ACT}?token={given(screen)['token']}"
    for wrong in ("", "&do=fly", "&do=seek", "&do=seek&to=nan", "&do=seek&to=inf", "&do=seek&to=x"):
        assert status_of(screen, may + wrong) == 400
    assert done == []
    assert status_of(screen, may + "&do=seek&to=12.5") == 200
    assert done == [12.5]
    assert status_of(screen, may + "&do=acknowledge") == 200
    assert screen.state()["alarms"][0]["acknowledged"]
    assert status_of(screen, STATE) == 200
    assert status_of(screen, f"{CHARTS}?vehicle=x") == 400


def test_the_page_is_whole_for_a_client_of_any_encoding():
    screen = screen_of(ONE)
    server = guarded_server(port=0, addition=screen)
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
            assert page.count(screen.insert) == 1
            assert page.rstrip().endswith(b"</html>")
            ask.close()  # the server waits for it when it stops
    finally:
        stop_server(server)


def test_the_page_is_given_every_language_and_whether_it_may_sound():
    assert given(screen_of(silent=True))["silent"]
    assert not given(screen_of())["silent"]
    assert given(screen_of(recorded=True))["silent"]
    assert {*given(screen_of())["catalogues"]} == {"en", "de"}
