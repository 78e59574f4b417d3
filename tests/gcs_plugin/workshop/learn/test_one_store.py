"""The hangar and the season's store are one folder with one schema, whoever wrote a flight."""

import json
import os
import subprocess
import sys
from dataclasses import fields
from importlib import resources
from pathlib import Path

import pytest

from tests.known_aircraft import BOARD_LOG, hangar_with_north
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.store.hangar import AircraftFlight, Hangar
from thrustmargin.gcs_plugin.store.schema import FLIGHTS
from thrustmargin.gcs_plugin.store.season_store import SeasonStore, read_sums
from thrustmargin.models.model.model_file import save_model
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

LOGS = Path("sitl_logs")
LOG, OTHER = LOGS / "campaign/v4_m10_q2.5.tlog", LOGS / "campaign/v2_m4_q2.5.tlog"


@pytest.fixture
def hangar(tmp_path: Path, monkeypatch) -> Hangar:
    """A hangar with the simulated F16 under the name north, which commands take by default."""
    made = hangar_with_north(tmp_path / "hangar")
    monkeypatch.setenv("THRUSTMARGIN_HANGAR", str(made.folder))
    return made


def report(*words: str) -> int:
    return run(["report", *words, "--json", "-"])


def stored(hangar: Hangar) -> list[dict]:
    return SeasonStore.open(str(hangar.folder)).table("flights").to_pylist()


def test_each_field_of_a_known_flight_is_a_column_by_the_same_name():
    assert {field.name for field in fields(AircraftFlight)} <= {one.name for one in FLIGHTS}


def test_a_reported_flight_is_in_the_hangar_and_the_season_with_the_same_values(hangar, capsys):
    assert report(str(LOG), "--aircraft", "north") == 0
    (row,) = hangar.load("north").flights
    (kept,) = stored(hangar)
    assert kept["aircraft"] == "north"
    for name in ("flight", "log_name", "started_unix_s", "verdict", "coverage", "use_lasting"):
        assert kept[name] == getattr(row, name), name
    assert kept["mean_power"] == pytest.approx(row.mean_power)
    assert json.loads(kept["offsets"])["offset"] == list(row.offsets.offset)
    assert kept["not_taught"] is None
    (sums,) = read_sums(SeasonStore.open(str(hangar.folder)))
    assert sums["flight"] == row.flight
    capsys.readouterr()
    assert run(["fleet", "--sql", "select aircraft, count(*) as n from flights group by 1"]) == 0
    assert "north" in capsys.readouterr().out
    assert run(["aircraft", "north", "--forget", LOG.name]) == 0
    assert hangar.load("north").flights == ()
    assert stored(hangar) == []


def test_a_season_follows_known_aircraft_and_aircraft_lists_the_others(hangar, capsys):
    store = str(hangar.folder)
    assert run(["learn", str(BOARD_LOG), str(OTHER), "--workers", "1", "--store", store]) == 0
    (row,) = hangar.load("north").flights
    assert row.log_name == BOARD_LOG.name
    assert row.offsets is not None
    by_aircraft = {one["aircraft"]: one for one in stored(hangar)}
    assert sorted(by_aircraft) == ["north", "sysid-1"]
    assert by_aircraft["north"]["coverage"] == row.coverage
    assert by_aircraft["sysid-1"]["coverage"] is None
    capsys.readouterr()
    assert run(["aircraft"]) == 0
    said = capsys.readouterr().out
    assert "north: 1 flight on 1 day" in said
    assert "sysid-1: 1 flight taken in, no model of its own" in said
    done = Path(store).parent / "done.json"
    again = ["learn", str(BOARD_LOG), str(OTHER), "--store", store, "--json", str(done)]
    for words, flights, already in ((again, 0, 2), ([*again, "--again"], 2, 0)):
        assert run(words) == 0
        said = json.loads(done.read_text())
        assert (said["schema"], said["already_stored"]) == ("thrustmargin.learn/1", already)
        assert len(said["flights"]) == flights


def test_a_flight_that_does_not_fit_its_aircraft_is_in_the_season_under_another_name(hangar):
    north = hangar.load("north")
    others = resources.files("thrustmargin.models.airframes").joinpath("agras-t20.toml")
    north.airframe_file.write_bytes(others.read_bytes())
    save_model(physics_model(load_airframe("agras-t20")), north.model_file)
    words = ["learn", str(BOARD_LOG), "--store", str(hangar.folder), "--workers", "1"]
    assert run(words) == 0
    assert hangar.load("north").flights == ()
    (row,) = stored(hangar)
    assert row["log_name"] == BOARD_LOG.name
    assert row["aircraft"] != "north"


def test_two_reports_at_once_lose_no_flight(hangar):
    command = [sys.executable, "-m", "thrustmargin.gcs_plugin.cli", "report", "--json", "-"]
    both = [
        subprocess.Popen(
            [*command, str(log), "--aircraft", "north"],
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        )
        for log in (LOG, OTHER)
    ]  # fmt: skip
    for one in both:
        _, errors = one.communicate(timeout=300)
        assert one.returncode == 0, errors
    names = sorted((LOG.name, OTHER.name))
    assert sorted(one.log_name for one in hangar.load("north").flights) == names
    assert sorted(one["log_name"] for one in stored(hangar)) == names


def test_a_full_disk_costs_no_report_and_no_flight_that_was_kept(hangar, monkeypatch, capsys):
    assert report(str(OTHER), "--aircraft", "north") == 0
    before = hangar.load("north"), stored(hangar)
    whole = os.replace

    def full(source, target, **options):
        if str(hangar.folder) in str(target):
            raise OSError(28, "No space left on device")
        whole(source, target, **options)

    monkeypatch.setattr(os, "replace", full)
    capsys.readouterr()
    assert report(str(LOG), "--aircraft", "north") == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["flights"][0]["verdict"]["level"] == "under"
    assert "north: not kept: cannot write" in said.err
    assert "No space left" in said.err
    assert run(["learn", str(LOG), "--aircraft", "north"]) == 1  # learning is its task
    monkeypatch.undo()
    monkeypatch.setenv("THRUSTMARGIN_HANGAR", str(hangar.folder))
    assert (hangar.load("north"), stored(hangar)) == before
    assert report(str(LOG), "--aircraft", "north") == 0
    assert len(stored(hangar)) == len(hangar.load("north").flights) == 2
