"""Transports that carry a stream of bytes (TCP, serial port), and one that reads a recording."""

from __future__ import annotations

import contextlib
import itertools
import socket
import time
from pathlib import Path
from typing import Any

from thrustmargin.gcs_plugin.link.transport import Address, Chunk
from thrustmargin.gcs_plugin.mavlink.scan import stamped_frames

AGAIN = 1.0  # s between attempts to connect
AT_ONCE = 512  # frames of a recording handed on together


class _TcpStream:
    """One connection at a time, of either direction."""

    datagrams = False
    live = True
    kernel_drops = 0

    def __init__(self) -> None:
        self._stream: socket.socket | None = None

    @property
    def ready(self) -> bool:
        return self._stream is not None

    def _take(self, timeout: float) -> list[Chunk]:
        stream = self._stream
        if stream is None:
            return []
        try:
            stream.settimeout(timeout)
            data = stream.recv(1 << 16)
        except TimeoutError:
            return []
        except OSError:
            data = b""
        if data:
            return [Chunk(data)]
        self._drop()
        return []

    def _adopt(self, stream: socket.socket) -> None:
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._stream = stream

    def _drop(self) -> None:
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    def send(self, data: bytes, peer: Address | None = None) -> None:  # noqa: ARG002
        stream = self._stream
        if stream is not None:
            with contextlib.suppress(OSError):
                stream.sendall(data)

    def close(self) -> None:
        self._drop()


class TcpClient(_TcpStream):
    """Connects, and again whenever the connection ends."""

    def __init__(self, address: Address) -> None:
        super().__init__()
        self._address = address
        self._adopt(socket.create_connection(address, timeout=3.0))

    def receive(self, timeout: float) -> list[Chunk]:
        if self._stream is None:
            try:
                self._adopt(socket.create_connection(self._address, timeout=AGAIN))
            except OSError:
                time.sleep(min(timeout, AGAIN))
                return []
        return self._take(timeout)


class TcpServer(_TcpStream):
    """Waits for a client; the next one is let in when it has gone."""

    def __init__(self, address: Address) -> None:
        super().__init__()
        self._door = socket.create_server(address)

    @property
    def address(self) -> Address:
        """Where the socket is bound."""
        return self._door.getsockname()[:2]

    def receive(self, timeout: float) -> list[Chunk]:
        if self._stream is None:
            try:
                self._door.settimeout(timeout)
                stream, _ = self._door.accept()
            except (TimeoutError, BlockingIOError):
                return []
            self._adopt(stream)
        return self._take(timeout)

    def close(self) -> None:
        super().close()
        self._door.close()


class SerialPort:
    """A serial port by pyserial; opened again when it vanishes (a pulled USB plug)."""

    datagrams = False
    live = True
    kernel_drops = 0

    def __init__(self, path: str, baud: int) -> None:
        import serial

        self._serial = serial
        self._path, self._baud = path, baud
        self._port: Any = serial.Serial(path, baud, timeout=0.1, write_timeout=1.0)

    @property
    def ready(self) -> bool:
        return self._port is not None

    def receive(self, timeout: float) -> list[Chunk]:
        if self._port is None:
            try:
                self._port = self._serial.Serial(
                    self._path, self._baud, timeout=0.1, write_timeout=1.0
                )
            except OSError:
                time.sleep(min(timeout, AGAIN))
                return []
        try:
            self._port.timeout = timeout
            data = self._port.read(1)
            if data:
                data += self._port.read(self._port.in_waiting)
        except OSError:
            self._port.close()
            self._port = None
            return []
        return [Chunk(data)] if data else []

    def send(self, data: bytes, peer: Address | None = None) -> None:  # noqa: ARG002
        port = self._port
        if port is not None:
            with contextlib.suppress(OSError):
                port.write(data)

    def close(self) -> None:
        if self._port is not None:
            self._port.close()


class TelemetryLog:
    """A .tlog as a link: each frame with the stamp written before it. Nothing can be sent."""

    datagrams = True
    live = False
    kernel_drops = 0
    ready = False

    def __init__(self, path: Path) -> None:
        self._frames = stamped_frames(path)

    def receive(self, timeout: float) -> list[Chunk]:  # noqa: ARG002
        taken = itertools.islice(self._frames, AT_ONCE)
        chunks = [Chunk(data, None, stamp_us) for stamp_us, data in taken]
        if not chunks:
            raise EOFError
        return chunks

    def send(self, data: bytes, peer: Address | None = None) -> None:
        """Nothing: a recording does not listen."""

    def close(self) -> None:
        self._frames.close()
