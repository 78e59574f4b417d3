"""What is given as a log need not be one: a sentence says what it is, and nothing waits."""

import os
from pathlib import Path

import pytest

from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.mission.plan import read_plan
from thrustmargin.models.errors import AirframeError, LogError, ModelError, PlanError
from thrustmargin.models.model.model_file import load_model
from thrustmargin.models.physics.airframe import load_airframe


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with a name here")
@pytest.mark.parametrize(
    ("read", "error", "ending"),
    [
        (read_log, LogError, ".tlog"),
        (load_model, ModelError, ".safetensors"),
        (load_airframe, AirframeError, ".toml"),
        (read_plan, PlanError, ".plan"),
    ],
)
def test_a_pipe_a_device_or_a_folder_is_refused_at_once(tmp_path, read, error, ending):
    pipe, folder, device = (tmp_path / f"{name}{ending}" for name in ("pipe", "folder", "device"))
    os.mkfifo(pipe)
    folder.mkdir()
    device.symlink_to("/dev/zero")
    for path, said in ((pipe, "pipe or a device"), (folder, "folder"), (device, "pipe or a")):
        with pytest.raises(error, match=said):
            read(path)


def test_only_a_telemetry_log_is_streamed(sitl_logs, capsys):
    log = next((sitl_logs / "formats").glob("*.BIN"))
    assert run(["stream", str(log), "--to", "udpout:127.0.0.1:1"]) == 1
    said = capsys.readouterr().err
    assert "is a DataFlash log" in said
    assert f"thrustmargin replay {log}" in said


@pytest.mark.parametrize("content", [b"", b"\0", bytes(5000), b"\xff" * 5000, b"\n" * 5000])
def test_nothing_in_a_file_is_a_sentence(tmp_path: Path, content):
    path = tmp_path / "x.tlog"
    path.write_bytes(content)
    with pytest.raises(LogError, match=r"x\.tlog"):
        read_log(path)
