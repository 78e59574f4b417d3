"""A recorded flight beside the forecast of its own mission, in the report."""

# pyright: reportArgumentType=false

import json
from dataclasses import replace

import pytest

from tests.gcs_plugin.reports.margin.report_flight import LOG, flight
from thrustmargin.gcs_plugin.commands.shared.plan_source import read_assumed, read_plan
from thrustmargin.gcs_plugin.reports.forecast.forecast_page import json_text
from thrustmargin.gcs_plugin.reports.margin import build_report
from thrustmargin.gcs_plugin.reports.margin.plan_comparison import plan_comparison
from thrustmargin.gcs_plugin.reports.margin.render import html_text
from thrustmargin.mission.forecast.battery import FlightBattery, stated_capacity
from thrustmargin.mission.forecast.plan_flight import TakeOff
from thrustmargin.mission.forecast.plan_forecast import forecast


@pytest.fixture(scope="module")
def made():
    return plan_comparison(*flight(), read_plan(LOG))


def test_every_stretch_of_the_mission_is_there_with_time_and_liquid_near(made):
    assert made["left_at"] is None
    stretches = made["stretches"]
    # Six lines with a turn after each, of two corners or of one.
    assert [s.kind for s in stretches].count("turn") == 6
    flown = sum(s.seconds.flown for s in stretches)
    assert sum(s.seconds.forecast for s in stretches) == pytest.approx(flown, rel=0.03)


def test_the_liquid_is_that_of_the_pump_as_it_is_simulated(made):
    assert not [o for o in made["off"] if o["what"] == "flow"]
    end = made["stretches"][-1].tank_end_kg
    assert end.forecast == pytest.approx(end.flown, abs=0.2)


def test_a_pump_that_the_file_has_too_large_is_named_as_what_was_off():
    # The simulated pump gives 3.5 L/min at full output.
    analysis, log = flight()
    craft = replace(analysis.model.airframe, pump_max_flow_l_min=4.5)
    wrong = replace(analysis, model=replace(analysis.model, airframe=craft))
    made = plan_comparison(wrong, log, read_plan(LOG))
    (one,) = [o for o in made["off"] if o["what"] == "flow"]
    assert one["forecast"] / one["flown"] == pytest.approx(4.5 / 3.5, abs=0.03)
    assert "of the flow assumed" in made["words"]


def test_the_page_and_the_verdict_say_it(made):
    report = build_report([flight()], plan=read_plan(LOG))
    facts = {fact["label"]: fact["text"] for fact in report.flights[0].json["verdict"]["facts"]}
    assert facts["plan"] == made["words"]
    assert "Beside the plan" in html_text(report, None)


def test_without_a_plan_nothing_is_said_of_one():
    report = build_report([flight()])
    assert report.flights[0].json["plan_comparison"] is None
    assert "Beside the plan" not in html_text(report, None)


@pytest.mark.parametrize(
    ("changed", "what", "words"),
    [
        ({"fill_kg": 8.0}, "fill", "took off with 10.0 kg, 8.0 kg assumed"),
        ({"altitude": 2500.0}, "density", "air of 1.224 kg/m³, 0.858 kg/m³ assumed"),
        ({"wind": 8.0, "wind_from_deg": 90.0}, "wind", "wind of 0.9 m/s, 8.0 m/s assumed"),
        ({"flow": 0.02}, "flow", "of the flow assumed"),
    ],
)
def test_what_was_assumed_wrongly_before_the_job_is_named(tmp_path, changed, what, words):
    """By the JSON of the forecast, as a pilot keeps it."""
    analysis, log = flight()
    plan = read_plan(LOG)
    battery = FlightBattery(capacity_ah=stated_capacity(log.parameters))
    day = TakeOff(**{"fill_kg": 10.0, "flow": 2.5 / 60.0, "battery": battery, **changed})
    file = tmp_path / "forecast.json"
    file.write_text(json_text(forecast(plan, analysis.model, day, parameters=log.parameters)))
    assumed = read_assumed(file, plan=LOG)
    made = plan_comparison(analysis, log, plan, assumed)
    assert made["assumed"]["tank_start_kg"] == assumed.fill_kg
    older = json.loads(file.read_text())  # thrustmargin.forecast/1 called it fill_kg
    older["conditions"]["fill_kg"] = older["conditions"].pop("tank_start_kg")
    file.write_text(json.dumps(older))
    assert read_assumed(file, plan=LOG) == assumed
    causes = [o["what"] for o in made["off"]]
    assert what in causes
    assert words in made["words"]
