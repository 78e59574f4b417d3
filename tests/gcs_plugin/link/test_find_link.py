"""The endpoint of a vehicle is found among the usual ones, over real sockets and a terminal."""

import contextlib
import os
import socket
import threading
import time
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.live.live_vehicle import Vehicle
from tests.gcs_plugin.peers.ports import free_port, free_udp_port
from tests.waiting import PATIENCE
from thrustmargin.gcs_plugin.link import find_link
from thrustmargin.gcs_plugin.link.find_link import USUAL, LinkFinder
from thrustmargin.gcs_plugin.wording.live_words import tried_words

HEARTBEAT = Vehicle().heartbeat()


@contextlib.contextmanager
def sending(send):
    """`send()` ten times a second meanwhile."""
    over = threading.Event()

    def run():
        while not over.wait(0.1):
            with contextlib.suppress(OSError):
                send()

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def test_the_usual_endpoints_are_looked_at():
    assert set(USUAL) == {
        *("udpin:127.0.0.1:14550", "udpin:127.0.0.1:14540", "tcp:127.0.0.1:5760"),
        *("tcp:127.0.0.1:5762", "tcp:127.0.0.1:5763", "tcp:127.0.0.1:5777"),
    }


def test_a_vehicle_by_udp_is_found_and_the_port_is_free_again():
    quiet, port = free_udp_port(), free_udp_port()
    urls = (f"udpin:127.0.0.1:{quiet}", f"udpin:127.0.0.1:{port}")
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with out, sending(lambda: out.sendto(HEARTBEAT, ("127.0.0.1", port))):
        assert LinkFinder(urls, list).find(PATIENCE) == urls[1]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", port))


def test_a_simulator_by_tcp_is_found_though_it_starts_later(monkeypatch):
    monkeypatch.setattr("thrustmargin.gcs_plugin.link.find_link.OPEN_EVERY", 0.4)
    port = free_port()
    url = f"tcp:127.0.0.1:{port}"

    def serve():
        time.sleep(0.2)
        with socket.create_server(("127.0.0.1", port)) as door:
            stream, _ = door.accept()
            with stream:
                stream.sendall(HEARTBEAT)
                time.sleep(0.5)

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    assert LinkFinder((url,), list).find(PATIENCE) == url
    thread.join()


def test_every_two_seconds_ports_are_tried_and_each_rate_has_three(monkeypatch):
    """By a clock that only what waits moves on."""
    now, opened = [0.0], []

    def wait(seconds: float) -> list:
        now[0] += seconds
        return []

    def opening(url: str):
        opened.append((round(now[0], 1), url))
        return SimpleNamespace(receive=wait, close=lambda: None)

    clock = SimpleNamespace(monotonic=lambda: now[0], sleep=wait)
    monkeypatch.setattr(find_link, "time", clock)
    monkeypatch.setattr(find_link, "open_transport", opening)
    assert LinkFinder((), lambda: ["/dev/radio"]).find(9.9) is None
    usb, radio = "/dev/radio,115200", "/dev/radio,57600"
    assert opened == [(0.0, usb), (4.0, radio), (6.0, usb)]


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo terminals here")
def test_an_autopilot_on_a_serial_port_is_found():
    ours, theirs = os.openpty()
    device = os.ttyname(theirs)
    with sending(lambda: os.write(ours, HEARTBEAT)):
        found = LinkFinder((), lambda: [device]).find(PATIENCE)
    assert found is not None
    assert found.split(",")[0] == device
    os.close(ours)
    os.close(theirs)


def test_it_says_what_became_of_each():
    """A ground station is no vehicle; a port may be taken, or nobody may answer there."""
    heard, taken, nobody, silent = free_udp_port(), free_udp_port(), free_port(), free_udp_port()
    station = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(dialect.MAVLink(None, 255))
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    other = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    other.bind(("127.0.0.1", taken))
    urls = [f"udpin:127.0.0.1:{port}" for port in (heard, taken, silent)]
    finder = LinkFinder((*urls, f"tcp:127.0.0.1:{nobody}"), list)
    with out, other, sending(lambda: out.sendto(bytes(station), ("127.0.0.1", heard))):
        assert finder.find(2.0) is None
    assert finder.tried[urls[0]] == "MAVLink, but no autopilot"
    assert "another program listens there" in finder.tried[urls[1]]
    assert finder.tried[urls[2]] == "nothing came"
    assert "refused" in finder.tried[f"tcp:127.0.0.1:{nobody}"].lower()


def test_what_was_tried_is_said_together_where_it_ended_alike():
    tried = {
        "udpin:127.0.0.1:1": "nothing came",
        "tcp:a:2": "refused",
        "udpin:127.0.0.1:3": "nothing came",
    }
    assert tried_words(tried).endswith(
        "Tried udpin:127.0.0.1:1, udpin:127.0.0.1:3: nothing came; tcp:a:2: refused"
    )
