"""Byte transports behind a link: UDP, TCP, serial port, telemetry log. URLs as pymavlink has them.

These are own sockets and not pymavlink's, because its UDP listener binds with SO_REUSEADDR (two
programs on one port then take each other's packets in silence), hides which peer sent what, and
its TCP client prints, sleeps and connects while it holds the receiving thread.

| URL | what it does |
|---|---|
| `udpin:host:port` (also `udp:`) | listen; answers go to everyone heard in the last minute |
| `udpout:host:port` | send to the address, and hear what it sends back |
| `tcp:host:port` | connect, and connect again whenever the other side goes away |
| `tcpin:host:port` | wait for one client at a time |
| `/dev/ttyACM0`, `COM3`, each with `,baud` | serial port, 115200 baud unless said |
| `flight.tlog` | a recording, as fast as it can be read, with its own time stamps |
"""

from __future__ import annotations

import contextlib
import os
import re
import socket
import stat
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from thrustmargin.models.errors import LinkError

Address = tuple[str, int]

#: Asked of the kernel for UDP; it may grant less (net.core.rmem_max on Linux).
RECEIVE_BUFFER = 8 << 20
LARGEST_DATAGRAM = 65_535
AT_ONCE = 512  # datagrams taken before they are handed on
REMEMBERED = 60.0  # s that a UDP peer is answered after it was last heard
_SO_RXQ_OVFL = 40  # Linux: the kernel's count of datagrams dropped for want of buffer


@dataclass(frozen=True, slots=True)
class Chunk:
    """Bytes as they came: from whom, and when if the source itself says so."""

    data: bytes
    peer: Address | None = None
    stamp_us: int | None = None


@dataclass(frozen=True, slots=True)
class Endpoint:
    """A URL taken apart."""

    kind: str  # udpin, udpout, tcp, tcpin, serial or tlog
    host: str = ""
    port: int = 0
    path: str = ""
    baud: int = 115_200


def parse_url(url: str) -> Endpoint:
    """The parts of a URL. Raises LinkError for a form that is not known."""
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
    """What a serial port is on Linux and macOS; any other file is a mistyped name."""
    try:
        return stat.S_ISCHR(os.stat(path).st_mode)
    except (OSError, ValueError):
        return False


class Transport(Protocol):
    """What a link needs. One thread receives; others may send."""

    datagrams: bool  # each chunk begins with a new frame
    live: bool  # bytes come as they happen, not out of a recording
    kernel_drops: int  # datagrams lost before they could be received, where the system tells

    @property
    def ready(self) -> bool:
        """Whether there is somebody to send to."""
        ...

    def receive(self, timeout: float) -> list[Chunk]:
        """What has come, waiting up to `timeout` s. Raises EOFError when nothing more can come."""
        ...

    def send(self, data: bytes, peer: Address | None = None) -> None:
        """Send to one peer, or to all that are known; what cannot be sent is lost, as on air."""
        ...

    def close(self) -> None: ...


def open_transport(url: str) -> Transport:
    """The transport of a URL. Raises LinkError when it cannot be opened."""
    from thrustmargin.gcs_plugin.link.byte_streams import (
        SerialPort,
        TcpClient,
        TcpServer,
        TelemetryLog,
    )

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


class Udp:
    """A UDP socket, listening or sending first."""

    datagrams = True
    live = True

    def __init__(self, address: Address, *, listen: bool) -> None:
        family = socket.getaddrinfo(*address, type=socket.SOCK_DGRAM)[0][0]
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self.kernel_drops = 0
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
                self._target = socket.getaddrinfo(*address, family, socket.SOCK_DGRAM)[0][4][:2]  # type: ignore[assignment]
                # Bound now, so that answers can be waited for before anything is sent.
                self._socket.bind(("" if family == socket.AF_INET else "::", 0))
        except OSError:
            self._socket.close()
            raise

    @property
    def address(self) -> Address:
        """Where the socket is bound."""
        return self._socket.getsockname()[:2]

    @property
    def ready(self) -> bool:
        return self._target is not None or bool(self._heard)

    def receive(self, timeout: float) -> list[Chunk]:
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
