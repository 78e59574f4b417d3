"""What a day needs runs where no extra is installed; the others say in one line what is missing."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from thrustmargin.gcs_plugin.cli import COMMANDS

ROOT = Path(__file__).resolve().parents[1]
FLIGHT = str(ROOT / "sitl_logs/campaign/v2_m4_q1.5.tlog")
VIEW = ["--port", "0", "--no-browser", "--seconds", "1"]
WITHOUT_EXTRAS = {
    "cover": ["--help"],
    "demo": [FLIGHT, *VIEW],
    "airframe": ["check", "topxgun-f16-sitl", FLIGHT],
    "export": [FLIGHT, "--layout", "layout.json"],
    "fill": ["--airframe", "topxgun-f16"],
    "forecast": [FLIGHT, "--fill", "4"],
    "identify": [FLIGHT],
    "inspect": [FLIGHT],
    "install": ["vehicle-sender", "."],
    "match": ["--airframe", "topxgun-f16"],
    "monitor": [FLIGHT, "--port", "0", "--no-browser", "--seconds", "3"],
    "record": [FLIGHT, "--out", "job"],
    "replay": [FLIGHT, "--port", "0", "--no-browser"],
    "report": [FLIGHT, "--out", "r.html", "--pdf", "r.pdf"],
    "stream": [FLIGHT, "--to", "udpout:127.0.0.1:9", "--speed", "10000"],
}
LINK = "udpin:127.0.0.1:14999"
#: command line, what it says is missing, and the extra that holds it
WITH_EXTRAS = [
    (["train", FLIGHT], "train needs torch", "train"),
    (["fetch", "mission", LINK, "-o", "a.plan"], "talking to a vehicle needs mavsdk", "vehicle"),
    (["airframe", "new", "--from", LINK], "talking to a vehicle needs mavsdk", "vehicle"),
    (["monitor", FLIGHT, "--fetch-mission"], "--fetch-mission needs mavsdk", "vehicle"),
    (["ingest", FLIGHT, "--store", "s"], "a season's store needs fsspec", "fleet"),
    (["fleet", "s"], "a season's store needs fsspec", "fleet"),
]
#: Hides what only extras hold from every finder, so that Python sees it as not installed.
BLOCKED = """
import sys

HIDDEN = {
    "torch", "mavsdk", "pyarrow", "duckdb", "fsspec", "filelock", "ruptures", "distributed",
    "dask", "s3fs", "shapefile", "pyproj", "pandas", "plotly", "matplotlib", "cattrs",
}

class Without:
    def __init__(self, finder):
        self.finder = finder
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] not in HIDDEN:
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
    assert {*WITHOUT_EXTRAS, *(line[0] for line, *_ in WITH_EXTRAS)} == {*COMMANDS}


@pytest.mark.slow
@pytest.mark.parametrize("command", WITHOUT_EXTRAS)
def test_a_command_runs_without_any_extra(command: str, tmp_path: Path):
    done = run_blocked(tmp_path, command, *WITHOUT_EXTRAS[command])
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    # Of these only `monitor` leaves something out, and says what.
    assert ("pip install" in done.stderr) == (command == "monitor")


@pytest.mark.parametrize(("line", "missing", "extra"), WITH_EXTRAS)
def test_what_needs_an_extra_says_in_one_line_what_to_install(line, missing, extra, tmp_path: Path):
    done = run_blocked(tmp_path, *line)
    assert done.returncode == 1
    said = done.stderr.splitlines()[-1]
    assert said.startswith("thrustmargin: ")
    assert f"{missing}, which is not installed; run: pip install 'thrustmargin[{extra}]'" in said
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.glob("s*"))  # nothing was begun


@pytest.mark.slow
def test_the_demo_needs_no_log_and_no_folder(tmp_path: Path):
    done = run_blocked(tmp_path, "demo", *VIEW)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "report.html").exists()
