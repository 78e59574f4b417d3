"""A small HTTP server in the monitor's process, with few requests at once and a time limit for
each.

Threads and files are those that the monitor needs, so a client must not be able to take them all,
nor to keep others out: where all places are taken, the next request replaces the oldest one of the
client with the most.
"""

from __future__ import annotations

import socket
import sys
import threading
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from thrustmargin.models.errors import LinkError

MOST = 32  # requests at once
SLOWEST = 10.0  # s that a slow peer may hold a thread
HANG_UP = 1.0  # s in which the thread of a request that was hung up on ends
#: Names of this computer in a request. Any other is that of a web page which leads here.
OWN_NAMES = ("127.0.0.1", "localhost")


class SmallServer:
    """A server that answers GET on a port until `close`; `port` 0 takes any free one.

    `answer` returns media type and body of a path, None for an unknown one. Without `for_all` only
    requests that name this computer are answered, because any web page could point a name of its
    own at it. Raises LinkError, with the `option` that chose the port, when the port cannot be
    opened.
    """

    def __init__(
        self,
        answer: Callable[[str], tuple[str, bytes] | None],
        option: str,
        address: tuple[str, int],
        *,
        for_all: bool,
    ) -> None:
        try:
            self._server = _Server(address, _handler(answer, for_all=for_all))
        except (OSError, OverflowError) as error:
            why = error.strerror if isinstance(error, OSError) else "give a port from 0 to 65535"
            raise LinkError(
                f"{option} {address[1]} cannot be opened ({why}); close the program that uses it "
                "or give another port"
            ) from error
        self._thread = threading.Thread(
            target=self._server.serve_forever, name=option.strip("-"), daemon=True
        )
        self._thread.start()

    @property
    def port(self) -> int:
        """Return the TCP port of the server."""
        return self._server.server_port

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class _Server(ThreadingHTTPServer):
    """A server with one thread for each request and at most MOST at once: a further one replaces an
    old one.
    """

    daemon_threads = True
    request_queue_size = 2 * MOST

    def __init__(self, *args: Any) -> None:
        # An answer takes milliseconds: whoever is old among so many is slow.
        self._peers: dict[Any, str] = {}  # connection -> address, the oldest first
        self._change = threading.Lock()
        self._room = threading.BoundedSemaphore(MOST)
        super().__init__(*args)

    def process_request(self, request: Any, client_address: Any) -> None:
        if not self._room.acquire(blocking=False):
            self._hang_up_on_one()
            if not self._room.acquire(timeout=HANG_UP):
                self.shutdown_request(request)
                return
        with self._change:
            self._peers[request] = client_address[0]
        super().process_request(request, client_address)

    def _hang_up_on_one(self) -> None:
        """End the oldest request of the client with the most requests, so that its thread ends too.

        Nothing happens without a request.
        """
        with self._change:
            if not self._peers:
                return
            counts = Counter(self._peers.values())
            most = max(counts, key=lambda peer: counts[peer])
            oldest = next(request for request, peer in self._peers.items() if peer == most)
            del self._peers[oldest]
            with suppress(OSError):  # it may have hung up itself
                oldest.shutdown(socket.SHUT_RDWR)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._room.release()

    def shutdown_request(self, request: Any) -> None:
        with self._change:
            self._peers.pop(request, None)
            super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        if not isinstance(sys.exc_info()[1], OSError):  # a peer that hangs up is no news
            super().handle_error(request, client_address)


def _handler(
    answer: Callable[[str], tuple[str, bytes] | None], *, for_all: bool
) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        timeout = SLOWEST

        def do_GET(self) -> None:
            if not for_all and self.headers.get("Host", "").rpartition(":")[0] not in OWN_NAMES:
                self.send_error(403, "open it as 127.0.0.1 or localhost")
                return
            found = answer(self.path.partition("?")[0])
            if found is None:
                self.send_error(404)
                return
            self.send_response(200)
            for name, value in (
                ("Content-Type", found[0]),
                ("Content-Length", str(len(found[1]))),
                ("Cache-Control", "no-store"),
                ("X-Content-Type-Options", "nosniff"),
                *([("Access-Control-Allow-Origin", "*")] if for_all else []),
            ):
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(found[1])

        def log_message(self, format: str, *args: Any) -> None:
            """Log nothing: the terminal is the monitor's."""

    return Handler
