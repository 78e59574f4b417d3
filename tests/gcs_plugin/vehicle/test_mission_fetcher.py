"""Missions fetched over the links of a monitor, from vehicles that are processes of their own."""

import hashlib
import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.gcs_plugin.peers.ports import free_udp_port
from tests.gcs_plugin.peers.processes import ARDUPILOT_ITEMS, vehicle
from tests.waiting import PATIENCE, until
from thrustmargin.gcs_plugin.link.listener import Listener
from thrustmargin.gcs_plugin.link.signing import Signer, SigningFilter
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.vehicle.mission_fetcher import MissionFetcher
from thrustmargin.models.model.model_file import save_model
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

pytestmark = pytest.mark.slow


class Ground:
    """A listener with its fleet and a fetcher, driven by `until`."""

    def __init__(self, port: int, key: bytes | None = None) -> None:
        self.fleet = Fleet(physics_model(load_airframe("topxgun-f16-sitl")))
        door = None if key is None else SigningFilter(key)
        sign = None if key is None or door is None else Signer(key, after=lambda: door.latest).sign
        self._frames: list = []
        self.listener = Listener(
            [f"udpin:127.0.0.1:{port}"],
            on_frames=self._on_frames,
            accept=None if door is None else door.accept,
        )
        self.fetcher = MissionFetcher(
            self.listener,
            sign=sign,
            timeout=PATIENCE,
        )
        self.listener.start()

    def _on_frames(self, frames) -> None:
        self.fetcher.on_frames(frames)
        self._frames.extend(frames)

    @property
    def told(self) -> list[tuple[int, str]]:
        return [(n, text) for n, w in self.fleet.vehicles.items() for _, text in w.notes]

    def until(self, done: Callable[[], object]) -> None:
        def told() -> bool:
            taken, self._frames = self._frames, []
            self.fleet.take(taken)
            self.fetcher.on_round(self.fleet, self.listener.now_us())
            return bool(done())

        until(told, lambda: self.told)


@contextmanager
def ground(port: int, key: bytes | None = None) -> Iterator[Ground]:
    made = Ground(port, key)
    try:
        yield made
    finally:
        made.fetcher.close()
        made.listener.close()


@pytest.fixture
def port() -> int:
    return free_udp_port()


def test_a_mission_replaced_or_cleared_past_the_program_is_fetched_again(port: int):
    """Nothing but the vehicle's MISSION_CURRENT says so, as behind another station's radio."""
    quiet = {"heartbeat": 1.0, "chatter": True}  # other messages before a heartbeat
    with vehicle(port=port, items=ARDUPILOT_ITEMS, **quiet) as peer, ground(port) as station:
        station.until(lambda: station.told)
        watch = station.fleet.vehicles[1]
        for items, told in (
            (ARDUPILOT_ITEMS[:4], "mission of 3 items fetched"),
            ([], "no mission fetched: the vehicle holds no mission; upload one to it first"),
            (ARDUPILOT_ITEMS, "mission of 6 items fetched"),
        ):
            peer.stdin.write(json.dumps({"items": items}) + "\n")  # type: ignore[union-attr]
            peer.stdin.flush()  # type: ignore[union-attr]
            count = len(station.told)
            station.until(lambda: len(station.told) > count)  # noqa: B023
            assert station.told[-1] == (1, told)
            assert (0 if watch.plan is None else len(watch.plan.items)) == max(len(items) - 1, 0)
            assert len(watch.state.mission) == len(items)
        time.sleep(3.0)
        station.until(lambda: True)
        assert len(station.told) == 4


def test_each_vehicle_is_asked_once_and_gets_its_own_plan(port: int):
    with (
        vehicle(port=port, system_id=1, items=ARDUPILOT_ITEMS),
        vehicle(port=port, system_id=2, items=ARDUPILOT_ITEMS[:3]),
        ground(port) as station,
    ):
        station.until(lambda: len(station.told) == 2)
        plans = {n: w.plan for n, w in station.fleet.vehicles.items()}
        assert sorted(station.told) == [
            (1, "mission of 6 items fetched"),
            (2, "mission of 2 items fetched"),
        ]
        assert [len(plans[n].items) for n in (1, 2)] == [6, 2]  # type: ignore[union-attr]
        time.sleep(0.5)
        station.until(lambda: True)
        assert len(station.told) == 2


def test_a_vehicle_that_wants_signatures_is_asked_with_them(port: int):
    key = hashlib.sha256(b"correct horse").digest()
    with (
        vehicle(port=port, items=ARDUPILOT_ITEMS, key=key.hex()),
        ground(port, key) as station,
    ):
        station.until(lambda: station.told)
        assert station.told == [(1, "mission of 6 items fetched")]


def test_a_vehicle_without_a_mission_is_told_and_the_others_go_on(port: int):
    with (
        vehicle(port=port, system_id=1),
        vehicle(port=port, system_id=2, items=ARDUPILOT_ITEMS),
        ground(port) as station,
    ):
        station.until(lambda: len(station.told) == 2)
        assert dict(station.told) == {
            1: "no mission fetched: the vehicle holds no mission; upload one to it first",
            2: "mission of 6 items fetched",
        }
        assert station.fleet.vehicles[1].plan is None


def test_closing_in_a_transfer_ends_at_once(port: int, monkeypatch: pytest.MonkeyPatch):
    """It waits for no answer: the wait for one is longer than a test may take."""
    monkeypatch.setattr("thrustmargin.gcs_plugin.vehicle.connection.SILENCE", 1e6)
    with vehicle(port=port, mute=True), ground(port) as station:
        station.until(lambda: station.fleet.vehicles)
        station.until(lambda: station.fetcher._link is not None)
        station.fetcher.close()
        assert not station.fetcher._thread.is_alive()


def test_monitor_fetches_the_mission_and_records_that_it_did(port: int, tmp_path: Path):
    model = tmp_path / "weight.safetensors"
    save_model(physics_model(load_airframe("topxgun-f16-sitl")), model)
    code = "import sys; from thrustmargin.gcs_plugin.cli import main; main(sys.argv[1:])"
    options = f"--fetch-mission --no-view --record {tmp_path / 'rec'} --model {model}"
    command = [sys.executable, "-c", code, "monitor", f"udpin:127.0.0.1:{port}", *options.split()]

    def recorded() -> bool:
        files = (tmp_path / "rec").rglob("events.jsonl")
        return any("mission of 6 items fetched" in file.read_text() for file in files)

    with vehicle(port=port, items=ARDUPILOT_ITEMS):
        monitor = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        until(recorded)
        monitor.send_signal(signal.SIGINT)
        _, told = monitor.communicate(timeout=120)
    assert "Traceback" not in told
