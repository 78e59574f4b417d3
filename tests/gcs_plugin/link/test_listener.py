"""Real sockets on loopback, a real pseudo-terminal as the serial port."""

import os
import socket
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from types import SimpleNamespace

import pytest

from tests.gcs_plugin.live.live_vehicle import Vehicle, log_frames
from tests.waiting import PATIENCE, until
from thrustmargin.gcs_plugin.link import transport as transports
from thrustmargin.gcs_plugin.link.bounded_queue import BoundedQueue
from thrustmargin.gcs_plugin.link.listener import Link, Listener, SteadyClock
from thrustmargin.gcs_plugin.link.transport import Chunk, open_transport, parse_url
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.models.errors import LinkError

LOOPBACK = "127.0.0.1"


class Heard:
    """Frames that a listener gave, in order."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []

    def __call__(self, frames: list[Frame]) -> None:
        self.frames += frames

    def wait(self, count: int, timeout: float = 100.0) -> list[bytes]:
        deadline = time.monotonic() + timeout
        while len(self.frames) < count and time.monotonic() < deadline:
            time.sleep(0.01)
        return [frame.data for frame in self.frames]


@contextmanager
def listening(url: str, *forwards: str, **options) -> Iterator[tuple[Listener, Heard]]:
    heard = Heard()
    listener = Listener([url], on_frames=heard, forwards=forwards, **options)
    listener.start()
    try:
        yield listener, heard
    finally:
        listener.close()
    assert listener.failure is None


def port_of(listener: Listener) -> int:
    return listener.links[0].transport.address[1]  # type: ignore[attr-defined]


def udp() -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind((LOOPBACK, 0))
    made.settimeout(PATIENCE)
    return made


def messages(count: int = 20) -> list[bytes]:
    vehicle = Vehicle()
    return [frame.data for _ in range(count // 5) for frame in vehicle.tick()]


def test_udp_frames_arrive_whole_in_order_and_stamped():
    sent = messages()
    with listening(f"udpin:{LOOPBACK}:0") as (listener, heard), udp() as vehicle:
        before = time.time()
        for data in sent:
            vehicle.sendto(data, (LOOPBACK, port_of(listener)))
        assert heard.wait(len(sent)) == sent
        assert all(before - 1 < f.stamp_us * 1e-6 < time.time() + 1 for f in heard.frames)


def test_of_more_than_256_senders_the_first_ones_unfinished_frame_is_forgotten():
    """Else whoever sends from ever new ports would fill the memory."""
    (whole,) = messages(5)[:1]
    for others, heard in ((255, 1), (256, 0)):
        link = Link("udpin:127.0.0.1:0", 0, SimpleNamespace(datagrams=False))  # type: ignore[arg-type]
        first = ("10.0.0.1", 1)
        link.frames(Chunk(whole[:7], first, 0), 0)
        for port in range(others):
            link.frames(Chunk(b"", ("10.0.0.2", port), 0), 0)
        assert len(link.frames(Chunk(whole[7:], first, 0), 0)[0]) == heard


def test_a_listener_sends_nothing_of_its_own():
    with listening(f"udpin:{LOOPBACK}:0") as (listener, heard), udp() as vehicle:
        vehicle.sendto(b"".join(messages()), (LOOPBACK, port_of(listener)))
        heard.wait(20)
        vehicle.settimeout(0.5)
        with pytest.raises(TimeoutError):
            vehicle.recv(1)


def test_two_programs_on_one_port_are_an_error_and_not_a_theft():
    with listening(f"udpin:{LOOPBACK}:0") as (listener, heard):
        port = port_of(listener)
        with pytest.raises(LinkError, match="another program listens there"):
            Listener([f"udpin:{LOOPBACK}:{port}"], on_frames=heard)


def test_every_byte_is_forwarded_unchanged_even_what_is_no_frame():
    sent = [*messages(5), b"not mavlink \xfd\x09", b"\xfe", *messages(5)]
    with udp() as station, udp() as vehicle:
        forward = f"udpout:{LOOPBACK}:{station.getsockname()[1]}"
        with listening(f"udpin:{LOOPBACK}:0", forward) as (listener, _):
            for data in sent:
                vehicle.sendto(data, (LOOPBACK, port_of(listener)))
            assert [station.recv(65535) for _ in sent] == sent


def test_a_ground_station_behind_a_forward_reaches_the_vehicle():
    with udp() as station, udp() as vehicle:
        forward = f"udpout:{LOOPBACK}:{station.getsockname()[1]}"
        with listening(f"udpin:{LOOPBACK}:0", forward) as (listener, heard):
            data = messages(5)[0]
            vehicle.sendto(data, (LOOPBACK, port_of(listener)))
            got, us = station.recvfrom(65535)
            assert got == data
            answer = Vehicle(255).heartbeat()
            station.sendto(answer, us)
            assert vehicle.recv(65535) == answer
            # What the station sends is heard too (an uploaded mission), and is not sent back to it.
            assert sorted(heard.wait(2)) == sorted([data, answer])  # two sockets, in either order
            station.settimeout(0.3)
            with pytest.raises(TimeoutError):
                station.recv(65535)


def test_nobody_but_the_target_of_a_forward_reaches_the_vehicle():
    with udp() as station, udp() as vehicle, udp() as stranger:
        forward = f"udpout:{LOOPBACK}:{station.getsockname()[1]}"
        with listening(f"udpin:{LOOPBACK}:0", forward) as (listener, heard):
            vehicle.sendto(messages(5)[0], (LOOPBACK, port_of(listener)))
            us = station.recvfrom(65535)[1]
            assert us[0] == LOOPBACK
            stranger.sendto(Vehicle(254).heartbeat(), us)
            answer = Vehicle(255).heartbeat()
            station.sendto(answer, us)
            assert vehicle.recv(65535) == answer
            assert sorted(heard.wait(2)) == sorted([messages(5)[0], answer])


def test_a_byte_stream_is_forwarded_in_whole_frames_without_losing_a_byte():
    stream = b"".join(messages()) + b"odd bytes" + b"".join(messages())
    with udp() as station:
        forward = f"udpout:{LOOPBACK}:{station.getsockname()[1]}"
        with (
            listening(f"tcpin:{LOOPBACK}:0", forward) as (listener, heard),
            socket.create_connection((LOOPBACK, port_of(listener))) as vehicle,
        ):
            for at in range(0, len(stream), 17):
                vehicle.sendall(stream[at : at + 17])
            heard.wait(40)
            got = b""
            while len(got) < len(stream):
                got += station.recv(65535)
    assert got == stream


def test_tcp_connects_again_when_the_vehicle_comes_back():
    sent = messages(5)
    with socket.create_server((LOOPBACK, 0)) as server:
        server.settimeout(PATIENCE)
        with listening(f"tcp:{LOOPBACK}:{server.getsockname()[1]}") as (_, heard):
            for turn in (1, 2):
                connection, _ = server.accept()
                with connection:
                    connection.sendall(b"".join(sent))
                    assert heard.wait(len(sent) * turn) == sent * turn


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals here")
def test_a_serial_port_is_read_and_written():
    import tty

    sent = messages()
    ours, theirs = os.openpty()
    tty.setraw(ours)
    tty.setraw(theirs)
    with listening(f"{os.ttyname(theirs)},57600") as (listener, heard):
        os.write(ours, b"".join(sent))
        assert heard.wait(len(sent)) == sent
        listener.send(sent[0])
        assert os.read(ours, 1000) == sent[0]
    os.close(ours)
    os.close(theirs)


def test_a_recording_is_a_link_too_and_keeps_its_stamps(sitl_logs):
    path = sitl_logs / "onset" / "reference.tlog"
    with listening(str(path)) as (listener, heard):
        expected = log_frames(path)
        heard.wait(len(expected))
        assert [f[:7] for f in heard.frames] == [f[:7] for f in expected]
        until(lambda: listener.finished)


def test_answers_go_to_where_the_vehicle_was_heard():
    with listening(f"udpin:{LOOPBACK}:0") as (listener, heard), udp() as one, udp() as two:
        one.sendto(Vehicle(1).heartbeat(), (LOOPBACK, port_of(listener)))
        two.sendto(Vehicle(2).heartbeat(), (LOOPBACK, port_of(listener)))
        heard.wait(2)
        listener.send(b"for two", system=2)
        assert two.recv(100) == b"for two"
        one.settimeout(0.3)
        with pytest.raises(TimeoutError):
            one.recv(100)


def test_a_peer_is_answered_for_a_minute_after_it_was_heard(monkeypatch):
    now = [1000.0]
    monkeypatch.setattr(transports, "time", SimpleNamespace(monotonic=lambda: now[0]))
    with closing(open_transport(f"udpin:{LOOPBACK}:0")) as ours, closing(udp()) as peer:
        peer.sendto(b"heard", ours.address)  # type: ignore[attr-defined]
        assert ours.receive(PATIENCE)
        now[0] += 59.0
        ours.send(b"within")
        assert peer.recv(99) == b"within"
        now[0] += 2.0
        ours.send(b"later")
        peer.settimeout(0.1)
        with pytest.raises(TimeoutError):
            peer.recv(99)


def test_a_refused_frame_is_counted_and_not_given_on_but_forwarded():
    with udp() as station, udp() as vehicle:
        forward = f"udpout:{LOOPBACK}:{station.getsockname()[1]}"
        good, bad = Vehicle(1).heartbeat(), Vehicle(9).heartbeat()
        with listening(f"udpin:{LOOPBACK}:0", forward, accept=lambda data, _: data != bad) as (
            listener,
            heard,
        ):
            for data in (bad, good):
                vehicle.sendto(data, (LOOPBACK, port_of(listener)))
            assert heard.wait(1) == [good]
            assert listener.links[0].refused == 1
            assert [station.recv(100), station.recv(100)] == [bad, good]


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("udpin:14550", "needs a host and a port"),
        ("udpin:127.0.0.1:99999", "needs a host and a port"),
        ("tcp:127.0.0.1:port", "needs a host and a port"),
        ("missing.tlog", "no such file"),
        ("nonsense", "not a link"),
        ("", "an empty URL: not a link"),
        ("COM3,fast", "no baud rate"),
        # A mistyped file name is no serial port, whether or not there is such a file.
        ("flight.bin", "not a link"),
        ("COMpany.log", "not a link"),
        (".", "not a link"),
        (__file__, "a file, but no .tlog"),
        ("/dev/ttyNOPE,57600", "no such serial port"),
    ],
)
def test_a_wrong_url_says_how_to_write_it(url, words):
    with pytest.raises(LinkError, match=words) as told:
        parse_url(url)
    assert "\n" not in str(told.value)


def test_urls_are_read_as_pymavlink_reads_them():
    udp_end = parse_url("udp:0.0.0.0:14550")
    assert (udp_end.kind, udp_end.host, udp_end.port) == ("udpin", "0.0.0.0", 14550)
    serial = parse_url("COM7,921600")
    assert (serial.kind, serial.path, serial.baud) == ("serial", "COM7", 921600)
    assert parse_url("COM7").baud == 115200


def test_a_port_that_nobody_listens_on_is_an_error_that_names_it():
    with closing(socket.create_server((LOOPBACK, 0))) as server:
        port = server.getsockname()[1]
    with pytest.raises(LinkError, match=f"tcp:{LOOPBACK}:{port}"):
        open_transport(f"tcp:{LOOPBACK}:{port}")


def test_a_set_wall_clock_does_not_move_the_stamps(monkeypatch):
    clock = SteadyClock()
    before = clock.now_us()
    monkeypatch.setattr(time, "time_ns", lambda: 0)
    monkeypatch.setattr(time, "time", lambda: 0.0)
    assert 0 <= clock.now_us() - before < 1_000_000_000


def test_a_full_queue_drops_the_newest_or_the_oldest_and_counts_them():
    box: BoundedQueue[int] = BoundedQueue(5)
    box.put([1, 2, 3])
    box.put([4, 5, 6, 7])
    assert box.take(0.0) == [1, 2, 3, 4, 5]
    assert box.dropped == 2
    newest: BoundedQueue[int] = BoundedQueue(5, keep_newest=True)
    newest.put([1, 2, 3])
    newest.put([4, 5, 6, 7])
    assert newest.first() == 3
    assert (newest.take(0.0), newest.dropped) == ([3, 4, 5, 6, 7], 2)
    assert newest.first() is None
    box.close()
    assert box.take(10.0) == []
    assert box.finished
