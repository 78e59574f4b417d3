"""`learn --store` on recorded flights: what is stored, what is refused, who is named."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.gcs_plugin.logs.log_files import with_rotor_speeds
from tests.gcs_plugin.store.season import content, files
from tests.import_graph import ROOT
from tests.stripped_logs import without
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.office.season.stored_words import flight_reason
from thrustmargin.gcs_plugin.store.ingest_run import content_of
from thrustmargin.gcs_plugin.store.schema import FLIGHTS
from thrustmargin.gcs_plugin.store.season_store import SeasonStore, read_flights, read_sums
from thrustmargin.gcs_plugin.workshop.learn.season_flight import (
    IngestSettings,
    season_flights,
)
from thrustmargin.gcs_plugin.workshop.learn.season_intake import find_logs
from thrustmargin.models.errors import DataError
from thrustmargin.models.identification.season.flight_sums import from_arrays
from thrustmargin.models.physics.known_battery import battery_resistance

FLIGHT = ROOT / "sitl_logs/campaign/v4_m16_q2.5.tlog"
OTHER = ROOT / "sitl_logs/formats/v4_m10_q2.5.BIN"
#: To start a process takes longer than to read a log; several are tested where the run is.
ALONE = ("--workers", "1")


@pytest.fixture(scope="module")
def taken_in(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict, dict]:
    """A store of two flights among files that are none, its JSON and the report's."""
    folder = tmp_path_factory.mktemp("season")
    logs = folder / "logs" / "deep"
    logs.mkdir(parents=True)
    shutil.copy(FLIGHT, logs / "a.tlog")
    shutil.copy(FLIGHT, logs / "b.TLOG")
    shutil.copy(OTHER, logs)
    (logs / "cut.BIN").write_bytes(OTHER.read_bytes()[:300])
    (logs / "empty.tlog").touch()
    (logs / "noise.ulg").write_bytes(np.random.default_rng(1).bytes(5000))
    (logs / "table.csv").write_text("a,b\n1,2\n")
    (logs / "notes.md").write_text("not a log")
    said, report = folder / "said.json", folder / "report.json"
    words = ["learn", str(folder / "logs"), "--store", str(folder / "store"), *ALONE]
    words += ["--json", str(said)]
    assert run(words) == 1
    assert run(["report", str(FLIGHT), "--json", str(report)]) == 0
    return folder, json.loads(said.read_text()), json.loads(report.read_text())


@pytest.mark.slow
def test_a_flight_is_stored_once_and_bad_logs_are_listed(taken_in: tuple[Path, dict, dict]):
    _, said, _ = taken_in
    assert sorted(said["flights"]) == sorted(map(content_of, map(str, (FLIGHT, OTHER))))
    assert said["already_stored"] == 1
    reasons = {row["name"]: row["reason"] for row in said["rejected"]}
    assert set(reasons) == {"cut.BIN", "empty.tlog", "noise.ulg", "table.csv"}
    assert all(reasons.values())
    assert reasons["empty.tlog"] == "is empty (0 bytes); copy it from the vehicle again"


def test_the_summary_is_what_the_report_says(taken_in: tuple[Path, dict, dict]):
    folder, _, report = taken_in
    rows = read_flights(SeasonStore.open(str(folder / "store"))).to_pylist()
    stored = {row["flight"]: row for row in rows}[content_of(str(FLIGHT))]
    flight = report["flights"][0]
    assert stored["verdict"] == flight["verdict"]["level"]
    assert stored["worst_margin"] == flight["verdict"]["worst"]["margin"]
    assert stored["worst_margin"] == min(stored["margin_by_rotor"])
    assert stored["rows_above_limit_s"] == flight["verdict"]["use"]["above_limit_s"]
    assert stored["fill_kg"] == flight["verdict"]["fill"]["kg"]
    assert stored["hectares"] == flight["flight"]["sprayed_area"] / 1e4
    assert stored["hectares_at_least"] is flight["flight"]["sprayed_area_at_least"] is None
    assert stored["flying_s"] == flight["flight"]["airborne_s"]
    assert stored["takeoff_mass_kg"] == pytest.approx(21.1 + stored["tank_start_kg"])
    assert stored["aircraft"] == "sysid-1"
    assert stored["aircraft_by"] == "system id"
    assert set(stored) == {c.name for c in FLIGHTS} | {"aircraft", "month"}
    assert stored["sums_reason"] is None


@pytest.mark.slow
def test_a_good_flight_that_is_predicted_alone_has_no_margin_and_no_good_rank(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    logs = tmp_path / "logs"
    logs.mkdir()
    silent = ("ESC_TELEMETRY_1_TO_4", "SERVO_OUTPUT_RAW")
    light = ROOT / "sitl_logs/onset/reference.tlog"
    without(light, logs / "unseen.tlog", *silent)
    store = str(tmp_path / "store")
    airframe = ["--airframe", "topxgun-f16-sitl"]
    assert run(["learn", str(logs), "--store", store, "--aircraft", "A7", *airframe]) == 0
    (stored,) = read_flights(SeasonStore.open(store)).to_pylist()
    assert stored["verdict"] == "unknown"
    assert {stored[n] for n in ("worst_margin", "mean_margin", "worst_rotor")} == {None}
    assert set(stored["margin_by_rotor"]) == {None}
    assert stored["reason_kinds"] == ["predicted_alone"]
    assert flight_reason(stored).startswith("predicted: for most of the flight")
    capsys.readouterr()
    assert run(["fleet", store, "--json", str(tmp_path / "fleet.json")]) == 0
    (rank_aircraft,) = json.loads((tmp_path / "fleet.json").read_text())["aircraft"]
    assert (rank_aircraft["level"], rank_aircraft["worst_margin"]) == ("no verdict", None)
    said = capsys.readouterr().out
    assert "none measured" in said
    assert "1 of 1 flights have no verdict: predicted: for most of" in said


def test_rows_and_sums_are_those_of_the_flight(taken_in: tuple[Path, dict, dict]):
    folder, _, report = taken_in
    store = SeasonStore.open(str(folder / "store"))
    name = content_of(str(FLIGHT))
    rows = [row for row in content(store)["rows"] if row["flight"] == name]
    assert len(rows) == 2210
    least = min(row[f"margin_{k}"] for row in rows for k in (1, 2, 3, 4) if row["flying"])
    assert least == pytest.approx(report["flights"][0]["verdict"]["worst"]["margin"], abs=1e-6)
    assert all(row["rotor_speed_rpm_5"] is None for row in rows)
    (sums,) = (row for row in read_sums(store) if row["flight"] == name)
    evidence = from_arrays(sums["arrays"])
    assert evidence.rotor_count == 4
    assert 150.0 < evidence.seconds < 230.0


def test_again_nothing_is_read_or_changed(taken_in: tuple[Path, dict, dict], tmp_path: Path):
    folder, _, _ = taken_in
    shutil.copytree(folder / "store", tmp_path / "store")
    before = files(tmp_path / "store")
    said = tmp_path / "said.json"
    words = [str(FLIGHT), str(OTHER), "--store", str(tmp_path / "store"), "--json", str(said)]
    assert run(["learn", *words]) == 0
    assert json.loads(said.read_text())["already_stored"] == 2
    after = files(tmp_path / "store")
    assert {k: v for k, v in after.items() if "rejected" not in k} == {
        k: v for k, v in before.items() if "rejected" not in k
    }


@pytest.mark.slow
def test_again_under_another_name_it_is_as_if_taken_in_so_at_first(
    taken_in: tuple[Path, dict, dict], tmp_path: Path
):
    folder, _, _ = taken_in
    shutil.copytree(folder / "store", tmp_path / "store")
    logs = [str(FLIGHT), str(OTHER)]
    words = [
        *logs,
        *ALONE,
        "--aircraft",
        "seven",
        "--load",
        "12",
    ]  # with a load the rows differ too
    for _ in range(2):
        assert run(["learn", *words, "--store", str(tmp_path / "store"), "--again"]) == 0
    assert run(["learn", *words, "--store", str(tmp_path / "fresh")]) == 0
    found, fresh = (
        {k: v for k, v in files(tmp_path / name).items() if "rejected" not in k}
        for name in ("store", "fresh")
    )
    assert found == fresh
    assert {key.split("/")[1] for key in found} == {"aircraft=seven"}


@pytest.mark.slow
def test_anonymised_nobody_and_no_place_is_named(
    taken_in: tuple[Path, dict, dict],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    log = tmp_path / "smith-north-field.tlog"
    shutil.copy(FLIGHT, log)
    words = ["learn", str(log), *ALONE, "--aircraft", "smith-7", "--anonymise", "--store"]
    assert run([*words, str(tmp_path / "store")]) == 0
    store = SeasonStore.open(str(tmp_path / "store"))
    (row,) = read_flights(store).to_pylist()
    names = [row[k] for k in ("log_name", "system_id", "latitude_deg", "longitude_deg")]
    assert names == [None] * 4
    assert row["flight"] != content_of(str(log))
    everything = b"".join(files(tmp_path / "store").values())
    everything += "".join(map(str, (tmp_path / "store").rglob("*"))).encode()
    for word in (b"smith", b"north-field", b"sysid"):
        assert word not in everything.replace(str(tmp_path).encode(), b"")
    rows = content(store)["rows"]
    placed = next(r for r in rows if r["position_ned_n"] is not None)
    assert (placed["position_ned_n"], placed["position_ned_e"]) == (0.0, 0.0)
    assert all(r["altitude"] is None for r in rows)
    open_row = read_flights(SeasonStore.open(str(taken_in[0] / "store"))).to_pylist()
    same = next(r for r in open_row if r["log_format"] == "tlog")
    for figure in (
        "worst_margin",
        "verdict",
        "hectares",
        "fill_kg",
        "flying_s",
        "prediction_rmse_rpm",
    ):
        assert row[figure] == same[figure]
    assert run([*words, str(tmp_path / "store")]) == 0  # known by its pseudonym
    assert read_flights(store).num_rows == 1
    capsys.readouterr()
    assert run(["learn", str(log), "--store", str(tmp_path / "store")]) == 1
    assert "would be counted twice" in capsys.readouterr().err

    fleet = [tmp_path / f"fleet.{ending}" for ending in ("html", "json", "csv")]
    asked = zip(("--out", "--json", "--csv"), map(str, fleet), strict=True)
    assert run(["fleet", str(tmp_path / "store"), *(w for pair in asked for w in pair)]) == 0
    for made in fleet:
        for word in ("smith", "36.65", "sysid", str(tmp_path)):
            assert word not in made.read_text()
    page = tmp_path / "page.html"
    assert run(["report", str(log), "--anonymise", "--out", str(page)]) == 0
    for made in (page, page.with_suffix(".json"), page.with_suffix(".csv")):
        text = made.read_text()
        assert "smith" not in text
        assert "36.65" not in text
        assert "EKF3" not in text


def test_folders_patterns_and_live_recordings_name_logs(tmp_path: Path):
    recording = tmp_path / "20260501-080000"
    recording.mkdir()
    shutil.copy(FLIGHT, recording / "telemetry.tlog")
    found, refused = find_logs((str(tmp_path),))
    assert found == []
    assert refused == [
        (
            "20260501-080000/telemetry.tlog",
            "it is still being recorded; learn it afterwards",
        )
    ]
    os.utime(recording / "telemetry.tlog", (1.0, 1.0))
    found, refused = find_logs((str(tmp_path / "2026*"), str(recording)))
    assert [log.name for log in found] == ["20260501-080000/telemetry.tlog"]
    with pytest.raises(DataError, match="no log at"):
        find_logs((str(tmp_path / "*.ulg"),))


@pytest.mark.parametrize("name", ["a/b", "", "..", "x=y", "a b"])
def test_a_name_that_no_folder_may_have_is_refused(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    words = ["learn", str(FLIGHT), "--store", str(tmp_path / "s"), "--aircraft", name]
    assert run(words) == 1
    assert "--aircraft" in capsys.readouterr().err
    assert not (tmp_path / "s").exists()


def test_resistance_is_found_beside_the_drain_and_not_without_current_or_rest():
    rng = np.random.default_rng(3)
    time_s = np.arange(0.0, 400.0, 0.1)
    flying = time_s >= 20.0
    # The current falls as the tank empties, and the battery drains as it does.
    current = np.where(flying, 60.0 + 2.0 * np.sin(time_s / 7.0) - 0.05 * time_s, 1.0)
    drawn = np.cumsum(current) / current.sum()
    voltage = 52.0 - 4.0 * drawn - 0.03 * current + rng.normal(0.0, 0.05, time_s.size)
    ohm, error = battery_resistance(time_s, voltage, current, flying)
    assert abs(ohm - 0.03) < 4.0 * error
    assert error < 0.001
    for rest in (flying, flying | (time_s < 20.0)):
        amperes = np.nan * current if rest is flying else current
        assert np.isnan(battery_resistance(time_s, voltage, amperes, rest)).all()


@pytest.mark.parametrize("name", ["v2_m10_q1.5", "v2_m4_q3.5", "v4_m16_q3.5", "v6_m4_q1.5"])
def test_the_simulators_battery_has_one_resistance_in_all_flights(sitl_logs, name):
    """In flight alone these gave 0.01 to 0.25 ohm."""
    track = read_log(sitl_logs / "campaign" / f"{name}.tlog").track
    ohm, error = battery_resistance(track.time_s, track.voltage, track.current, track.flying)
    assert abs(ohm - 0.03) < 0.002
    assert error < 0.002


def test_a_flight_whose_escs_fall_silent_has_a_verdict_and_teaches_what_was_measured(
    sitl_logs, tmp_path
):
    def silent_from_the_middle(speeds):
        return np.where(np.arange(len(speeds))[:, None] < len(speeds) // 2, speeds, 0.0)

    path = tmp_path / "half.tlog"
    flight = sitl_logs / "campaign/v4_m10_q2.5.tlog"
    path.write_bytes(with_rotor_speeds(flight, silent_from_the_middle))
    (stored,) = season_flights(path, "0" * 16, IngestSettings(store=""), name=path.name)
    assert stored.summary["verdict"] == "under"
    assert stored.summary["sums_reason"] is None
    assert stored.sums is not None


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--cluster", "tcp://h:1"], "--cluster is about the store of a season; add --store"),
        (["--anonymise"], "--anonymise is about the store"),
        (["--model", "m.safetensors"], "--model is about the store"),
        (["--airframe", "agras-t20"], "--airframe is about the store"),
        (["--max-utilisation", "60%"], "--max-utilisation is about the store"),
        (["--json", "-"], "--json is about the store"),
        (["--store", "s", "--mass", "18"], "--mass is about making one aircraft known"),
        (["--store", "s", "--hangar", "h"], "--hangar is about making"),
        (["--store", "s", "--no-learn"], "--no-learn is about making"),
        (["--store", "s", "--seed", "3"], "--seed is about making"),
        (["--store", "s", "--cluster", "tcp://h:1", "--workers", "2"], "leave out --workers"),
        (["--workers", "0"], "--workers 0 is not between"),
    ],
)
def test_options_that_make_no_sense_together_are_a_wrong_command_line(
    words: list[str], said: str, tmp_path: Path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert run(["learn", str(FLIGHT), *words]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_an_address_is_for_a_season_and_a_folder_without_logs_names_the_endings(
    tmp_path: Path, capsys
):
    assert run(["learn", "s3://season/logs"]) == 2
    assert "s3://season/logs: logs at an address are taken into a season" in capsys.readouterr().err
    for store in ((), ("--store", str(tmp_path / "s"))):
        assert run(["learn", str(tmp_path), *store]) == 1
        assert f"no log in {tmp_path}; its endings are .bin" in capsys.readouterr().err
        assert run(["learn", str(tmp_path / "gone.BIN"), *store]) == 1
        assert "no log at" in capsys.readouterr().err
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize(
    ("words", "now"),
    [
        (["a b/*.tlog", "--store", "s"], "learn 'a b/*.tlog' --store s"),
        (["x", "--quiet", "--store=s"], "learn x --quiet --store=s"),
        (["x", "--workers", "2"], "learn --store 'my hangar' x --workers 2"),
    ],
)
def test_the_old_name_says_the_command_to_type_now(words, now, monkeypatch, capsys):
    monkeypatch.setenv("THRUSTMARGIN_HANGAR", "my hangar")
    assert run(["ingest", *words]) == 2
    said = capsys.readouterr()
    assert said.err == f"thrustmargin: ingest is no command any more; type: thrustmargin {now}\n"
    assert said.out == ""
    assert run(["--help"]) == 0
    assert "ingest" not in capsys.readouterr().out
