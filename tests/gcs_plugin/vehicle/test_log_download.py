"""Logs from vehicles that run as processes of their own, over loopback UDP."""

import gc
import signal
import subprocess
import sys
import weakref
from pathlib import Path

import pytest
from mavsdk import Mavsdk

from tests.gcs_plugin.peers.ports import free_udp_port
from tests.gcs_plugin.peers.processes import vehicle
from tests.gcs_plugin.vehicle.fetching import fetch, onboard_logs
from tests.waiting import until
from thrustmargin.gcs_plugin.vehicle import connection as vehicle_link
from thrustmargin.gcs_plugin.vehicle.connection import VehicleLink
from thrustmargin.gcs_plugin.vehicle.downloads import LogEntry, VehicleLogs, choose_log
from thrustmargin.models.errors import LinkError

RUN = "import sys; from thrustmargin.gcs_plugin.cli import main; main(['fetch', *sys.argv[1:]])"


@pytest.fixture
def port() -> int:
    return free_udp_port()


@pytest.fixture
def logs(tmp_path: Path) -> dict[int, tuple[int, str]]:
    return onboard_logs(tmp_path)


def test_the_list_shows_every_log_with_its_date_and_size(port: int, logs):
    with vehicle(port=port, logs=logs):
        done = fetch("log", f"udpin:127.0.0.1:{port}", "--list")
    assert done.returncode == 0, done.stderr
    assert [line.split() for line in done.stdout.splitlines()] == [
        ["1", "2025-10-09T08:53:20Z", "1000", "bytes"],
        ["2", "2025-10-10T12:40:00Z", "300017", "bytes"],
        ["3", "date", "unknown", "0", "bytes"],
    ]


def test_the_latest_log_arrives_byte_for_byte(port: int, logs, tmp_path: Path):
    out = tmp_path / "out" / "flight.BIN"
    out.parent.mkdir()
    with vehicle(port=port, logs=logs):
        done = fetch("log", f"udpin:127.0.0.1:{port}", "--latest", "-o", out)
    assert done.returncode == 0, done.stderr
    assert out.read_bytes() == Path(logs[2][1]).read_bytes()
    assert list(out.parent.iterdir()) == [out]


@pytest.mark.parametrize("named", [True, False])
def test_a_file_that_is_there_is_replaced_only_with_force(
    port: int, logs, tmp_path, named, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    there = tmp_path / "log_1.BIN"
    there.write_bytes(b"another day's log")
    order = ["log", f"udpin:127.0.0.1:{port}", "--id", 1, *(["-o", there] if named else [])]
    with vehicle(port=port, logs=logs):
        done = fetch(*order)
        assert done.returncode == 1
        assert "log_1.BIN is already there; give another --output, or --force" in done.stderr
        assert there.read_bytes() == b"another day's log"
        assert fetch(*order, "--force").returncode == 0
    assert there.read_bytes() == Path(logs[1][1]).read_bytes()


def test_lost_packets_are_asked_for_again(port: int, logs, tmp_path: Path):
    shown: list[tuple[int, int]] = []
    with (
        vehicle(port=port, logs=logs, drop=700),
        VehicleLink.open(f"udpin:127.0.0.1:{port}") as link,
    ):
        shelf = VehicleLogs(link, link.vehicle(1))
        shelf.download(shelf.choose(2), tmp_path / "log", lambda done, of: shown.append((done, of)))
    assert (tmp_path / "log").read_bytes() == Path(logs[2][1]).read_bytes()
    assert shown[-1] == (300_017, 300_017)
    assert len(shown) > 20


def test_a_vehicle_that_falls_silent_leaves_no_file(
    port: int, logs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "out").mkdir()
    old = tmp_path / "out" / "flight.BIN"
    old.write_bytes(b"yesterday")
    with (
        vehicle(port=port, logs=logs, silent_after=3000),
        VehicleLink.open(f"udpin:127.0.0.1:{port}") as link,
    ):
        shelf = VehicleLogs(link, link.vehicle(1))
        monkeypatch.setattr(vehicle_link, "SILENCE", 0.7)
        with pytest.raises(LinkError, match=r"stopped sending log 2 for 0.7 s; bring the antenna"):
            shelf.download(shelf.choose(2), old)
    assert old.read_bytes() == b"yesterday"
    assert list(old.parent.iterdir()) == [old]


def test_a_log_shorter_than_the_vehicle_says_is_an_error_and_no_file(
    port: int, logs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "out").mkdir()
    with (
        vehicle(port=port, logs=logs, overstate=500),
        VehicleLink.open(f"udpin:127.0.0.1:{port}") as link,
    ):
        shelf = VehicleLogs(link, link.vehicle(1))
        monkeypatch.setattr(vehicle_link, "SILENCE", 0.7)
        with pytest.raises(LinkError, match="log 1"):
            shelf.download(shelf.choose(1), tmp_path / "out" / "f.BIN")
    assert list((tmp_path / "out").iterdir()) == []


def test_ctrl_c_in_a_transfer_ends_at_once_and_leaves_no_file(port: int, logs, tmp_path: Path):
    folder = tmp_path / "out"
    folder.mkdir()
    with vehicle(port=port, logs=logs, silent_after=2000):
        running = subprocess.Popen(
            [sys.executable, "-c", RUN, "log", f"udpin:127.0.0.1:{port}", "-o", folder / "f.BIN"],
            stderr=subprocess.PIPE,
            text=True,
        )
        until(lambda: any(p.stat().st_size > 100_000 for p in folder.iterdir()))
        running.send_signal(signal.SIGINT)
        _, said = running.communicate(timeout=120)
    assert running.returncode == 130
    assert said == "thrustmargin: stopped; files that were finished are whole\n"
    assert list(folder.iterdir()) == []


def test_callbacks_live_until_mavsdk_s_thread_has_ended(
    port: int, logs, monkeypatch: pytest.MonkeyPatch
):
    """A callback may be under way, or still to come, when a link closes: it ran freed memory."""
    alive: list[bool] = []
    end = Mavsdk.destroy

    def destroy(mavsdk: Mavsdk) -> None:
        end(mavsdk)
        alive.extend(callback() is not None for callback in callbacks)

    monkeypatch.setattr(Mavsdk, "destroy", destroy)
    with (
        vehicle(port=port, logs=logs),
        VehicleLink.open(f"udpin:127.0.0.1:{port}") as link,
    ):
        shelf = VehicleLogs(link, link.vehicle(1))
        callbacks = [weakref.ref(c) for c in shelf._files._callbacks]
        del shelf
        gc.collect()
    assert alive == [True]
    assert callbacks[0]() is None  # and no longer


def test_a_folder_that_does_not_exist_is_named(port: int, logs, tmp_path: Path):
    out = tmp_path / "absent" / "f.BIN"
    with vehicle(port=port, logs=logs):
        done = fetch("log", f"udpin:127.0.0.1:{port}", "--id", 1, "-o", out)
    assert done.returncode == 1
    said = f"thrustmargin: no folder {out.parent}; make it, or give another --output\n"
    assert done.stderr == said


@pytest.mark.slow
def test_a_vehicle_without_logs_says_so(port: int):
    with vehicle(port=port):
        url = f"udpin:127.0.0.1:{port}"
        assert fetch("log", url, "--list").stdout == "the vehicle holds no logs\n"
        done = fetch("log", url)
    assert done.returncode == 1
    assert "the vehicle holds no logs; check its SD card" in done.stderr


def entries(*rows: tuple[int, str | None, int]) -> tuple[LogEntry, ...]:
    return tuple(LogEntry(number=n, date=d, size_bytes=s) for n, d, s in rows)


def test_the_latest_log_is_by_date_then_by_number():
    dated = entries((1, "2026-05-02T10:00:00Z", 5), (2, "2026-05-01T10:00:00Z", 5), (3, None, 5))
    assert choose_log(dated, None, "u").number == 1
    assert choose_log(entries((4, None, 5), (9, None, 5), (11, None, 0)), None, "u").number == 9


def test_choosing_a_log_that_is_not_there_names_those_that_are():
    some = entries((4, None, 5), (9, None, 0))
    with pytest.raises(LinkError, match=r"u: there is no log 5; the vehicle has 4 to 9"):
        choose_log(some, 5, "u")
    with pytest.raises(LinkError, match="log 9 is empty"):
        choose_log(some, 9, "u")
    with pytest.raises(LinkError, match="all 1 logs on the vehicle are empty"):
        choose_log(some[1:], None, "u")
