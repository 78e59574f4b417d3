"""A pipe where a file is asked for may never end: it is refused in one line, and nothing hangs."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
LOG = ROOT / "sitl_logs" / "campaign" / "v4_m10_q2.5.tlog"
pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")

#: Words of a command in which {pipe} is the pipe.
COMMANDS = (
    ("report", "{pipe}.tlog"),
    ("stream", "{pipe}.tlog"),
    ("cover", "{pipe}.kml", "--swath", "5"),
    ("forecast", "{pipe}.plan", "--fill", "4"),
    ("airframe", "show", "{pipe}.toml"),
    ("report", "demo", "--model", "{pipe}.safetensors"),
    ("monitor", "demo", "--signing-key-file", "{pipe}.key", "--no-view"),
    ("monitor", "demo", "--token-file", "{pipe}.key", "--no-browser"),
    ("report", "recorded/telemetry.tlog"),
    ("inspect", "table/flight.csv"),
)


def test_every_pipe_is_refused_in_one_line(tmp_path: Path):
    for ending in ("tlog", "kml", "plan", "toml", "safetensors", "key"):
        os.mkfifo(tmp_path / f"pipe.{ending}")
    for folder in ("recorded", "table"):
        (tmp_path / folder).mkdir()
    (tmp_path / "recorded" / "telemetry.tlog").symlink_to(LOG)
    os.mkfifo(tmp_path / "recorded" / "options.json")
    (tmp_path / "table" / "flight.csv").write_text("time_s,voltage\n0,50\n1,50\n")
    os.mkfifo(tmp_path / "table" / "columns.toml")
    # One process: each would import the same for a second.
    program = (
        "import os, signal, sys\nfrom thrustmargin.gcs_plugin.cli import run\n"
        "signal.signal(signal.SIGALRM, signal.default_int_handler)\n"
        "for words in sys.argv[1:]:\n"
        "    signal.alarm(20)\n"
        "    print('###', words, file=sys.stderr, flush=True)\n"
        "    print('=', run(words.split()), file=sys.stderr, flush=True)\n"
    )
    lines = [" ".join(words).replace("{pipe}", "pipe") for words in COMMANDS]
    done = subprocess.run(
        [sys.executable, "-c", program, *lines],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    answers = dict(part.split("\n", 1) for part in done.stderr.split("### ")[1:])
    assert list(answers) == lines
    for words, said in answers.items():
        complaint, code = said.strip().splitlines()
        assert code == "= 1", words
        assert "it is a pipe or a device" in complaint, words


@pytest.mark.parametrize("words", ["fill --airframe topxgun-f16 --out page.html", "airframe list"])
def test_what_nobody_reads_any_more_ends_no_command(tmp_path: Path, words: str):
    """As after `| head -1`: the files are written all the same, and the exit code says it."""
    reads, writes = os.pipe()
    os.close(reads)
    program = "import sys; from thrustmargin.gcs_plugin.cli import run; sys.exit(run(sys.argv[1:]))"
    done = subprocess.run(
        [sys.executable, "-c", program, *words.split()],
        cwd=tmp_path,
        stdout=writes,
        stderr=subprocess.PIPE,
        text=True,
        timeout=200,
        check=False,
    )
    os.close(writes)
    assert (done.returncode, done.stderr) == (1, "")
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"] * ("--out" in words)
