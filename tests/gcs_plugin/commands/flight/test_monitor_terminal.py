"""`thrustmargin monitor` in a real pseudo-terminal: what a pilot's terminal shows is read back."""

import os
import re
import select
import subprocess
import time
from pathlib import Path

import pytest

from tests.gcs_plugin.live.live_vehicle import Vehicle, command
from tests.gcs_plugin.peers.ports import free_udp_port
from tests.waiting import PATIENCE, until
from thrustmargin.gcs_plugin.link.transport import open_transport

pty = pytest.importorskip("pty")  # no such thing on Windows
STEERING = re.compile(rb"\x1b\[[0-9;?]*[A-Za-z]")


def text(shown: bytes) -> str:
    return STEERING.sub(b"", shown).decode(errors="replace")


GREEN = b"\x1b[32m"  # as a terminal is told


def on_a_terminal(
    folder: Path, *options: str, awaited: str, colour: bytes = b""
) -> tuple[bytes, str]:
    """What the monitor writes to its terminal while a vehicle flies: its bytes, and as read.

    It ends with what is waited for.
    """
    port = free_udp_port()
    ours, theirs = pty.openpty()
    os.environ.setdefault("TERM", "xterm-256color")
    monitor = command(
        *("monitor", f"udpin:127.0.0.1:{port}", "--no-view", "--silent"),
        *("--record", str(folder), *options),
        stdin=theirs,
        stdout=theirs,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "COLUMNS": "160", "LINES": "40"},
    )
    os.close(theirs)
    shown = b""
    vehicle, air = Vehicle(), open_transport(f"udpout:127.0.0.1:{port}")
    try:
        until(lambda: list(folder.glob("*/telemetry.tlog")))
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end and not (colour in shown and re.search(awaited, text(shown))):
            for frame in vehicle.tick(rpm=(1700,) * 4):
                air.send(frame.data)
            if select.select([ours], [], [], 0.1)[0]:
                shown += os.read(ours, 65536)
    finally:
        air.close()
        monitor.kill()
        monitor.wait()
        os.close(ours)
    return shown, text(shown)


def test_a_real_terminal_shows_colours_and_no_markup(tmp_path):
    margin = r"\d+% r[1-4]"
    shown, read = on_a_terminal(
        tmp_path, "--airframe", "topxgun-f16-sitl", awaited=margin, colour=GREEN
    )
    assert re.search(margin, read), read[-2000:]
    for markup in ("[green]", "[bold red]", "[dim]", "[/"):
        assert markup not in read
    assert GREEN in shown


def test_what_is_advised_can_be_done_while_the_monitor_holds_its_link(tmp_path):
    _, read = on_a_terminal(tmp_path, awaited="airframe new --from[^`]+`")
    (telemetry,) = tmp_path.glob("*/telemetry.tlog")
    advised = re.findall(r"airframe new --from ([^`]+)`", re.sub(r"\r?\n", "", read))
    assert advised, read[-2000:]
    assert {Path(source) for source in advised} == {telemetry}
