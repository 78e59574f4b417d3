"""Missions from vehicles that run as processes of their own, over loopback UDP."""

import socket
import threading
from pathlib import Path

import pytest

from tests.gcs_plugin.peers.ports import free_udp_port
from tests.gcs_plugin.peers.processes import ARDUPILOT_ITEMS, process, vehicle
from tests.gcs_plugin.vehicle.fetching import fetch, fetch_mission
from thrustmargin.gcs_plugin.vehicle.connection import VehicleLink
from thrustmargin.gcs_plugin.vehicle.downloads import download_mission
from thrustmargin.mission.plan import read_plan
from thrustmargin.models.errors import LinkError, PlanError

FIRMWARE_ARDUPILOT, FIRMWARE_PX4 = 3, 12  # MAV_AUTOPILOT


@pytest.fixture
def port() -> int:
    return free_udp_port()


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

        with VehicleLink.from_sender(send, name="own") as link:
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


def test_a_vehicle_that_claims_65535_items_is_refused(port: int):
    with (
        vehicle(port=port, items=ARDUPILOT_ITEMS, claims=65_535),
        pytest.raises(LinkError, match="65535 items"),
    ):
        fetch_mission(f"udpin:127.0.0.1:{port}")


@pytest.mark.slow
def test_a_mission_that_takes_too_long_is_given_up(port: int, monkeypatch):
    monkeypatch.setattr("thrustmargin.gcs_plugin.vehicle.downloads.LONGEST", 0.5)
    with (
        vehicle(port=port, items=ARDUPILOT_ITEMS, claims=9_000),
        pytest.raises(LinkError, match=r"took more than 0.5 s \(\d+ of 9000\)"),
    ):
        fetch_mission(f"udpin:127.0.0.1:{port}", 10.0)


@pytest.mark.parametrize(
    ("at", "value", "says"),
    [(8, 2_147_483_647, "item 3"), (9, 1_900_000_000, "item 3"), (10, float("nan"), "no altitude")],
)
def test_a_place_that_is_none_is_refused(port: int, at: int, value: float, says: str):
    items = [list(item) for item in ARDUPILOT_ITEMS]
    items[3][at] = value
    with vehicle(port=port, items=items), pytest.raises(PlanError, match=says):
        fetch_mission(f"udpin:127.0.0.1:{port}", 10.0)
