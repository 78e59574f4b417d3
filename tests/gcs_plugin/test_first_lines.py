"""No command's first line is more reassuring than the report's of the same log.

Each kind of log is made of one sound flight (tests/kinds_of_logs.py). A green answer is one without
a word about what is missing; only the sound flight has it.
"""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.kinds_of_logs import KINDS
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.commands.flight.replay import replay_view
from thrustmargin.models.model.model_file import shipped_model

SLOW = ("no_speeds", "zero_speeds", "frozen_voltage", "zero_gauge", "worn", "hexa")
#: Kind -> start of the report's first line, of the forecast's, and a word of its first step.
LINES = {
    "sound": ("THRUST LEFT ABOVE THE 50 % LIMIT", "MAY TAKE OFF WITH 4.0 kg", ""),
    "no_gauge": ("THRUST LEFT ABOVE THE 50 % LIMIT", "MAY TAKE OFF WITH 4.0 kg", ""),
    "truncated": (
        "THRUST LEFT ABOVE THE 50 % LIMIT UP TO 1:54 (LOG ENDS IN FLIGHT)",
        "TAKE OFF WITH 4.0 kg (4.0 L) ONLY IF ITS LAST FLIGHT ENDED WELL (THE LOG ENDS IN FLIGHT",
        "see how the flight ended",
    ),
    "never_flew": ("NO VERDICT", "NO VERDICT: the log shows no flight", "every propeller"),
    "worn_then_sound": (
        "1 OF 2 FLIGHTS: A BAD ROTOR OR MOTOR",
        "TAKE OFF WITH 4.0 kg (4.0 L) ONLY IF THE DAMAGE OF ROTOR 1 WAS REPAIRED",
        "repaired",
    ),
    "sound_then_worn": (
        "1 OF 2 FLIGHTS: A BAD ROTOR OR MOTOR",
        "DO NOT TAKE OFF WITH 4.0 kg (4.0 L): ROTOR 1, FRONT RIGHT: 8 % LESS THRUST",
        "propeller, motor and ESC of rotor 1",
    ),
    "worn": (
        "ROTOR 1, FRONT RIGHT: 8 % LESS THRUST",
        "DO NOT TAKE OFF WITH 4.0 kg (4.0 L): ROTOR 1, FRONT RIGHT: 8 % LESS THRUST",
        "propeller, motor and ESC of rotor 1",
    ),
    "no_esc": (
        "THRUST LEFT ABOVE THE 50 % LIMIT (ROTORS LOOKED AT BY OUTPUTS ALONE)",
        "TAKE OFF WITH 4.0 kg (4.0 L) ONLY IF NO ROTOR IS WEAK FROM THE START",
        "every propeller",
    ),
    "zero_speeds": (
        "THRUST LEFT ABOVE THE 50 % LIMIT (ROTORS LOOKED AT BY OUTPUTS ALONE)",
        "TAKE OFF WITH 4.0 kg (4.0 L) ONLY IF NO ROTOR IS WEAK FROM THE START",
        "every propeller",
    ),
    "no_speeds": ("NO VERDICT", "NO VERDICT: the flight in this log is not rec", "every propeller"),
    "frozen_voltage": (
        "Motors at 60 %",
        "NO VERDICT: the flight in this log is not recognised",
        "voltmeter",
    ),
    "collapsed": (
        "THRUST LEFT ABOVE THE 50 % LIMIT (VOLTMETER LEFT OUT)",
        "TAKE OFF WITH 4.0 kg (4.0 L) ONLY IF THE VOLTAGE IS KNOWN",
        "voltmeter",
    ),
    "stuck_gauge": (
        "THRUST LEFT ABOVE THE 50 % LIMIT (TANK GAUGE LEFT OUT)",
        "TAKE OFF WITH 4.0 kg (4.0 L) ONLY IF THE TANK LEVEL IS KNOWN",
        "tank gauge",
    ),
    "zero_gauge": (
        "THRUST LEFT ABOVE THE 50 % LIMIT (TANK GAUGE LEFT OUT)",
        "TAKE OFF WITH 4.0 kg (4.0 L) ONLY IF THE TANK LEVEL IS KNOWN",
        "tank gauge",
    ),
    "tumbled": (
        "LOST CONTROL AT 1:54",
        "DO NOT TAKE OFF WITH 4.0 kg (4.0 L): control was lost in this log, at 1:54",
        "known why",
    ),
}
GREEN = ("sound", "no_gauge")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    folder = tmp_path_factory.mktemp("kinds")
    logs: dict[str, Path] = {}

    def log(kind: str) -> Path:
        return logs.setdefault(kind, KINDS[kind](folder)) if kind not in logs else logs[kind]

    return SimpleNamespace(log=log)


EACH = [pytest.param(kind, marks=pytest.mark.slow if kind in SLOW else ()) for kind in LINES]


@pytest.mark.parametrize("kind", EACH)
def test_report_forecast_inspect_and_replay_of_a_log_are_equally_sure(kind, made, tmp_path, capsys):
    log, (report, forecast, step) = made.log(kind), LINES[kind]
    file = tmp_path / "r.json"
    assert run(["report", str(log), "--json", str(file)]) == 0
    said = json.loads(file.read_text())
    first = said["overview"]["headline"] if len(said["flights"]) > 1 else ""
    first = first or said["flights"][0]["verdict"]["headline"]
    assert first.startswith(report)
    capsys.readouterr()
    run(["forecast", str(log), "--fill", "4", "--flow", "2.5"])
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith(forecast)
    assert step in lines[1]
    assert lines[1].startswith("To do first: ") is (kind not in GREEN)
    run(["inspect", str(log), "--json", str(tmp_path / "i.json")])
    seen = json.loads((tmp_path / "i.json").read_text())
    levels = {one["level"] for part in seen for one in part["findings"]}
    assert kind in GREEN or levels & {"grave", "warning", "unknown"}
    view = replay_view(log, shipped_model(), given=False, port=0, paused=True)
    assert view.whole is not None
    assert ("OK" in view.whole.glance) is (kind in GREEN)


@pytest.mark.parametrize("command", ["report", "inspect", "forecast", "record"])
def test_an_empty_log_is_an_error_that_says_what_to_do(command, made, tmp_path, capsys):
    options = {"forecast": ["--fill", "4"], "record": ["--out", str(tmp_path)]}.get(command, [])
    assert run([command, str(made.log("empty")), *options]) == 1
    out, err = capsys.readouterr()
    assert "is empty (0 bytes); copy it from the vehicle again" in " ".join((out + err).split())


def test_a_hexacopter_given_as_a_quad_has_no_verdict(made, capsys, tmp_path):
    words = ["report", str(made.log("hexa")), "--airframe", "topxgun-f16-sitl"]
    assert run([*words, "--json", str(tmp_path / "r.json")]) == 1
    out = capsys.readouterr().out
    assert "NO VERDICT" in out.splitlines()[0]
    assert "6 rotors by FRAME_CLASS 2; airframe topxgun-f16-sitl has 4" in out


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("truncated", "ends in flight, at 1:54: the rest is unseen"),
        ("never_flew", "by this log it never left the ground"),
    ],
)
def test_the_record_of_a_job_says_what_its_log_lacks(kind, words, made, tmp_path, capsys):
    assert run(["record", str(made.log(kind)), "--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert f"left out: {kind}.tlog: {words}" in out
    (left,) = json.loads((tmp_path / "record.json").read_text("utf-8"))["left_out"]
    assert left["reason"].startswith(words)
