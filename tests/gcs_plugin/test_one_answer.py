"""Every surface says the same of one flight: the same first line, action and numbers."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.gcs_plugin.live.live_vehicle import log_frames
from tests.gcs_plugin.live.monitored import metrics_of
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.commands.flight.replay import replay_view
from thrustmargin.gcs_plugin.commands.shared.inputs import chosen_model
from thrustmargin.gcs_plugin.live.alarms.alarm import Alarm
from thrustmargin.gcs_plugin.live.watch.update import WatchSettings
from thrustmargin.gcs_plugin.live.watch.vehicle_monitor import VehicleMonitor
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.logs.log_answer import matched_flights
from thrustmargin.gcs_plugin.office.season.stored_words import flight_action, flight_reason
from thrustmargin.gcs_plugin.office.stations.mavproxy_worker import reading, summary
from thrustmargin.gcs_plugin.reports.margin.summary import report_flight
from thrustmargin.gcs_plugin.view.figures.vehicle_summary import VehicleSummary
from thrustmargin.gcs_plugin.view.scene.shown_row import ShownRow
from thrustmargin.gcs_plugin.wording.advice_words import action, headline
from thrustmargin.gcs_plugin.workshop.learn.season_flight import IngestSettings, season_flights
from thrustmargin.models.model.advice import FlightLevel, advise
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.fill_limits import before_take_off, largest_fills
from thrustmargin.models.model.model_file import shipped_model

FLIGHTS = ("onset/worn_prop_onset.tlog", "campaign/v4_m16_q2.5.tlog")


def plain(text: str) -> str:
    return " ".join(text.replace("\N{NO-BREAK SPACE}", " ").split())


@pytest.mark.slow
@pytest.mark.parametrize("name", FLIGHTS)
def test_report_page_json_console_replay_store_and_python_agree(
    sitl_logs: Path, tmp_path: Path, capsys, name: str
):
    path, page = sitl_logs / name, tmp_path / "r.html"
    assert run(["report", str(path), "--out", str(page)]) == 0
    console = plain(capsys.readouterr().out)
    verdict = json.loads(page.with_suffix(".json").read_text())["flights"][0]["verdict"]
    first, do = verdict["headline"], verdict["action"]
    assert plain(f"{path.name}: {first}") in console
    assert plain(f"what to do: {do}") in console
    shown = plain(page.read_text("utf-8"))
    assert first.lower() in shown.lower()
    assert plain(do[:1].upper() + do[1:]) in shown
    view = replay_view(path, shipped_model(), given=False, port=0, paused=True)
    assert view.whole is not None
    assert (view.whole.headline, view.whole.action) == (first, do)
    (stored,) = season_flights(path, "0" * 16, IngestSettings(store=""), name=path.name)
    assert stored.summary["verdict"] == verdict["level"]
    assert (flight_reason(stored.summary), flight_action(stored.summary)) == (first, do)
    advice = advise(analyse(read_log(path).track, shipped_model())).advice
    assert (headline(advice), action(advice)) == (first, do)
    bad = FlightLevel.DAMAGED in advice.levels
    assert (
        "no fill before the bad rotor or motor is repaired"
        if bad
        else f"{np.floor(advice.fill.kg * 10) / 10:.1f} kg"
    ) in do.lower()


@pytest.mark.parametrize("name", FLIGHTS)
def test_the_store_keeps_no_redundancy_of_a_flight_with_a_bad_rotor(sitl_logs: Path, name: str):
    (stored,) = season_flights(sitl_logs / name, "0" * 16, IngestSettings(store=""), name=name)
    bad = stored.summary["verdict"] == FlightLevel.DAMAGED
    assert bad == ("worn" in name)
    kept = stored.rows["redundancy_yaw_free"]
    assert np.any(kept >= 1.0) != bad
    assert np.isnan(stored.summary["fill_kg"]) == bad


def test_of_an_aircraft_that_is_not_known_live_says_what_the_report_says(sitl_logs: Path):
    """Terminal, page, bar, metrics and MAVProxy, once it has landed; in flight of the flight so
    far, without what its owner is asked."""
    path = sitl_logs / "campaign/v4_m10_q2.5.tlog"
    other = chosen_model(None, "agras-t20")
    ((log, airframe_match),) = matched_flights(path, other, given=False)
    reported = report_flight(
        analyse(log.track, other, airframe_match=airframe_match), log, max_utilisation=0.5
    )
    first = reported.json["verdict"]["headline"]
    assert first.startswith("Motors at ")
    vehicle = VehicleMonitor(1, other, WatchSettings(airframe_given=False, link="udpin:LINK"))
    frames = [frame for frame in log_frames(path) if frame.system == 1]
    half = len(frames) // 2
    for frame in frames[:half]:
        vehicle.take(frame)
    so_far = vehicle.updates()[-1].answer
    assert so_far is not None
    assert so_far.line.startswith("Flight to 1:47: Motors at ")
    (line,) = so_far.contact_lines
    assert line.startswith("motor outputs: median ")
    for frame in frames[half:]:
        vehicle.take(frame)
    last = vehicle.updates(final=True)[-1]
    answer = last.answer
    assert answer is not None
    assert (answer.headline, answer.brief) == (first, first)
    facts = {fact["label"]: fact["text"] for fact in reported.json["verdict"]["facts"]}
    said = dict(line.split(": ", 1) for line in answer.contact_lines)
    copied = {"to copy", "or be asked"}  # they name the link, and not the log
    assert said["or be asked"] == "thrustmargin airframe new --from udpin:LINK"
    assert {k: v for k, v in said.items() if k not in copied}.items() <= facts.items()
    assert set(said) >= {"motor outputs", "in the log", "--mass KG", *copied}
    assert f"  Last flight: {first}" in summary(reading(last, 0.0), 0.5, 0.0)
    contact = answer.contact
    assert contact is not None
    (_, share), *_ = metrics_of(vehicle)["thrustmargin_outputs_median_ratio"]
    assert share == contact.median_use
    notice = Alarm("airframe", None, 5, "NO VERDICT: airframe not known", 0.0)
    row = ShownRow(last.analysis, -1)
    page = VehicleSummary(number=1, row=row, update=last, alarms=(notice,))
    assert page.first_line == (first, "", "grey")
    low = Alarm("tank", None, 4, "Tank nearly empty", 0.0)
    assert replace(page, alarms=(low, notice)).first_line[0] == "Tank nearly empty"


def test_fill_says_before_the_flight_what_the_report_says_after_it(sitl_logs: Path):
    """In the air, on the battery and at the airspeed of the flight the fill is the same."""
    model = shipped_model()
    analysis = analyse(read_log(sitl_logs / "campaign/v4_m10_q2.5.tlog").track, model)
    # Of a question the air is known; of a flight it is not, which is kept back besides.
    sure = replace(analysis, redundancy_error=np.zeros_like(analysis.redundancy_error))
    after = advise(sure).advice.fill
    rows = np.flatnonzero(analysis.track.flying)
    lowest = rows[np.argmin(analysis.max_thrust[rows, 0])]
    asked = largest_fills(
        model,
        analysis.density[lowest],
        analysis.track.voltage[lowest],
        airspeed=float(np.median(analysis.track.airspeed[rows])),
    )
    before = before_take_off(asked, model)
    assert after.kg == pytest.approx(before.kg, abs=1e-6)
    assert after.reason == before.reason
