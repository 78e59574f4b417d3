"""`report --pdf`: the page's words and figures on A4, made without a browser."""

import io
from dataclasses import replace

import pytest
from pypdf import PdfReader

from tests.gcs_plugin.reports.margin.report_flight import flight
from thrustmargin.gcs_plugin.reports.margin import build_report
from thrustmargin.gcs_plugin.reports.margin.data import Report
from thrustmargin.gcs_plugin.reports.margin.render import pdf_bytes


@pytest.fixture(scope="module")
def report() -> Report:
    return build_report([flight()], max_utilisation=0.5)


def words(text: str) -> str:
    """Text without what a line break or a font does to its spaces and ligatures."""
    return "".join(text.split())


def read(report: Report) -> PdfReader:
    return PdfReader(io.BytesIO(pdf_bytes(report, None)))


@pytest.fixture(scope="module")
def pdf(report: Report) -> PdfReader:
    return read(report)


def test_a_flight_takes_three_to_five_pages_of_a4(pdf):
    assert 3 <= len(pdf.pages) <= 5
    for page in pdf.pages:
        assert [round(float(side)) for side in page.mediabox[2:]] == [595, 842]


def test_verdict_facts_and_moments_are_those_of_the_report(report, pdf):
    said = words(" ".join(page.extract_text() for page in pdf.pages))
    verdict = report.flights[0].json["verdict"]
    first = words(pdf.pages[0].extract_text())
    assert words(verdict["headline"]).lower() in first.lower()
    assert words(f"OK, {verdict['fill']['kg']:.1f} L next") in first
    assert len(pdf.pages) <= 4
    for fact in verdict["facts"]:
        assert words(fact["text"][1:]) in said, fact
    for moment in report.flights[0].peaks:
        assert words(f"{moment.rotor + 1} {moment.rotor_name}") in said
    assert "unknown" not in words(pdf.pages[0].extract_text())


def test_figures_are_drawn_once_with_their_axes_units_and_limit(pdf):
    said = words(" ".join(page.extract_text() for page in pdf.pages))
    assert [said.count(title) for title in ("tank,kg", "north,m", "east,m")] == [1, 1, 1]
    assert said.count("50%limit") >= 6  # of the worst rotor, each rotor and the map's colours
    for key in (
        "worstrotor",
        "tankwhilespraying",
        "predicted",
        "take-off",
    ):
        assert key in said
    # The residual and the map of redundancy stay on the screen: a table and a chart have them.
    assert "measuredminuspredictedrotorspeed" not in said.lower()
    assert not [image for page in pdf.pages for image in page.images]  # sharp at any size


@pytest.mark.slow
def test_of_several_flights_paper_has_what_was_decided_and_one_figure_each():
    five = build_report([flight(name=f"{k}.tlog") for k in range(5)], max_utilisation=0.5)
    pages = read(five).pages
    assert len(pages) <= 6  # the table of all, and five flights
    said = words(" ".join(page.extract_text() for page in pages))
    assert said.count(words("Thrust left over time")) == 5
    assert said.count(words("Nothing; you may fill up to")) == 5
    assert said.count("tankwhilespraying") == 5
    assert words("Where each channel came from") not in said


def test_text_of_a_log_stays_text(report):
    evil = "<b>bold</b> <script>alert(1)</script> $x^2$ \u202e %d {}"
    facts = [{"label": "airframe", "text": evil}]
    one = report.flights[0]
    shown = {"name": "<i>a", "verdict": {**one.json["verdict"], "facts": facts}}
    changed = replace(one, json={**one.json, **shown})
    pages = read(replace(report, flights=(changed,))).pages
    text = words(" ".join(page.extract_text() for page in pages))
    assert words("<b>bold</b> <script>alert(1)</script> $x^2$") in text
    assert words("<i>a") in text
