"""One aircraft, one day and one mission: every surface has one fill, level, colour and action.

Three questions have three fills, and the words and keys say which: the battery at its lowest in a
flight, the battery as at its start, and the battery at rest before a take-off along a plan.
"""

import json
import math
from pathlib import Path

import pytest

from tests.gcs_plugin.live.live_vehicle import log_frames
from tests.gcs_plugin.live.monitored import metrics_of
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.commands.flight.replay import replay_view
from thrustmargin.gcs_plugin.live.announce import figures
from thrustmargin.gcs_plugin.live.watch.update import WatchSettings
from thrustmargin.gcs_plugin.live.watch.vehicle_monitor import VehicleMonitor
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.office.season.stored_words import flight_action
from thrustmargin.gcs_plugin.reports.fill.fill_table import fill_table
from thrustmargin.gcs_plugin.wording.fill_words import safe_kg
from thrustmargin.gcs_plugin.workshop.learn.season_flight import IngestSettings, season_flights
from thrustmargin.mission.day_fill import day_fill
from thrustmargin.models.model.advice import Advice, advise
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
from thrustmargin.models.model.flight_day import day_before_take_off
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.physics.day import Day, DaySource, DayValue, complete_day, merged

NAME = "campaign/v4_m16_q2.5.tlog"
STILL = DayValue(0.0, DaySource.OPTION)


@pytest.fixture(scope="module")
def path(sitl_logs: Path) -> Path:
    return sitl_logs / NAME


@pytest.fixture(scope="module")
def analysis(path: Path) -> FlightAnalysis:
    return analyse(read_log(path).track, shipped_model())


@pytest.fixture(scope="module")
def advice(analysis: FlightAnalysis) -> Advice:
    return advise(analysis).advice


@pytest.fixture(scope="module")
def verdict(path: Path, tmp_path_factory: pytest.TempPathFactory) -> dict:
    file = tmp_path_factory.mktemp("report") / "r.json"
    assert run(["report", str(path), "--json", str(file)]) == 0
    return json.loads(file.read_text())["flights"][0]["verdict"]


def still(day: Day) -> Day:
    """The day with what a fill asks besides: a wind, gusts, a capacity."""
    known = Day(wind=STILL, gusts=STILL, battery_capacity_ah=DayValue(16.0, DaySource.LOG))
    return complete_day(51.8, merged(known, day))


def test_the_report_names_the_battery_that_its_fill_is_for(verdict):
    assert "at most 8.6 kg (8.6 L) with the battery at 3:32 of this flight: " in verdict["action"]
    assert verdict["fill"]["kg"] == 8.6
    loaded = verdict["fill"]["day"]["loaded_voltage"]
    assert (loaded["source"], loaded["at_s"]) == ("log", 212.5)
    assert verdict["fill"]["day"]["air_temperature_c"]["source"] == "log"
    assert verdict["fill"]["fresh_day"]["loaded_voltage"]["at_s"] < 40.0


@pytest.mark.slow
def test_live_replay_store_bar_and_metrics_have_the_reports_answer(path, verdict):
    stored, *_ = season_flights(path, "0" * 16, IngestSettings(store=""), name=path.name)
    view = replay_view(path, shipped_model(), given=False, port=0, paused=True)
    vehicle = VehicleMonitor(1, shipped_model(), WatchSettings(airframe_given=True))
    for frame in log_frames(path):
        if frame.system == 1:
            vehicle.take(frame)
    last = vehicle.updates(final=True)[-1]
    assert last.answer is not None
    assert view.whole is not None
    fills = {
        "report": verdict["fill"]["kg"],
        "store": stored.summary["fill_kg"],
        "replay": view.whole.fill_kg,
        "live": last.answer.fill_kg,
        "announced": figures(last)["NEXT_FILL"],
        "metrics": metrics_of(vehicle)["thrustmargin_next_fill_kg"][0][1],
    }
    assert set(fills.values()) == {8.6}, fills
    levels = {verdict["level"], stored.summary["verdict"], view.whole.level, last.answer.level}
    assert levels == {"critical"}
    actions = {
        verdict["action"],
        flight_action(stored.summary),
        view.whole.action,
        last.answer.action,
    }
    assert len(actions) == 1, actions
    assert last.answer.brief == "Next fill: at most 8.6 kg, battery as at 3:32"


@pytest.mark.parametrize("which", ["day", "fresh_day"])
def test_fill_for_the_day_of_a_report_is_the_reports_fill(analysis, advice, which):
    """The battery at its lowest, and as at the start."""
    fill = advice.fill
    asked = still(getattr(fill, which))
    made = day_fill(analysis.model, asked).fill
    assert made.kg == pytest.approx(fill.kg if which == "day" else fill.fresh_kg, abs=1e-6)
    table = fill_table(
        analysis.model, asked, limit=0.5, rotor_lost=True, temperatures_c=(15.0,), altitudes=(0.0,)
    )
    assert safe_kg(table.fill) == safe_kg(made)
    assert table.level == "under"


def test_forecast_and_fill_of_one_day_name_it_alike_and_agree(analysis, path, tmp_path, capsys):
    """Along the plan it is never more than in steady flight, and little less."""
    file = tmp_path / "f.json"
    assert run(["forecast", str(path), "--fill", "8", "--json", str(file)]) == 0
    text = capsys.readouterr().out
    made = json.loads(file.read_text())
    rest, ohm = (made["day"][key] for key in ("battery_voltage", "battery_resistance_mohm"))
    assert (rest["value"], rest["source"]) == (58.8, "log")
    assert ohm["source"] == "log"
    assert "home is given without" not in text
    assert "the nose points along" not in text  # the log has its heading before take-off
    day = complete_day(
        51.8,
        day_before_take_off(analysis),
        Day(battery_capacity_ah=DayValue(16.0, DaySource.LOG)),
    )
    steady = day_fill(analysis.model, day).fill
    assert 0.0 <= steady.kg - made["fill_kg"] < 1.0
    named = "with the battery of this log, 58.8 V at rest, 13 °C, 1 013 hPa, no wind: "
    assert f"Fill at most {made['fill_kg']:.1f} kg ({made['fill_kg']:.1f} L) {named}" in text


def test_the_default_of_all_commands_is_one(tmp_path, capsys):
    """A plan without a known battery, and `fill`: hot still air at sea level, half a battery."""
    plan = tmp_path / "field.plan"
    assert run(["cover", "demo", "--swath", "5", "--out", str(plan)]) == 0
    capsys.readouterr()
    assert run(["fill", "--airframe", "topxgun-f16-sitl", "--json", "-"]) == 0
    asked = json.loads(capsys.readouterr().out)
    craft = ("--airframe", "topxgun-f16-sitl")
    assert run(["forecast", str(plan), "--fill", "2", *craft, "--json", "-"]) == 0
    made = json.loads(capsys.readouterr().out)
    for key in ("air_temperature_c", "wind", "gusts", "loaded_voltage", "battery_voltage"):
        assert made["day"][key] == asked["day"][key], key
    assert asked["day"]["air_temperature_c"] == {"value": 30.0, "source": "default"}
    assert math.isclose(asked["recommended"]["fill_kg"], 5.1)
    # Its turns, by the autopilot's defaults, take the rest.
    assert 0.0 <= asked["recommended"]["fill_kg"] - made["fill_kg"] < 2.5
