"""`thrustmargin monitor` as a process: fed over UDP, killed, on a full disk, and as a page."""

import math
import os
import re
import signal
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink import mavutil

from tests.browser import open_page
from tests.gcs_plugin.live.live_vehicle import (
    command,
)
from tests.gcs_plugin.live.monitored import (
    AIRFRAME,
    MODEL,
    read_samples,
    recording_in,
    same,
    sample_table,
)
from tests.gcs_plugin.peers.ports import free_port, free_udp_port
from tests.gcs_plugin.peers.udp_sender import send_frames, sending_frames
from tests.waiting import until
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.mavlink.scan import stamped_frames
from thrustmargin.gcs_plugin.wording.answer import brief
from thrustmargin.models.model.advice import advise
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.model_file import save_model

COMPONENT = 25  # MAV_COMP_ID_USER1


@pytest.fixture(scope="module")
def landing(sitl_logs, tmp_path_factory) -> Path:
    """The last 110 s of a flight, so that it is streamed in seconds."""
    frames = list(stamped_frames(sitl_logs / "campaign/v4_m10_q3.5.tlog"))
    kept = [(us, data) for us, data in frames if us > frames[-1][0] - 110_000_000]
    path = tmp_path_factory.mktemp("flown") / "landing.tlog"
    path.write_bytes(b"".join(us.to_bytes(8, "big") + data for us, data in kept))
    return path


@pytest.fixture(scope="module")
def model_file(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("model") / "physics.safetensors"
    save_model(MODEL, path)
    return path


def recording(
    port: int, folder: Path, model_file: Path, *more: str, **options: Any
) -> subprocess.Popen:
    """The monitor as a process, once it listens on `port` and records into `folder`."""
    monitor = command(
        "monitor",
        f"udpin:127.0.0.1:{port}",
        *("--record", str(folder), "--model", str(model_file), "--no-view"),
        *more,
        **options,
    )
    while not list(folder.glob("*/telemetry.tlog")):
        assert monitor.poll() is None
        time.sleep(0.05)
    return monitor


def wait_until_heard(session: Path, streamed: Path) -> None:
    """Until the recording ends as the flight that was streamed does."""
    *_, (_, last) = stamped_frames(streamed)
    until(lambda: (session / "telemetry.tlog").read_bytes().endswith(last))


@pytest.mark.slow
def test_streamed_over_udp_a_flight_gives_the_samples_and_margins_of_its_file(
    landing, tmp_path, model_file
):
    path = landing
    port = free_udp_port()
    monitor = recording(port, tmp_path, model_file, stderr=subprocess.PIPE, text=True)
    send_frames(stamped_frames(path), port, speed=25.0)
    session = recording_in(tmp_path)
    wait_until_heard(session, path)
    monitor.send_signal(signal.SIGINT)
    _, told = monitor.communicate(timeout=120)
    sent = list(stamped_frames(path))
    assert [data for _, data in stamped_frames(session / "telemetry.tlog")] == [d for _, d in sent]
    assert f"{len(sent)} messages" in told
    assert re.search(r"^vehicle 1: (Flight to \d+:\d\d|Last flight): \S", told, re.MULTILINE)
    live = read_samples(session, 1)
    # The recorded telemetry, read as a file, says the same.
    read = read_log(session / "telemetry.tlog", airframe=AIRFRAME, sampling="hold").track
    same(live, read)
    # Its speeds are those of the flight; which row each is in is by when this machine heard it.
    flown = read_log(path, airframe=AIRFRAME, sampling="hold").track.rotor_speed_rpm
    known = np.isfinite(live.rotor_speed_rpm)
    assert np.isin(live.rotor_speed_rpm[known], flown).all()
    assert known.sum() > 0.5 * np.isfinite(flown).sum()
    table = sample_table(session)
    margin = np.column_stack([table[f"margin_{k}"].to_numpy() for k in range(1, 5)])
    predicted = np.column_stack([table[f"margin_predicted_{k}"].to_numpy() for k in range(1, 5)])
    settled = live.time_s > 1.0
    expected = analyse(read, MODEL)
    assert np.array_equal(margin[settled], expected.margin[settled], equal_nan=True)
    assert np.allclose(
        predicted[settled], expected.margin_predicted[settled], rtol=1e-12, equal_nan=True
    )
    assert np.array_equal(
        table["redundancy_yaw_free"].to_numpy()[settled],
        expected.redundancy_yaw_uncontrolled[settled],
        equal_nan=True,
    )


@pytest.mark.slow
@pytest.mark.browser
def test_streamed_over_udp_the_page_and_the_announcements_say_what_the_file_says(
    sitl_logs, tmp_path, model_file
):
    """Real processes; every number that a pilot reads is that of a row of the file."""
    path = sitl_logs / "campaign" / "v4_m10_q3.5.tlog"
    track = read_log(path, airframe=AIRFRAME, sampling="hold").track
    expected = analyse(track, MODEL)
    margin = expected.margin_predicted[-1].min()
    landed = (f"{math.floor(100 * margin + 1e-6)} %", f"{track.tank_kg[-1]:.1f} kg")
    port, page_port = free_udp_port(), free_port()
    station = mavutil.mavlink_connection("udpin:127.0.0.1:0", dialect="ardupilotmega")
    monitor = command(
        "monitor",
        f"udpin:127.0.0.1:{port}",
        *("--record", str(tmp_path), "--model", str(model_file), "--announce", "--no-browser"),
        *("--forward", f"udpout:127.0.0.1:{station.port.getsockname()[1]}"),
        *("--port", str(page_port)),
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert monitor.stdout is not None
    ours: list[Any] = []
    ended = threading.Event()
    listening = threading.Thread(target=listen, args=(station, ours, ended))
    listening.start()
    try:
        url = monitor.stdout.readline().split()[2]
        # What is read is text: a small window, for to draw the scene takes most of both cores.
        with open_page(url, width=390, height=300) as page:
            read_off = set()
            with sending_frames(stamped_frames(path), port, speed=12.0) as streamed:
                while streamed.is_alive():
                    page.wait_for_timeout(100)
                    if (figures := page.evaluate(READ)) is not None:
                        read_off.add(tuple(figures))
            # The last row comes to the page as soon as this machine has made it.
            until(lambda: tuple(page.evaluate(READ) or ()) == landed)
    finally:
        monitor.send_signal(signal.SIGINT)
        told, _ = monitor.communicate(timeout=120)
        ended.set()
        listening.join()
        station.close()
    # Rotor speeds carry no clock: their row is that in which this machine heard them, as recorded.
    heard = read_log(recording_in(tmp_path) / "telemetry.tlog", airframe=AIRFRAME, sampling="hold")
    kg = [f"{mass:.1f} kg" for mass in heard.track.tank_kg]
    as_heard = analyse(heard.track, MODEL)
    rows = {
        # A margin is rounded down; the circles and the cards may be of two rows in a row.
        (f"{math.floor(100 * margin + 1e-6)} %", tank)
        # Live, the moments before a landing still count as flight.
        for margins in (as_heard.margin, as_heard.margin_predicted)
        for row, margin in enumerate(margins.min(axis=1))
        if math.isfinite(margin)
        for tank in kg[max(row - 1, 0) : row + 2]
    }
    assert len(read_off) > 3  # on a busy machine the page is read seldom
    assert {pair for pair in read_off if "no data" not in pair} <= rows

    clock = heard.clock_start_s + heard.track.time_s
    at = {round(1e3 * c): row for row, c in enumerate(clock)}
    figures = [m for m in ours if m.get_type() == "NAMED_VALUE_FLOAT" and m.name == "MARGIN"]
    # A computer that is behind sends NaN for what it no longer knows.
    known = [figure for figure in figures if math.isfinite(figure.value)]
    assert len(known) >= 4
    for figure in known:
        row = min(at, key=lambda ms: abs(ms - figure.time_boot_ms))
        assert abs(row - figure.time_boot_ms) <= 1
        assert figure.value == pytest.approx(100 * as_heard.margin[at[row]].min(), rel=1e-6)
    texts = {m.text for m in ours if m.get_type() == "STATUSTEXT"}
    assert texts <= {line[20:].removeprefix("vehicle 1: ") for line in told.splitlines()} | {
        text for text in texts if text.startswith("Over: ")
    } | {brief(advise(as_heard).advice)}


def listen(station: Any, ours: list[Any], ended: threading.Event) -> None:
    """Keep what our component says, as a ground station would."""
    while not ended.is_set():
        message = station.recv_match(blocking=True, timeout=0.1)
        if message is not None and message.get_srcComponent() == COMPONENT:
            ours.append(message)


#: The worst rotor's margin and the tank level as a reader of the page sees them; null in the moment
#: in which the page draws them anew.
READ = """() => {
  const shown = [...document.querySelectorAll('[data-left]')];
  const left = shown.map((one) => parseInt(one.textContent));
  const tank = document.querySelector('[data-card=tank] small')?.textContent.split(' at ')[0];
  return left.length && left.every(isFinite) && tank ? [`${Math.min(...left)} %`, tank] : null;
}"""


@pytest.mark.slow
def test_kill_9_leaves_a_recording_that_reads_as_a_flight(sitl_logs, tmp_path, model_file):
    port = free_udp_port()
    monitor = recording(port, tmp_path, model_file, stderr=subprocess.DEVNULL)
    path = sitl_logs / "campaign" / "v4_m10_q2.5.tlog"
    stream = command("stream", str(path), "--to", f"udpout:127.0.0.1:{port}", "--speed", "20")
    session = recording_in(tmp_path)

    def enough() -> bool:
        parts = list((session / "samples").glob("*.parquet"))
        return bool(parts) and sample_table(session).num_rows > 500

    until(enough)
    os.kill(monitor.pid, signal.SIGKILL)
    monitor.wait()
    stream.kill()
    stream.wait()
    live = read_samples(session, 1)
    read = read_log(session / "telemetry.tlog", airframe=AIRFRAME, sampling="hold").track
    rows = live.time_s.size
    assert 500 < rows <= read.time_s.size
    same(live, read.rows(slice(0, rows)))


@contextmanager
def small_disk(folder: Path, kilobytes: int) -> Iterator[Path]:
    """A file system of so many kB of its own; skips the test where none can be mounted."""
    folder.mkdir()
    made = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", str(folder)],
        capture_output=True,
    )
    if made.returncode:
        pytest.skip("this machine does not let a test mount a file system")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="mounts need root")
def test_on_a_full_disk_the_monitor_goes_on_and_says_so_and_records_again_when_there_is_room(
    sitl_logs, tmp_path, model_file
):
    port = free_udp_port()
    with small_disk(tmp_path / "small", 2000) as disk:
        ballast = disk / "ballast"
        ballast.write_bytes(bytes(1_850_000))
        monitor = recording(
            port,
            disk / "recordings",
            model_file,
            *("--max-utilisation", "0.4"),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert monitor.stdout is not None
        path = sitl_logs / "campaign" / "v4_m10_q2.5.tlog"
        lines = iter(monitor.stdout.readline, "")
        said = []
        with sending_frames(stamped_frames(path), port, speed=20.0) as streamed:
            for line in lines:
                said.append(line.strip())
                if "NOT RECORDING" in said[-1]:
                    break
            assert said[-1].endswith("NOT RECORDING: No space left on device")
            time.sleep(3.0)
            ballast.unlink()
            for line in lines:
                said.append(line.strip())
                if said[-1].endswith("recording again"):
                    break
            streamed.join()
        session = recording_in(disk / "recordings")
        wait_until_heard(session, path)
        monitor.send_signal(signal.SIGINT)
        rest, told = monitor.communicate(timeout=120)
        assert monitor.returncode == 130 or "KeyboardInterrupt" in told
        # Watched all the same, while nothing could be recorded, too.
        rows = read_log(path, airframe=AIRFRAME, sampling="hold").track.time_s.size
        heard = re.search(r"^vehicle 1: (\d+) samples", told, re.MULTILINE)
        assert heard is not None
        recorded = sample_table(session).num_rows
        assert max(0.5 * rows, recorded) <= int(heard[1]) <= rows
        assert "lost earlier" in told
        assert any("Thrust left" in line for line in [*said, *rest.splitlines()])
        kept = [data for _, data in stamped_frames(session / "telemetry.tlog")]
        sent = [data for _, data in stamped_frames(path)]
        assert len(sent) / 10 < len(kept) < len(sent)
        # What was kept is whole, and goes on after the gap to the end.
        assert set(kept) <= set(sent)
        assert kept[-1] == sent[-1]
        assert recorded > rows / 4


MAIN = "import sys; from thrustmargin.gcs_plugin.cli import main; main(sys.argv[1:])"


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no such signals here")
@pytest.mark.parametrize("number", [signal.SIGTERM, getattr(signal, "SIGHUP", 1)])
def test_sigterm_and_sighup_end_as_ctrl_c_does(sitl_logs, tmp_path, model_file, number):
    port = free_udp_port()
    options = ("--record", str(tmp_path), "--model", str(model_file), "--host", "0.0.0.0")
    url = f"udpin:127.0.0.1:{port}"
    monitor = subprocess.Popen(
        [sys.executable, "-c", MAIN, "monitor", url, "--port", str(free_port()), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),  # nohup has it ignored
    )
    assert monitor.stdout is not None
    page = monitor.stdout.readline().split()[2]
    # Others can reach 0.0.0.0: the address that is printed opens it, and none without the token.
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/\?token=[\w-]{20,}", page)
    with urllib.request.build_opener(urllib.request.HTTPCookieProcessor()).open(page) as reply:
        assert reply.status == 200
    with pytest.raises(urllib.error.HTTPError, match="401"):
        urllib.request.urlopen(page.partition("?")[0])
    path = sitl_logs / "campaign" / "v4_m10_q2.5.tlog"
    stream = command("stream", str(path), "--to", f"udpout:127.0.0.1:{port}", "--speed", "20")
    session = recording_in(tmp_path)
    until(lambda: list((session / "samples").glob("*.parquet")))
    monitor.send_signal(number)
    said, told = monitor.communicate(timeout=120)
    stream.kill()
    stream.wait()
    assert monitor.returncode == 130
    assert "stopped; files that were finished are whole" in told
    assert f"recording to {session}" in told
    assert "Traceback" not in said + told
    kept = list(stamped_frames(session / "telemetry.tlog"))
    assert f"{len(kept)} messages" in told
