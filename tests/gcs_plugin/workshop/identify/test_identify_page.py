"""The page of `identify`: same numbers as the result, no network, nothing from a log that acts."""

import base64
import gzip
import json
import re
from dataclasses import replace
from html import unescape
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from tests.browser import open_page, screenshot_folder
from tests.models.identification.known_terms import known_term
from tests.models.made_flights import curve_model, made_flight, made_flights, table
from thrustmargin.gcs_plugin.reports.shared import UnusedLog
from thrustmargin.gcs_plugin.workshop.identify.identify_page import (
    Rows,
    channels_figures,
    html_text,
    map_figure,
    map_limit,
    residual_rows,
    time_figure,
)
from thrustmargin.gcs_plugin.workshop.identify.identify_result import (
    Result,
    json_text,
    make_result,
    printed_tables,
)
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.answer.result import Excluded, Mentioned, OneOf, SetWeight
from thrustmargin.models.identification.loop import identify

#: As the code has them, written down by hand: a change there is to be seen here.
MOST_CHANNELS = 4

HOSTILE = "</script><img src=x onerror=alert(1)>\u2028{{ 7*7 }}&amp;\"'.tlog"


@pytest.fixture(scope="module")
def result() -> Result:
    """Three flights with a worn rotor, one of them held out, one log with a hostile name."""
    flights = made_flights(3, loss=0.08, duration=90.0)
    flights[1] = replace(flights[1], name=HOSTILE)
    found = identify(
        flights[:2],
        curve_model(),
        held_out=flights[2:],
        catalogue=table(["rotor_degradation"]),
    )
    return make_result(
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
    return residual_rows(result.unseen, result.tracks)


def data_of(page: str) -> dict[str, dict]:
    """The figures that the page holds, by name."""
    found = re.findall(r'<script type="application/gzip" id="figure-(\w+)">(.*?)</script>', page)
    return {
        name: json.loads(gzip.decompress(base64.b64decode(text)).decode()) for name, text in found
    }


def test_a_hostile_name_stays_text(page):
    assert "<img" not in page
    assert "&lt;/script&gt;&lt;img src=x" in page
    assert "{{ 7*7 }}" in unescape(page)
    body = re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)
    assert "onerror=alert(1)>" not in body
    for text in re.findall(r'<script type="application/gzip"[^>]*>(.*?)</script>', page):
        assert re.fullmatch(r"[A-Za-z0-9+/=]+", text)


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
    assert "held out" in text
    assert "learnt from" in text
    assert "Not used" in text


def test_the_page_begins_with_what_its_reader_does_next(page, result):
    first = re.search(r'<p class="call">(.*?)</p>', page)
    assert first is not None
    said = unescape(first[1]).replace("\N{NO-BREAK SPACE}", " ")
    assert said == result.answer[0]
    assert said.startswith("Rotor 1 (front right) makes 8")
    assert json.loads(json_text(result))["answer"] == list(result.answer)


def test_the_page_has_every_figure(page, rows):
    named = data_of(page)
    modes = {f"channels_{k}" for k in range(4)}
    flights = {f"{kind}_{f}" for kind in ("time", "map_before", "map_after") for f in range(3)}
    assert set(named) == {"modes"} | modes | flights
    asked = set(re.findall(r'data-figure="figure-(\w+)"', page))
    assert asked == set(named)
    assert rows.mode_names == ("collective", "roll", "pitch", "yaw")


@pytest.fixture(scope="module")
def undecided() -> Result:
    """A rotor named, one not cleared, and mass that could as well be the gauge."""
    flights = made_flights(3, loss=0.08, hidden_mass=1.0)
    both = identify(
        flights,
        curve_model(),
        catalogue=table(["rotor_degradation", "extra_mass"]),
    )
    worn = tuple(f for f in both.found if f.term.rotor == 0)
    mass, gauge = (known_term(key) for key in ("extra_mass", "tank_scale"))
    rotors = [known_term("rotor_degradation", rotor=k) for k in range(4)]
    found = replace(
        both,
        found=worn,
        one_of=(OneOf(terms=(mass, gauge), probabilities=(0.6, 0.35)),),
        alternatives=(
            SetWeight(probability=0.6, terms=(rotors[0], mass)),
            SetWeight(probability=0.35, terms=(rotors[0], gauge)),
        ),
        mentioned=(Mentioned(rotor=2, probability=0.08, loss=0.03, ci95=(0.01, 0.05)),),
        excluded=tuple(
            Excluded(term=t, parameter="loss", unit="1", above=0.02) for t in rotors[1:]
        ),
    )
    return make_result(found, tracks=flights, mission=HOSTILE)


@pytest.mark.slow
def test_what_is_undecided_has_shares_limits_and_a_next_flight(undecided):
    following = undecided.following
    assert following is not None
    kept = [{t.key for t in side} for side in following.separates]
    assert kept == [{"rotor_degradation@1", key} for key in ("extra_mass", "tank_scale")]
    text = unescape(re.sub(r"<[^>]+>", " ", html_text(undecided))).replace(
        "\N{NO-BREAK SPACE}", " "
    )
    for words in (
        "a weak rotor 1 (front right) and hidden mass 60 %",
        "any other weak rotor above 2 %",
        "Rotor 3 (front left) cannot be ruled out (8 % by ",
        "To tell hidden mass from a wrong tank gauge, ",
    ):
        assert " ".join(text.split()).count(words) == 1, words
    told = json.loads(json_text(undecided))["next_flight"]
    assert told["separates"] == [
        ["rotor_degradation of rotor 1", "extra_mass"],
        ["rotor_degradation of rotor 1", "tank_scale"],
    ]
    assert told["mission"] == HOSTILE
    assert "<img" not in html_text(undecided)


def test_probabilities_are_drawn_on_one_scale(undecided):
    widths = re.findall(r'<i style="width:([0-9.]+)%">', html_text(undecided))
    shown = [float(w) for w in widths]
    assert shown == pytest.approx([0.6 * shown[0] / 0.6, 0.35 * shown[0] / 0.6], abs=0.1)


def test_the_printed_tables_fit_80_columns(undecided):
    console = Console(width=80, record=True, file=StringIO())
    for table_ in printed_tables(undecided):
        console.print(table_)
    text = console.export_text()
    assert "…" not in text
    for shown in ("over 99 %", "any other weak rotor", "1 front right", "RMSE after", "35 %"):
        assert shown in text


def test_rows_are_where_the_aircraft_was(rows, result):
    for f, track in enumerate(result.tracks):
        mine = rows.flight_rows(f)
        at = np.searchsorted(track.time_s, track.time_s[0] + rows.time_s[mine] - 1e-9)
        np.testing.assert_allclose(rows.north[mine], track.position_ned[at, 0])
        np.testing.assert_allclose(rows.east[mine], track.position_ned[at, 1])
        np.testing.assert_allclose(track.time_s[at] - track.time_s[0], rows.time_s[mine])
    assert rows.roles == ("fit", "fit", "held_out")


def test_rows_hold_every_residual_in_rotors_and_in_modes(rows, result):
    held = rows.flight_rows(2)
    rmse = np.sqrt(np.mean(rows.after_rpm[held] ** 2))
    assert rmse == pytest.approx(result.found.after.rmse_rpm)
    assert np.sum(rows.before_modes**2) == pytest.approx(np.sum(rows.before_rpm**2))


def test_channels_that_hardly_vary_are_left_out_and_angles_are_in_degrees(rows):
    assert "density" not in rows.channels
    assert "tank_kg" in rows.channels
    assert 170.0 < np.max(rows.channels["heading"]) < 360.0


def test_a_mode_is_drawn_along_the_channels_that_it_goes_with(rows):
    tank = rows.channels["tank_kg"]
    along = np.zeros_like(rows.before_modes)
    along[:, 1] = tank - tank.mean()
    drawn = channels_figures(replace(rows, before_modes=along))[1]
    titles = [a["title"]["text"] for name, a in drawn.layout.items() if name.startswith("xaxis")]
    assert titles[0] == "tank level, kg"
    assert len(titles) == min(MOST_CHANNELS, len(rows.channels))


def test_before_and_after_share_axes_and_colours(rows):
    limit = map_limit(rows)
    first, second = (
        map_figure(rows, 0, table_, limit) for table_ in (rows.before_rpm, rows.after_rpm)
    )
    assert first is not None
    assert second is not None
    markers = [f.data[1]["marker"] for f in (first, second)]
    assert markers[0]["cmin"] == markers[1]["cmin"] == -limit
    assert markers[0]["colorscale"] == markers[1]["colorscale"]
    names = [trace["name"] for trace in time_figure(rows, 0).data]
    assert names == ["before", "after"] * 4
    for made in (channels_figures(rows).values(), [time_figure(rows, f) for f in range(3)]):
        axes = [a for f in made for name, a in f.layout.items() if name.startswith("yaxis")]
        assert len({tuple(axis["range"]) for axis in axes}) == 1


def test_a_flight_without_positions_has_no_map(rows):
    nowhere = replace(rows, north=np.full_like(rows.north, np.nan))
    assert map_figure(nowhere, 0, rows.before_rpm, 10.0) is None


def test_a_pause_breaks_the_line():
    track = made_flight(1, loss=0.08)
    paused = _without(track, 30.0, 40.0)
    found = identify([paused], curve_model(), catalogue=table(["rotor_degradation"]))
    made = make_result(found, tracks=[paused])
    trace = time_figure(residual_rows(made.unseen, made.tracks), 0).data[0]
    assert np.count_nonzero(np.isnan(trace["y"])) == 1


def _without(track: FlightTrack, start_s: float, end_s: float) -> FlightTrack:
    return track.rows((track.time_s < start_s) | (track.time_s > end_s))


@pytest.fixture(scope="module")
def address(undecided, tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("page") / "found.html"
    path.write_text(html_text(undecided), encoding="utf-8")
    return path.as_uri()


@pytest.mark.browser
def test_every_plot_is_drawn_and_the_page_keeps_to_the_screen(address, tmp_path):
    """Drawn on a phone, and then on wider screens too; at 390 px no table is cut."""
    with open_page(address, width=390, height=1000) as shown:
        boxes = shown.locator("[data-figure]")
        for k in range(boxes.count()):
            boxes.nth(k).scroll_into_view_if_needed()
            boxes.nth(k).locator(".main-svg").first.wait_for()
        drawn = shown.evaluate(
            "[...document.querySelectorAll('[data-figure]')].map(b => b.querySelectorAll("
            "'.scatterlayer .trace, .heatmaplayer image, .barlayer .trace').length)"
        )
        assert len(drawn) == 1 + 4 + 9
        assert min(drawn) >= 2
        assert "onerror" not in shown.evaluate(
            "[...document.querySelectorAll('img')].map(i => i.outerHTML).join('')"
        )
        cut = "[...document.querySelectorAll('.scroll')].filter(s => s.scrollWidth > s.clientWidth)"
        for width in (390, 820, 1366):
            shown.set_viewport_size({"width": width, "height": 1000})
            shown.wait_for_function("w => document.documentElement.scrollWidth <= w", arg=width)
            assert shown.evaluate(f"{cut}.length") == 0
            shown.screenshot(path=screenshot_folder(tmp_path) / f"identify_{width}.png")
