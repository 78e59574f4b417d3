"""The page, the table, JSON and CSV of a fleet."""

import csv
import io
import json
import os
from pathlib import Path

import numpy as np
import pytest

from tests.gcs_plugin.office.season.made_store import flight_row, made_store, rows_of, sums_of
from tests.models.identification.season.made_seasons import LOSS_2, season, wear, with_change
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.office.season.aircraft_season import aircraft_season
from thrustmargin.gcs_plugin.office.season.fleet_page import (
    as_csv,
    as_json,
    cells,
    chart,
    html_text,
    rank_aircraft,
)
from thrustmargin.gcs_plugin.store.season_store import SeasonStore
from thrustmargin.gcs_plugin.store.staging import SeasonFlight, merge, stage, staged_partitions

RNG = np.random.default_rng
HOSTILE = "<script>alert(1)</script>=cmd()"

CHANGE = "with the battery off, change propeller 2 for a new one of the same kind"


def fleet():
    worn = with_change(season(RNG(1), 40), LOSS_2, wear(40, 20, 0.003))
    rows = rows_of(40, alarms=[HOSTILE], log_name=HOSTILE)
    return rank_aircraft(
        "season",
        [
            aircraft_season("sound", rows_of(40), sums_of(season(RNG(2), 40))),
            aircraft_season(HOSTILE, rows_of(5, verdict="unknown", verdict_reason=HOSTILE), []),
            aircraft_season("worn", rows, sums_of(worn)),
        ],
    )


def test_the_worst_aircraft_is_the_call_of_the_page():
    made = fleet()
    assert [a.name for a in made.aircraft] == ["worn", HOSTILE, "sound"]
    assert made.call == f"worn: {CHANGE}"
    page = html_text(made)
    assert page.index(
        "worn: with the battery off, change propeller 2 for a new one of the same kind"
    ) < page.index("All aircraft")
    assert "would have been seen" in page


@pytest.mark.parametrize(
    ("second", "whole", "least"),
    [
        ({"hectares": 0.5, "spraying_s": 60.0}, 2.5, None),
        ({"spraying_s": 0.0}, 2.0, None),
        ({"hectares_at_least": 0.25, "spraying_s": 60.0}, None, 2.25),
        ({"spraying_s": 60.0}, None, 2.0),  # of a line alone no width is known
        ({}, None, 2.0),
    ],
)
def test_hectares_of_a_part_are_not_those_of_the_season(second, whole, least):
    rows = [flight_row(0, hectares=2.0, spraying_s=200.0), flight_row(1, **second)]
    made = rank_aircraft("season", [aircraft_season("mine", rows, [])])
    (one,) = json.loads(as_json(made))["aircraft"]
    assert (one["hectares"], one["hectares_at_least"]) == (whole, least)


def test_a_flight_that_was_lost_without_a_known_margin_is_listed_first():
    bad = {"verdict": "battery", "worst_margin": None, "log_name": "collapsed.tlog"}
    rows = [flight_row(0, verdict="over", worst_margin=0.4), flight_row(1, **bad)]
    made = rank_aircraft("season", [aircraft_season("mine", rows, [])])
    assert [f["log_name"] for _, f in made.above_limit] == ["collapsed.tlog", "flight_1.tlog"]
    assert "collapsed.tlog" in html_text(made)


def test_a_season_goes_from_its_first_day_to_its_last_and_has_its_least_margin():
    sound = aircraft_season("a", [*rows_of(39), flight_row(39, worst_margin=0.42)], [])
    made = rank_aircraft("season", [sound])
    assert made.days == "1 May 2026 to 9 Jun 2026"
    assert cells(sound)[:6] == ("a", "sound", "40", "6.7", "42 %", "0")
    blind = aircraft_season("b", [flight_row(0, started_unix_s=None, worst_margin=None)], [])
    assert rank_aircraft("season", [blind]).days == "no dates"
    assert cells(blind)[4] == "none measured"


def test_text_of_a_log_stays_text():
    page = html_text(fleet(), alone=True)
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert(1)" in page
    assert "script-src 'none'" in page or "script-src ;" in page or "<script" not in page
    hostile = next(r for r in csv.reader(io.StringIO(as_csv(fleet()))) if HOSTILE in r[0])
    assert all(cell[:1] not in ("=", "+", "-", "@") for cell in hostile)


def test_json_has_null_for_what_is_unknown_and_every_change():
    told = json.loads(as_json(fleet()))
    worn = told["aircraft"][0]
    (trend,) = (t for t in worn["trends"] if t["changes"])
    assert trend["name"] == LOSS_2
    assert trend["changes"][0]["ramp"] is True
    assert abs(trend["changes"][0]["flight"] - 20) <= 3
    assert told["aircraft"][1]["smallest_loss_seen"] is None


def test_a_chart_draws_each_flight_and_marks_each_change():
    found = fleet().aircraft[0].changes
    trend = found.trend(LOSS_2) if found else None
    assert trend is not None
    assert str(chart(trend)).count("<circle") == 40
    assert str(chart(trend)).count('class="at"') == 1


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    worn = with_change(season(RNG(1), 30), LOSS_2, wear(30, 12, 0.003))
    folder = tmp_path_factory.mktemp("fleet") / "season"
    return made_store(folder, {"a-1": season(RNG(2), 30), "a-2": worn})


@pytest.mark.slow
def test_the_command_says_whom_to_look_at_and_writes_page_json_and_csv(
    store: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    page, numbers = tmp_path / "fleet.html", tmp_path / "fleet.json"
    assert run(["fleet", store, "--out", str(page), "--json", str(numbers)]) == 0
    assert capsys.readouterr().out.startswith("a-2: with the battery off, change propeller 2")
    assert f"<title>a-2: {CHANGE}</title>" in page.read_text("utf-8")
    assert json.loads(numbers.read_text())["aircraft"][0]["aircraft"] == "a-2"
    assert run(["fleet", store, "--aircraft", "a-1", "--csv", "-"]) == 0
    rows = list(csv.reader(io.StringIO(capsys.readouterr().out)))
    assert [r[0] for r in rows] == ["aircraft", "a-1"]


def test_sql_and_compare_read_the_same_store(store: str, capsys: pytest.CaptureFixture[str]):
    assert run(["fleet", store, "--sql", "select count(*) as n from flights", "--csv", "-"]) == 0
    assert capsys.readouterr().out.split() == ["n", "60"]
    assert run(["fleet", store, "--compare", "a-1", "a-2", "--csv", "-"]) == 0
    assert "worst_margin,0.6,0.6" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--aircraft", "a-3"], "it has a-1, a-2"),
        (["--compare", "a-1", "x"], "no aircraft, flight or model 'x'"),
        (["--sql", "drop table flights"], "takes one SELECT"),
    ],
)
def test_what_is_not_there_is_said(
    store: str, capsys: pytest.CaptureFixture[str], words: list[str], said: str
):
    assert run(["fleet", store, *words]) == 1
    assert said in capsys.readouterr().err


def test_a_folder_without_flights_asks_for_logs(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert run(["fleet", str(tmp_path)]) == 1
    assert "thrustmargin learn" in capsys.readouterr().err


def test_a_hexacopter_under_the_name_of_a_quad_has_a_season_of_its_own(tmp_path: Path):
    flights = season(RNG(8), 6)
    where = made_store(tmp_path / "s", {"sysid-1": flights}, rotor_count=4, layout="quad-x")
    store = SeasonStore.open(where)
    for k in range(5):
        row = flight_row(k, flight=f"hexa{k:012x}", rotor_count=6, layout="hexa-x")
        rows = {"time_s": np.arange(2.0)}
        stage(store, SeasonFlight(aircraft="sysid-1", summary=row, rows=rows, sums=None))
    for at, keys in staged_partitions(store).items():
        merge(store, *at, keys)
    said = tmp_path / "fleet.json"
    assert run(["fleet", where, "--aircraft", "sysid-1", "--json", str(said)]) == 0
    found = {a["aircraft"]: a for a in json.loads(said.read_text())["aircraft"]}
    assert {name: a["flights"] for name, a in found.items()} == {
        "sysid-1 (4 rotors, quad-x)": 6,
        "sysid-1 (6 rotors, hexa-x)": 5,
    }
    for one in found.values():
        assert "its name is that of 2 aircraft" in one["findings"][0]["sentence"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with a name here")
def test_parts_that_are_a_pipe_or_no_file_are_one_line(
    store: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    os.mkfifo(tmp_path / "pipe.csv")
    for name, why in (("pipe.csv", "pipe"), ("none.csv", "No such file"), ("", "folder")):
        assert run(["fleet", store, "--parts", str(tmp_path / name)]) == 1
        (said,) = capsys.readouterr().err.splitlines()
        assert "cannot read --parts" in said
        assert why in said
