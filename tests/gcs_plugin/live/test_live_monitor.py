"""From bytes in a recording, or on a socket, to samples, margins, alarms and files."""

import json
import re
import socket
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.gcs_plugin.live.live_vehicle import (
    SECOND,
    Vehicle,
    as_frame,
    first_part,
    write_log,
)
from tests.gcs_plugin.live.monitored import (
    AIRFRAME,
    MODEL,
    read_samples,
    recording_in,
    same,
    sample_table,
)
from tests.gcs_plugin.peers.ports import free_udp_port
from tests.waiting import until
from thrustmargin.gcs_plugin.live.alarms.alarm import AlarmEvent
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.live.live_monitor import LiveMonitor, MonitorSettings
from thrustmargin.gcs_plugin.live.output import Output
from thrustmargin.gcs_plugin.live.watch.update import Update, WatchSettings
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.gcs_plugin.mavlink.scan import stamped_frames
from thrustmargin.gcs_plugin.wording.check_words import source_words
from thrustmargin.models.errors import LinkError
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.model_file import shipped_model


class Seen(Output):
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


def run(path: Path, record: Path | None = None, **watch) -> tuple[LiveMonitor, Seen]:
    """A recording through the whole monitor, at full speed, with its own times."""
    seen = Seen()
    settings = MonitorSettings(urls=(str(path),), record=record, watch=WatchSettings(**watch))
    monitor = LiveMonitor(MODEL, settings, outputs=[seen])
    monitor.start()
    while not monitor.finished:
        time.sleep(0.02)
    monitor.close()
    monitor.check()
    return monitor, seen


def flight(vehicle: Vehicle, seconds: float, **options) -> list[Frame]:
    return [f for _ in range(round(seconds * 10)) for f in vehicle.tick(**options)]


@pytest.mark.slow
def test_a_recording_gives_the_same_rows_as_its_file(sitl_logs, tmp_path):
    path = first_part(sitl_logs / "onset" / "worn_prop_onset.tlog", 245.0, tmp_path)
    _, seen = run(path, tmp_path / "out")
    live = read_samples(recording_in(tmp_path / "out"), 1)
    same(live, read_log(path, airframe=AIRFRAME, sampling="hold").track)
    assert seen.rows() == live.time_s.size
    assert (1, "rotor", True) in seen.names()
    lines = (recording_in(tmp_path / "out") / "events.jsonl").read_text().splitlines()
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
    # The first row comes with the attitude, before any rotor speed.
    assert np.all(read_samples(session, 1).rotor_speed_rpm[1:] == 1500.0)
    assert np.all(read_samples(session, 2).rotor_speed_rpm[1:] == 2400.0)
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


def test_two_vehicles_with_one_id_are_found_on_a_thinned_link_without_a_flood_of_restarts(tmp_path):
    """36 % of the frames, in bursts of seconds: no count of sequence numbers is unbroken."""
    rng = np.random.default_rng(5)
    one, two = Vehicle(1, clock_s=100.0), Vehicle(1, clock_s=900.0)
    frames: list[Frame] = []
    while one.clock_s < 220.0:
        both = [flight(vehicle, 0.1) for vehicle in (one, two)]
        turn = int(one.clock_s / 1.7) % 2
        frames += [frame for frame in both[turn] if rng.random() < 0.36]
    monitor, _ = run(write_log(tmp_path / "thinned.tlog", frames), tmp_path / "out")
    assert "SYSID_THISMAV" in monitor.fleet.vehicles[1].problem
    events = (recording_in(tmp_path / "out") / "events.jsonl").read_text()
    assert events.count("restarted") + events.count("ahead") <= 5
    assert events.count("Two aircraft have id 1: give each its own") == 1
    times = [json.loads(line)["unix_s"] for line in events.splitlines()]
    assert times == sorted(times)
    assert monitor.fleet.vehicles[1].rows < 150  # of 1,200


def test_a_thinned_link_of_one_vehicle_that_restarts_is_one_vehicle(tmp_path):
    rng = np.random.default_rng(6)
    vehicle, frames = Vehicle(1, clock_s=500.0), []
    for clock_s in (500.0, 2.0, 2.0):
        vehicle.clock_s = clock_s
        vehicle.stamp_us += 5 * SECOND
        frames += [frame for frame in flight(vehicle, 20) if rng.random() < 0.36]
    monitor, _ = run(write_log(tmp_path / "thinned.tlog", frames), tmp_path / "out")
    assert monitor.fleet.vehicles[1].problem == ""
    assert (recording_in(tmp_path / "out") / "events.jsonl").read_text().count("restarted") == 2


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
    assert clean.fleet.vehicles[1].link.senders[1].doubled == 0
    swapped = list(frames)
    for at in range(30, len(frames) - 10, 50):
        swapped[at], swapped[at + 1] = swapped[at + 1], swapped[at]
    monitor, _ = run(write_log(tmp_path / "swapped.tlog", swapped), tmp_path / "c")
    mixed = read_samples(recording_in(tmp_path / "c"), 1)
    assert monitor.fleet.vehicles[1].link.senders[1].late > 10
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
    monitor = LiveMonitor(MODEL, settings, outputs=[seen])
    monitor.start()
    address = monitor.listener.links[0].transport.address  # type: ignore[attr-defined]
    with socket.create_connection(address) as client:
        client.sendall(raw + b"".join(f.data for f in frames[-60:]))
        good = len(frames) - 2 * len(range(5, len(frames), 20)) + 60
        until(lambda: monitor.status().frames >= good - 5)
    monitor.close()
    status = monitor.status()
    assert abs(status.frames - good) <= 2
    assert status.bad_checksum > 0
    assert status.bytes_skipped > 0
    kept = [data for _, data in stamped_frames(recording_in(tmp_path) / "telemetry.tlog")]
    assert len(kept) == status.frames
    assert set(kept) <= {f.data for f in frames}


def test_ground_stations_and_companions_are_no_vehicles(sitl_logs, tmp_path):
    monitor, _ = run(first_part(sitl_logs / "onset" / "reference.tlog", 60.0, tmp_path))
    assert list(monitor.fleet.vehicles) == [1]
    watch = monitor.fleet.vehicles[1]
    assert watch.plan is not None
    assert watch.last is not None
    assert source_words(watch.last.analysis.track.source("tank_kg")) == "NAMED_VALUE_FLOAT TANK"


@pytest.mark.slow
def test_the_outlook_follows_the_mission_to_its_end(sitl_logs):
    path = sitl_logs / "campaign" / "v4_m16_q2.5.tlog"
    _, seen = run(path)
    flying = [u for u in seen.updates if u.analysis.track.flying[-1]]
    # On a line: in a turn the pump stands still.
    middle = next(u for u in flying if u.clock_s[-1] > 155.0)
    route = middle.outlook.route
    assert route is not None
    # Empty in 2.5 L/min from here, and the margin grows as the tank empties.
    tank = float(middle.analysis.track.tank_kg[-1])
    assert middle.outlook.seconds_to_empty == pytest.approx(tank / (2.5 / 60), rel=0.1)
    assert route.margin[-1] > route.margin[0]
    # What lasts is what alarms go by; for moments there is less.
    assert np.min(route.margin) <= middle.outlook.margin_ahead < 0.6
    # Predicted end of the tank against what the flight really had left.
    final = float(seen.updates[-1].analysis.track.tank_kg[-1])
    assert float(route.analysis.track.tank_kg[-1]) == pytest.approx(final, abs=0.8)
    assert middle.outlook.margin_full < float(np.min(route.margin))


def test_a_busy_port_ends_the_command_with_one_line():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        url = f"udpin:127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(LinkError, match=re.escape(url)):
            LiveMonitor(MODEL, MonitorSettings(urls=(url,)))


def test_the_recorders_failure_to_open_frees_the_port(tmp_path):
    (tmp_path / "file").write_text("")
    port = free_udp_port()
    settings = MonitorSettings(urls=(f"udpin:127.0.0.1:{port}",), record=tmp_path / "file")
    with pytest.raises(LinkError):
        LiveMonitor(MODEL, settings)
    LiveMonitor(MODEL, replace(settings, record=None)).close()


def test_a_flight_with_stations_frames_only_gives_no_vehicle(tmp_path):
    station = Vehicle(255)
    frames = [as_frame(station.heartbeat(), n * SECOND) for n in range(1, 10)]
    monitor, seen = run(write_log(tmp_path / "station.tlog", frames))
    assert monitor.fleet.vehicles == {}
    assert seen.updates == []


@pytest.mark.slow
def test_predictions_with_effects_settle_to_those_of_the_file(sitl_logs, tmp_path):
    """Effects look both ways in time: what is recorded is what they say once both are known."""
    path = first_part(sitl_logs / "campaign" / "v6_m10_q2.5.tlog", 120.0, tmp_path)
    model = shipped_model()
    assert model.effects
    settings = MonitorSettings(urls=(str(path),), record=tmp_path / "out")
    seen = Seen()
    monitor = LiveMonitor(model, settings, outputs=[seen])
    monitor.start()
    while not monitor.finished:
        time.sleep(0.02)
    monitor.close()
    monitor.check()
    table = sample_table(recording_in(tmp_path / "out"))
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
