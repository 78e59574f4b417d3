"""Open the transport of a URL: a socket, a serial port or a recording."""

from __future__ import annotations

import itertools
from functools import partial
from pathlib import Path
from typing import Any

from thrustmargin.gcs_plugin.link.sockets import Reopened, TcpClient, TcpServer, Udp
from thrustmargin.gcs_plugin.link.transport import Address, Chunk, Transport, parse_url
from thrustmargin.gcs_plugin.mavlink.scan import stamped_frames
from thrustmargin.models.errors import LinkError

AT_ONCE = 512  # frames of a recording handed on together


def open_transport(url: str) -> Transport:
    """Open the transport of a URL; raise LinkError if it cannot be opened."""
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
