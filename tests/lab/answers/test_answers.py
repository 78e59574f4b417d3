"""Two folders of answers are compared: what differs is named, and what is the same is silent."""

import gzip
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.lab.answers.asking import plain, without_moments
from tests.lab.answers.comparing import compare
from tests.lab.answers.questions import AIRFRAMES, COMMANDS, ROOT, questions
from thrustmargin.gcs_plugin import cli

FLIGHT = "report/sitl_logs/a.tlog"
REPORT = {"level": "under", "fill_kg": 9.75, "rotors": [{"use": 0.5}, {"use": 0.4}], "why": None}
CONSOLE = "$ thrustmargin report a.tlog\na.tlog: BELOW THE LIMIT\n  worst: rotor 3\n--- exit 0\n"


def written(folder: Path, report: dict, console: str, table: str) -> Path:
    place = folder / FLIGHT
    place.mkdir(parents=True)
    (place / "report.json").write_text(json.dumps(report))
    (place / "console.txt").write_text(console)
    (place / "report.csv.gz").write_bytes(gzip.compress(table.encode(), mtime=0))
    return folder


@pytest.fixture
def old(tmp_path: Path) -> Path:
    return written(tmp_path / "old", REPORT, CONSOLE, "time_s,use\n0,0.5\n1,0.6\n2,\n")


def test_the_same_is_silent(tmp_path: Path, old: Path):
    new = written(tmp_path / "new", REPORT, CONSOLE, "time_s,use\n0,0.5\n1,0.6\n2,\n")
    (line,) = compare(old, new).lines()
    assert line == (
        "3 files compared, 0 differ, 0 only old, 0 only new; "
        "first line or level of 0 answers changed"
    )


def test_each_number_that_differs_is_named(tmp_path: Path, old: Path):
    changed = {**REPORT, "fill_kg": 9.8, "rotors": [{"use": 0.5}, {"use": 0.41}, {"use": 1}]}
    console = CONSOLE.replace("rotor 3", "rotor 4")
    new = written(tmp_path / "new", changed, console, "time_s,use\n0,0.5\n1,0.7\n2,0.1\n")
    *lines, total = compare(old, new).lines()
    assert lines == [
        f"{FLIGHT}/console.txt: line 3:   worst: rotor 3 ->   worst: rotor 4",
        f"{FLIGHT}/report.csv.gz: column use: 2 rows, most in row 3: (none) -> 0.1",
        f"{FLIGHT}/report.json: fill_kg: 9.75 -> 9.8",
        f"{FLIGHT}/report.json: rotors: length: 2 -> 3",
        f"{FLIGHT}/report.json: rotors[1].use: 0.4 -> 0.41",
        f'{FLIGHT}/report.json: rotors[2]: (none) -> {{"use": 1}}',
    ]
    assert total.startswith("3 files compared, 3 differ, 0 only old, 0 only new; first line or ")
    assert total.endswith("level of 0 answers changed")


def test_the_short_form_has_first_lines_levels_and_how_it_ended(tmp_path: Path, old: Path):
    console = CONSOLE.replace("BELOW", "ABOVE").replace("exit 0", "exit 1").replace("3", "4")
    changed = {**REPORT, "level": "over", "fill_kg": 1.0}
    new = written(tmp_path / "new", changed, console, "time_s,use\n0,0.5\n1,0.6\n2,\n")
    lines = list(compare(old, new).lines(short=True))
    assert lines == [
        f"{FLIGHT}/console.txt: line 2: a.tlog: BELOW THE LIMIT -> a.tlog: ABOVE THE LIMIT",
        f"{FLIGHT}/console.txt: line 4: --- exit 0 -> --- exit 1",
        f'{FLIGHT}/report.json: level: "under" -> "over"',
        "3 files compared, 2 differ, 0 only old, 0 only new; "
        "first line or level of 1 answers changed",
    ]


def test_what_lacks_is_named_and_a_command_that_was_not_asked_is_not(tmp_path: Path, old: Path):
    new = written(tmp_path / "new", REPORT, CONSOLE, "time_s,use\n0,0.5\n1,0.6\n2,\n")
    (new / FLIGHT / "report.json").unlink()
    (new / "fill").mkdir()
    (new / "fill" / "console.txt").write_text("9 kg")
    line, total = compare(old, new).lines()
    assert line == f"{FLIGHT}/report.json: file: there -> (none)"
    assert total.startswith("2 files compared, 0 differ, 1 only old, 0 only new;")


def test_a_value_of_another_type_differs(tmp_path: Path):
    before = {"why": None, "fill_kg": 9.75, "rotors": [{"use": 0.5}, {"use": False}]}
    changed = {"why": False, "fill_kg": "9.75", "rotors": [{"use": 0.5}, {"use": 0}]}
    old = written(tmp_path / "old", before, CONSOLE, "time_s,use\n")
    new = written(tmp_path / "new", changed, CONSOLE, "time_s,use\n0,0.5\n1,0.6\n2,\n")
    lines = list(compare(old, new).lines())
    assert f'{FLIGHT}/report.json: fill_kg: 9.75 -> "9.75"' in lines
    assert f"{FLIGHT}/report.json: why: null -> false" in lines
    assert f"{FLIGHT}/report.json: rotors[1].use: false -> 0" in lines


def test_what_is_no_answer_is_taken_out():
    made = {"made_utc": "2026-11-28T07:23:33Z", "flights": [{"version": "0.3.0", "level": "near"}]}
    assert without_moments(made) == {"flights": [{"level": "near"}]}
    assert plain("wrote /tmp/x1/report.html", {"/tmp/x1": "OUT"}) == "wrote OUT/report.html"


def test_every_command_is_asked_or_needs_a_vehicle_or_a_program():
    asked = {*COMMANDS, "airframe", "demo", "fetch", "install", "stream"}
    assert asked == set(cli.COMMANDS)
    logs = [ROOT / "sitl_logs" / "onset"]
    found = list(questions(logs, COMMANDS))
    assert {question.command for question in found} == set(COMMANDS)
    assert len({(q.command, q.label) for q in found}) == len(found)


def test_every_shipped_airframe_is_asked():
    shipped = {path.stem for path in (ROOT / "models" / "airframes").glob("*.toml")}
    assert set(AIRFRAMES) == shipped


@pytest.mark.slow
def test_a_tree_answers_twice_the_same(tmp_path: Path):
    for name in ("old", "new"):
        options = ["--out", str(tmp_path / name), "--only", "cover,fill", "--without-bundled"]
        program = [sys.executable, "-m", "tests.lab.answers", *options]
        subprocess.run(program, cwd=ROOT, env={**os.environ}, check=True)
    comparison = compare(tmp_path / "old", tmp_path / "new")
    assert comparison.differences == ()
    assert comparison.files == 2 * 3 + 15 * 2  # two fields, five aircraft on three days
