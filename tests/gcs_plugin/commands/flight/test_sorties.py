"""Commands on a log of two flights: each has its verdict, the worse first, and is stored."""

import json
from pathlib import Path

import pytest

from tests.gcs_plugin.logs.sortie_logs import HEAVY, LIGHT, rebooted, refilled
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.commands.flight.replay import replay_view
from thrustmargin.gcs_plugin.workshop.learn.season_flight import IngestSettings, season_flights
from thrustmargin.models.errors import DataError
from thrustmargin.models.model.model_file import shipped_model


def levels(report: Path, *logs: Path) -> list[str]:
    assert run(["report", *map(str, logs), "--json", str(report)]) == 0
    return [f["verdict"]["level"] for f in json.loads(report.read_text())["flights"]]


@pytest.mark.slow
def test_a_report_has_a_verdict_on_each_sortie_and_says_the_worse_first(tmp_path: Path, capsys):
    alone = levels(tmp_path / "alone.json", LIGHT, HEAVY)
    assert alone == ["under", "critical"]
    capsys.readouterr()
    assert levels(tmp_path / "day.json", refilled(tmp_path / "day.tlog")) == alone
    said = capsys.readouterr()
    headlines = [line for line in said.out.splitlines() if not line.startswith(("  ", "wrote"))]
    assert headlines[0] == "1 OF 2 FLIGHTS: TOO HEAVY TO LOSE A ROTOR"
    assert headlines[1].startswith("day.tlog sortie 2 of 2: FILL LESS: FOR ")
    assert headlines[2] == "day.tlog sortie 1 of 2: THRUST LEFT ABOVE THE 50 % LIMIT"
    assert "day.tlog: 2 sorties in the log, each a flight of its own\n" in said.err
    assert levels(tmp_path / "day.json", rebooted(tmp_path / "day.tlog")) == alone[::-1]


def test_a_load_that_is_stated_is_said_to_be_that_of_each(tmp_path: Path, capsys):
    path = rebooted(tmp_path / "day.tlog")
    json_file = str(tmp_path / "r.json")
    assert run(["report", str(path), "--load", "8", "--json", json_file]) == 0
    assert "the load that you state is taken for each of them" in capsys.readouterr().err


@pytest.mark.slow
def test_a_season_keeps_each_sortie_under_a_name_of_its_own(tmp_path: Path):
    path = rebooted(tmp_path / "day.tlog")
    flights = season_flights(path, "f" * 16, IngestSettings(store=""), name="north/day.tlog")
    rows = [flight.summary for flight in flights]
    assert [row["flight"] for row in rows] == ["f" * 16, "f" * 16 + "-sortie-2"]
    assert [row["log_name"] for row in rows] == [
        "north/day.tlog sortie 1 of 2",
        "north/day.tlog sortie 2 of 2",
    ]
    assert [row["verdict"] for row in rows] == ["critical", "under"]
    assert rows[0]["tank_start_kg"] > rows[1]["tank_start_kg"] + 10.0
    hidden = IngestSettings(store="", key="ab")
    (first, second) = season_flights(path, "f" * 16, hidden, name="north/day.tlog")
    assert first.summary["log_name"] is second.summary["log_name"] is None
    kept = repr((first.summary, second.summary))
    assert "day.tlog" not in kept
    assert "north" not in kept


@pytest.mark.slow
def test_a_replay_shows_the_worst_and_names_the_others(tmp_path: Path, capsys):
    path = refilled(tmp_path / "day.tlog")
    view = replay_view(path, shipped_model(), port=0, paused=True)
    assert view._analysis.track.name == "day.tlog sortie 2 of 2"
    said = capsys.readouterr().err.splitlines()
    assert said[0] == "day.tlog: 2 sorties in the log, each a flight of its own"
    assert said[1].startswith("  sortie 1: from 2026-")
    assert said[1].endswith("THRUST LEFT ABOVE THE 50 % LIMIT; --sortie 1 shows it")
    assert said[2].endswith("; shown")
    view = replay_view(path, shipped_model(), sortie=1, port=0, paused=True)
    assert view._analysis.track.name == "day.tlog sortie 1 of 2"
    with pytest.raises(DataError, match=r"--sortie 3: day\.tlog holds sorties 1 to 2"):
        replay_view(path, shipped_model(), sortie=3, port=0)


def test_inspect_shows_each_sortie(tmp_path: Path, capsys):
    path, said = rebooted(tmp_path / "day.tlog"), tmp_path / "said.json"
    assert run(["inspect", str(path), "--json", str(said)]) == 0
    found = json.loads(said.read_text())
    assert [(one["file"], one["sortie"], one["sorties"]) for one in found] == [
        ("day.tlog", 1, 2),
        ("day.tlog", 2, 2),
    ]
    printed = capsys.readouterr().out
    assert "\n  sortie 2: from 2026-" in printed
    assert "\nday.tlog sortie 2 of 2: tlog, ArduPilot, vehicle 1, " in printed
