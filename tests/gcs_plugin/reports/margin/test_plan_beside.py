"""A recorded flight beside the forecast of its own mission, in the report."""

# pyright: reportArgumentType=false

from dataclasses import replace

import pytest

from tests.gcs_plugin.reports.margin.report_flight import LOG, flight
from thrustmargin.gcs_plugin.commands.shared.plan_source import read_plan
from thrustmargin.gcs_plugin.reports.margin import build_report
from thrustmargin.gcs_plugin.reports.margin.plan_beside import plan_beside
from thrustmargin.gcs_plugin.reports.margin.render import html_text


@pytest.fixture(scope="module")
def made():
    return plan_beside(*flight(), read_plan(LOG))


def test_every_stretch_of_the_mission_is_there_with_time_and_liquid_near(made):
    assert made["left_at"] is None
    stretches = made["stretches"]
    # Six lines with a turn after each, of two corners or of one.
    assert [s["kind"] for s in stretches].count("turn") == 6
    flown = sum(s["seconds"]["flown"] for s in stretches)
    assert sum(s["seconds"]["forecast"] for s in stretches) == pytest.approx(flown, rel=0.03)


def test_the_liquid_is_that_of_the_pump_as_it_is_simulated(made):
    assert not [o for o in made["off"] if o["what"] == "flow"]
    end = made["stretches"][-1]["tank_end_kg"]
    assert end["forecast"] == pytest.approx(end["flown"], abs=0.2)


def test_a_pump_that_the_file_has_too_large_is_named_as_what_was_off():
    # The simulated pump gives 3.5 L/min at full output.
    analysis, log = flight()
    craft = replace(analysis.model.airframe, pump_max_flow_l_min=4.5)
    wrong = replace(analysis, model=replace(analysis.model, airframe=craft))
    made = plan_beside(wrong, log, read_plan(LOG))
    (one,) = [o for o in made["off"] if o["what"] == "flow"]
    assert one["forecast"] / one["flown"] == pytest.approx(4.5 / 3.5, abs=0.03)
    assert "of the flow assumed" in made["words"]


def test_the_page_and_the_verdict_say_it(made):
    report = build_report([flight()], plan=read_plan(LOG))
    facts = {fact.label: fact.text for fact in report.flights[0].verdict.facts}
    assert facts["plan"] == made["words"]
    assert "Beside the plan" in html_text(report, None)


def test_without_a_plan_nothing_is_said_of_one():
    report = build_report([flight()])
    assert report.flights[0].beside_plan is None
    assert "Beside the plan" not in html_text(report, None)
