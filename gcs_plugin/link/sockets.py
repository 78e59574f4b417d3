"""Provide UDP and TCP transports, and the base of streams that are reopened after they end."""

from __future__ import annotations

import contextlib
import ipaddress
import socket
import sys
import time
from abc import abstractmethod
from typing import Any

from thrustmargin.gcs_plugin.link.transport import Address, Chunk, Transport

#: Asked of the kernel for UDP; it may grant less (net.core.rmem_max on Linux).
RECEIVE_BUFFER = 8 << 20
LARGEST_DATAGRAM, LARGEST_READ = 65_535, 65_536  # bytes; of UDP, of TCP
AT_ONCE = 512  # datagrams taken before they are handed on
REMEMBERED = 60.0  # s that a UDP peer is answered after it was last heard
_SO_RXQ_OVFL = 40  # Linux: the kernel's count of datagrams dropped for want of buffer
AGAIN = 1.0  # s between attempts to connect


class Udp(Transport):
    """A UDP socket, listening or sending first; one that sends first receives from its target
    alone.
    """

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
        senders become peers for `send`. Return an empty list if none arrives or is left, or at once
        if an earlier send met a closed port. `emptied` is set to whether fewer than AT_ONCE waited.
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
    """A TCP server of one client at a time; the next is accepted when it has left."""

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
