"""The alarms of a long flight come after its picture; until then the page says that they do."""

import threading

import numpy as np
import pytest

from tests.browser import open_page
from tests.gcs_plugin.view.view_flight import flight
from tests.waiting import PATIENCE, until
from thrustmargin.gcs_plugin.view import replay_view
from thrustmargin.gcs_plugin.view.replay_view import ReplayView
from thrustmargin.gcs_plugin.wording.answer import FlightAnswer
from thrustmargin.models.model.advice import FlightLevel
from thrustmargin.models.model.fault_test import RotorFault

ALARMS_SOUGHT = "alarms still being looked for"
ALARMS_UNKNOWN = "alarms are not known: this flight could not be searched for them"
FAULT = RotorFault(kind="propeller", rotor=1, size=0.12, lower=0.09, upper=0.15)


@pytest.fixture
def search(monkeypatch) -> threading.Event:
    """Set: the search of a flight that counts as long, with nobody waited for, ends."""
    over = threading.Event()

    def history(_analysis):
        assert over.wait(PATIENCE)
        return [(20.0, (FAULT,))]

    monkeypatch.setattr(replay_view, "SEARCHED_FIRST", 0)
    monkeypatch.setattr(replay_view, "NOBODY_S", 0.0)
    monkeypatch.setattr(replay_view, "PICTURE_S", 0.0)
    monkeypatch.setattr(replay_view, "fault_history", history)
    return over


@pytest.fixture
def view(search):
    view = ReplayView(
        flight(), port=0, paused=True, whole=FlightAnswer("Enough thrust", FlightLevel.UNDER)
    )
    view.start()
    view.seek(25.0)
    yield view
    search.set()
    view.stop()


def test_it_is_open_before_the_search_ends_and_calls_nothing_good_till_then(view, search):
    until(lambda: view.clock.now() == 25.0)
    first = {"vehicle": 1, "headline": "Enough thrust", "because": ALARMS_SOUGHT, "level": "grey"}
    until(lambda: view._screen.state()["first"] == first)
    assert not view._screen.state()["alarms"]
    search.set()
    until(lambda: view._screen.state()["first"]["level"] == "red")
    assert "otor 2" in view._screen.state()["first"]["headline"]
    until(lambda: view._screen.state()["vehicles"][0]["pending"] == "")  # set behind the alarms
    view.seek(10.0)  # before it was found
    until(lambda: view._screen.state()["first"]["level"] == "green")


def test_a_bad_verdict_does_not_wait_for_the_search(search):
    view = ReplayView(
        flight(), port=0, paused=True, whole=FlightAnswer("Too heavy", FlightLevel.CRITICAL)
    )
    view.start()
    try:
        assert view._screen.state()["first"]["level"] == "red"
    finally:
        search.set()
        view.stop()


@pytest.mark.usefixtures("search")
def test_a_search_that_breaks_is_said_and_never_shown_as_no_alarm(monkeypatch):
    monkeypatch.setattr(replay_view, "fault_history", lambda _: 1 / 0)
    view = ReplayView(flight(), port=0, paused=True)
    view.start()
    try:
        until(lambda: view._screen.state()["first"]["because"] == ALARMS_UNKNOWN)
    finally:
        view.stop()


def test_nobody_need_open_the_page_for_the_search_to_begin(search, monkeypatch):
    monkeypatch.setattr(replay_view, "NOBODY_S", 0.3)
    search.set()
    view = ReplayView(flight(), port=0, paused=True)
    view.start()
    try:
        assert view._screen.state()["vehicles"][0]["pending"] == ALARMS_SOUGHT
        until(lambda: not view._screen.state()["vehicles"][0]["pending"])
        np.testing.assert_array_equal(view._fault_times, [20.0])
    finally:
        view.stop()


@pytest.mark.browser
def test_a_browser_that_opens_the_page_begins_the_search(search, monkeypatch):
    monkeypatch.setattr(replay_view, "NOBODY_S", 1000.0)
    search.set()
    view = ReplayView(flight(), port=0, paused=True)
    view.start()
    try:
        with open_page(view.url, width=1366, height=768):
            until(lambda: not view._screen.state()["vehicles"][0]["pending"])
    finally:
        view.stop()
