"""`thrustmargin replay` as a user runs it: a real log, a real process, Ctrl-C."""

import os
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

from thrustmargin.gcs_plugin.cli import run

RUN = "from thrustmargin.gcs_plugin.cli import main; main()"


def replay(*arguments: str | Path) -> subprocess.Popen:
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    return subprocess.Popen(
        [sys.executable, "-c", RUN, "replay", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        cwd=Path(__file__).resolve().parents[4],
    )


@pytest.mark.slow
def test_nothing_is_imported_that_takes_half_a_second_and_shows_nothing(sitl_logs):
    log = sitl_logs / "campaign" / "v2_m4_q1.5.tlog"
    code = (
        "import sys\nfrom pathlib import Path\n"
        "from thrustmargin.gcs_plugin.commands.shared.inputs import chosen_model\n"
        "from thrustmargin.gcs_plugin.commands.flight.replay import replay_view\n"
        f"view = replay_view(Path({str(log)!r}), chosen_model(None, None), port=0)\n"
        "view.start()\nview.stop()\n"
        "print({'scipy.stats', 'scipy.signal', 'torch', 'plotly'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["set()"], done.stdout + done.stderr


@pytest.mark.slow
def test_a_log_is_served_until_ctrl_c_which_is_a_clean_end(sitl_logs):
    log = sitl_logs / "campaign" / "v4_m10_q2.5.tlog"
    process = replay(log, "--port", "0", "--start-paused")
    assert process.stdout is not None
    line = process.stdout.readline()
    assert line.startswith("replay at http://127.0.0.1:"), process.communicate()[1]
    page = urllib.request.urlopen(line.split()[2], timeout=100).read()
    assert b"<html" in page.lower()
    process.send_signal(signal.SIGINT)
    rest, errors = process.communicate(timeout=120)
    assert process.returncode == 0, errors
    assert "Traceback" not in errors
    assert rest == ""


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["no_such_flight.tlog"], "no_such_flight.tlog"),
        (["{log}", "--airframe", "dragonfly"], "dragonfly"),
    ],
)
def test_what_cannot_be_replayed_is_one_line_and_exit_1(sitl_logs, capsys, arguments, words):
    log = str(sitl_logs / "campaign" / "v4_m10_q2.5.tlog")
    assert run(["replay", *(a.format(log=log) for a in arguments)]) == 1
    errors = capsys.readouterr().err
    assert words in errors
    assert len(errors.strip().splitlines()) == 1
    assert "Traceback" not in errors


def test_help_reads_without_loading_the_view():
    process = replay("--help")
    words, _ = process.communicate(timeout=120)
    assert process.returncode == 0
    for option in ("--model", "--airframe", "--port", "--speed", "--no-browser", "--start-paused"):
        assert option in words
