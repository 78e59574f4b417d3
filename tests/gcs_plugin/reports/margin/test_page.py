"""The report's files: one set of numbers, no network, nothing from a log that acts."""

import base64
import csv
import gzip
import hashlib
import io
import json
import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pypdf
import pytest
from markupsafe import Markup

from tests.gcs_plugin.reports.margin.report_flight import HOSTILE, flight, log, without
from tests.made_sources import sent
from thrustmargin.gcs_plugin.reports.margin import build_report
from thrustmargin.gcs_plugin.reports.margin.data import Report
from thrustmargin.gcs_plugin.reports.margin.figures import figures
from thrustmargin.gcs_plugin.reports.margin.render import (
    Written,
    csv_bytes,
    html_text,
    json_text,
    pdf_bytes,
    strip_of,
    write_report,
)
from thrustmargin.gcs_plugin.reports.shared import UnusedLog
from thrustmargin.gcs_plugin.reports.shared.page_shell import packed, with_heads
from thrustmargin.gcs_plugin.reports.shared.plot_style import keep_extremes, keep_worst, single
from thrustmargin.gcs_plugin.reports.shared.route_map import plotly_scale
from thrustmargin.gcs_plugin.wording.margin_verdict import estimate
from thrustmargin.gcs_plugin.wording.palette import css, thrust_left
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.scores import Estimate
from thrustmargin.models.statement import state
from thrustmargin.models.vehicle_facts import VehicleFacts


def unpacked(text: str) -> str:
    return gzip.decompress(base64.b64decode(text)).decode()


class Page(HTMLParser):
    """Elements and text of a page; text of <script> is kept by its type, the packed unpacked."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []
        self.packed: dict[str, str] = {}
        self.text = ""
        self._inside: tuple[str, dict[str, str | None]] | None = None
        self.feed(text)
        plain = {name: unpacked(data) for name, data in self.packed.items()}
        self.library = plain.pop("library")
        self.data = plain

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag in ("script", "style"):
            self._inside = (tag, dict(attrs))
            if tag == "script" and "type" not in dict(attrs):
                self.scripts.append("")

    def handle_endtag(self, tag):
        if tag in ("script", "style"):
            self._inside = None

    def handle_data(self, data):
        if self._inside is None:
            self.text += data
        elif self._inside[0] == "script":
            kind = self._inside[1]
            if "type" in kind:
                self.packed[kind["id"] or ""] = self.packed.get(kind["id"] or "", "") + data
            else:
                self.scripts[-1] += data


def page_of(report: Report, tmp_path) -> Page:
    out = tmp_path / "r.html"
    written = Written(html=out, json=out.with_suffix(".json"), csv=out.with_suffix(".csv"))
    return Page(html_text(report, written))


def plain(text: str) -> str:
    return " ".join(text.replace("\N{NO-BREAK SPACE}", " ").split())


@pytest.fixture(scope="module")
def report():
    return build_report([flight()])


@pytest.fixture(scope="module")
def page(report, tmp_path_factory):
    return page_of(report, tmp_path_factory.mktemp("page"))


def test_page_json_and_csv_say_the_same_numbers(report, page):
    made = json.loads(json_text(report, "r.csv"))
    assert made["schema"] == "thrustmargin.report/3"
    one, of = made["flights"][0], report.flights[0]
    rows = list(csv.DictReader(io.StringIO(csv_bytes(report).decode())))

    worst = one["verdict"]["worst"]
    assert worst["capacity_use"] == of.worst.utilisation
    row = next(
        r for r in rows if float(r["time_s [s]"]) == pytest.approx(worst["time_s"], abs=1e-3)
    )
    in_csv = float(row[f"utilisation_{worst['rotor']} [1]"])
    assert in_csv == pytest.approx(worst["capacity_use"], abs=1e-5)
    text = plain(page.text)
    # One quantity on the page: thrust left, rounded down, and not what is in use beside it.
    left = math.floor(100 * (1 - worst["capacity_use"]))
    assert f"{left} %thrust left" in text.replace("% th", "%th")
    assert not re.search("in use", text)
    rmse = one["accuracy"]["overall"]["rmse_rpm"]
    assert estimate(Estimate(**rmse), "", 1) in text
    assert f"{one['redundancy']['yaw_free_min']:.2f} × weight" in text
    assert f"{one['flight']['liquid_used_kg']:.2f} kg" in text


def test_csv_has_every_row_with_units_and_empty_cells_for_unknown(report):
    rows = list(csv.reader(io.StringIO(csv_bytes(report).decode())))
    header, body = rows[0], rows[1:]
    assert header[:2] == ["flight_number", "time_s [s]"]
    assert all(re.fullmatch(r".+ \[.+\]", name) for name in header[1:])
    track = log().track
    assert len(body) == track.time_s.size
    column = header.index("rotor_speed_rpm_2 [rpm]")
    got = np.array([float(r[column] or "nan") for r in body])
    np.testing.assert_allclose(got, track.rotor_speed_rpm[:, 1], atol=0.05)
    lower = header.index("rotor_speed_lower_rpm_1 [rpm]")  # no network: no interval
    assert {r[lower] for r in body} == {""}
    assert not any("nan" in cell for r in body for cell in r)


def test_json_has_null_for_unknown_and_no_nan():
    text = json_text(build_report([without("rotor_speed_rpm", "tank_kg")]), "r.csv")
    assert "NaN" not in text
    made = json.loads(text)
    assert made["flights"][0]["flight"]["tank_start_kg"] is None
    assert made["flights"][0]["verdict"]["worst"] is None


def test_json_names_the_columns_of_the_csv(report):
    named = json.loads(json_text(report, "north.csv"))["csv"]
    assert named["file"] == "north.csv"
    header = next(csv.reader(io.StringIO(csv_bytes(report).decode())))
    numbered = [re.sub(r"_\d+ \[", "_{} [", name) for name in header]
    assert list(dict.fromkeys(numbered)) == named["columns"]


def test_page_loads_nothing_from_anywhere(page):
    for tag, attributes in page.elements:
        for name in ("src", "srcset", "data", "action", "poster", "background"):
            assert name not in attributes, (tag, name)
        assert (attributes.get("href") or "#").startswith("#"), tag
        assert tag not in {"link", "iframe", "object", "embed", "base", "img"}
        assert not any(name.startswith("on") for name in attributes), tag
        assert "url(" not in (attributes.get("style") or "")


def test_policy_lets_exactly_the_two_scripts_of_the_page_run(page):
    policy = next(
        a["content"]
        for tag, a in page.elements
        if tag == "meta" and a.get("http-equiv") == "Content-Security-Policy"
    )
    assert "default-src 'none'" in policy
    hashes = re.findall(r"'sha256-([^']+)'", policy)
    found = [
        base64.b64encode(hashlib.sha256(s.encode()).digest()).decode()
        for s in (page.library, *page.scripts)
    ]
    assert hashes == found
    assert len(found) == 2
    assert "http" not in policy


def test_a_whole_flight_has_every_figure(report):
    made = figures(report.flights[0])
    assert set(made) == {"use", "rotors", "map_use", "map_redundancy", "redundancy", "residual"}


def test_an_alarm_of_the_flight_and_what_to_do_both_stand_under_the_verdict(report, tmp_path):
    one = report.flights[0]
    alarm = {"label": "alarm", "text": "rotor 1 makes 8% less thrust"}
    facts = [alarm, *one.json["verdict"]["facts"]]
    shown = {**one.json["verdict"], "facts": facts}
    changed = replace(one, json={**one.json, "verdict": shown})
    page = page_of(replace(report, flights=(changed,)), tmp_path)
    (do,) = (fact["text"] for fact in facts if fact["label"] == "what to do")
    for said in ("rotor 1 makes 8% less thrust", f"{do[0].upper()}{do[1:]}."):
        assert plain(page.text).count(said) == 1
    assert [a for _, a in page.elements].count({"class": "do"}) == 1
    assert "conditions" in [a.get("class") for _, a in page.elements]


def test_the_strip_has_the_colours_of_the_replay_and_the_worst_moment(report):
    one = report.flights[0]
    strip = strip_of(one)
    assert strip is not None
    assert sum(share for share, _ in strip.parts) == pytest.approx(100.0)
    use = np.array([0.3, 0.3, 0.8, np.nan])
    rows = {
        "time_s": np.array([0.0, 50.0, 75.0, 100.0]),
        "flying": np.ones(4),
        "known_utilisation": use[:, None],
    }
    worst = replace(one.peaks[0], time_s=75.0)
    made = strip_of(replace(one, rows=rows, peaks=(worst,)))
    assert made is not None
    assert made.worst_at == 75.0
    colours = [colour for _, colour in made.parts]
    low, high, none = (css(thrust_left().screen(1 - value)) for value in (0.3, 0.8, np.nan))
    # 120 parts: the first, the one of 50 s, the one of 75 s; between them and at the end no data.
    assert colours == [low, none, low, none, high, none]


def test_a_cell_carries_its_heading_for_a_phone():
    rows = Markup("<tr><td>1</td><td class='x'>&lt;td&gt;</td></tr>\n<tr><td>3</td></tr>")
    made = with_heads(rows, ["rotor", "words:what <b>"])
    assert made == (
        '<tr><td data-head="rotor">1</td><td data-head="what &lt;b&gt;" class=\'x\'>&lt;td&gt;</td>'
        '</tr>\n<tr><td data-head="rotor">3</td></tr>'
    )


def test_the_maps_have_outline_take_off_scale_and_wind(report):
    made = figures(report.flights[0])
    for name in ("map_use", "map_redundancy"):
        figure = made[name]
        shown = {trace["name"]: trace for trace in figure.data if trace["showlegend"]}
        assert {"sprayed field", "take-off"} < set(shown)
        (scale,) = (key for key in shown if key.endswith(" m"))
        assert np.ptp(np.asarray(shown[scale]["x"])) == pytest.approx(float(scale[:-2]))
        assert "wind" in " ".join(a["text"] for a in figure.layout["annotations"])
        assert "images" not in figure.layout


def test_figures_hold_the_worst_value_after_thinning(report):
    of = report.flights[0]
    figure = figures(of)["use"]
    (trace,) = (one for one in figure.data if one.get("name") == "worst rotor")
    drawn = trace["y"]
    least = 100 * (1 - of.worst.utilisation)
    assert np.nanmin(drawn) == pytest.approx(least, rel=1 / 16000)
    assert drawn.size < 1700


@pytest.mark.parametrize("rows", [1, 50, 1601, 20_000])
def test_thinning_keeps_ends_extremes_and_gaps(rows):
    rng = np.random.default_rng(rows)
    values = rng.normal(size=rows)
    values[rows // 2 : rows // 2 + rows // 10] = np.nan
    kept = keep_extremes(values, 400)
    assert np.all(np.diff(kept) > 0)
    assert kept[0] == 0
    assert kept[-1] == rows - 1
    assert kept.size <= max(1600, 5 * 400)
    if np.any(np.isfinite(values)):
        assert np.nanmax(values[kept]) == np.nanmax(values)
        assert np.nanmin(values[kept]) == np.nanmin(values)
    assert np.any(np.isnan(values[kept])) == np.any(np.isnan(values))


def test_thinning_keeps_a_gap_of_one_row():
    values = np.sin(np.arange(20_000) / 300.0)
    values[7777] = np.nan
    assert 7777 in keep_extremes(values, 400)


def test_what_is_packed_has_no_character_that_ends_an_element_and_is_whole():
    text = packed(HOSTILE + "\u2028")
    assert re.fullmatch(r"[A-Za-z0-9+/=]+", text)
    assert unpacked(text) == HOSTILE + "\u2028"
    assert packed("the same") == packed("the same")


def test_what_is_drawn_is_within_a_part_in_16000_of_its_value():
    values = np.concatenate([np.geomspace(1e-3, 1e4, 999), -np.geomspace(1e-3, 1e4, 999)])
    np.testing.assert_allclose(single(values), values, rtol=1 / 16000)
    assert np.isnan(single(np.array([np.nan]))).all()


def test_the_map_keeps_the_worst_row_of_each_stretch():
    score = np.sin(np.arange(10_000) / 37.0)
    score[1234], score[5000:6000] = 9.0, np.nan
    kept = keep_worst(score, 300)
    assert 1234 in kept
    assert np.all(np.isfinite(score[kept]))
    assert kept.size <= 300
    assert keep_worst(np.full(50, np.nan), 10).size == 0


def test_a_moved_limit_moves_the_jump_of_the_colours():
    scale = plotly_scale(thrust_left(0.6))
    places = [float(place) for place, _ in scale]
    assert np.count_nonzero(np.isclose(places, 0.6)) == 2
    assert places == sorted(places)
    assert (places[0], places[-1]) == (0.0, 1.0)


def test_nothing_hostile_in_a_log_becomes_an_element(tmp_path):
    hostile = state("as written", text=HOSTILE)
    track = replace(log().track, name=HOSTILE, notes=(hostile,), sources={"tank_kg": sent(HOSTILE)})
    channels = tuple(replace(c, source=sent(HOSTILE), unused=hostile) for c in log().channels)
    analysis, recorded = flight(
        track=track, messages=((1.0, HOSTILE),), channels=channels, autopilot=HOSTILE
    )
    names = tuple(HOSTILE for _ in range(4))
    airframe = replace(analysis.model.airframe, title=HOSTILE, rotor_names=names)
    analysis = replace(
        analysis,
        model=physics_model(airframe),
        density_basis=hostile,
        voltage_basis=hostile,
    )
    report = build_report(
        [(analysis, recorded), flight()], unread=[UnusedLog(name=HOSTILE, reason=HOSTILE)]
    )
    page = page_of(report, tmp_path)
    clean = page_of(
        build_report([flight(), flight()], unread=[UnusedLog(name="a", reason="b")]), tmp_path
    )
    assert len(page.scripts) == len(clean.scripts) == 1
    assert not [a for tag, a in page.elements if tag == "img"]
    assert not [a for _, a in page.elements if "onerror" in a]
    assert plain(page.text).count("alert(1)") >= 12
    assert page.text.count("{{7*7}}") == page.text.count("alert(1)")
    # Inside the figures' JSON the text is data: it parses, and plotly sees no markup in it.
    for text in page.data.values():
        figure = json.loads(text)
        shown = [str(a.get("text", "")) for a in figure["layout"].get("annotations", [])]
        assert not [t for t in shown if "<script" in t or "<img" in t]
    made = json.loads(json_text(report, "r.csv"))
    assert made["flights"][0]["name"] == HOSTILE
    assert HOSTILE.encode() not in csv_bytes(report)


@pytest.mark.parametrize(
    "missing",
    [
        ("rotor_speed_rpm",),
        ("tank_kg",),
        ("position_ned",),
        ("rotor_speed_rpm", "tank_kg"),
        ("voltage", "velocity_ned", "attitude", "angular_rate_frd", "spraying", "wind_ned"),
    ],
)
def test_a_page_without_channels_is_whole_and_says_what_is_missing(missing, tmp_path):
    report = build_report([without(*missing)])
    page = page_of(report, tmp_path)
    text = plain(page.text)
    assert report.flights[0].json["quality"]["missing"]
    for said in report.flights[0].json["quality"]["missing"]:
        assert said in text
    assert " nan" not in text.lower()
    assert "None" not in text
    for figure in page.data.values():
        go.Figure(json.loads(figure))


def test_an_octocopter_has_eight_rotors_in_page_and_csv(tmp_path):
    airframe = load_airframe("agras-t40")
    rows = 600
    speed = np.linspace(0.5, 0.7, rows)[:, None] * airframe.max_rotor_speed_rpm * np.ones(8)
    track = FlightTrack.of(
        name="octo",
        time_s=np.linspace(0.0, 60.0, rows),
        rotor_count=8,
        rotor_speed_rpm=speed,
        tank_kg=np.full(rows, 20.0),
        airspeed=np.full(rows, 3.0),
        altitude=np.full(rows, 50.0),
    )
    analysis = analyse(track, physics_model(airframe))
    other = replace(log(), track=track, facts=VehicleFacts())
    report = build_report([(analysis, other), flight()])
    header = next(csv.reader(io.StringIO(csv_bytes(report).decode())))
    assert "utilisation_8 [1]" in header
    rows_of = list(csv.DictReader(io.StringIO(csv_bytes(report).decode())))
    assert rows_of[-1]["flight_number"] == "2"
    assert rows_of[-1]["utilisation_8 [1]"] == ""
    page = page_of(report, tmp_path)
    assert len(report.flights[0].json["rotors"]) == 8
    assert airframe.rotor_names[7] in page.text


def test_several_flights_have_an_overview_that_leads_to_each(tmp_path):
    lighter = flight(tank_kg=log().track.tank_kg / 2, name="light.tlog")
    report = build_report(
        [lighter, flight()], unread=[UnusedLog(name="bad.tlog", reason="is empty")]
    )
    page = page_of(report, tmp_path)
    links = [a["href"] for tag, a in page.elements if tag == "a"]
    anchors = {"#" + (a["id"] or "") for tag, a in page.elements if tag == "section" and "id" in a}
    assert set(links) == {"#flight-1", "#flight-2"} == anchors
    folded = [a for tag, a in page.elements if tag == "details" and a.get("class") == "one"]
    assert folded == [{"class": "one"}] * 2  # a table first: no flight is open
    assert "bad.tlog: is empty" in plain(page.text)
    assert "ALL 2 FLIGHTS: THRUST LEFT ABOVE THE 50 % LIMIT" in plain(page.text)


def test_the_three_files_stand_beside_each_other(report, tmp_path):
    written = write_report(report, tmp_path / "north field.html")
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "north field.csv",
        "north field.html",
        "north field.json",
    ]
    assert json.loads(written.json.read_text("utf-8"))["csv"]["file"] == "north field.csv"


@pytest.mark.parametrize("stop", [KeyboardInterrupt, RuntimeError])
def test_a_report_that_stops_half_way_leaves_the_old_files_whole(
    report, tmp_path, monkeypatch, stop
):
    out = tmp_path / "r.html"
    write_report(report, out)
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}

    def interrupted(*_):
        raise stop

    monkeypatch.setattr("thrustmargin.gcs_plugin.reports.margin.render.html_text", interrupted)
    changed = replace(report, max_utilisation=0.4)
    with pytest.raises(stop):
        write_report(changed, out)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


def test_a_part_of_the_area_is_said_to_be_one_on_page_and_paper():
    track = log().track
    gone = np.where((np.abs(track.time_s - 100.0) < 15.0)[:, None], np.nan, track.position_ned)
    files = Written(html=Path("r.html"), json=Path("r.json"), csv=Path("r.csv"))
    cases: list[tuple[dict[str, Any], bool]] = [({}, False), ({"position_ned": gone}, True)]
    for changes, part in cases:
        made = build_report([flight(None, **changes)], max_utilisation=0.5)
        found = json.loads(json_text(made, "r.csv"))["flights"][0]["flight"]
        assert (found["sprayed_area"] is None) == part
        paper = pypdf.PdfReader(io.BytesIO(pdf_bytes(made, files))).pages
        printed = " ".join("".join(page.extract_text() for page in paper).split())
        for text in (" ".join(Page(html_text(made, files)).text.split()), printed):
            assert bool(re.search(r"at least 0\.2\d.ha", text)) == part
            assert bool(re.search(r"of \d\d.s place or pump is not known", text)) == part


def test_each_page_is_in_the_language_of_its_day(monkeypatch):
    """One program makes many pages; their words are not those of its first."""
    made = build_report([flight()], max_utilisation=0.5)
    files = Written(html=Path("r.html"), json=Path("r.json"), csv=Path("r.csv"))
    pages = []
    for code in ("en", "de", "en"):
        monkeypatch.setenv("THRUSTMARGIN_LANGUAGE", code)
        pages.append(html_text(made, files))
    assert "Worst moments" in pages[0]
    assert "Worst moments" not in pages[1]
    assert pages[2] == pages[0]


def test_a_part_of_the_way_is_said_to_be_one_on_page_and_paper():
    track = log().track
    gone = np.where((np.abs(track.time_s - 100.0) < 15.0)[:, None], np.nan, track.velocity_ned)
    files = Written(html=Path("r.html"), json=Path("r.json"), csv=Path("r.csv"))
    cases: list[tuple[dict[str, Any], bool]] = [({}, False), ({"velocity_ned": gone}, True)]
    for changes, part in cases:
        made = build_report([flight(None, **changes)], max_utilisation=0.5)
        paper = pypdf.PdfReader(io.BytesIO(pdf_bytes(made, files))).pages
        printed = " ".join("".join(page.extract_text() for page in paper).split())
        for text in (" ".join(Page(html_text(made, files)).text.split()), printed):
            assert bool(re.search(r"at least 5\d\d.m", text)) == part  # of 655 m
            assert bool(re.search(r"of 30.s the speed over ground is not known", text)) == part
    unknown = html_text(build_report([without("velocity_ned")], max_utilisation=0.5), files)
    assert "at least unknown" not in unknown
    assert "the speed over ground is not known" not in unknown


@pytest.mark.parametrize("taught", [True, False])
def test_a_condition_that_is_open_is_no_clearance_in_colour_either(taught):
    """A fill page and a forecast are amber then; the report of the flight is too."""
    files = Written(html=Path("r.html"), json=Path("r.json"), csv=Path("r.csv"))
    for logs in (1, 2):
        made = build_report([flight(taught=taught)] * logs, max_utilisation=0.5)
        page = html_text(made, files)
        assert {one.advice.level for one in made.flights} == {"under"}
        assert ('class="verdict near"' in page) is not taught
        assert ('class="verdict under"' in page) is taught
