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
from thrustmargin.gcs_plugin.view.figures.aircraft_figures import aircraft_figures, shown_margin
from thrustmargin.gcs_plugin.view.figures.screen import PageState, finite
from thrustmargin.gcs_plugin.view.figures.vehicle_summary import VehicleSummary
from thrustmargin.gcs_plugin.view.page.guard import guarded_server, stop_server
from thrustmargin.gcs_plugin.view.scene.shown_row import ShownRow
from thrustmargin.gcs_plugin.wording.alarm_words import margin_words
from thrustmargin.gcs_plugin.wording.answer import FlightAnswer
from thrustmargin.gcs_plugin.wording.check_words import remedy_words
from thrustmargin.gcs_plugin.wording.palette import css, thrust_left
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.advice import FlightLevel
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.statement import state

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
    return PageState(lambda _: list(standing), **options)


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
    if level != "red":
        assert replace(quiet, alarms=(LOW,)).first_line == (LOW.text, "The verdict", "red")
    sought = replace(quiet, pending="being sought").first_line
    assert sought == ("The verdict", "Do this", "grey" if level == "green" else level)


BAD = FlightAnswer(
    "ROTOR 4: 12 % LESS THRUST",
    FlightLevel.DAMAGED,
    "do not fly it before rotor 4 was looked at",
    rotors=(4,),
    brief="Do not fly",
    glance="DO NOT FLY: rotor 4",
)
SAYS = (
    "DO NOT FLY: rotor 4",
    "Rotor 4: 12 % less thrust · Do not fly it before rotor 4 was looked at",
    "red",
)
LANDED_US = 1_700_000_000_000_000


def landed(answer: FlightAnswer = BAD, **changes) -> VehicleSummary:
    """The aircraft on the ground after a flight of this answer, as a monitor has it."""
    track = hover(2.0, tank=0.0)
    on_ground = replace(track, flying=np.zeros_like(track.flying))
    update: Any = SimpleNamespace(
        answer=answer, landed_us=LANDED_US, outlook=None, airframe_remarks=(), takeoff=None
    )
    return replace(standing_of(on_ground), update=update, **changes)


@pytest.mark.parametrize("doubt", [{}, {"age": 4.0}, {"pending": "being sought"}])
def test_what_was_found_in_the_flight_does_not_end_with_a_gap_in_the_telemetry(doubt: dict):
    update: Any = SimpleNamespace(answer=BAD, landed_us=0, takeoff=None)
    late = replace(standing_of(hover(2.0, tank=0.0)), update=update, **doubt)
    assert late.first_line[0] == SAYS[0]
    assert late.first_line[1].startswith(SAYS[1])
    assert late.first_line[2] == "red"


SILENT = Alarm("telemetry", None, NOTICE, "No telemetry, last on the ground", 50.0)
ROTOR = Alarm("rotor", 4, CRITICAL, "Rotor 4 rear right 12% (9-15) less thrust: land", 40.0)
UNSURE = replace(ROTOR, state=AlarmState.UNCONFIRMED, missing=Missing.LINK)


def test_after_landing_the_answer_leads_whatever_the_link_does():
    """The pilot has landed: neither `land` nor a battery that is off is the news."""
    for alarms in ((ROTOR,), (UNSURE, SILENT), (UNSURE, SILENT, TANK)):
        one = landed(alarms=tuple(sorted(alarms, key=lambda a: a.order)))
        assert one.first_line == SAYS
        assert one.faulty == {4}
    fine = replace(BAD, level=FlightLevel.UNDER, glance="OK, 9.8 L next", rotors=())
    assert landed(fine, alarms=(SILENT,)).first_line[::2] == ("OK, 9.8 L next", "green")
    # Of a sound flight an alarm that is raised on the ground comes first.
    assert landed(fine, alarms=(TANK,)).first_line[0] == TANK.text


def test_the_answer_outlives_the_battery_until_somebody_has_seen_it():
    heard = [landed(alarms=(UNSURE, SILENT), gone=True, age=95.0, silent=95.0)]
    screen = PageState(lambda _: heard, clock=lambda: LANDED_US + 125_000_000)
    for _ in range(2):  # also when the page is loaded anew
        state = screen.state()
        assert (state["first"]["headline"], state["first"]["level"]) == (SAYS[0], "red")
        (shown,) = state["vehicles"]
        assert shown["landed"]["ago_s"] == 125
        assert shown["landed"]["unseen"]
        assert shown["old"]
        assert [alarm["text"] for alarm in state["alarms"]] == [ROTOR.text, SILENT.text]
        assert state["left"] == []
    screen.acknowledge()
    state = screen.state()
    assert (state["first"], state["vehicles"], state["alarms"]) == (None, [], [])
    assert [one["number"] for one in state["left"]] == [1]
    assert "seen" in [line["kind"] for line in state["history"]]
    # The next flight has an answer of its own, which nobody has seen.
    update: Any = SimpleNamespace(**{**vars(heard[0].update), "landed_us": LANDED_US + 900_000_000})
    heard[0] = replace(heard[0], update=update)
    assert screen.state()["first"]["headline"] == SAYS[0]


def test_of_several_aircraft_the_answer_of_one_is_seen_and_no_other():
    heard = [landed(), replace(landed(), number=2)]
    screen = PageState(lambda _: heard)
    may = f"{ACT}?token={given(screen)['token']}&do=acknowledge"
    for to, unseen in (("", [True, True]), ("&to=2", [True, False]), ("&to=1", [False, False])):
        assert status_of(screen, may + to) == 200
        shown = [one["landed"] for one in screen.state()["vehicles"]]
        assert [one is not None and one["unseen"] for one in shown] == unseen
    assert status_of(screen, may + "&to=x") == 400


def test_a_restarted_aircraft_keeps_its_answer_until_it_was_seen():
    heard = [landed()]
    screen = PageState(lambda _: heard)
    assert screen.state()["first"]["headline"] == SAYS[0]
    screen.acknowledge()
    assert screen.state()["first"]["headline"] != SAYS[0]


def test_in_the_air_the_alarm_says_what_to_do_now():
    flying = replace(standing_of(hover(2.0, tank=0.0)), alarms=(ROTOR,))
    assert flying.first_line == ("LAND: rotor 4 rear right", ROTOR.text, "red")
    assert replace(flying, alarms=(LOW,)).first_line == ("FLY GENTLY", LOW.text, "red")
    lost = Alarm("telemetry", None, CRITICAL, "Telemetry lost in flight", 39.0)
    both = tuple(sorted((lost, UNSURE), key=lambda a: a.order))
    headline, because, _ = replace(flying, alarms=both).first_line
    assert headline == "LAND: rotor 4 rear right"
    assert because.endswith(lost.text)


def test_a_replay_says_what_to_do_now_and_not_what_its_alarm_asked_then():
    then = replace(ROTOR, text="alarm then: rotor 4 rear right")
    for alarms in ((), (then,)):
        shown = replace(standing_of(hover(2.0, tank=0.0)), whole=BAD, alarms=alarms)
        headline, because, level = shown.first_line
        assert (headline, level) == (SAYS[0], "red")
        assert because == " · ".join([SAYS[1], *(a.text for a in alarms)])
        assert shown.faulty == {4}  # from the first moment on


def test_no_verdict_is_never_green():
    airframe_match = AirframeMatch(no_verdict=(state("not yet"),))
    track = hover(2.0)
    on_ground = replace(track, flying=np.zeros_like(track.flying))
    assert standing_of(on_ground, airframe_match=airframe_match).first_line[2] == "grey"


@pytest.mark.parametrize(
    ("left", "percent", "low"), [(0.496, 49, True), (0.5, 50, False), (0.5004, 50, False)]
)
def test_number_colour_and_alarm_of_a_margin_agree(left: float, percent: int, low: bool):
    """What an alarm calls below 50 % has the number and the colour of it, and nothing else has."""
    assert shown_margin(left, left, left)["percent"] == percent
    assert (percent < 50) == low
    said = margin_words("Thrust left", left, 0.5, ends=(left, left), rotor=None)
    assert f"{percent}%" in said
    papers = {side: css(thrust_left().screen(side)) for side in (0.496, 0.5, 0.5004)}
    assert (papers[left] == papers[0.496]) == low
    row = standing_of(hover(2.0, tank=0.0)).row
    assert row is not None
    use = np.full_like(row.analysis.track.rotor_speed_rpm, 1.0 - left)
    at = replace(row, analysis=replace(row.analysis, utilisation=use), low=None)
    (shown, *_) = aircraft_figures(at, 0.0)["rotors"]
    assert shown["percent"] == percent
    assert shown["paper"] == css(thrust_left().screen(left))


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
    airframe_match = AirframeMatch(no_verdict=(state("not yet"),))
    standing = standing_of(hover(2.0), airframe_match=airframe_match)
    (shown,) = screen_of(standing).state()["vehicles"]
    assert shown["figures"]["no_verdict"] == ["airframe not known yet: hover 5 s"]
    assert shown["figures"]["why"] == "airframe not known yet: hover 5 s"
    assert shown["figures"]["remedy"] == remedy_words(airframe_match)
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
        lambda _: standing, acknowledged=lambda number, a: heard.append((number, a.name))
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
    screen = screen_of(ONE, acts={"seek": lambda text, _: done.append(finite(text))})
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
