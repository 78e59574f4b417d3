"""The forecast on one page and on paper."""

# pyright: reportArgumentType=false

import base64
import gzip
import io
import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from pypdf import PdfReader

from tests.mission.plans_made import TWO_LINES, plan_of
from thrustmargin.gcs_plugin.reports.forecast.forecast_page import hardest, html_text, pdf_bytes
from thrustmargin.gcs_plugin.reports.shared.plot_style import milliseconds
from thrustmargin.gcs_plugin.wording.forecast_words import verdict
from thrustmargin.mission.forecast.plan_forecast import forecast
from thrustmargin.models.model.model_file import load_model


@pytest.fixture(scope="module")
def made():
    # The return is as fast as the lines, not at the default 10 m/s.
    return forecast(plan_of(*TWO_LINES), load_model(), 3.0, parameters={"WP_SPD": 4.0})


def test_the_answer_comes_before_the_chart_and_the_chart_before_what_was_assumed(made):
    page = html_text(made, "field.plan")
    call, _, reason = verdict(made).partition(": ")
    order = (call.split()[0], "Fill at most", "Weakest", "figure-use", "hardest of", "Assumed")
    at = [page.index(words, page.index("<main>")) for words in order]
    assert at == sorted(at)
    assert 'class="verdict under"' in page
    assert reason.split(",")[0].split()[0] in page


def axes(made) -> dict[str, list[float] | None]:
    """The vertical axes of the page's chart, each with its range."""
    page = html_text(made, "field.plan")
    (text,) = re.findall(r'<script type="application/gzip" id="figure-use">(.*?)</script>', page)
    layout = json.loads(gzip.decompress(base64.b64decode(text)))["layout"]
    return {name: of.get("range") for name, of in layout.items() if name.startswith("yaxis")}


def test_the_chart_shows_all_of_thrust_left_tank_and_battery(made):
    shown = axes(made)
    assert shown.keys() == {"yaxis", "yaxis2", "yaxis3"}
    low, high = shown["yaxis"] or (0.0, 0.0)
    assert -20.0 < low <= 0.0  # %, of a least of 4 whose interval goes below 0
    assert 50.0 < high <= 100.0
    low, high = shown["yaxis2"] or (0.0, 0.0)
    assert low == 0.0
    assert 3.0 < high < 4.0  # kg, of a fill of 3
    track = made.flight.track
    unknown = replace(track, voltage=np.full(track.time_s.size, np.nan))
    without = axes(replace(made, flight=replace(made.flight, track=unknown)))
    assert without.keys() == {"yaxis", "yaxis2"}
    dry = made.advised.analysis.model
    dry = replace(dry, airframe=replace(dry.airframe, tank_volume_l=0.0))
    advised = replace(made.advised, analysis=replace(made.advised.analysis, model=dry))
    assert axes(replace(made, advised=advised)).keys() == {"yaxis", "yaxis2"}


def test_a_name_of_a_file_is_text(made):
    page = html_text(made, "<img src=x>.plan")
    assert "<img" not in page
    assert "&lt;img" in page


def test_on_paper_it_is_one_page_with_the_same_words(made):
    read = PdfReader(io.BytesIO(pdf_bytes(made, "field.plan")))
    assert len(read.pages) == 1
    text = read.pages[0].extract_text()
    assert "MAY TAKE OFF" in text
    assert "give --wind" in text


def test_the_hardest_stretches_keep_the_order_of_flight():
    peaks = [0.1, 0.9, 0.2, 0.8, np.nan, 0.7, 0.6, 0.5, 0.4, 0.3, 0.25]
    legs = [SimpleNamespace(item=k, utilisation_peak=p) for k, p in enumerate(peaks)]
    assert [leg.item for leg in hardest(legs)] == [1, 3, 5, 6, 7, 8, 9, 10]


def test_no_time_on_an_axis_can_be_read_as_a_year():
    # plotly takes a whole number of four digits for a year, so 1.5 s would be the year 1500.
    shown = milliseconds(np.array([0.0, 1.5, 9.9, 60.0]))
    assert not np.any(shown == np.round(shown))
    assert np.abs(shown - [0.0, 1500.0, 9900.0, 60_000.0]).max() < 1.0
