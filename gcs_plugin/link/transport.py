"""Define byte transports of a link: UDP, TCP, serial port, telemetry log; URLs as in pymavlink.

`link.open_transport` opens them. They are own sockets and not pymavlink's, because its UDP
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

import os
import re
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from thrustmargin.models.errors import LinkError

Address = tuple[str, int]


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
    """Parse a URL into its parts; raise LinkError for an unknown form."""
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
    """Return whether the path is a character device, as serial ports are on Linux and macOS.

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
        """Return whether there is a receiver to send to."""
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
