"""From bytes on a socket, or in a recording, to samples, margins, alarms and files."""

import json
import os
import re
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink import mavutil

from gcs_plugin.alarm import AlarmEvent
from gcs_plugin.fleet import Fleet
from gcs_plugin.frames import Frame
from gcs_plugin.logs import read_log
from gcs_plugin.monitor import Monitor, MonitorSettings
from gcs_plugin.samples import read_samples, sample_table
from gcs_plugin.speaker import COMPONENT
from gcs_plugin.stream import stamped_frames
from gcs_plugin.watch import Update, WatchSettings
from models.airframe import load_airframe
from models.analysis import analyse
from models.errors import LinkError
from models.flight import CHANNEL_COLUMNS, FlightTrack
from models.rotor_model import physics_model, save_model, shipped_model
from tests.browser import open_page
from tests.gcs_plugin.live_vehicle import (
    SECOND,
    Vehicle,
    as_frame,
    command,
    write_log,
)

AIRFRAME = load_airframe("topxgun-f16-sitl")
MODEL = physics_model(AIRFRAME)


@pytest.fixture(scope="module")
def model_file(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("model") / "physics.safetensors"
    save_model(MODEL, path)
    return path


class Seen:
    """A subscriber that keeps all."""

    def __init__(self) -> None:
        self.updates: list[Update] = []
        self.events: list[tuple[int, AlarmEvent]] = []

    def on_update(self, update: Update) -> None:
        self.updates.append(update)

    def on_event(self, vehicle: int, event: AlarmEvent) -> None:
        self.events.append((vehicle, event))

    def on_round(self, fleet: Fleet, now_us: int) -> None:
        pass

    def names(self) -> list[tuple[int, str, bool]]:
        return [(vehicle, e.alarm.name, e.raised) for vehicle, e in self.events]

    def rows(self, vehicle: int = 1) -> int:
        return sum(u.clock_s.size - u.first for u in self.updates if u.vehicle == vehicle)


def run(path: Path, record: Path | None = None, **watch) -> tuple[Monitor, Seen]:
    """A recording through the whole monitor, at full speed, with its own times."""
    seen = Seen()
    settings = MonitorSettings(urls=(str(path),), record=record, watch=WatchSettings(**watch))
    monitor = Monitor(MODEL, settings, subscribers=[seen])
    monitor.start()
    while not monitor.finished:
        time.sleep(0.02)
    monitor.close()
    monitor.check()
    return monitor, seen


def flight(vehicle: Vehicle, seconds: float, **options) -> list[Frame]:
    return [f for _ in range(round(seconds * 10)) for f in vehicle.tick(**options)]


def same(ours: FlightTrack, theirs: FlightTrack, after: float = 1.0) -> None:
    """Rows agree in every channel.

    In the first second another source may stand in live, and the origin settles at take-off.
    """
    assert np.allclose(ours.time_s, theirs.time_s, rtol=0, atol=1e-4)
    start = ours.time_s > after
    airborne = np.arange(ours.time_s.size) >= int(np.argmax(theirs.flying))
    for channel in CHANNEL_COLUMNS:
        settled = start & airborne if channel == "position_ned" else start
        one, other = getattr(ours, channel)[settled], getattr(theirs, channel)[settled]
        assert np.array_equal(one, other, equal_nan=True), channel


def recording_in(folder: Path) -> Path:
    (session,) = folder.iterdir()
    return session


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def free_tcp_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return probe.getsockname()[1]


@pytest.mark.slow
def test_streamed_over_udp_a_flight_gives_the_samples_and_margins_of_its_file(
    sitl_logs, tmp_path, model_file
):
    path = sitl_logs / "campaign" / "v4_m10_q3.5.tlog"
    port = free_port()
    monitor = command(
        "monitor",
        f"udpin:127.0.0.1:{port}",
        *("--record", str(tmp_path), "--model", str(model_file), "--no-view"),
        stderr=subprocess.PIPE,
        text=True,
    )
    while not list(tmp_path.glob("*/telemetry.tlog")):
        assert monitor.poll() is None
        time.sleep(0.05)
    streamed = command("stream", str(path), "--to", f"udpout:127.0.0.1:{port}", "--speed", "25")
    assert streamed.wait(timeout=120) == 0
    time.sleep(2.0)
    monitor.send_signal(signal.SIGINT)
    _, told = monitor.communicate(timeout=60)
    session = recording_in(tmp_path)
    sent = list(stamped_frames(path))
    assert [data for _, data in stamped_frames(session / "telemetry.tlog")] == [d for _, d in sent]
    assert f"{len(sent)} messages" in told
    live = read_samples(session, 1)
    read = read_log(path, airframe=AIRFRAME, sampling="hold").track
    same(live, read)
    # The recorded telemetry, read as a file, says the same.
    same(live, read_log(session / "telemetry.tlog", airframe=AIRFRAME, sampling="hold").track)
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
        expected.redundancy_yaw_free[settled],
        equal_nan=True,
    )


def test_a_recording_gives_the_same_rows_as_its_file(sitl_logs, tmp_path):
    path = sitl_logs / "onset" / "worn_prop_onset.tlog"
    _, seen = run(path, tmp_path)
    live = read_samples(recording_in(tmp_path), 1)
    same(live, read_log(path, airframe=AIRFRAME, sampling="hold").track)
    assert seen.rows() == live.time_s.size
    assert (1, "rotor", True) in seen.names()
    lines = (recording_in(tmp_path) / "events.jsonl").read_text().splitlines()
    events = [json.loads(line) for line in lines]
    raised = [e for e in events if e.get("alarm") == "rotor" and e["event"] == "raised"]
    assert [e["rotor"] for e in raised] == [3]
    # The manifest: from 180 s after boot.
    assert 180.0 < raised[0]["time_s"] < 190.0


def test_two_vehicles_on_one_link_are_two(tmp_path):
    one, two = Vehicle(1, clock_s=100.0), Vehicle(2, clock_s=900.0)
    frames = []
    for _ in range(100):
        frames += one.tick(rpm=(1500,) * 4) + two.tick(rpm=(2400,) * 4)
    monitor, seen = run(write_log(tmp_path / "two.tlog", frames), tmp_path / "out")
    assert list(monitor.fleet.vehicles) == [1, 2]
    session = recording_in(tmp_path / "out")
    assert np.all(read_samples(session, 1).rotor_speed_rpm == 1500.0)
    assert np.all(read_samples(session, 2).rotor_speed_rpm == 2400.0)
    assert seen.rows(1) == seen.rows(2) == 100
    # Rotors at 2400 rpm leave less than half: an alarm of that vehicle alone.
    assert {(v, name) for v, name, raised in seen.names() if raised} >= {(2, "margin")}
    assert (1, "margin", True) not in seen.names()


def test_two_vehicles_with_one_id_give_no_margin_but_a_warning(tmp_path):
    one, two = Vehicle(1, clock_s=100.0), Vehicle(1, clock_s=900.0)
    two.packer.seq = 90
    frames = flight(one, 20)
    two.stamp_us = one.stamp_us
    for _ in range(200):
        frames += one.tick() + two.tick(rpm=(2900, 2900, 2900, 2900))
    monitor, _ = run(write_log(tmp_path / "shared.tlog", frames), tmp_path / "out")
    watch = monitor.fleet.vehicles[1]
    assert "SYSID_THISMAV" in watch.problem
    # Found out within the first moments: the other's rotor speeds never make a row for long.
    rows = read_samples(recording_in(tmp_path / "out"), 1)
    assert rows.time_s.size < 210
    assert int(np.sum(rows.rotor_speed_rpm[:, 0] == 2900.0)) <= 5
    # Heard and recorded all the same.
    kept = list(stamped_frames(recording_in(tmp_path / "out") / "telemetry.tlog"))
    assert len(kept) == len(frames)


def test_a_link_that_is_down_for_30_s_is_told_and_the_flight_goes_on(tmp_path):
    vehicle = Vehicle()
    frames = flight(vehicle, 20)
    flight(vehicle, 30)  # flown, and heard by nobody
    frames += flight(vehicle, 20)
    _, seen = run(write_log(tmp_path / "gap.tlog", frames), tmp_path / "out")
    links = [(name, raised) for _, name, raised in seen.names() if name == "telemetry"]
    assert links == [("telemetry", True), ("telemetry", False)]
    track = read_samples(recording_in(tmp_path / "out"), 1)
    steps = np.diff(track.time_s)
    assert steps.max() == pytest.approx(30.1, abs=0.01)
    assert np.sum(steps > 0.2) == 1
    # Nothing from before the gap is held over it.
    first = int(np.argmax(steps)) + 1
    assert np.isnan(track.airspeed[first])
    assert np.isfinite(track.airspeed[first + 1])


def test_a_clock_that_leaps_ahead_is_noted_and_nothing_from_before_is_held_over_it(tmp_path):
    vehicle = Vehicle()
    frames = flight(vehicle, 20)
    vehicle.clock_s += 500.0  # and the ground's clock runs on as ever
    frames += flight(vehicle, 20)
    _, seen = run(write_log(tmp_path / "leap.tlog", frames), tmp_path / "out")
    session = recording_in(tmp_path / "out")
    assert "jumped 500 s ahead" in (session / "events.jsonl").read_text()
    track = read_samples(session, 1)
    first = int(np.argmax(np.diff(track.time_s))) + 1
    assert track.time_s[first] - track.time_s[first - 1] == pytest.approx(500.1, abs=0.01)
    assert np.isnan(track.airspeed[first])
    assert np.isfinite(track.airspeed[first + 1 :]).all()
    assert not [name for _, name, raised in seen.names() if raised and name != "margin"]


def test_a_restart_begins_a_new_flight_of_the_same_vehicle(tmp_path):
    vehicle = Vehicle(clock_s=500.0)
    frames = flight(vehicle, 10)
    vehicle.clock_s = 2.0
    vehicle.stamp_us += 5 * SECOND
    frames += flight(vehicle, 10)
    _, seen = run(write_log(tmp_path / "restart.tlog", frames), tmp_path / "out")
    session = recording_in(tmp_path / "out")
    before, after = read_samples(session, 1, boot=0), read_samples(session, 1, boot=1)
    assert before.time_s.size == 100
    assert 95 <= after.time_s.size <= 100
    assert after.time_s[0] == 0.0
    assert "restarted" in (session / "events.jsonl").read_text()
    assert seen.updates[-1].boot == 1


def test_doubled_and_overtaken_frames_change_nothing(tmp_path):
    vehicle = Vehicle()
    frames = flight(vehicle, 20)
    clean, _ = run(write_log(tmp_path / "clean.tlog", frames), tmp_path / "a")
    twice = [g for f in frames for g in (f, f)]
    run(write_log(tmp_path / "twice.tlog", twice), tmp_path / "b")
    one, other = (read_samples(recording_in(tmp_path / n), 1) for n in ("a", "b"))
    same(one, other, after=-1.0)
    assert clean.fleet.vehicles[1].senders[1].doubled == 0
    swapped = list(frames)
    for at in range(30, len(frames) - 10, 50):
        swapped[at], swapped[at + 1] = swapped[at + 1], swapped[at]
    monitor, _ = run(write_log(tmp_path / "swapped.tlog", swapped), tmp_path / "c")
    mixed = read_samples(recording_in(tmp_path / "c"), 1)
    assert monitor.fleet.vehicles[1].senders[1].late > 10
    assert monitor.fleet.vehicles[1].problem == ""
    # An overtaken report of rotor speeds costs its row, and no row is out of order.
    assert 180 <= mixed.time_s.size <= 200
    assert np.all(np.diff(mixed.time_s) > 0)


def test_noise_bad_checksums_and_cut_frames_cost_only_themselves(tmp_path):
    vehicle = Vehicle()
    frames = flight(vehicle, 20)
    rng = np.random.default_rng(3)
    raw = bytearray()
    for number, frame in enumerate(frames):
        data = bytearray(frame.data)
        if number % 20 == 5:
            data[int(rng.integers(10, len(data)))] ^= 0x40
        if number % 20 == 11:
            data = data[: len(data) // 2]
        if number % 20 == 17:
            data += bytes(rng.integers(0, 256, 30, dtype=np.uint8))
        raw += data
    seen = Seen()
    settings = MonitorSettings(urls=("tcpin:127.0.0.1:0",), record=tmp_path)
    monitor = Monitor(MODEL, settings, subscribers=[seen])
    monitor.start()
    address = monitor.listener.links[0].transport.address  # type: ignore[attr-defined]
    with socket.create_connection(address) as client:
        client.sendall(raw + b"".join(f.data for f in frames[-60:]))
        good = len(frames) - 2 * len(range(5, len(frames), 20)) + 60
        deadline = time.monotonic() + 10
        while monitor.status().frames < good - 5 and time.monotonic() < deadline:
            time.sleep(0.02)
    monitor.close()
    status = monitor.status()
    assert abs(status.frames - good) <= 2
    assert status.bad_checksum > 0
    assert status.bytes_skipped > 0
    kept = [data for _, data in stamped_frames(recording_in(tmp_path) / "telemetry.tlog")]
    assert len(kept) == status.frames
    assert set(kept) <= {f.data for f in frames}


def test_a_vehicle_that_is_long_silent_has_left_and_may_return(tmp_path):
    leaving, staying = Vehicle(1), Vehicle(2)
    frames = []
    for second in range(200):
        if not 20 <= second < 150:
            frames += leaving.tick(1.0)
        else:
            leaving.clock_s += 1.0
            leaving.stamp_us += SECOND
        frames += staying.tick(1.0)
    run(write_log(tmp_path / "leave.tlog", frames), tmp_path / "out")
    lines = (recording_in(tmp_path / "out") / "events.jsonl").read_text().splitlines()
    events = [(e["vehicle"], e["event"]) for e in map(json.loads, lines)]
    ours = [kind for vehicle, kind in events if vehicle == 1 and kind in ("left", "returned")]
    assert ours == ["left", "returned"]
    assert (2, "left") not in events


def test_ground_stations_and_companions_are_no_vehicles(sitl_logs):
    monitor, _ = run(sitl_logs / "onset" / "reference.tlog")
    assert list(monitor.fleet.vehicles) == [1]
    watch = monitor.fleet.vehicles[1]
    assert watch.plan is not None
    assert watch.last is not None
    assert watch.last.tank_source == "NAMED_VALUE_FLOAT TANK"


def test_the_outlook_follows_the_mission_to_its_end(sitl_logs):
    path = sitl_logs / "campaign" / "v4_m16_q2.5.tlog"
    _, seen = run(path)
    flying = [u for u in seen.updates if u.analysis.track.flying[-1]]
    middle = flying[len(flying) // 2]
    route = middle.outlook.route
    assert route is not None
    # Empty in 2.5 L/min from here, and the margin grows as the tank empties.
    tank = float(middle.analysis.track.tank_kg[-1])
    assert middle.outlook.seconds_to_empty == pytest.approx(tank / (2.5 / 60), rel=0.1)
    assert route.margin[-1] > route.margin[0]
    assert middle.outlook.margin_ahead == pytest.approx(float(np.min(route.margin)))
    # Predicted end of the tank against what the flight really had left.
    final = float(seen.updates[-1].analysis.track.tank_kg[-1])
    assert float(route.analysis.track.tank_kg[-1]) == pytest.approx(final, abs=0.8)
    assert middle.outlook.margin_full < float(np.min(route.margin))


@pytest.mark.slow
@pytest.mark.browser
def test_streamed_over_udp_the_page_and_the_announcements_say_what_the_file_says(
    sitl_logs, tmp_path, model_file
):
    """Real processes; every number that a pilot reads is that of a row of the file."""
    path = sitl_logs / "campaign" / "v4_m10_q3.5.tlog"
    port, page_port = free_port(), free_tcp_port()
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
        with open_page(url) as page:
            target = f"udpout:127.0.0.1:{port}"
            streamed = command("stream", str(path), "--to", target, "--speed", "25")
            read_off = set()
            while streamed.poll() is None:
                page.wait_for_timeout(100)
                if page.locator("[data-gauge=tank]").count():
                    read_off.add(tuple(page.evaluate(READ)))
            page.wait_for_timeout(1500)
            last = tuple(page.evaluate(READ))
    finally:
        monitor.send_signal(signal.SIGINT)
        told, _ = monitor.communicate(timeout=60)
        ended.set()
        listening.join()
        station.close()
    track = read_log(path, airframe=AIRFRAME, sampling="hold").track
    expected = analyse(track, MODEL)
    rows = {
        (f"{100 * margin:.0f} %", f"{kg:.1f} kg")
        # Live, the moments before a landing still count as flight.
        for margins in (expected.margin, expected.margin_predicted)
        for margin, kg in zip(margins.min(axis=1), track.tank_kg, strict=True)
    }
    assert len(read_off) > 6
    assert {pair for pair in read_off if "no data" not in pair} <= rows
    landed = expected.margin_predicted[-1].min()
    assert last == (f"{100 * landed:.0f} %", f"{track.tank_kg[-1]:.1f} kg")

    clock = read_log(path, airframe=AIRFRAME, sampling="hold").clock_start_s + track.time_s
    at = {round(1e3 * c): row for row, c in enumerate(clock)}
    figures = [m for m in ours if m.get_type() == "NAMED_VALUE_FLOAT" and m.name == "MARGIN"]
    assert len(figures) >= 4
    for figure in figures:
        row = min(at, key=lambda ms: abs(ms - figure.time_boot_ms))
        assert abs(row - figure.time_boot_ms) <= 1
        assert figure.value == pytest.approx(100 * expected.margin[at[row]].min(), rel=1e-6)
    texts = {m.text for m in ours if m.get_type() == "STATUSTEXT"}
    assert texts <= {line.removeprefix("vehicle 1: ") for line in told.splitlines()} | {
        text for text in texts if text.startswith("Over: ")
    }


def listen(station: Any, ours: list[Any], ended: threading.Event) -> None:
    """Keep what our component says, as a ground station would."""
    while not ended.is_set():
        message = station.recv_match(blocking=True, timeout=0.1)
        if message is not None and message.get_srcComponent() == COMPONENT:
            ours.append(message)


#: The worst rotor's margin and the tank level as a reader of the page sees them.
READ = """() => [
  document.querySelector('[data-gauge=worst] .big').innerText,
  document.querySelector('[data-gauge=tank] .mid').innerText]"""


@pytest.mark.slow
def test_kill_9_leaves_a_recording_that_reads_as_a_flight(sitl_logs, tmp_path, model_file):
    port = free_port()
    monitor = command(
        "monitor",
        f"udpin:127.0.0.1:{port}",
        *("--record", str(tmp_path), "--model", str(model_file), "--no-view"),
        stderr=subprocess.DEVNULL,
    )
    while not list(tmp_path.glob("*/telemetry.tlog")):
        assert monitor.poll() is None
        time.sleep(0.05)
    path = sitl_logs / "campaign" / "v4_m10_q2.5.tlog"
    stream = command("stream", str(path), "--to", f"udpout:127.0.0.1:{port}", "--speed", "20")
    session = recording_in(tmp_path)
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        parts = list((session / "samples").glob("*.parquet"))
        if parts and sample_table(session).num_rows > 500:
            break
        time.sleep(0.2)
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
    port = free_port()
    with small_disk(tmp_path / "small", 2000) as disk:
        ballast = disk / "ballast"
        ballast.write_bytes(bytes(1_850_000))
        monitor = command(
            "monitor",
            f"udpin:127.0.0.1:{port}",
            *("--record", str(disk / "recordings"), "--model", str(model_file), "--no-view"),
            *("--limit", "0.6"),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert monitor.stdout is not None
        while not list(disk.glob("recordings/*/telemetry.tlog")):
            assert monitor.poll() is None
            time.sleep(0.05)
        path = sitl_logs / "campaign" / "v4_m10_q2.5.tlog"
        stream = command("stream", str(path), "--to", f"udpout:127.0.0.1:{port}", "--speed", "20")
        lines = iter(monitor.stdout.readline, "")
        said = []
        for line in lines:
            said.append(line.strip())
            if said[-1].startswith("NOT RECORDING"):
                break
        assert said[-1] == "NOT RECORDING: No space left on device"
        time.sleep(3.0)
        ballast.unlink()
        for line in lines:
            said.append(line.strip())
            if said[-1] == "recording again":
                break
        assert stream.wait(timeout=60) == 0
        monitor.send_signal(signal.SIGINT)
        rest, told = monitor.communicate(timeout=60)
        assert monitor.returncode == 130 or "KeyboardInterrupt" in told
        # Watched all the same: every row of the file, and its alarms.
        rows = read_log(path, airframe=AIRFRAME, sampling="hold").track.time_s.size
        assert f"vehicle 1: {rows} samples" in told
        assert "lost earlier" in told
        assert any("Thrust margin" in line for line in [*said, *rest.splitlines()])
        session = recording_in(disk / "recordings")
        kept = [data for _, data in stamped_frames(session / "telemetry.tlog")]
        sent = [data for _, data in stamped_frames(path)]
        assert len(sent) / 10 < len(kept) < len(sent)
        # What was kept is whole, and goes on after the gap to the end.
        assert set(kept) <= set(sent)
        assert kept[-1] == sent[-1]
        assert sample_table(session).num_rows > rows / 2


def test_a_busy_port_ends_the_command_with_one_line():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        url = f"udpin:127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(LinkError, match=re.escape(url)):
            Monitor(MODEL, MonitorSettings(urls=(url,)))


def test_the_recorders_failure_to_open_frees_the_port(tmp_path):
    (tmp_path / "file").write_text("")
    port = free_port()
    settings = MonitorSettings(urls=(f"udpin:127.0.0.1:{port}",), record=tmp_path / "file")
    with pytest.raises(LinkError):
        Monitor(MODEL, settings)
    Monitor(MODEL, replace(settings, record=None)).close()


def test_a_flight_with_stations_frames_only_gives_no_vehicle(tmp_path):
    station = Vehicle(255)
    frames = [as_frame(station.heartbeat(), n * SECOND) for n in range(1, 10)]
    monitor, seen = run(write_log(tmp_path / "station.tlog", frames))
    assert monitor.fleet.vehicles == {}
    assert seen.updates == []


def test_predictions_with_effects_settle_to_those_of_the_file(sitl_logs, tmp_path):
    """Effects look both ways in time: what is recorded is what they say once both are known."""
    path = sitl_logs / "campaign" / "v6_m10_q2.5.tlog"
    model = shipped_model()
    assert model.effects
    settings = MonitorSettings(urls=(str(path),), record=tmp_path)
    seen = Seen()
    monitor = Monitor(model, settings, subscribers=[seen])
    monitor.start()
    while not monitor.finished:
        time.sleep(0.02)
    monitor.close()
    monitor.check()
    table = sample_table(recording_in(tmp_path))
    live = np.column_stack([table[f"predicted_rpm_{k}"].to_numpy() for k in range(1, 5)])
    track = read_log(path, airframe=model.airframe, sampling="hold").track
    read = analyse(track, model).prediction.rotor_speed_rpm
    assert live.shape == read.shape
    flown = track.flying & (track.time_s > 2.0)
    apart = np.abs(live - read)[flown]
    assert np.nanmax(apart) < 3.0
    assert np.nanmedian(apart) < 0.1
    # The margin itself is measured, and never waits for a prediction.
    assert all(u.first >= u.unsettled for u in seen.updates)
    assert any(u.settled < u.clock_s.size for u in seen.updates)
