"""A recorded flight beside the forecast of its own mission, in the report."""

# pyright: reportArgumentType=false

import pytest

from tests.gcs_plugin.reports.margin.report_flight import LOG, flight
from thrustmargin.gcs_plugin.logs.plan_source import read_plan
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


def test_the_pump_of_the_file_is_named_as_what_was_off(made):
    # The airframe file has a pump of 4.5 L/min, the simulated one gives 3.5.
    (one,) = [o for o in made["off"] if o["what"] == "flow"]
    assert one["forecast"] / one["flown"] == pytest.approx(4.5 / 3.5, abs=0.03)
    assert "forecast" in made["words"]


def test_the_page_and_the_verdict_say_it(made):
    report = build_report([flight()], plan=read_plan(LOG))
    facts = {fact.label: fact.text for fact in report.flights[0].verdict.facts}
    assert facts["plan"] == made["words"]
    assert "Beside the plan" in html_text(report, None)


def test_without_a_plan_nothing_is_said_of_one():
    report = build_report([flight()])
    assert report.flights[0].beside_plan is None
    assert "Beside the plan" not in html_text(report, None)
