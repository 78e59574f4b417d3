"""The address at which Prometheus collects the metrics: this computer's own, and no other's."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from typing import Any
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer, make_server

from prometheus_client import CollectorRegistry, make_wsgi_app
from prometheus_client.exposition import ThreadingWSGIServer
from prometheus_client.registry import Collector

from thrustmargin.models.errors import LinkError

HOST = "127.0.0.1"
#: Names of this computer in a request. Any other is that of a web page which leads here.
OWN_NAMES = (HOST, "localhost")


class _Quiet(WSGIRequestHandler):
    def log_message(self, format: str, *args: Any) -> None:
        """Nothing: requests are no news on the terminal."""


class MetricsServer:
    """Serves one collector's metrics until `close`; `port` 0 takes any free one.

    Raises LinkError when the port cannot be opened.
    """

    def __init__(self, collector: Collector, port: int) -> None:
        registry = CollectorRegistry(auto_describe=False)
        registry.register(collector)
        try:
            self._server: WSGIServer = make_server(
                HOST,
                port,
                _own_names_only(make_wsgi_app(registry)),
                server_class=ThreadingWSGIServer,
                handler_class=_Quiet,
            )
        except (OSError, OverflowError) as error:
            why = error.strerror if isinstance(error, OSError) else "ports are 0 to 65535"
            raise LinkError(
                f"--metrics {port} cannot be opened ({why}); close the program that uses it or "
                "choose another"
            ) from error
        self._thread = threading.Thread(
            target=self._server.serve_forever, name="metrics", daemon=True
        )
        self._thread.start()

    @property
    def url(self) -> str:
        """Where the metrics are."""
        return f"http://{HOST}:{self._server.server_port}/metrics"

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


def _own_names_only(app: Callable[..., Iterable[bytes]]) -> Callable[..., Iterable[bytes]]:
    """The app, which answers only requests that name this computer.

    Else any web page could read the metrics through a name that it points here.
    """

    def answer(environ: dict[str, Any], start: Callable[..., Any]) -> Iterable[bytes]:
        if environ.get("HTTP_HOST", "").rpartition(":")[0] not in OWN_NAMES:
            start("403 Forbidden", [("Content-Type", "text/plain")])
            return [b"open it as 127.0.0.1 or localhost\n"]

        def guarded(status: str, headers: list[tuple[str, str]], *rest: Any) -> Any:
            return start(status, [*headers, ("X-Content-Type-Options", "nosniff")], *rest)

        return app(environ, guarded)

    return answer
