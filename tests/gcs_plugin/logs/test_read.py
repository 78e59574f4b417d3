"""What is given as a log need not be one: a sentence says what it is, and nothing waits."""

import os
import sys
from pathlib import Path

import pytest

from thrustmargin.gcs_plugin import logs
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


OWN_READER = """
import numpy as np
from thrustmargin.gcs_plugin.logs.read import LogFormat
from thrustmargin.gcs_plugin.logs.csv_table import table_log
from thrustmargin.models.flight import FlightTrack

def read(path, vehicle, options):
    speeds = np.loadtxt(path, skiprows=1, ndmin=2)
    track = FlightTrack.of(name=path.name, time_s=speeds[:, 0], rotor_count=4,
                           rotor_speed_rpm=speeds[:, 1:])
    return (table_log(track, path, options, format=FORMAT.name),)

FORMAT = LogFormat(name="pegboard", known_by="a pegboard (PEGS)", suffixes=(".peg",), is_text=True,
                   likeness=lambda begins: float(begins.head.startswith(b"PEGS")), read=read)
"""


def test_a_reader_is_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """It is found by its module alone, and what no reader takes is described with its words."""
    (tmp_path / "pegboard.py").write_text(OWN_READER)
    monkeypatch.setattr(logs, "__path__", [*logs.__path__, str(tmp_path)])
    monkeypatch.setitem(sys.modules, f"{logs.__name__}.pegboard", None)
    monkeypatch.delitem(sys.modules, f"{logs.__name__}.pegboard")
    flight = tmp_path / "flight.peg"
    flight.write_text("PEGS\n0 2000 2001 2002 2003\n1 2000 2001 2002 2003\n")
    log = read_log(flight, load=3.0)
    assert log.track.tank_kg.tolist() == [3.0, 3.0]
    assert log.track.rotor_speed_rpm[1].tolist() == [2000, 2001, 2002, 2003]
    assert (log.format, log.vehicles) == ("pegboard", ())
    (tmp_path / "letter.peg").write_text("Dear reader\n")
    with pytest.raises(LogError, match=r"nor a pegboard \(PEGS\)"):
        read_log(tmp_path / "letter.peg")
