"""Define byte transports of a link: UDP, TCP, serial port, telemetry log; URLs as in pymavlink.

`open_transport` opens them. They are own sockets and not pymavlink's, because its UDP
listener binds with SO_REUSEADDR (two programs on one port then take each other's packets in
silence), hides which peer sent what, and its TCP client prints, sleeps and connects while it holds
the receiving thread.

| URL | what it does |
|---|---|
| `udpin:host:port` (also `udp:`) | listen; answers go to everyone heard in the last minute |
| `udpout:host:port` | send to the address, and hear what it sends back |
| `tcp:host:port` | connect, and connect again whenever the other side goes away |
| `tcpin:host:port` | wait for one client at a time |
| `/dev/ttyACM0`, `COM3`, each with `,baud` | serial port, 115200 baud unless given |
| `flight.tlog` | a recording, as fast as it can be read, with its own time stamps |
"""

from __future__ import annotations

import contextlib
import ipaddress
import itertools
import os
import re
import socket
import stat
import sys
import time
from abc import abstractmethod
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from thrustmargin.gcs_plugin.mavlink.scan import stamped_frames
from thrustmargin.models.errors import LinkError

Address = tuple[str, int]
#: Asked of the kernel for UDP; it may grant less (net.core.rmem_max on Linux).
RECEIVE_BUFFER = 8 << 20
LARGEST_DATAGRAM, LARGEST_READ = 65_535, 65_536  # bytes; of UDP, of TCP
AT_ONCE = 512  # datagrams, or frames of a recording, taken before they are handed on
REMEMBERED = 60.0  # s that a UDP peer is answered after it was last heard
_SO_RXQ_OVFL = 40  # Linux: the kernel's count of datagrams dropped for want of buffer
AGAIN = 1.0  # s between attempts to connect


@dataclass(frozen=True, slots=True)
class Chunk:
    """Received bytes, their sender, and their time if the source itself states it."""

    data: bytes
    peer: Address | None = None
    stamp_us: int | None = None


@dataclass(frozen=True, slots=True)
class Endpoint:
    """The parts of a URL."""

    kind: str  # udpin, udpout, tcp, tcpin, serial or tlog
    host: str = ""
    port: int = 0
    path: str = ""
    baud: int = 115_200


def parse_url(url: str) -> Endpoint:
    """Parse a URL into its parts; raise LinkError for an unknown form.

    Forms: udpin, udpout, tcp or tcpin with host and port (udp counts as udpin), a recording
    (.tlog), and a serial port, with the baud rate after a comma, 115200 without. A recording, and a
    serial port under /dev, must exist.
    """
    kind, _, rest = url.partition(":")
    if kind in ("udpin", "udpout", "udp", "tcp", "tcpin"):
        host, _, port = rest.rpartition(":")
        if not host or not port.isdecimal() or not 0 <= int(port) <= 65_535:
            raise LinkError(f"{url}: needs a host and a port, as in {kind}:127.0.0.1:14550")
        return Endpoint("udpin" if kind == "udp" else kind, host.strip("[]"), int(port))
    if url.lower().endswith(".tlog"):
        if not Path(url).is_file():
            raise LinkError(f"{url}: there is no such file")
        return Endpoint("tlog", path=url)
    device, _, baud = url.partition(",")
    if baud and not baud.isdecimal():
        raise LinkError(f"{url}: {baud!r} is no baud rate; write it as in {device},57600")
    if re.fullmatch(r"COM\d+", device, re.IGNORECASE) or _is_character_device(device):
        return Endpoint("serial", path=device, baud=int(baud) if baud else 115_200)
    if device.startswith("/dev/"):
        raise LinkError(f"{url}: there is no such serial port; is it plugged in?")
    if Path(url).is_file():
        raise LinkError(
            f"{url}: a file, but no .tlog; only telemetry logs (.tlog) can be played as a link"
        )
    raise LinkError(
        f"{url or 'an empty URL'}: not a link; use udpin:host:port, udpout:host:port, "
        "tcp:host:port, tcpin:host:port, a serial port (/dev/ttyACM0,57600) or a .tlog"
    )


def _is_character_device(path: str) -> bool:
    """Return True if the path is a character device, as serial ports are on Linux and macOS.

    Any other file is a mistyped name.
    """
    try:
        return stat.S_ISCHR(os.stat(path).st_mode)
    except (OSError, ValueError):
        return False


class Transport(Protocol):
    """The interface of a byte transport to a link. One thread receives; others may send."""

    datagrams: bool = False  # each chunk begins with a new frame
    live: bool = True  # bytes come as they happen, not out of a recording
    emptied: bool = True  # the last `receive` took all that was there
    #: Datagrams lost before they could be received, where the system counts them.
    kernel_drops: int = 0

    @property
    def ready(self) -> bool:
        """Return True if there is a receiver to send to."""
        ...

    def receive(self, timeout: float) -> list[Chunk]:
        """Return the chunks received, waiting up to `timeout` s; raise EOFError if no more can
        come.
        """
        ...

    def send(self, data: bytes, peer: Address | None = None) -> None:
        """Send to one peer, or to all known; bytes that cannot be sent are lost, as on air."""
        ...

    def close(self) -> None: ...


class Udp(Transport):
    """A UDP socket that listens, or that sends first and then receives only from its target."""

    datagrams = True

    def __init__(self, address: Address, *, listen: bool) -> None:
        family = socket.getaddrinfo(*address, type=socket.SOCK_DGRAM)[0][0]
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._heard: dict[Address, float] = {}
        self._counted = False
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
            if sys.platform == "linux":
                with contextlib.suppress(OSError):
                    self._socket.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
                    self._counted = True
            self._target: Address | None = None
            if listen:
                if sys.platform == "win32":
                    exclusive = getattr(socket, "SO_EXCLUSIVEADDRUSE")  # noqa: B009
                    self._socket.setsockopt(socket.SOL_SOCKET, exclusive, 1)
                self._socket.bind(address)
            else:
                target = socket.getaddrinfo(*address, family, socket.SOCK_DGRAM)[0][4]
                self._target = str(target[0]), int(target[1])
                # Bound now, so that answers can be waited for before anything is sent. Not
                # connected: that fails as long as there is no way to the target.
                here = ipaddress.ip_address(self._target[0].partition("%")[0]).is_loopback
                anywhere = "" if family == socket.AF_INET else "::"
                self._socket.bind((self._target[0] if here else anywhere, 0))
        except OSError:
            self._socket.close()
            raise

    @property
    def address(self) -> Address:
        """Return the address that the socket is bound to."""
        return self._socket.getsockname()[:2]

    @property
    def ready(self) -> bool:
        return self._target is not None or bool(self._heard)

    def receive(self, timeout: float) -> list[Chunk]:
        """Return up to AT_ONCE datagrams, waiting up to `timeout` s for the first one.

        With a target, datagrams of other senders end the wait too and are dropped; without one,
        senders become peers for `send`. Return an empty list if none arrives or all are dropped, or
        at once if an earlier send met a closed port. `emptied` becomes True if fewer than AT_ONCE
        waited.
        """
        chunks: list[Chunk] = []
        try:
            self._socket.settimeout(timeout)
            chunks.append(self._one())
            self._socket.settimeout(0.0)
            while len(chunks) < AT_ONCE:
                chunks.append(self._one())
        except (TimeoutError, BlockingIOError, ConnectionError):
            # ConnectionError: an earlier send met a closed port. UDP goes on regardless.
            pass
        self.emptied = len(chunks) < AT_ONCE
        if self._target is not None:
            return [chunk for chunk in chunks if chunk.peer == self._target]
        now = time.monotonic()
        for chunk in chunks:
            if chunk.peer is not None:
                self._heard[chunk.peer] = now
        return chunks

    def _one(self) -> Chunk:
        if not self._counted:
            data, peer = self._socket.recvfrom(LARGEST_DATAGRAM)
            return Chunk(data, peer[:2])
        data, extra, _, peer = self._socket.recvmsg(LARGEST_DATAGRAM, 64)
        for level, kind, value in extra:
            if level == socket.SOL_SOCKET and kind == _SO_RXQ_OVFL:
                self.kernel_drops = int.from_bytes(value, sys.byteorder)
        return Chunk(data, peer[:2])

    def send(self, data: bytes, peer: Address | None = None) -> None:
        if peer is not None:
            targets = [peer]
        elif self._target is not None:
            targets = [self._target]
        else:
            since = time.monotonic() - REMEMBERED
            targets = [p for p, heard in list(self._heard.items()) if heard >= since]
        for target in targets:
            with contextlib.suppress(OSError):
                self._socket.sendto(data, target)

    def close(self) -> None:
        self._socket.close()


class Reopened(Transport):
    """A transport of one byte stream at a time, reopened whenever it has ended."""

    _end: Any = None

    @abstractmethod
    def _open(self, timeout: float) -> Any:
        """Open a new stream; raise OSError, or TimeoutError after waiting `timeout` s."""

    @abstractmethod
    def _read(self, end: Any, timeout: float) -> bytes:
        """Return the bytes received, empty if none; raise OSError if the stream has ended."""

    @abstractmethod
    def _write(self, end: Any, data: bytes) -> None:
        """Send all of `data`; raise OSError if the stream has ended."""

    @property
    def ready(self) -> bool:
        return self._end is not None

    def receive(self, timeout: float) -> list[Chunk]:
        try:
            if self._end is None:
                self._end = self._open(timeout)
        except TimeoutError:
            return []
        except OSError:
            time.sleep(min(timeout, AGAIN))
            return []
        try:
            data = self._read(self._end, timeout)
        except TimeoutError:
            return []
        except OSError:
            self._drop()
            return []
        return [Chunk(data)] if data else []

    def _drop(self) -> None:
        end, self._end = self._end, None
        if end is not None:
            end.close()

    def send(self, data: bytes, peer: Address | None = None) -> None:  # noqa: ARG002
        end = self._end
        if end is not None:
            with contextlib.suppress(OSError):
                self._write(end, data)

    def close(self) -> None:
        self._drop()


class _TcpStream(Reopened):
    """A TCP connection of either direction."""

    def _read(self, end: socket.socket, timeout: float) -> bytes:
        end.settimeout(timeout)
        self.emptied = True
        data = end.recv(LARGEST_READ)
        if not data:
            raise ConnectionError("the other side has closed it")
        self.emptied = len(data) < LARGEST_READ
        return data

    def _write(self, end: socket.socket, data: bytes) -> None:
        end.sendall(data)


class TcpClient(_TcpStream):
    """A TCP client that reconnects whenever the connection ends."""

    def __init__(self, address: Address) -> None:
        self._address = address
        self._end = self._open(3.0)

    def _open(self, timeout: float) -> socket.socket:
        end = socket.create_connection(self._address, timeout=max(timeout, AGAIN))
        end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return end


class TcpServer(_TcpStream):
    """A TCP server for one client at a time; the next is accepted after the last has left."""

    def __init__(self, address: Address) -> None:
        self._door = socket.create_server(address)

    @property
    def address(self) -> Address:
        """Return the address that the socket is bound to."""
        return self._door.getsockname()[:2]

    def _open(self, timeout: float) -> socket.socket:
        self._door.settimeout(timeout)
        end, _ = self._door.accept()
        end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return end

    def close(self) -> None:
        super().close()
        self._door.close()


class SerialPort(Reopened):
    """A serial port by pyserial, reopened after it vanishes (a pulled USB plug)."""

    def __init__(self, path: str, baud: int) -> None:
        import serial

        self._make = partial(serial.Serial, path, baud, timeout=0.1, write_timeout=1.0)
        self._end = self._make()

    def _open(self, timeout: float) -> Any:  # noqa: ARG002
        return self._make()

    def _read(self, end: Any, timeout: float) -> bytes:
        end.timeout = timeout
        data = end.read(1)
        return data + end.read(end.in_waiting) if data else b""

    def _write(self, end: Any, data: bytes) -> None:
        end.write(data)


class TelemetryLog(Transport):
    """A .tlog as a link: each frame with the stamp written before it; sending does nothing."""

    datagrams = True
    live = False

    @property
    def ready(self) -> bool:
        return False

    def __init__(self, path: Path) -> None:
        self._frames = stamped_frames(path)

    def receive(self, timeout: float) -> list[Chunk]:  # noqa: ARG002
        batch = itertools.islice(self._frames, AT_ONCE)
        chunks = [Chunk(data, None, stamp_us) for stamp_us, data in batch]
        if not chunks:
            raise EOFError
        return chunks

    def send(self, data: bytes, peer: Address | None = None) -> None:
        """Do nothing: a recording has no receiver."""

    def close(self) -> None:
        self._frames.close()


def open_transport(url: str) -> Transport:
    """Open the transport of a URL in a form of `parse_url`; raise LinkError if it has none or
    cannot be opened."""
    end = parse_url(url)
    try:
        if end.kind in ("udpin", "udpout"):
            return Udp((end.host, end.port), listen=end.kind == "udpin")
        if end.kind == "tcp":
            return TcpClient((end.host, end.port))
        if end.kind == "tcpin":
            return TcpServer((end.host, end.port))
        if end.kind == "serial":
            return SerialPort(end.path, end.baud)
        return TelemetryLog(Path(end.path))
    except OSError as error:
        hint = ""
        if error.errno is not None and "in use" in str(error).lower():
            hint = "; another program listens there: close it or let it forward to another port"
        raise LinkError(f"{url}: cannot be opened: {error.strerror or error}{hint}") from error
