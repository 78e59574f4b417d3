"""A late computer is no lost link: silence is by what came; order and newest figures are kept."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.gcs_plugin.live.live_vehicle import Vehicle, command
from tests.gcs_plugin.live.monitored import MODEL, Ground, recording_in
from tests.gcs_plugin.peers.ports import free_udp_port
from tests.waiting import PATIENCE, until
from thrustmargin.gcs_plugin.live.alarms.alarm import AlarmEvent, AlarmSettings
from thrustmargin.gcs_plugin.live.console import EventPrinter, status_lines, vehicle_cells
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.live.live_monitor import (
    Lateness,
    LiveMonitor,
    MonitorSettings,
    spacing,
)
from thrustmargin.gcs_plugin.live.output import Output
from thrustmargin.gcs_plugin.live.watch.update import Update, WatchSettings
from thrustmargin.gcs_plugin.mavlink.scan import stamped_frames
from thrustmargin.gcs_plugin.view.live_view import HeardVehicles

#: s here, to be quick; rotor speeds are missed a second earlier.
SILENCE = 3.0
TICK_US = 100_000


class Blocked(Output):
    """Holds the compute thread up in its first row after `hold`, until `release`."""

    def __init__(self) -> None:
        self.events: list[tuple[int, AlarmEvent]] = []
        self.newest: list[tuple[int, int]] = []  # vehicle, stamp of the newest row of each update
        self.rounds = 0
        self.hold, self.held, self.release = (threading.Event() for _ in range(3))

    @property
    def blocked(self) -> bool:
        return self.held.is_set() and not self.release.is_set()

    def on_round(self, *_: object) -> None:
        self.rounds += 1

    def on_update(self, update: Update) -> None:
        self.newest.append((update.vehicle, int(update.stamp_us[-1])))
        if self.hold.is_set() and not self.held.is_set():
            self.held.set()
            self.release.wait(PATIENCE)

    def on_event(self, vehicle: int, event: AlarmEvent) -> None:
        self.events.append((vehicle, event))

    def named(self, name: str) -> list[tuple[int, bool]]:
        return [(v, event.raised) for v, event in self.events if event.alarm.name == name]


class Sending:
    """Two vehicles that fly until they are silenced; the ground's clock goes on by what they flew.

    It waits until what was sent is received, and every half second until the monitor, unless it is
    blocked, has had a round: however busy the machine is, no vehicle seems silent for it.
    """

    def __init__(self, monitor: LiveMonitor, ground: Ground, seen: Blocked) -> None:
        self.rpm = 1700
        self._monitor, self._ground, self._seen = monitor, ground, seen
        self._silent, self._end = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        vehicles = Vehicle(1), Vehicle(2, clock_s=500.0)
        address = self._monitor.listener.links[0].transport.address  # type: ignore[attr-defined]
        sent = ticks = rounds = 0
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            while not self._end.wait(0.05):
                if self._seen.rounds != rounds or self._seen.blocked:
                    rounds, ticks = self._seen.rounds, 0
                elif ticks == 5:
                    continue
                ticks += 1
                self._ground.us += TICK_US
                if self._silent.is_set():
                    continue
                for vehicle in vehicles:
                    for frame in vehicle.tick(rpm=(self.rpm,) * 4):
                        out.sendto(frame.data, address)
                        sent += 1
                until(lambda: self._end.is_set() or self._monitor.status().frames >= sent)  # noqa: B023

    def passes(self, seconds: float) -> None:
        """Return when so many s have passed on the ground."""
        end_us = self._ground.us + seconds * 1e6
        until(lambda: self._ground.us >= end_us)

    def silence(self) -> None:
        """Nothing is sent any more; time goes on."""
        self._silent.set()
        self.passes(0.2)

    def end(self) -> None:
        self._end.set()
        self._thread.join()


@contextmanager
def flown(folder: Path) -> Iterator[tuple[LiveMonitor, Blocked, Sending]]:
    seen = Blocked()
    watch = WatchSettings(alarms=AlarmSettings(silence=SILENCE))
    settings = MonitorSettings(urls=("udpin:127.0.0.1:0",), record=folder, watch=watch)
    ground = Ground()
    with ground.in_listeners():
        monitor = LiveMonitor(MODEL, settings, outputs=[seen])
    monitor.start()
    sending = Sending(monitor, ground, seen)
    try:
        until(lambda: sum(w.flying for w in monitor.fleet.vehicles.values()) == 2)
        yield monitor, seen, sending
    finally:
        seen.release.set()
        sending.end()
        monitor.close()
        monitor.check()


def recorded(folder: Path) -> list[dict]:
    lines = (recording_in(folder) / "events.jsonl").read_text().splitlines()
    return [json.loads(line) for line in lines]


@pytest.mark.slow
def test_a_blocked_analysis_is_said_and_is_no_lost_telemetry(tmp_path):
    with flown(tmp_path) as (monitor, seen, sending):
        # What kind each is, is heard once a second; from there on rows go on in one part.
        heard = monitor.fleet.vehicles
        until(lambda: len(heard) == 2 and all(w.telemetry.counts[0] for w in heard.values()))
        newest = len(seen.newest)
        until(lambda: {1, 2} <= {vehicle for vehicle, _ in seen.newest[newest:]})
        seen.hold.set()
        assert seen.held.wait(PATIENCE)
        began_us = monitor.now_us()
        sending.rpm = 2400  # a low margin, that nobody sees yet
        sending.passes(SILENCE + 0.5)
        (late, *_) = status_lines(monitor.status(), page=True)
        assert late in (
            f"this computer is {n} s behind: closing the 3D page helps" for n in range(3, 6)
        )
        for watch in monitor.fleet.vehicles.values():
            assert watch.link.silent(monitor.now_us()) < SILENCE
            assert watch.stale(monitor.now_us()) == ""
        seen.release.set()
        released_us = monitor.now_us()
        until(lambda: {1, 2} <= {v for v, us in seen.newest if us > released_us - 1_000_000})
        # A few updates more of each, not one for each of the 35 moments that were missed.
        after = [vehicle for vehicle, us in seen.newest if us > began_us]
        assert after.index(2) < 10
        until(lambda: not monitor.status().behind_s)
        until(lambda: len(seen.named("margin")) == 2)
        sending.passes(1.5)
        assert seen.named("telemetry") == []
        assert seen.named("rotor speeds") == []
    events = recorded(tmp_path)
    assert not [e for e in events if e.get("alarm") in ("telemetry", "rotor speeds")]
    (note,) = [e for e in events if "this computer is" in e["text"]]
    assert note["vehicle"] is None
    # The file is in the order of time, whichever vehicle was analysed first.
    shown = sorted(((v, e.alarm.text, e.unix_s) for v, e in seen.events), key=lambda one: one[2])
    kept = [(e["vehicle"], e["text"], e["unix_s"]) for e in events if "alarm" in e]
    assert shown == kept
    # Raised as of when its report came, 7.5 s after the margin fell, and not when it was analysed.
    (raised,) = [e for e in events if e.get("alarm") == "margin" and e["vehicle"] == 1]
    assert 7.0 < raised["unix_s"] - began_us * 1e-6 < 9.0


def test_real_silence_is_said_in_time_also_just_after_a_blocked_analysis(tmp_path):
    with flown(tmp_path) as (_, seen, sending):
        seen.hold.set()
        assert seen.held.wait(PATIENCE)
        sending.silence()
        sending.passes(SILENCE + 0.2)
        assert seen.named("telemetry") == []  # nobody could
        seen.release.set()
        until(lambda: sorted(seen.named("telemetry")) == [(1, True), (2, True)])


class BlockedBetween(Blocked):
    """Held up in a row of vehicle 1, behind which one of vehicle 2 waits."""

    def on_update(self, update: Update) -> None:
        super().on_update(update)
        if update.vehicle == 2:
            self.hold.set()


def test_its_end_waits_no_longer_than_asked_and_says_what_is_left_out(tmp_path):
    seen = BlockedBetween()
    settings = MonitorSettings(urls=("udpin:127.0.0.1:0",), record=tmp_path)
    monitor = LiveMonitor(MODEL, settings, outputs=[seen])
    monitor.start()
    sending = Sending(monitor, Ground(), seen)
    assert seen.held.wait(PATIENCE)
    before = monitor.status().frames
    until(lambda: monitor.status().frames > before + 100)
    sending.end()
    updates = len(seen.newest)
    monitor.close(0.3)
    assert status_lines(monitor.status())[0] == (
        "ended before all that came was analysed: the answer is without the rest"
    )
    seen.release.set()
    time.sleep(0.5)
    monitor.check()
    assert len(seen.newest) == updates
    kept = list(stamped_frames(recording_in(tmp_path) / "telemetry.tlog"))
    assert len(kept) == monitor.status().frames


def test_silence_is_said_within_its_time(tmp_path):
    with flown(tmp_path) as (monitor, seen, sending):
        began_us = monitor.now_us()
        sending.silence()
        until(lambda: sorted(seen.named("telemetry")) == [(1, True), (2, True)])
        for _, event in seen.events:
            assert SILENCE - 0.3 < event.unix_s - began_us * 1e-6 < SILENCE + 1.5
        assert {event.alarm.text for _, event in seen.events} == {
            "Telemetry lost in flight: fly by sight"
        }


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGSTOP")
@pytest.mark.slow
def test_a_computer_that_slept_has_lost_nothing_that_came_meanwhile(tmp_path):
    """The whole process stands still for 5 s; the system keeps what comes."""
    port = free_udp_port()
    options = ("--record", str(tmp_path), "--no-view", "--seconds", "16")
    monitor = command(
        "monitor", f"udpin:127.0.0.1:{port}", *options, stdout=subprocess.PIPE, text=True
    )
    until(lambda: list(tmp_path.glob("*/telemetry.tlog")))
    over = threading.Event()

    def fly() -> None:
        vehicle = Vehicle(1)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            while not over.wait(0.1):
                for frame in vehicle.tick(rpm=(1700,) * 4):
                    out.sendto(frame.data, ("127.0.0.1", port))

    flying = threading.Thread(target=fly)
    flying.start()
    time.sleep(3.0)
    os.kill(monitor.pid, signal.SIGSTOP)
    time.sleep(5.0)
    os.kill(monitor.pid, signal.SIGCONT)
    told, _ = monitor.communicate(timeout=120)
    over.set()
    flying.join()
    assert "vehicle 1: heard" in told
    assert "Telemetry" not in told


@pytest.mark.parametrize(
    ("round_s", "vehicles", "wanted"),
    [
        (0.001, 1, 0.25),
        (0.04, 1, 0.4),
        (0.5, 1, 1.0),  # a hiccup of one aircraft's analysis is no reason to wait for long
        (0.15, 12, 1.32),
        (0.01, 3, 0.25),  # however fast the computer is
        (0.04, 20, 2.09),
        (0.5, 20, 2.2),
        (0.5, 50, 2.2),
    ],
)
def test_rounds_are_rarer_where_they_take_long_and_rarest_with_many_aircraft(
    round_s, vehicles, wanted
):
    assert spacing(round_s, vehicles) == pytest.approx(wanted)


def test_a_row_is_not_old_while_the_next_one_is_not_overdue(tmp_path):
    fleet, vehicle = Fleet(MODEL), Vehicle(3)
    view = HeardVehicles(threading.Event())
    for _ in range(80):
        fleet.take(vehicle.tick(rpm=(1700,) * 4))
        for update in fleet.updates():
            view.update(update)

    def old(after_s: float) -> tuple[bool, bool]:
        now_us = vehicle.stamp_us + round(after_s * 1e6)
        view.round(fleet, now_us)
        cells = vehicle_cells(fleet.vehicles[3], now_us, 0.5, fleet.old_s)
        return view.summaries[0].old, "OLD" in cells[-1].plain

    assert old(1.4) == (False, False)
    assert old(1.7) == (True, True)
    fleet.every_s = 2.0
    assert old(2.3) == (False, False)
    assert old(2.7) == (True, True)
    with flown(tmp_path) as (monitor, _, _):
        assert 0.02 <= monitor.fleet.every_s <= 1.0


def test_a_computer_that_is_behind_now_and_then_says_so_once():
    lateness, told = Lateness(), []
    behind = {0.0: 2.5, 4.0: 0.0, 8.0: 3.0, 12.0: 0.0, 27.0: 0.0, 28.5: 0.0}
    for now_s, behind_s in behind.items():
        if lateness.changes(behind_s, now_s):
            told.append((now_s, lateness.late))
    assert told == [(0.0, True), (28.5, False)]


def test_lines_of_a_round_are_printed_in_the_order_of_their_time(tmp_path):
    printed: list[str] = []
    with flown(tmp_path) as (monitor, _, _):
        printer = EventPrinter(monitor, printed.append)
        printer.on_note(1, "second", 1.7e9 + 7.0)
        printer.on_note(1, "first", 1.7e9)
        printer.print()
        printer.on_note(1, "found late", 1.7e9 + 2.0)
        printer.print()
    assert [line.split(": ")[1].split(" (")[0] for line in printed] == [
        *("first", "second", "found late"),
    ]
    times = [line[:19] for line in printed]
    assert times == sorted(times)
    assert printed[2].endswith(f"(at {time.strftime('%H:%M:%S', time.localtime(1.7e9 + 2.0))})")
