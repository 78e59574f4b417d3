"""`thrustmargin report` as a user runs it: what it prints and writes, and what it refuses."""

import json
import shutil
from pathlib import Path

import pytest

from tests.gcs_plugin.reports.margin.report_flight import LOG
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.models.model.model_file import save_model
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe


@pytest.fixture(scope="module")
def model_file(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("model") / "curve.safetensors"
    save_model(physics_model(load_airframe("topxgun-f16-sitl")), path)
    return path


def test_one_log_gives_page_json_csv_and_a_verdict_in_words(tmp_path, capsys):
    out = tmp_path / "r.html"
    assert run(["report", str(LOG), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    made = json.loads(out.with_suffix(".json").read_text("utf-8"))
    verdict = made["flights"][0]["verdict"]
    assert verdict["headline"] in said
    for fact in verdict["facts"]:
        assert fact["text"] in said
    assert 500_000 < out.stat().st_size < 1_000_000  # the library of the charts is inside
    assert out.with_suffix(".csv").read_text("utf-8").startswith('"flight_number","time_s [s]"')


def test_the_shipped_model_predicts_the_flight_with_its_network(tmp_path):
    out = tmp_path / "r.html"
    run(["report", str(LOG), "--out", str(out)])
    flight = json.loads(out.with_suffix(".json").read_text("utf-8"))["flights"][0]
    assert flight["model"]["network_share"] > 0.5
    assert flight["accuracy"]["promised_coverage"] == 0.9
    assert flight["accuracy"]["overall"]["coverage"]["value"] > 0.5


def test_a_log_that_cannot_be_read_is_named_and_the_others_are_reported(
    tmp_path, capsys, model_file
):
    bad = tmp_path / "bad.tlog"
    bad.write_bytes(b"")
    out = tmp_path / "r.html"
    options = ["--model", str(model_file), "--out", str(out)]
    assert run(["report", str(LOG), str(bad), *options]) == 1
    heard = capsys.readouterr()
    assert "not read: bad.tlog" in heard.err
    made = json.loads(out.with_suffix(".json").read_text("utf-8"))
    assert [f["name"] for f in made["flights"]] == [LOG.name]
    assert [u["name"] for u in made["unread"]] == ["bad.tlog"]


def test_only_unreadable_logs_write_nothing(tmp_path, capsys, model_file):
    bad = tmp_path / "bad.tlog"
    bad.write_bytes(bytes(range(256)) * 40)
    out = tmp_path / "r.html"
    assert run(["report", str(bad), "--model", str(model_file), "--out", str(out)]) == 1
    heard = capsys.readouterr().err.strip()
    assert heard.startswith("thrustmargin: ")
    assert "Traceback" not in heard
    assert not out.exists()


@pytest.mark.parametrize(
    ("options", "said", "code"),
    [
        (["--out", "report.txt"], "end its name in .html", 2),
        (["--out", "no/such/folder/r.html"], "no folder", 1),
        (["--max-utilisation", "50"], "is not a share", 2),
        (["--airframe", "nosuch"], "no airframe", 1),
        (["--model", "nosuch.safetensors"], "nosuch.safetensors", 1),
    ],
)
def test_a_request_that_cannot_work_is_refused_in_one_line(
    options, said, code, tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    assert run(["report", str(LOG), *options]) == code
    heard = capsys.readouterr().err.strip()
    assert said in heard
    assert "\n" not in heard
    assert list(tmp_path.iterdir()) == []


def test_a_log_is_never_overwritten_by_its_report(tmp_path, capsys, model_file):
    log = tmp_path / "flight.csv"
    shutil.copy(LOG, log)
    before = log.read_bytes()
    out = tmp_path / "flight.html"
    assert run(["report", str(log), "--model", str(model_file), "--out", str(out)]) == 1
    assert "would overwrite" in capsys.readouterr().err
    assert log.read_bytes() == before


def test_no_log_is_a_usage_error(capsys):
    assert run(["report"]) == 2
    assert "no log given" in capsys.readouterr().err


def test_a_model_of_another_aircraft_than_asked_for_is_refused(capsys, model_file, tmp_path):
    out = str(tmp_path / "r.html")
    options = ["--model", str(model_file), "--airframe", "agras-t20", "--out", out]
    assert run(["report", str(LOG), *options]) == 1
    assert "is a model of topxgun-f16-sitl" in capsys.readouterr().err


def test_ctrl_c_while_writing_leaves_the_old_report(tmp_path, monkeypatch, model_file):
    out = tmp_path / "r.html"
    out.write_text("old", encoding="utf-8")

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("thrustmargin.gcs_plugin.reports.margin.render.csv_bytes", interrupted)
    assert run(["report", str(LOG), "--model", str(model_file), "--out", str(out)]) == 130
    assert out.read_text("utf-8") == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["r.html"]


def test_a_flight_that_says_nothing_of_its_rotors_gets_a_page_and_no_verdict(tmp_path, capsys):
    log = tmp_path / "bare.csv"
    log.write_text("time_s,airspeed,height_agl\n" + "".join(f"{t},3,9\n" for t in range(60)))
    assert run(["report", str(log), "--out", str(tmp_path / "r.html")]) == 0
    assert "bare.csv: NO VERDICT" in capsys.readouterr().out
    assert (tmp_path / "r.html").exists()


@pytest.mark.parametrize("airframe", ["agras-t20", "agras-t40", "crazyflie-rpm"])
def test_a_flight_of_another_aircraft_has_no_verdict_but_its_reason_and_what_helps(
    airframe, tmp_path, capsys
):
    out = tmp_path / "r.html"
    assert run(["report", str(LOG), "--airframe", airframe, "--out", str(out)]) == 1
    said = capsys.readouterr().out
    assert f"{LOG.name}: NO VERDICT" in said
    assert f"thrustmargin airframe new --from {LOG}" in said
    (flight,) = json.loads(out.with_suffix(".json").read_text())["flights"]
    assert flight["airframe_basis"] == "given"
    assert flight["no_verdict"]
    assert flight["verdict"]["worst"] is None
    assert {r["measured_max"] for r in flight["rotors"]} == {None}
    assert flight["redundancy"]["fill_limit_start_kg"] is None
    assert flight["flight"]["airborne_s"] > 100.0


def test_out_takes_a_page_to_print_as_forecast_does(tmp_path, capsys, model_file):
    paper = tmp_path / "flight.pdf"
    assert run(["report", str(LOG), "--model", str(model_file), "--out", str(paper)]) == 0
    assert paper.read_bytes().startswith(b"%PDF")
    assert [path.name for path in tmp_path.glob("flight*")] == ["flight.pdf"]
    assert f"wrote {paper}" in capsys.readouterr().out
