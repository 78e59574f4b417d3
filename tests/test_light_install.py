"""What a day needs runs where no extra is installed; the others say in one line what is missing."""

import json
import signal
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.gcs_plugin.live.live_vehicle import first_part
from thrustmargin.gcs_plugin.cli import COMMANDS

ROOT = Path(__file__).resolve().parents[1]
#: The first 100 s of a flight, in the folder in which a command runs.
FLIGHT = "flight.tlog"
VIEW = ["--port", "0", "--no-browser", "--seconds", "1"]
WITHOUT_EXTRAS = {
    "demo": VIEW,
    "aircraft": [],
    "airframe": ["check", "topxgun-f16-sitl", FLIGHT],
    "export": [FLIGHT, "--layout", "layout.json"],
    "fill": ["--airframe", "topxgun-f16"],
    "forecast": [FLIGHT, "--fill", "4"],
    "inspect": [FLIGHT],
    "install": ["vehicle-sender", "."],
    "match": ["--airframe", "topxgun-f16"],
    "monitor": [FLIGHT, "--port", "0", "--no-browser", "--seconds", "3"],
    "record": [FLIGHT, "--out", "job"],
    "replay": [FLIGHT, "--port", "0", "--no-browser"],
    "report": [FLIGHT, "--out", "r.html", "--pdf", "r.pdf"],
    "stream": [FLIGHT, "--to", "udpout:127.0.0.1:9", "--speed", "1000"],
}
LINK = "udpin:127.0.0.1:14999"
#: command line, what it says is missing, and the extra that holds it
WITH_EXTRAS = [
    (["identify", FLIGHT], "identify needs scipy", "loop"),
    (["cover", FLIGHT, "--swath", "4"], "cover needs scipy", "loop"),
    (["train", FLIGHT], "train needs torch", "train"),
    (["learn", FLIGHT], "train needs torch", "train"),
    (["fetch", "mission", LINK, "-o", "a.plan"], "talking to a vehicle needs mavsdk", "vehicle"),
    (["airframe", "new", "--from", LINK], "talking to a vehicle needs mavsdk", "vehicle"),
    (["monitor", FLIGHT, "--fetch-mission"], "--fetch-mission needs mavsdk", "vehicle"),
    (["learn", FLIGHT, "--store", "s"], "learn --store needs fsspec", "fleet"),
    (["fleet", "s"], "a season's store needs fsspec", "fleet"),
]
#: Hides what only extras hold from every finder, so that Python sees it as not installed.
BLOCKED = """
import sys

HIDDEN = {
    "torch", "mavsdk", "pyarrow", "duckdb", "fsspec", "filelock", "distributed",
    "dask", "s3fs", "scipy", "threadpoolctl", "shapefile", "pyproj", "pandas", "plotly",
    "matplotlib", "cattrs",
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
"""
ONE = "from thrustmargin.gcs_plugin.cli import main; main(sys.argv[1:])"
#: Each command in a process of its own that begins with what all share: most of a start.
MANY = """
import json, os
import thrustmargin.gcs_plugin.reports.margin, tyro
from thrustmargin.gcs_plugin.cli import main

for folder, words in json.loads(sys.argv[1]):
    if not os.fork():
        os.chdir(folder)
        for stream, name in ((1, ".out"), (2, ".err")):
            os.dup2(os.open(folder + name, os.O_WRONLY | os.O_CREAT), stream)
        main(words)
    print(os.waitstatus_to_exitcode(os.wait()[1]), flush=True)
"""


@dataclass
class Done:
    folder: Path
    code: int
    errors: str


def with_flight(folder: Path) -> Path:
    first_part(ROOT / "sitl_logs/campaign/v2_m4_q1.5.tlog", 100.0, folder).rename(folder / FLIGHT)
    return folder


def done(lines: list[list[str]], place: pytest.TempPathFactory) -> dict[str, Done]:
    """How each command line ended, by its words."""
    folders = [with_flight(place.mktemp(line[0])) for line in lines]
    asked = json.dumps([(str(f), line) for f, line in zip(folders, lines, strict=True)])
    run = [sys.executable, "-c", BLOCKED + MANY, asked]
    told = subprocess.run(run, stdout=subprocess.PIPE, text=True, check=True, timeout=500)
    ends = zip(lines, folders, told.stdout.split(), strict=True)
    return {
        " ".join(line): Done(folder, int(code), Path(f"{folder}.err").read_text())
        for line, folder, code in ends
    }


@pytest.fixture(scope="module")
def ran(tmp_path_factory) -> dict[str, Done]:
    lines = [[c, *words] for c, words in WITHOUT_EXTRAS.items() if c != "replay"]
    return done(lines, tmp_path_factory)


@pytest.fixture(scope="module")
def refused(tmp_path_factory) -> dict[str, Done]:
    return done([line for line, *_ in WITH_EXTRAS], tmp_path_factory)


def test_every_command_is_on_one_of_the_two_lists():
    assert {*WITHOUT_EXTRAS, *(line[0] for line, *_ in WITH_EXTRAS)} == {*COMMANDS}


@pytest.mark.slow
@pytest.mark.parametrize("command", [c for c in WITHOUT_EXTRAS if c != "replay"])
def test_a_command_runs_without_any_extra(command: str, ran: dict[str, Done]):
    ended = ran[" ".join([command, *WITHOUT_EXTRAS[command]])]
    assert ended.code == 0, ended.errors
    assert "Traceback" not in ended.errors
    # Of these only `monitor` leaves something out, and says what.
    assert ("pip install" in ended.errors) == (command == "monitor")


@pytest.mark.slow
def test_a_replay_runs_without_any_extra_until_ctrl_c(tmp_path: Path):
    line = [sys.executable, "-c", BLOCKED + ONE, "replay", *WITHOUT_EXTRAS["replay"]]
    pipe = subprocess.PIPE
    with subprocess.Popen(
        line, cwd=with_flight(tmp_path), stdout=pipe, stderr=pipe, text=True
    ) as process:
        try:
            if process.stdout and process.stdout.readline():
                process.send_signal(signal.SIGINT)
            _, errors = process.communicate(timeout=300)
        finally:
            process.kill()
    assert process.returncode == 0, errors
    assert "Traceback" not in errors
    assert "pip install" not in errors


@pytest.mark.slow
@pytest.mark.parametrize(("line", "missing", "extra"), WITH_EXTRAS)
def test_what_needs_an_extra_says_in_one_line_what_to_install(
    line, missing, extra, refused: dict[str, Done]
):
    ended = refused[" ".join(line)]
    assert ended.code == 1
    said = ended.errors.splitlines()[-1]
    assert said.startswith("thrustmargin: ")
    assert f"{missing}, which is not installed; run: pip install " in said
    assert f'[{extra}]"' in said
    assert "Traceback" not in ended.errors
    assert not list(ended.folder.glob("s*"))  # nothing was begun


@pytest.mark.slow
def test_the_demo_needs_no_log_and_no_folder(ran: dict[str, Done]):
    ended = ran[" ".join(["demo", *VIEW])]
    assert ended.code == 0, ended.errors
    assert (ended.folder / "report.html").exists()


def test_windows_gets_the_time_zones_that_it_has_not():
    """`record --zone` would refuse every zone there."""
    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["dependencies"]
    (zones,) = [one for one in wanted if one.startswith("tzdata")]
    assert zones.partition(";")[2].strip() == "sys_platform == 'win32'"
