"""Every command but `train` runs where torch is not installed."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from thrustmargin.gcs_plugin.cli import COMMANDS

ROOT = Path(__file__).resolve().parents[1]
FLIGHT = str(ROOT / "sitl_logs/campaign/v2_m4_q1.5.tlog")
VIEW = ["--port", "0", "--no-browser", "--seconds", "1"]
WITHOUT_TORCH = {
    "cover": ["--help"],
    "demo": [FLIGHT, *VIEW],
    "airframe": ["check", "topxgun-f16-sitl", FLIGHT],
    "export": [FLIGHT, "--layout", "layout.json"],
    "fetch": ["mission", "--help"],
    "fill": ["--airframe", "topxgun-f16"],
    "fleet": ["season"],
    "forecast": [FLIGHT, "--fill", "4"],
    "identify": [FLIGHT],
    "ingest": [FLIGHT, "--store", "season"],
    "inspect": [FLIGHT],
    "match": ["--airframe", "topxgun-f16"],
    "monitor": [FLIGHT, "--port", "0", "--no-browser", "--seconds", "3"],
    "record": [FLIGHT, "--out", "job"],
    "replay": [FLIGHT, "--port", "0", "--no-browser"],
    "report": [FLIGHT],
    "stream": [FLIGHT, "--to", "udpout:127.0.0.1:9", "--speed", "10000"],
}
WITH_TORCH = {"train": [FLIGHT]}
#: Hides torch from every finder, so that Python sees it as not installed.
BLOCKED = """
import sys

class Without:
    def __init__(self, finder):
        self.finder = finder
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] != "torch":
            return self.finder.find_spec(name, path, target)
    def __getattr__(self, name):
        return getattr(self.finder, name)

sys.meta_path[:] = map(Without, sys.meta_path)
from thrustmargin.gcs_plugin.cli import main
main(sys.argv[1:])
"""


def run_blocked(folder: Path, command: str, *words: str) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-c", BLOCKED, command, *words]
    pipe = subprocess.PIPE
    with subprocess.Popen(line, cwd=folder, stdout=pipe, stderr=pipe, text=True) as process:
        try:
            if command == "replay" and process.stdout and process.stdout.readline():
                process.send_signal(signal.SIGINT)  # it is served until Ctrl-C
            said, errors = process.communicate(timeout=300)
        finally:
            process.kill()
    return subprocess.CompletedProcess(line, process.returncode, said, errors)


def test_every_command_is_on_one_of_the_two_lists():
    assert sorted([*WITHOUT_TORCH, *WITH_TORCH]) == sorted(COMMANDS)


@pytest.mark.slow
@pytest.mark.parametrize("command", WITHOUT_TORCH)
def test_a_command_runs_without_torch(command: str, tmp_path: Path):
    if command == "fleet":  # it reads what `ingest` has stored
        run_blocked(tmp_path, "ingest", *WITHOUT_TORCH["ingest"])
    done = run_blocked(tmp_path, command, *WITHOUT_TORCH[command])
    assert done.returncode == 0, done.stderr
    assert "torch" not in done.stderr


@pytest.mark.parametrize("command", WITH_TORCH)
def test_a_command_that_needs_torch_says_in_one_line_what_to_install(command: str, tmp_path: Path):
    done = run_blocked(tmp_path, command, *WITH_TORCH[command])
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr == (
        f"thrustmargin: {command} needs torch, which is not installed; "
        "run: pip install 'thrustmargin[train]'\n"
    )


@pytest.mark.slow
def test_the_demo_needs_no_log_and_no_folder(tmp_path: Path):
    done = run_blocked(tmp_path, "demo", *VIEW)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "report.html").exists()
