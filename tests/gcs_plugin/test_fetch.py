"""Missions and logs from vehicles that run as processes of their own, over loopback UDP."""

import hashlib
import random
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from gcs_plugin import vehicle_link
from gcs_plugin.vehicle_link import VehicleLink
from gcs_plugin.vehicle_logs import LogEntry, VehicleLogs, choose_log
from gcs_plugin.vehicle_mission import download_mission, fetch_mission
from gcs_plugin.vehicle_signed import signed_link
from gcs_plugin.vehicle_url import mavsdk_url
from mission.plan import FIRMWARE_ARDUPILOT, FIRMWARE_PX4, read_plan
from models.errors import LinkError, PlanError
from tests.gcs_plugin.peers.processes import ARDUPILOT_ITEMS, free_udp_port, process, vehicle

RUN = "import sys; from gcs_plugin.cli import main; main(['fetch', *sys.argv[1:]])"


@pytest.fixture
def port() -> int:
    return free_udp_port()


def fetch(*arguments: object, timeout: float = 40.0) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, "-c", RUN, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )


@pytest.fixture
def logs(tmp_path: Path) -> dict[int, tuple[int, str]]:
    """Three logs of random bytes: 1000 B, 1.2 MB dated later, and an empty one without a date."""
    made = {}
    sizes = {1: (1_760_000_000, 1000), 2: (1_760_100_000, 1_200_017), 3: (0, 0)}
    for number, (unix, size) in sizes.items():
        path = tmp_path / f"onboard{number}"
        path.write_bytes(random.Random(number).randbytes(size))
        made[number] = (unix, str(path))
    return made


# --- missions ---------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_mission_in_mavsdks_own_server_comes_back_as_a_plan(port: int, tmp_path: Path):
    from mavsdk.plugins.mission_raw import MissionItem, MissionRaw

    uploaded = [
        MissionItem(i, 3, 16, int(i == 0), 1, 1.5, 0, 0, float("nan"), 366500000 + 90 * i, -7, 3.25)
        for i in range(150)
    ]
    with process("mission_server.py", port, 7) as server:
        url = f"udpin:127.0.0.1:{port}"
        with VehicleLink.open(url) as link:
            MissionRaw(link.vehicle()).upload_mission(uploaded)
        assert server.stdout is not None
        assert server.stdout.readline() == "SUCCESS 150\n"
        done = fetch("mission", url, "-o", tmp_path / "field.plan")
    assert done.returncode == 0, done.stderr
    assert "150 items (150 places) from vehicle 7" in done.stdout
    assert "home is not known" in done.stdout
    plan = read_plan(tmp_path / "field.plan")
    assert [i.number for i in plan.items] == list(range(1, 151))
    assert [i.place for i in plan.items] == [
        (round(36.65 + 9e-6 * i, 7), -7e-7, 3.25) for i in range(150)
    ]
    first = plan.items[0].parameters
    assert first[:3] == (1.5, 0.0, 0.0)
    assert first[3] != first[3]


@pytest.mark.slow
def test_home_comes_from_mavsdks_own_telemetry_server(port: int):
    from mavsdk.plugins.mission_raw import MissionItem, MissionRaw

    url = f"udpin:127.0.0.1:{port}"
    with process("mission_server.py", port, 7, "36.5,116.25,15.5"):
        with VehicleLink.open(url) as link:
            item = MissionItem(0, 3, 16, 1, 1, 0, 0, 0, 0, 366500000, 1169000000, 3.0)
            MissionRaw(link.vehicle(7)).upload_mission([item])
        plan = fetch_mission(url, vehicle=7)
    assert plan.home == (36.5, 116.25, 15.5)
    assert plan.notes == ()


def test_ardupilots_home_item_becomes_the_plans_home(port: int):
    with vehicle(port=port, items=ARDUPILOT_ITEMS):
        shown: list[tuple[int, int]] = []
        plan = fetch_mission(
            f"udpin:127.0.0.1:{port}", 10.0, progress=lambda done, of: shown.append((done, of))
        )
    assert plan.home == (36.65, 116.9, 12.25)
    assert plan.firmware == FIRMWARE_ARDUPILOT
    assert [i.command for i in plan.items] == [22, 178, 16, 216, 177, 20]
    assert [i.number for i in plan.items] == [1, 2, 3, 4, 5, 6]
    assert plan.items[0].place is None
    assert plan.items[0].parameters[6] == 3.1
    assert plan.items[2].place == (36.6509881, 116.9000559, 3.1)
    assert plan.items[3].parameters[4] == 7.0
    assert plan.items[4].parameters[0] == 3.0
    assert plan.notes == ()
    assert shown[-1] == (7, 7)
    assert [done for done, _ in shown] == sorted({done for done, _ in shown})


def test_px4_items_are_renumbered_and_its_home_is_asked_for(port: int):
    items = [*ARDUPILOT_ITEMS[1:5], (2, 177, 0, 1, 2, 2, 0, 0, 0, 0, 0, 0)]
    with vehicle(port=port, items=items, autopilot=12, home=[366500001, 1169000002, 15500]):
        plan = fetch_mission(f"udpin:127.0.0.1:{port}")
    assert plan.home == (36.6500001, 116.9000002, 15.5)
    assert plan.firmware == FIRMWARE_PX4
    assert [i.number for i in plan.items] == [1, 2, 3, 4, 5]
    assert plan.items[4].parameters[0] == 3.0


def test_a_mission_comes_over_a_socket_that_somebody_else_owns(port: int):
    with (
        vehicle(port=port, items=ARDUPILOT_ITEMS),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own,
    ):
        own.bind(("127.0.0.1", port))
        data, peer = own.recvfrom(2048)

        def send(out: bytes) -> None:
            own.sendto(out, peer)

        with VehicleLink.over(send, name="own") as link:
            stop = threading.Event()

            def listen() -> None:
                own.settimeout(0.1)
                while not stop.is_set():
                    try:
                        link.feed(own.recv(2048))
                    except TimeoutError:
                        continue

            listener = threading.Thread(target=listen)
            listener.start()
            link.feed(data)
            try:
                plan = download_mission(link, link.vehicle(1))
            finally:
                stop.set()
                listener.join()
    assert len(plan.items) == 6


def test_an_empty_vehicle_is_an_error_and_no_file(port: int, tmp_path: Path):
    with vehicle(port=port, items=[]):
        done = fetch("mission", f"udpin:127.0.0.1:{port}", "-o", tmp_path / "field.plan")
    assert done.returncode == 1
    assert done.stderr == ("thrustmargin: the vehicle holds no mission; upload one to it first\n")
    assert list(tmp_path.iterdir()) == []


def test_only_home_is_no_mission(port: int):
    with (
        vehicle(port=port, items=ARDUPILOT_ITEMS[:1]),
        pytest.raises(PlanError, match="no mission"),
    ):
        fetch_mission(f"udpin:127.0.0.1:{port}")


# --- which vehicle, and links that fail -------------------------------------------------------


@pytest.mark.slow
def test_two_vehicles_on_a_link_are_never_mixed_up(port: int):
    other = [*ARDUPILOT_ITEMS[:2]]
    url = f"udpin:127.0.0.1:{port}"
    with (
        vehicle(port=port, system_id=1, items=ARDUPILOT_ITEMS),
        vehicle(port=port, system_id=9, items=other),
    ):
        with pytest.raises(LinkError, match=r"carries vehicles 1, 9; choose one with --vehicle"):
            fetch_mission(url)
        assert len(fetch_mission(url, vehicle=9).items) == 1
        assert len(fetch_mission(url, vehicle=1).items) == 6
        with pytest.raises(LinkError, match=r"no vehicle 3 heard in 2 s \(heard: 1, 9\)"):
            fetch_mission(url, 2.0, vehicle=3)


def test_silence_is_one_line_that_says_where_and_what_to_do(port: int, tmp_path: Path):
    url = f"udpin:127.0.0.1:{port}"
    done = fetch("mission", url, "-o", tmp_path / "m.plan", "--timeout", 1)
    assert done.returncode == 1
    assert done.stderr == (
        f"thrustmargin: {url}: no vehicle heard in 1 s; check that the vehicle is on, that its "
        "radio or ground station sends here, and that the URL is right\n"
    )
    assert done.stdout == ""
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_vehicle_that_only_sends_heartbeats_is_said_to_be_heard(port: int):
    url = f"udpin:127.0.0.1:{port}"
    with (
        vehicle(port=port, mute=True),
        pytest.raises(LinkError, match=r"is heard but did not send its mission \(timeout\)"),
    ):
        fetch_mission(url)


@pytest.mark.slow
def test_a_vehicle_that_answers_no_request_for_logs_is_said_to_be_heard(port: int):
    with (
        vehicle(port=port, mute=True),
        VehicleLink.open(f"udpin:127.0.0.1:{port}") as link,
        pytest.raises(LinkError, match=r"did not send its list of logs \(timeout\)"),
    ):
        VehicleLogs(link, link.vehicle(1))


@pytest.mark.parametrize(
    ("given", "mavsdk"),
    [
        ("udpin:127.0.0.1:14550", "udpin://127.0.0.1:14550"),
        ("udp:0.0.0.0:14550", "udpin://0.0.0.0:14550"),
        ("udpin://localhost:14550", "udpin://127.0.0.1:14550"),
        ("udpout:127.0.0.1:14550", "udpout://127.0.0.1:14550"),
        ("tcp:127.0.0.1:5760", "tcpout://127.0.0.1:5760"),
        ("tcpin:127.0.0.1:5760", "tcpin://127.0.0.1:5760"),
        ("/dev/null,57600", "serial:///dev/null:57600"),
        ("COM7", "serial://COM7:115200"),
    ],
)
def test_urls_are_those_of_the_listener(given: str, mavsdk: str):
    assert mavsdk_url(given) == mavsdk


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("14550", "not a link"),
        ("udpin:14550", "needs a host and a port"),
        ("udpin:127.0.0.1:0", "has port 0"),
        ("udpin:127.0.0.1:70000", "needs a host and a port"),
        ("udpin:no.such.host.invalid:1", "the host 'no.such.host.invalid' is not known"),
    ],
)
def test_what_is_no_url_is_refused(given: str, words: str):
    with pytest.raises(LinkError, match=words):
        mavsdk_url(given)


def test_a_recording_is_no_vehicle(sitl_logs: Path):
    with pytest.raises(LinkError, match="is a recording, which has no vehicle to ask"):
        fetch_mission(str(sitl_logs / "campaign" / "v4_m16_q2.5.tlog"))


def test_a_port_in_use_is_said_to_be_in_use():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        url = f"udpin:127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(LinkError, match="the port is in use; close the program"):
            VehicleLink.open(url)


@pytest.mark.slow
def test_a_vehicle_that_wants_signatures_gets_them(port: int, logs, tmp_path: Path):
    key_file = tmp_path / "signing.key"
    key_file.write_text("correct horse\n")
    key_file.chmod(0o600)
    key = hashlib.sha256(b"correct horse").hexdigest()
    url = f"udpin:127.0.0.1:{port}"
    out = tmp_path / "out"
    with vehicle(port=port, items=ARDUPILOT_ITEMS, logs=logs, key=key):
        done = fetch("mission", url, "-o", tmp_path / "m.plan", "--signing-key-file", key_file)
        assert done.returncode == 0, done.stderr
        done = fetch("log", url, "--id", 2, "-o", out, "--signing-key-file", key_file)
        assert done.returncode == 0, done.stderr
        with pytest.raises(LinkError, match="is heard but did not send its mission"):
            fetch_mission(url)
    assert len(read_plan(tmp_path / "m.plan").items) == 6
    assert out.read_bytes() == Path(logs[2][1]).read_bytes()


@pytest.mark.slow
def test_with_a_key_an_unsigned_or_wrongly_signed_vehicle_is_not_believed(port: int):
    key = bytes(32)
    url = f"udpin:127.0.0.1:{port}"

    def heard() -> None:
        with signed_link(url, key) as link:
            link.vehicle(timeout=1.5)

    with vehicle(port=port), pytest.raises(LinkError, match=r"no vehicle heard .* [2-4] unsigned"):
        heard()
    with (
        vehicle(port=port, key=bytes(31).hex() + "01"),
        pytest.raises(LinkError, match=r"no vehicle heard .* [2-4] signed with another key"),
    ):
        heard()


# --- logs -------------------------------------------------------------------------------------


def test_the_list_shows_every_log_with_its_date_and_size(port: int, logs):
    with vehicle(port=port, logs=logs):
        done = fetch("log", f"udpin:127.0.0.1:{port}", "--list")
    assert done.returncode == 0, done.stderr
    assert [line.split() for line in done.stdout.splitlines()] == [
        ["1", "2025-10-09T08:53:20Z", "1000", "bytes"],
        ["2", "2025-10-10T12:40:00Z", "1200017", "bytes"],
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


def test_lost_packets_are_asked_for_again(port: int, logs, tmp_path: Path):
    shown: list[tuple[int, int]] = []
    with (
        vehicle(port=port, logs=logs, drop=700),
        VehicleLink.open(f"udpin:127.0.0.1:{port}") as link,
    ):
        shelf = VehicleLogs(link, link.vehicle(1))
        shelf.download(shelf.choose(2), tmp_path / "log", lambda done, of: shown.append((done, of)))
    assert (tmp_path / "log").read_bytes() == Path(logs[2][1]).read_bytes()
    assert shown[-1] == (1_200_017, 1_200_017)
    assert len(shown) > 20


def test_a_vehicle_that_falls_silent_leaves_no_file(
    port: int, logs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(vehicle_link, "SILENCE", 1.5)
    (tmp_path / "out").mkdir()
    old = tmp_path / "out" / "flight.BIN"
    old.write_bytes(b"yesterday")
    with (
        vehicle(port=port, logs=logs, silent_after=3000),
        VehicleLink.open(f"udpin:127.0.0.1:{port}") as link,
    ):
        shelf = VehicleLogs(link, link.vehicle(1))
        with pytest.raises(LinkError, match=r"stopped sending log 2 for 1.5 s; bring the antenna"):
            shelf.download(shelf.choose(2), old)
    assert old.read_bytes() == b"yesterday"
    assert list(old.parent.iterdir()) == [old]


def test_a_log_shorter_than_the_vehicle_says_is_an_error_and_no_file(
    port: int, logs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(vehicle_link, "SILENCE", 1.5)
    (tmp_path / "out").mkdir()
    with (
        vehicle(port=port, logs=logs, overstate=500),
        VehicleLink.open(f"udpin:127.0.0.1:{port}") as link,
    ):
        shelf = VehicleLogs(link, link.vehicle(1))
        with pytest.raises(LinkError, match="log 1"):
            shelf.download(shelf.choose(1), tmp_path / "out" / "f.BIN")
    assert list((tmp_path / "out").iterdir()) == []


def test_ctrl_c_in_a_transfer_ends_at_once_and_leaves_no_file(port: int, logs, tmp_path: Path):
    folder = tmp_path / "out"
    folder.mkdir()
    with vehicle(port=port, logs=logs, silent_after=4000):
        running = subprocess.Popen(
            [sys.executable, "-c", RUN, "log", f"udpin:127.0.0.1:{port}", "-o", folder / "f.BIN"],
            stderr=subprocess.PIPE,
            text=True,
        )
        deadline = time.monotonic() + 15
        while not any(p.stat().st_size > 100_000 for p in folder.iterdir()):
            assert time.monotonic() < deadline
            time.sleep(0.05)
        running.send_signal(signal.SIGINT)
        pressed = time.monotonic()
        _, said = running.communicate(timeout=10)
        assert time.monotonic() - pressed < 3.0
    assert running.returncode == 130
    assert said == "thrustmargin: stopped; files that were finished are whole\n"
    assert list(folder.iterdir()) == []


def test_a_folder_that_does_not_exist_is_named(port: int, logs, tmp_path: Path):
    out = tmp_path / "absent" / "f.BIN"
    with vehicle(port=port, logs=logs):
        done = fetch("log", f"udpin:127.0.0.1:{port}", "--id", 1, "-o", out)
    assert done.returncode == 1
    assert done.stderr == f"thrustmargin: {out} cannot be written: No such file or directory\n"


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


def test_contradicting_choices_of_a_log_are_refused():
    done = fetch("log", "udpin:127.0.0.1:1", "--id", "3", "--latest")
    assert done.returncode == 1
    assert "--id, --latest and --list exclude each other" in done.stderr


def test_help_of_fetch_loads_no_native_library():
    code = (
        "import sys\nfrom gcs_plugin.cli import run\n"
        "try:\n    run(['fetch', 'log', '--help'])\n"
        "except SystemExit as e:\n    assert e.code == 0\n"
        "assert 'mavsdk' not in sys.modules\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "--latest" in done.stdout
