"""Every command on logs of other vehicles, without rotors told, or whose ESCs measure nothing."""

import json
from pathlib import Path

import pytest

from tests.gcs_plugin.logs.log_files import frames_of, with_rotor_speeds
from tests.gcs_plugin.logs.test_vehicles import HOVER_MOTORS, dataflash
from thrustmargin.gcs_plugin.cli import run

NAN = float("nan")
LOGS = {
    "no frame": dataflash("ArduCopter V4.5.7"),
    "damaged": dataflash("ArduCopter V4.5.7", FRAME_CLASS=NAN, SERVO1_FUNCTION=NAN),
    "nothing told": dataflash("hello"),
    "quadplane": dataflash("ArduPlane V4.3.0", Q_ENABLE=1.0, Q_FRAME_CLASS=1.0, **HOVER_MOTORS),
    "plane": dataflash("ArduPlane V4.3.0"),
}


@pytest.fixture(params=LOGS)
def log(request, tmp_path) -> Path:
    path = tmp_path / f"{request.param}.BIN"
    path.write_bytes(LOGS[request.param].binary())
    return path


def test_no_command_claims_a_margin_or_ends_in_a_traceback(log, tmp_path, capsys):
    out = tmp_path / "report.html"
    code = run(["report", str(log), "--out", str(out)])
    said = capsys.readouterr()
    if log.stem == "plane":
        assert code != 0
        assert "this is a plane (by boot text 'ArduPlane V4.3.0')" in said.err
        assert not out.exists()
    else:
        assert code == 0
        assert "NO VERDICT" in said.out
    for command in (["identify"], ["train", "--out", str(tmp_path / "m.safetensors")]):
        assert run([*command, str(log)]) != 0
        assert log.name in capsys.readouterr().err


def test_inspect_says_what_it_is_and_which_rotors_are_told(log, tmp_path, capsys):
    made = tmp_path / "inspect.json"
    assert run(["inspect", str(log), "--json", str(made)]) == 0
    said, found = capsys.readouterr().out, json.loads(made.read_text("utf-8"))[0]
    kind, rotors = {"plane": ("plane", 0), "quadplane": ("quadplane", 4)}.get(
        log.stem, ("unknown" if log.stem == "nothing told" else "multirotor", 0)
    )
    assert (found["vehicle_kind"], found["rotor_count"]) == (kind, rotors)
    if kind in ("multirotor", "unknown"):
        assert "rotors: not reported" in said


@pytest.mark.parametrize("outputs", [True, False])
def test_speeds_that_are_all_zero_never_make_a_measured_margin(
    sitl_logs, tmp_path, capsys, outputs
):
    path = tmp_path / "zero.tlog"
    path.write_bytes(with_rotor_speeds(sitl_logs / "campaign/v4_m10_q2.5.tlog", lambda n: 0 * n))
    if not outputs:  # without SERVO_OUTPUT_RAW, message 36
        path.write_bytes(
            b"".join(f for f in frames_of(path) if int.from_bytes(f[15:18], "little") != 36)
        )
    assert run(["report", str(path), "--out", str(tmp_path / "r.html")]) == 0
    said = capsys.readouterr().out
    assert "from: measured rotor speeds" not in said
    assert "100 %" not in said
