"""Which vehicle is asked, and links that fail: over loopback UDP, with vehicles as processes."""

import hashlib
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tests.gcs_plugin.peers.ports import free_udp_port
from tests.gcs_plugin.peers.processes import ARDUPILOT_ITEMS, vehicle
from tests.gcs_plugin.vehicle.fetching import fetch, fetch_mission, onboard_logs
from thrustmargin.gcs_plugin.vehicle.connection import VehicleLink, mavsdk_url, signed_link
from thrustmargin.gcs_plugin.vehicle.downloads import VehicleLogs
from thrustmargin.mission.plan import read_plan
from thrustmargin.models.errors import LinkError


@pytest.fixture
def port() -> int:
    return free_udp_port()


@pytest.mark.slow
def test_two_vehicles_on_a_link_are_never_mixed_up(port: int):
    other = [*ARDUPILOT_ITEMS[:2]]
    url = f"udpin:127.0.0.1:{port}"
    with (
        vehicle(port=port, system_id=1, items=ARDUPILOT_ITEMS),
        vehicle(port=port, system_id=9, items=other),
    ):
        assert len(fetch_mission(url, vehicle=9).items) == 1
        assert len(fetch_mission(url, vehicle=1).items) == 6
        with pytest.raises(LinkError, match=r"carries vehicles 1, 9; choose one with --vehicle"):
            fetch_mission(url, vehicle=None)
        with pytest.raises(LinkError, match=r"no vehicle 3 heard in 2 s \(heard: 1, 9\)"):
            fetch_mission(url, 2.0, vehicle=3)


def test_silence_is_one_line_that_says_where_and_what_to_do(port: int, tmp_path: Path):
    url = f"udpin:127.0.0.1:{port}"
    done = fetch("mission", url, "-o", tmp_path / "m.plan", "--timeout", 0.3)
    assert done.returncode == 1
    assert done.stderr == (
        f"thrustmargin: {url}: no vehicle heard in 0.3 s; check that the vehicle is on, that its "
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
def test_a_vehicle_that_wants_signatures_gets_them(port: int, tmp_path: Path):
    logs = onboard_logs(tmp_path)
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
            link.vehicle(timeout=3.0)

    with (
        vehicle(port=port, heartbeat=0.5),
        pytest.raises(LinkError, match=r"no vehicle heard .* [1-9]\d* unsigned"),
    ):
        heard()
    with (
        vehicle(port=port, heartbeat=0.5, key=bytes(31).hex() + "01"),
        pytest.raises(LinkError, match=r"no vehicle heard .* [1-9]\d* signed with another key"),
    ):
        heard()


def test_contradicting_choices_of_a_log_are_refused():
    done = fetch("log", "udpin:127.0.0.1:1", "--id", "3", "--latest")
    assert done.returncode == 1
    assert "--id, --latest and --list exclude each other" in done.stderr


def test_help_of_fetch_loads_no_native_library():
    code = (
        "import sys\nfrom thrustmargin.gcs_plugin.cli import run\n"
        "try:\n    run(['fetch', 'log', '--help'])\n"
        "except SystemExit as e:\n    assert e.code == 0\n"
        "assert 'mavsdk' not in sys.modules\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "--latest" in done.stdout
