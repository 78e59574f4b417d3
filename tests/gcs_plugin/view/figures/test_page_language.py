"""Each browser reads the page in its own language, whatever the program's is; the link has one."""

import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.gcs_plugin.live.live_vehicle import log_frames
from thrustmargin.gcs_plugin.live.watch.update import WatchSettings
from thrustmargin.gcs_plugin.live.watch.vehicle_monitor import VehicleMonitor
from thrustmargin.gcs_plugin.view.live_view import LiveView
from thrustmargin.gcs_plugin.wording.language import Sentence, in_spoken, say, speaking
from thrustmargin.models.model.model_file import shipped_model


def test_a_sentence_is_in_the_language_of_who_reads_it(monkeypatch):
    monkeypatch.setenv("THRUSTMARGIN_LANGUAGE", "de")
    made = Sentence.of(lambda: say("fly gently"))
    assert made == "sanft fliegen"
    with speaking("en"):
        assert in_spoken(made) == "fly gently"
        assert in_spoken("a name") == "a name"
    assert in_spoken(made) == "sanft fliegen"


@pytest.fixture(scope="module")
def flown(sitl_logs: Path) -> Any:
    """The page over the first minute of a flight that is too heavy, and the alarms of the link."""
    vehicle = VehicleMonitor(1, shipped_model(), WatchSettings(airframe_given=False))
    view = LiveView(shipped_model().airframe, port=0)
    frames = [f for f in log_frames(sitl_logs / "campaign/v4_m16_q2.5.tlog") if f.system == 1]
    events = []
    for frame in frames[: len(frames) // 4]:
        vehicle.take(frame)
    for update in vehicle.updates():
        view.on_update(update)
        for event in update.events:
            view.on_event(1, event)
            events.append(event)
    fleet: Any = SimpleNamespace(vehicles={1: vehicle}, old_s=1e9)
    view.on_round(fleet, frames[len(frames) // 4 - 1].stamp_us)
    return view, events


def page(view: LiveView, language: str) -> dict[str, Any]:
    answer = view._screen.answer(f"/screen.json?lang={language}")
    assert answer is not None
    return json.loads(answer[1])


def test_alarms_history_and_gauges_are_in_the_readers_language(flown):
    view, events = flown
    (english,) = [event.alarm.text for event in events if event.alarm.name == "margin"]
    assert re.fullmatch(r"Thrust left \d\d% below 50%.*: fly gently", english)
    english_page, german_page = page(view, "en"), page(view, "de")
    for part in ("text", "line"):
        assert english_page["alarms"][0][part].startswith("Thrust left")
        assert german_page["alarms"][0][part].startswith("Schubreserve")
    assert english_page["history"][-1]["text"] == english
    assert german_page["history"][-1]["text"].endswith("sanft fliegen")
    assert german_page["first"]["because"].startswith("Schubreserve")
    (one,) = german_page["vehicles"]
    shown = [one["stale"], one["figures"]["airframe_match"], *one["figures"]["remarks"]]
    text = " ".join([*shown, german_page["field"]["legend"]["note"]])
    assert not re.search(r"\b(the|of|is|not|with|by|measured)\b", text), text
    assert [50.0, "Grenze 50 %"] in german_page["field"]["legend"]["marks"]
    assert [50.0, "50 % limit"] in english_page["field"]["legend"]["marks"]
