"""What commands print: whole, in plain text, and with an exit code when it does not get out."""

import io
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from rich.live import Live
from rich.table import Table

from thrustmargin.gcs_plugin.cli import main, run
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal, steps
from thrustmargin.gcs_plugin.logs import read_log

COMMANDS = Path(__file__).parents[4] / "gcs_plugin" / "commands"
HOSTILE = "a\x1b]0;owned\x07\x1b[2J\x9b31m[bold]:car:\udcff\u202eb"


def test_no_byte_of_a_text_steers_the_terminal_however_it_is_printed():
    shown = io.StringIO()
    terminal = Terminal(file=shown, force_terminal=True, width=200)
    terminal.print(HOSTILE, soft_wrap=True)
    table = Table(title=HOSTILE)
    table.add_column(HOSTILE)
    table.add_row(HOSTILE)
    terminal.print(table)
    with Live(table, console=terminal, transient=True):
        pass
    text = shown.getvalue()
    assert "[bold]:car:?" in text
    for steering in ("\x1b]", "\x1b[2J\x1b", "\x07", "\x9b", "\udcff", "\u202e"):
        assert steering not in text


def test_long_work_without_a_terminal_says_each_kind_of_it_once(monkeypatch):
    def said(**options) -> str:
        shown = io.StringIO()
        with steps(Terminal(file=shown), total=2.0, **options) as step:
            for what in ("network: epoch 1", "network: epoch 2", "how flights differ"):
                step(what, 1.0)
        return shown.getvalue()

    assert said(lines=True).split("\n")[:2] == ["network ...", "how flights differ ..."]
    assert said().strip() == ""
    monkeypatch.setenv("THRUSTMARGIN_QUIET", "1")
    assert said(lines=True).strip() == ""


def test_commands_print_by_the_terminal_alone():
    for path in COMMANDS.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        found = re.findall(r"(?<![\w.])(?:print|Console)\(", text)
        assert path.name == "terminal.py" or not found, path.name


def test_an_error_with_a_hostile_file_name_is_clean(tmp_path, capfd):
    assert run(["inspect", str(tmp_path / HOSTILE)]) == 1
    said = capfd.readouterr().err
    assert "\x1b" not in said
    assert "owned" in said
    assert said.count("\n") == 1


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="names are text here")
@pytest.mark.parametrize("name", [b"flight\xe9.tlog", b"a[b] <script>'\".tlog"])
def test_a_log_of_any_name_is_inspected_and_reported(sitl_logs, tmp_path, capfd, name):
    log = tmp_path / os.fsdecode(name)
    log.write_bytes((sitl_logs / "campaign/v4_m16_q2.5.tlog").read_bytes()[:400_000])
    assert run(["inspect", str(log), "--json", str(tmp_path / "i.json")]) == 0
    assert run(["report", str(log), "--out", str(tmp_path / "r.html")]) == 0
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "a[b] <script>" not in page
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
@pytest.mark.parametrize("words", [["--help"], ["match", "--help"], ["inspect", "{log}"]])
@pytest.mark.parametrize("place", ["full", "closed"])
def test_an_answer_that_does_not_get_out_is_one_line_and_exit_1(sitl_logs, words, place):
    log = str(sitl_logs / "campaign/v4_m16_q2.5.tlog")
    argv = [word.format(log=log) for word in words]
    command = [sys.executable, "-m", "thrustmargin.gcs_plugin.cli", *argv]
    if place == "closed":
        reader, writer = os.pipe()
        os.close(reader)
        out = os.fdopen(writer, "wb")
    else:
        out = Path("/dev/full").open("wb")  # noqa: SIM115
    with out:
        done = subprocess.run(command, stdout=out, stderr=subprocess.PIPE, text=True, timeout=100)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert done.stderr.count("\n") == (place == "full")
    assert place == "closed" or "standard output: No space left" in done.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_watch_goes_on_when_what_it_prints_does_not_get_out(sitl_logs, tmp_path):
    log = tmp_path / "short.tlog"
    log.write_bytes((sitl_logs / "campaign/v4_m16_q2.5.tlog").read_bytes()[:80_000])
    words = ["monitor", str(log), "--no-view", "--record", str(tmp_path / "recordings")]
    command = [sys.executable, "-m", "thrustmargin.gcs_plugin.cli", *words]
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=200)
    assert done.returncode == 1
    rows = read_log(log).track.time_s.size
    assert f"vehicle 1: {rows} samples" in done.stderr
    assert "standard output: No space left" in done.stderr


def test_without_a_terminal_at_all_a_command_still_works(monkeypatch):
    monkeypatch.setattr(sys, "stdout", None)
    monkeypatch.setattr(sys, "stderr", None)
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
