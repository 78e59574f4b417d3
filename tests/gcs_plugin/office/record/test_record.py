"""The record of a real flight, written by the command and read back by other libraries."""

import csv
import io
import json
import os
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace
from typing import Any

import numpy as np
import pypdf
import pytest
import shapefile
import shapely
import shapely.geometry

from tests.gcs_plugin.reports.margin.report_flight import LOG, log
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.office.record.applied import (
    Liquid,
    applied_swaths,
    differences,
    gauge_estimate,
    job_estimate,
    pump_estimate,
    thrust_estimate,
)
from thrustmargin.gcs_plugin.office.record.job_record import (
    due_utc,
    job_rules,
    liquid_entries,
    open_items,
    product_entries,
)
from thrustmargin.gcs_plugin.office.record.record_words import TITLES, liquid_words, missing_words
from thrustmargin.models.errors import DataError
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.provenance import SourceKind
from thrustmargin.models.statement import state

STATED = {
    "--product": "=Oil 5",
    "--registration": "024-01",
    "--rate": "1.5 L/ha",
    "--pilot": "Å. Pilot",
    "--aircraft-serial": "F16-7",
    "--air-temperature": "21",
    "--zone": "Australia/Sydney",
}


@pytest.fixture(scope="module")
def job(tmp_path_factory) -> SimpleNamespace:
    """What `record` and `report` write of one flight."""
    folder = tmp_path_factory.mktemp("job")
    field = folder / "north.geojson"
    ring = [[116.89, 36.64], [116.91, 36.64], [116.91, 36.66], [116.89, 36.66], [116.89, 36.64]]
    field.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    words = [word for pair in STATED.items() for word in pair]
    more = ["--weather-source", "station", "--rule", "nsw", "--rule", "us"]
    out, asked = folder / "out", ["--field", str(field), *words, *more]
    assert run(["record", str(LOG), "--out", str(out), *asked]) == 0
    assert run(["report", str(LOG), "--json", str(folder / "r.json")]) == 0
    return SimpleNamespace(
        out=out,
        asked=asked,
        record=json.loads((out / "record.json").read_text("utf-8")),
        flight=json.loads((folder / "r.json").read_text("utf-8"))["flights"][0]["flight"],
    )


@pytest.mark.skipif(os.name != "posix", reason="files have no such modes there")
def test_nobody_else_on_the_computer_reads_names_and_places(job):
    modes = {path.name: path.stat().st_mode & 0o777 for path in job.out.iterdir()}
    assert {"record.json", "record.csv", "record.pdf", "applied.geojson"} <= modes.keys()
    assert set(modes.values()) == {0o600}


def test_the_pump_is_summed_from_no_level_that_somebody_would_have_stated(job):
    said = {one["by"]: one["source"] for one in job.record["liquid"]["estimates"]}
    assert said["pump"] == "pump output: 3.5 L/min at full output"
    kg = {one["by"]: one["kg"] for one in job.record["liquid"]["estimates"]}
    # The tank lost 6.155 kg in this flight.
    assert kg == pytest.approx(dict.fromkeys(("gauge", "pump", "thrust"), 6.155), abs=0.2)


def test_the_record_is_the_same_in_every_language(job, tmp_path, monkeypatch):
    """It is kept for years, and for an authority that need not read the user's language."""
    monkeypatch.setenv("THRUSTMARGIN_LANGUAGE", "de")
    assert run(["record", str(LOG), "--out", str(tmp_path), *job.asked]) == 0
    made = json.loads((tmp_path / "record.json").read_text("utf-8"))
    assert made | {"made_utc": ""} == job.record | {"made_utc": ""}
    for name in ("record.csv", "applied.geojson"):
        assert (tmp_path / name).read_bytes() == (job.out / name).read_bytes()


def test_area_and_liquid_are_those_of_the_report(job):
    fields = job.record["fields"]
    assert fields["area"]["value"] == pytest.approx(job.flight["sprayed_area"] / 10_000.0, rel=1e-3)
    assert fields["swath"]["value"] == pytest.approx(job.flight["swath_width"], rel=1e-3)
    assert fields["quantity_kg"]["value"] == pytest.approx(job.flight["liquid_used_kg"], abs=0.05)
    dose = 1.5 * fields["area"]["value"]
    assert fields["product_quantity"]["value"] == pytest.approx(dose, rel=1e-9)
    litres = fields["quantity"]["value"] / fields["area"]["value"]
    assert fields["spray_volume"]["value"] == pytest.approx(litres, rel=1e-9)


def test_every_field_has_its_source(job):
    sources = {name: entry["source"] for name, entry in job.record["fields"].items()}
    assert sources["product"] == sources["pilot"] == "option"
    assert sources["start"] == sources["wind"] == sources["swath"] == "log"
    assert sources["temperature"] == "weather station"
    assert sources["area"] == "computed"
    assert sources["field_area"] == "file"
    assert all(entry["detail"] for entry in job.record["fields"].values())


def test_times_are_in_utc_and_in_the_zone_with_its_offset(job):
    fields = job.record["fields"]
    start = datetime.fromisoformat(fields["start"]["value"])
    began = datetime.fromisoformat(job.flight["start_utc"])
    assert timedelta(0) < start - began < timedelta(minutes=2)
    local = fields["start_local"]["value"]
    assert local.endswith("+11:00")  # summer time of November
    assert datetime.fromisoformat(local) == start
    assert fields["date"]["value"] == local[:10]


def test_nothing_is_guessed_and_all_that_lacks_is_listed(job):
    fields = job.record["fields"]
    rules = {rule["rule"]: rule for rule in job.record["rules"]}
    assert rules.keys() == {"us", "nsw"}
    lacking = {name for item in rules["nsw"]["missing"] for name in item["fields"]}
    assert {"pilot_address", "active", "inversion", "crop", "land_address"} <= lacking
    assert lacking & fields.keys() == set()
    assert {"product", "aircraft", "wind", "start"} & lacking == set()
    assert {"crop", "customer", "pilot_certificate"} & fields.keys() == set()
    finish = datetime.fromisoformat(fields["finish"]["value"])
    assert datetime.fromisoformat(rules["nsw"]["due_utc"]) == finish + timedelta(hours=48)
    assert rules["us"]["due_utc"] is None


def test_the_swaths_are_the_area_in_both_files(job):
    found = json.loads((job.out / "applied.geojson").read_text("utf-8"))["features"]
    area, *passes = found
    assert area["properties"]["part"] == "area"
    assert area["properties"]["area_ha"] == pytest.approx(job.record["fields"]["area"]["value"])
    shapes = [shapely.geometry.shape(feature["geometry"]) for feature in passes]
    assert all(shape.is_valid for shape in shapes)
    west, south, east, north = shapely.total_bounds(shapes)
    assert 116.89 < west < east < 116.91
    assert 36.64 < south < north < 36.66
    read: Any
    with shapefile.Reader(str(job.out / "applied.shp")) as read:
        theirs = [shapely.geometry.shape(s.__geo_interface__) for s in read.shapes()]
        assert [r["start_utc"] for r in read.records()] == [
            f["properties"]["start_utc"] for f in passes
        ]
    assert len(theirs) == len(shapes) > 3
    for one, other in zip(theirs, shapes, strict=True):
        assert one.symmetric_difference(other).area < 1e-6 * other.area
    assert "WGS_1984" in (job.out / "applied.prj").read_text()


def test_what_was_sprayed_outside_the_field_is_counted(job):
    fields = job.record["fields"]
    assert fields["area_outside_field"]["value"] == pytest.approx(0.0, abs=1e-6)
    # 0.02° of latitude are 2219 m there, 0.02° of longitude 1788 m.
    assert fields["field_area"]["value"] == pytest.approx(396.8, rel=5e-3)


def test_the_table_holds_all_fields_and_no_formula(job):
    rows = list(csv.DictReader(io.StringIO((job.out / "record.csv").read_text("utf-8"))))
    values = {row["field"]: row["value"] for row in rows if row["source"] != "missing"}
    assert values.keys() == job.record["fields"].keys()
    assert values["product"] == "'=Oil 5"
    assert not [cell for row in rows for cell in row.values() if cell[:1] in tuple("=+-@")]
    assert "pilot_address" in {row["field"] for row in rows if row["source"] == "missing"}


def test_the_pdf_says_the_same(job):
    pages = pypdf.PdfReader(job.out / "record.pdf").pages
    text = " ".join("".join(page.extract_text() for page in pages).split())
    for said in ("=Oil 5", "Å. Pilot", "F16-7", "weather station", "address of the pilot"):
        assert said in text


def test_ground_that_is_sprayed_twice_counts_once():
    once, twice = applied_swaths([log()], 5.0), applied_swaths([log(), log()], 5.0)
    assert once is not None
    assert twice is not None
    assert once.area > 2000.0
    assert twice.area == pytest.approx(once.area, rel=1e-4)
    assert len(twice.passes) == 2 * len(once.passes)


def test_sorties_with_other_origins_meet_on_one_plane():
    one = log()
    assert one.track.origin is not None
    zero = one.track.origin
    # The same place, counted from 0.001° further north: 110.97 m.
    moved = one.track.position_ned - np.array([110.97, 0.0, 0.0])
    there = replace(zero, latitude_deg=zero.latitude_deg + 0.001)
    other = replace(one, track=replace(one.track, position_ned=moved, origin=there))
    alone, both = applied_swaths([one], 5.0), applied_swaths([one, other], 5.0)
    assert alone is not None
    assert both is not None
    assert both.area == pytest.approx(alone.area, rel=0.01)


def test_sorties_without_a_place_on_the_globe_have_no_common_area():
    bare = replace(log(), track=replace(log().track, origin=None))
    both, one = applied_swaths([bare, log()], 5.0), applied_swaths([bare], 5.0)
    assert both is not None
    assert one is not None
    assert np.isnan(both.area)
    assert one.area > 2000.0
    assert one.ground is None


def test_a_pause_of_the_log_is_not_sprayed():
    track = log().track
    on = np.flatnonzero((track.spraying > 0.5) & track.flying)
    half = on[20]
    later = track.time_s + np.where(np.arange(track.time_s.size) > half, 60.0, 0.0)
    whole, cut = (
        applied_swaths([log()], 5.0),
        applied_swaths([replace(log(), track=replace(track, time_s=later))], 5.0),
    )
    assert whole is not None
    assert cut is not None
    assert len(cut.passes) == len(whole.passes) + 1
    assert cut.area < whole.area


def test_a_pump_that_is_never_on_makes_no_area():
    off = replace(log().track, spraying=np.zeros(log().track.time_s.size))
    assert applied_swaths([replace(log(), track=off)], 5.0) is None


def test_a_gauge_and_a_stated_or_inferred_level_are_not_confused():
    assert gauge_estimate(log().track) is not None
    assert pump_estimate(log().track) is None
    stated = replace(log().track.source("tank_kg"), kind="stated")
    sources = {**log().track.sources, "tank_kg": stated}
    assert gauge_estimate(replace(log().track, sources=sources)) is None


def test_what_rotors_carried_less_is_an_estimate_where_their_speeds_are_known():
    """The gauge fell by 6.15 kg, which no other estimate may use."""
    track, airframe = log().track, load_airframe("topxgun-f16-sitl")
    found = thrust_estimate(track, airframe)
    assert found is not None
    assert found.by == "thrust"
    assert 0.5 < found.within_kg < 4.0
    assert found.kg == pytest.approx(6.15, abs=found.within_kg)
    unknown = np.full_like(track.rotor_speed_rpm, np.nan)
    assert thrust_estimate(replace(track, rotor_speed_rpm=unknown), airframe) is None


def test_what_a_pump_did_in_a_pause_of_the_log_is_not_known():
    track = log().track
    summed = replace(
        track.source("tank_kg"),
        kind=SourceKind.INFERRED,
        remarks=(state("as written", text="3 L/min"),),
    )
    track = replace(track, sources={**track.sources, "tank_kg": summed})
    whole = pump_estimate(track)
    assert whole is not None
    assert whole.kg > 1.0
    row = np.flatnonzero(track.flying)[600]
    for pause, known in ((2.8, True), (3.2, False)):  # beside the 0.1 s between rows
        later = track.time_s + np.where(np.arange(track.time_s.size) > row, pause - 0.1, 0.0)
        assert (pump_estimate(replace(track, time_s=later)) is not None) == known


def made(by: str, kg: float, within: float = 0.0) -> Liquid:
    return Liquid(by=by, kg=kg, within_kg=within, source="x")


@pytest.mark.parametrize(
    ("gauge", "pump", "within", "agree"),
    [
        (10.0, 10.9, 0.0, True),
        (10.0, 11.5, 0.0, False),
        (10.0, 13.0, 2.0, True),
        (0.0, 5.0, 0.0, False),
    ],
)
def test_two_estimates_agree_within_a_tenth_and_their_intervals(gauge, pump, within, agree):
    (found,) = differences([made("gauge", gauge), made("pump", pump, within)])
    assert found["agree"] is agree
    assert found["difference_kg"] == pytest.approx(pump - gauge)
    said = list(liquid_words([], [found]))
    assert bool(said) is not agree
    assert all(words.startswith("pump shows") for words in said)


def test_the_liquid_of_a_job_is_known_when_that_of_each_sortie_is():
    assert job_estimate([made("gauge", 3.0), None]) is None
    whole = job_estimate([made("gauge", 3.0, 3.0), made("gauge", 4.0, 4.0)])
    assert whole is not None
    assert (whole.kg, whole.within_kg) == (7.0, 5.0)


def test_litres_are_not_made_without_a_density():
    found = liquid_entries([made("gauge", 6.0)], None, 0.5)
    assert found["quantity"].unit == "kg"
    assert "spray_volume" not in found
    assert liquid_entries([made("gauge", 6.0)], 1.2, 0.5)["spray_volume"].value == pytest.approx(
        10.0
    )


def test_the_rate_needs_a_unit(capsys, tmp_path):
    assert product_entries("200 g/ha", 2.0)["product_quantity"].value == 400.0
    assert product_entries("1,5 L/ha", None) == {}
    with pytest.raises(DataError, match="is no dose"):
        product_entries("1.5", 2.0)
    out = tmp_path / "job"
    assert run(["record", str(LOG), "--rate", "a lot", "--out", str(out)]) == 1
    assert "is no dose" in capsys.readouterr().err
    assert not out.exists()


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_on_a_terminal_what_is_missing_is_asked(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.stdin", Terminal("Farmer\n\nX\n"))
    words = ["record", str(LOG), "--rule", "us", "--out", str(tmp_path), "--zone", "UTC"]
    assert run(words) == 0
    assert "name of the person served" in capsys.readouterr().out
    fields = json.loads((tmp_path / "record.json").read_text("utf-8"))["fields"]
    assert fields["customer"] == {
        "value": "Farmer",
        "unit": "",
        "source": "terminal",
        "detail": "",
    }
    assert "customer_address" not in fields


@pytest.mark.parametrize(
    ("more", "said"),
    [(["--zone", "Nowhere/City"], "--zone"), (["--swath", "0"], "--swath 0 m is not between")],
)
def test_options_that_mean_nothing_are_refused(more, said, tmp_path, capsys):
    assert run(["record", str(LOG), "--out", str(tmp_path / "job"), *more]) == 2
    assert said in capsys.readouterr().err


def test_every_field_of_a_rule_has_a_title():
    asked = {f for rule in job_rules().values() for item in rule.items for f in item.fields}
    assert asked <= TITLES.keys()
    assert job_rules().keys() == {"us", "eu", "uk", "nsw"}


def test_a_conditional_item_says_when_it_is_due():
    eu = job_rules()["eu"]
    lacking = open_items(eu, {f for item in eu.items for f in item.fields} - {"growth_stage"})
    assert [item["fields"] for item in lacking] == [["growth_stage"]]
    (said,) = missing_words([{"title": "EU", "missing": lacking, "late": False}])
    assert "due where the authorisation restricts the growth stage" in said


def test_a_record_is_due_by_the_rule_and_not_without_an_end():
    end = datetime(2026, 3, 1, 8, tzinfo=UTC)
    assert due_utc(job_rules()["nsw"], end) == datetime(2026, 3, 3, 8, tzinfo=UTC)
    assert due_utc(job_rules()["nsw"], None) is None
