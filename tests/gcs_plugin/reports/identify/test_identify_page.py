"""The page of `identify`: same numbers as the result, no network, nothing from a log that acts."""

import json
import re
from dataclasses import replace
from html import unescape

import numpy as np
import pytest

from tests.browser import open_page, screenshot_folder
from tests.models.made_flights import QUICK, curve_model, made_flight, made_flights, table
from thrustmargin.gcs_plugin.reports.identify.channel_figures import channels_figure, shares
from thrustmargin.gcs_plugin.reports.identify.identify_result import Result, result_of
from thrustmargin.gcs_plugin.reports.identify.identify_sentences import term_name
from thrustmargin.gcs_plugin.reports.identify.page import html_text, looks
from thrustmargin.gcs_plugin.reports.identify.residual_figures import (
    map_figure,
    map_limit,
    time_figure,
)
from thrustmargin.gcs_plugin.reports.identify.residual_rows import Rows, rows_of
from thrustmargin.gcs_plugin.reports.shared import UnusedLog
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.identify import identify
from thrustmargin.models.identification.unexplained import Curve

HOSTILE = "</script><img src=x onerror=alert(1)>\u2028{{ 7*7 }}&amp;\"'.tlog"


@pytest.fixture(scope="module")
def result() -> Result:
    """Three flights with a worn rotor, one of them held out, one log with a hostile name."""
    flights = made_flights(3, loss=0.08)
    flights[1] = replace(flights[1], name=HOSTILE)
    found = identify(
        flights[:2],
        curve_model(),
        held_out=flights[2:],
        config=QUICK,
        catalogue=table(["rotor_degradation"]),
    )
    return result_of(
        found,
        tracks=flights,
        not_used=(UnusedLog(name=HOSTILE, reason=HOSTILE),),
        model_in=HOSTILE,
        model_out=HOSTILE,
        date="2026-01-02",
    )


@pytest.fixture(scope="module")
def page(result) -> str:
    return html_text(result)


@pytest.fixture(scope="module")
def rows(result) -> Rows:
    return rows_of(result.unseen, result.tracks)


def data_of(page: str) -> dict[str, dict]:
    """The figures that the page holds, by name."""
    found = re.findall(r'<script type="application/json" id="figure-(\w+)">(.*?)</script>', page)
    return {name: json.loads(text) for name, text in found}


def test_a_hostile_name_stays_text(page):
    assert "<img" not in page
    assert "&lt;/script&gt;&lt;img src=x" in page
    assert "{{ 7*7 }}" in unescape(page)
    body = re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)
    assert "onerror=alert(1)>" not in body
    for text in re.findall(r'<script type="application/json"[^>]*>(.*?)</script>', page):
        assert not set(text) & {"<", ">", "&", "\u2028"}


def test_the_page_asks_nothing_of_a_network(page):
    policy = re.search(r'Content-Security-Policy" content="([^"]+)"', page)
    assert policy is not None
    assert unescape(policy[1]).startswith("default-src 'none'; script-src 'sha256-")
    without_library = re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)
    assert not re.search(r'(?:src|href|action)="(?!#)', without_library)


def test_the_page_shows_the_numbers_of_the_result(page, result):
    text = unescape(re.sub(r"<[^>]+>", " ", page)).replace("\N{NO-BREAK SPACE}", " ")
    for sentence in result.answer:
        assert sentence in text
    worst = result.errors[1]
    assert f"{worst.before.rmse_rpm:.0f} (" in text
    assert f"{worst.after.rmse_rpm:.1f} (" in text
    assert "MISSING: ROTOR DEGRADATION OF ROTOR 1" in text
    assert "No other effect of the table fits as well" in text
    assert "held out" in text
    assert "learnt from" in text
    assert "Not used" in text


def test_the_page_has_every_figure(page, rows):
    named = data_of(page)
    modes = {f"channels_{k}" for k in range(4)}
    flights = {f"{kind}_{f}" for kind in ("time", "map_before", "map_after") for f in range(3)}
    assert set(named) == {"modes", "shares"} | modes | flights
    asked = set(re.findall(r'data-figure="figure-(\w+)"', page))
    assert asked == set(named)
    assert rows.mode_names == ("collective", "roll", "pitch", "yaw")


def test_candidates_are_listed_best_first_with_what_was_taken(result):
    listed = looks(result.found.tried)
    assert [t.taken for t, _ in listed[0]].count(True) == 1
    best, bar = listed[0][0]
    assert term_name(best.term) == "rotor degradation of rotor 1"
    assert best.p_value == pytest.approx(0.05)
    assert bar == 1.0
    assert not any(t.taken for t, _ in listed[-1])
    gains = [t.share for t, _ in listed[0]]
    assert gains == sorted(gains, reverse=True)
    assert [bar for _, bar in listed[0]] == pytest.approx([max(0.0, g / gains[0]) for g in gains])


def test_rows_are_where_the_aircraft_was(rows, result):
    for f, track in enumerate(result.tracks):
        mine = rows.of(f)
        at = np.searchsorted(track.time_s, track.time_s[0] + rows.time_s[mine] - 1e-9)
        np.testing.assert_allclose(rows.north[mine], track.position_ned[at, 0])
        np.testing.assert_allclose(rows.east[mine], track.position_ned[at, 1])
        np.testing.assert_allclose(track.time_s[at] - track.time_s[0], rows.time_s[mine])
    assert rows.roles == ("fit", "fit", "held_out")


def test_rows_hold_every_residual_in_rotors_and_in_modes(rows, result):
    held = rows.of(2)
    rmse = np.sqrt(np.mean(rows.after_rpm[held] ** 2))
    assert rmse == pytest.approx(result.found.after.rmse_rpm)
    assert np.sum(rows.before_modes**2) == pytest.approx(np.sum(rows.before_rpm**2))


def test_channels_that_hardly_vary_are_left_out_and_angles_are_in_degrees(rows):
    assert "density" not in rows.channels
    assert "tank_kg" in rows.channels
    assert 170.0 < np.max(rows.channels["heading"]) < 360.0


def test_shares_tell_a_constant_from_what_goes_with_a_channel(rows):
    tank = rows.channels["tank_kg"]
    along = np.zeros_like(rows.before_modes)
    along[:, 1] = tank - tank.mean()
    with_tank = replace(rows, before_modes=along)
    column = 1 + list(rows.channels).index("tank_kg")
    told = shares(with_tank, along)
    assert told[1, column] > 0.98
    assert told[1, 0] == pytest.approx(0.0, abs=1e-9)
    assert np.sum(told[[0, 2, 3]]) == pytest.approx(0.0, abs=1e-9)
    constant = np.zeros_like(along)
    constant[:, 3] = 5.0
    told = shares(replace(rows, before_modes=constant), constant)
    assert told[3, 0] == pytest.approx(1.0)
    assert np.sum(told[:, 1:]) == pytest.approx(0.0, abs=1e-9)


def test_before_and_after_share_axes_and_colours(rows):
    limit = map_limit(rows)
    first, second = (
        map_figure(rows, 0, table_, limit) for table_ in (rows.before_rpm, rows.after_rpm)
    )
    assert first is not None
    assert second is not None
    markers = [f["data"][1]["marker"] for f in (first, second)]
    assert markers[0]["cmin"] == markers[1]["cmin"] == -limit
    assert markers[0]["colorscale"] == markers[1]["colorscale"]
    names = [t.name for t in time_figure(rows, 0).select_traces()]
    assert names == ["before", "after"] * 4
    ranges = {axis.range for axis in channels_figure(rows, 0).select_yaxes()}
    assert len(ranges) == 1


def test_a_flight_without_positions_has_no_map(rows):
    nowhere = replace(rows, north=np.full_like(rows.north, np.nan))
    assert map_figure(nowhere, 0, rows.before_rpm, 10.0) is None


def test_a_pause_breaks_the_line():
    track = made_flight(1, loss=0.08)
    paused = _without(track, 30.0, 40.0)
    found = identify([paused], curve_model(), config=QUICK, catalogue=table(["rotor_degradation"]))
    made = result_of(found, tracks=[paused])
    trace = next(time_figure(rows_of(made.unseen, made.tracks), 0).select_traces())
    assert np.count_nonzero(np.isnan(trace.y)) == 1


def _without(track: FlightTrack, start_s: float, end_s: float) -> FlightTrack:
    return track.rows((track.time_s < start_s) | (track.time_s > end_s))


def test_what_is_unexplained_is_drawn_and_said(result):
    curve = Curve(
        mode=2,
        channel="yaw_rate",
        gain=1.0,
        share=0.34,
        p_value=0.01,
        grid=np.linspace(-1.0, 1.0, 30),
        value_rpm=np.linspace(-20.0, 20.0, 30),
    )
    odd = replace(result.found, found=(), curve=curve)
    page = html_text(result_of(odd, tracks=result.tracks))
    assert "curve" in data_of(page)
    assert "NO EFFECT OF THE TABLE; 34.0 % UNEXPLAINED" in page
    assert "pitch that goes with yaw rate" in page


@pytest.fixture(scope="module")
def address(page, tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("page") / "found.html"
    path.write_text(page, encoding="utf-8")
    return path.as_uri()


@pytest.mark.browser
@pytest.mark.parametrize("width", [1280, 420])
def test_every_plot_is_drawn_and_the_page_keeps_to_the_screen(address, tmp_path, width):
    with open_page(address, width=width, height=1000) as shown:
        boxes = shown.locator("[data-figure]")
        for k in range(boxes.count()):
            boxes.nth(k).scroll_into_view_if_needed()
            boxes.nth(k).locator(".main-svg").first.wait_for(timeout=30_000)
        drawn = shown.evaluate(
            "[...document.querySelectorAll('[data-figure]')].map(b => b.querySelectorAll("
            "'.scatterlayer .trace, .heatmaplayer image, .barlayer .trace').length)"
        )
        assert len(drawn) == 2 + 4 + 9
        assert min(drawn) >= 2
        assert shown.evaluate("document.documentElement.scrollWidth") <= width
        assert "onerror" not in shown.evaluate(
            "[...document.querySelectorAll('img')].map(i => i.outerHTML).join('')"
        )
        shown.screenshot(path=screenshot_folder(tmp_path) / f"identify_{width}.png")
