"""The server under metrics and pilot's bar: few at once, none for ever, and who may read."""

import http.client
import socket
import threading

import pytest

from tests.waiting import PATIENCE, until
from thrustmargin.gcs_plugin.live import small_server
from thrustmargin.gcs_plugin.live.pilot_bar import PilotBar
from thrustmargin.gcs_plugin.live.small_server import SmallServer
from thrustmargin.gcs_plugin.office.streams.collector import MetricsServer


class Nothing:
    def collect(self):
        return ()


def metrics():
    served = MetricsServer(Nothing(), 0)  # type: ignore[arg-type]
    return served.port, "/metrics", served.close


def bar():
    served = PilotBar(lambda: 0, limit=0.5, port=0, host="127.0.0.1")
    served.start()
    return served.port, "/bar.json", served.close


def answered(port: int, path: str = "/", host: str = "") -> tuple[int, dict[str, str], bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=100)
    connection.request("GET", path, headers={"Host": host} if host else {})
    answer = connection.getresponse()
    return answer.status, dict(answer.getheaders()), answer.read()


@pytest.mark.parametrize("made", [metrics, bar])
def test_many_who_connect_and_say_nothing_take_few_threads(made):
    port, path, stop = made()
    before = threading.active_count()
    idle = [socket.create_connection(("127.0.0.1", port), PATIENCE) for _ in range(60)]
    idle[0].settimeout(PATIENCE)
    assert idle[0].recv(1) == b""  # hung up on
    assert threading.active_count() - before <= 32
    for one in idle:
        one.close()
    until(lambda: threading.active_count() <= before)
    assert answered(port, path)[0] == 200
    stop()
    with pytest.raises(ConnectionRefusedError):
        answered(port, path)


@pytest.mark.parametrize("made", [metrics, bar])
def test_one_peer_with_many_slow_connections_keeps_nobody_out(made, monkeypatch):
    monkeypatch.setattr(small_server, "SLOWEST", 10 * PATIENCE)  # none is hung up on to make room
    port, path, stop = made()
    slow = [socket.create_connection(("127.0.0.1", port), PATIENCE) for _ in range(32)]
    for one in slow:
        one.sendall(b"GET / HTTP/1.1\r\nX: ")  # and never ends
    other = http.client.HTTPConnection("127.0.0.1", port, PATIENCE, source_address=("127.0.0.2", 0))
    for _ in range(3):
        other.request("GET", path)
        assert other.getresponse().status == 200
        assert answered(port, path)[0] == 200  # of the address of the slow ones, too
        other.close()
    for one in slow:
        one.close()
    stop()


def test_who_says_nothing_is_hung_up_on(monkeypatch):
    assert small_server.SLOWEST == 10.0
    monkeypatch.setattr(small_server, "SLOWEST", 0.2)
    port, _, stop = metrics()
    with socket.create_connection(("127.0.0.1", port), PATIENCE) as slow:
        assert slow.recv(1) == b""
    stop()


@pytest.mark.parametrize(
    ("for_all", "host", "status"),
    [
        (False, "localhost:80", 200),
        (False, "127.0.0.1:9464", 200),
        (False, "evil.example:9464", 403),
        (False, "localhost.evil.example:9464", 403),
        (True, "boat.local:8090", 200),
    ],
)
def test_who_may_read(for_all: bool, host: str, status: int):
    served = SmallServer(
        lambda path: ("text/x", path.encode()), "-o", ("127.0.0.1", 0), for_all=for_all
    )
    found, headers, body = answered(served.port, "/a?b=c", host)
    served.close()
    assert found == status
    # A page of another address must not read what is for this computer alone.
    assert ("Access-Control-Allow-Origin" in headers) == for_all
    if status == 200:
        assert body == b"/a"
        assert headers["Content-Type"] == "text/x"
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert headers["Cache-Control"] == "no-store"
    else:
        assert b"/a" not in body


def test_what_is_not_there_is_not_found():
    port, _, stop = metrics()
    assert answered(port, "/")[0] == 404
    stop()


@pytest.mark.parametrize(("error", "told"), [(BrokenPipeError, False), (ZeroDivisionError, True)])
def test_a_peer_that_hangs_up_is_no_news_and_a_fault_is(error, told: bool, capfd):
    def wrong(_path: str) -> None:
        raise error

    served = SmallServer(wrong, "-o", ("127.0.0.1", 0), for_all=True)
    with pytest.raises(http.client.RemoteDisconnected):
        answered(served.port)
    served.close()
    assert (error.__name__ in capfd.readouterr().err) == told
