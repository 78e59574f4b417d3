"""No output of a command may land on something that it reads, by whatever name."""

import json
import os
from pathlib import Path

import pytest

from thrustmargin.gcs_plugin.cli import run

#: command, its inputs as options, its outputs as option and ending of what is written
REPORT = tuple(("--out", ending) for ending in (".html", ".json", ".csv"))
CASES = (
    ("inspect", ("", "--airframe"), (("--json", ".json"),)),
    (
        "report",
        ("", "--model", "--airframe"),
        tuple(("--out", e) for e in (".html", ".json", ".csv")),
    ),
    (
        "identify",
        ("", "--held-out", "--model", "--airframe"),
        (("--json", ".json"), ("--out", ".html"), ("--out-model", ".safetensors")),
    ),
    (
        "train",
        ("", "--airframe"),
        tuple(("--out-model", e) for e in (".safetensors", ".loss.csv", ".loss.svg")),
    ),
    ("match", ("--model", "--airframe"), (("--out", ".svg"), ("--out", ".pdf"))),
    ("airframe new", ("--from", "--bench", "--hover"), (("--out", ".toml"),)),
    ("fetch mission", ("--signing-key-file",), (("--output", ".plan"),)),
    ("fetch log", ("--signing-key-file",), (("--output", ".BIN"),)),
)
#: ending of what is asked for where other files come beside it
ASKED = {"report": ".html", "train": ".safetensors"}
#: what a command wants before its options, where the input tried is an option
BEFORE = {"match": [], "airframe": [], "fetch": ["udpin:127.0.0.1:1"]}
ALL = [(c, i, o, e) for c, inputs, outputs in CASES for i in inputs for o, e in outputs]
LINKS = ("name", "./name", "symlink", "hard link")
#: All kinds of a name for one, and for each of the others one kind.
TRIED = [(*ALL[0], link) for link in LINKS]
TRIED += [(*one, LINKS[k % len(LINKS)]) for k, one in enumerate(ALL[1:])]


@pytest.mark.parametrize(("command", "option", "output", "ending", "link"), TRIED)
def test_an_output_on_an_input_is_refused_at_once(
    tmp_path, monkeypatch, capsys, command, option, output, ending, link
):
    monkeypatch.chdir(tmp_path)
    written = Path(f"x{ending}")
    read = written if link in ("name", "./name") else Path(f"input{ending}")
    read.write_bytes(b"not to be lost")
    if link == "symlink":
        written.symlink_to(read)
    elif link == "hard link":
        os.link(read, written)
    named = f"./{read}" if link == "./name" else str(read)
    asked = f"x{ASKED.get(command, ending)}"
    given = [named]
    if option:
        given = [*BEFORE.get(command.split()[0], ["other.tlog"]), option, named]
    force = ["--force"] if command in ("train", "identify", "airframe new") else []
    assert run([*command.split(), *given, output, asked, *force]) == 1
    said = capsys.readouterr().err
    assert f"x{ending} would overwrite {read}, which is read; give another {output}" in said
    assert read.read_bytes() == b"not to be lost"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with a name here")
def test_a_folder_a_pipe_or_a_device_is_no_place_for_a_result(tmp_path, capsys):
    (tmp_path / "folder.json").mkdir()
    os.mkfifo(tmp_path / "pipe.json")
    for name in ("folder.json", "pipe.json", "/dev/null"):
        assert run(["inspect", "x.tlog", "--json", str(tmp_path / name)]) == 1
        assert "not a file; give another --json" in capsys.readouterr().err


def test_an_out_that_ends_in_json_is_the_json(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fill = ["fill", "--airframe", "topxgun-f16"]
    assert run([*fill, "--out", "x.json", "--json", "x.json"]) == 0
    assert json.loads(Path("x.json").read_text("utf-8"))["schema"].startswith("thrustmargin.fill/")
    assert capsys.readouterr().out.count("wrote x.json") == 1
    assert run([*fill, "--out", "y.json"]) == 0
    assert Path("y.json").read_bytes() == Path("x.json").read_bytes()
    assert run([*fill, "--out", "y.json", "--json", "z.json"]) == 2
    assert "cannot write y.json; end its name in .html or .htm" in capsys.readouterr().err


def test_the_json_beside_a_page_may_be_asked_for_by_its_name(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run(["report", "demo", "--out", "x.html", "--json", "x.json"]) == 0
    assert json.loads(Path("x.json").read_text("utf-8"))["flights"]
    capsys.readouterr()
    words = ["export", "demo", "--mcap", "x.mcap", "--layout", "a.json", "--grafana", "a.json"]
    assert run(words) == 2  # two contents in one file
    assert "a.json is asked for twice" in capsys.readouterr().err
