"""Serve the monitor's figures to Prometheus: the output of `monitor --metrics PORT`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.live.live_monitor import OutputContext
from thrustmargin.gcs_plugin.live.output import Output

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.office.streams.collector import MetricsServer

LIBRARY = "prometheus_client"  # required before the monitor begins


class Metrics(Output):
    """An output that answers Prometheus on `port` of this computer; 0 is any free one.

    Raises LinkError from `start` when the port cannot be opened.
    """

    name = "--metrics"

    def __init__(self, context: OutputContext, port: int) -> None:
        self._context, self._port = context, port
        self._server: MetricsServer | None = None

    def start(self) -> None:
        """Open the port and print its address."""
        from thrustmargin.gcs_plugin.office.streams.collector import MetricsServer, MonitorCollector

        self._server = MetricsServer(MonitorCollector(self._context.monitor), self._port)
        self._context.print_note(f"metrics: {self._server.url}")

    def close(self) -> None:
        """Close the port; do nothing if it is not open."""
        if self._server is not None:
            self._server.close()
            self._server = None


def output(context: OutputContext, value: int) -> Metrics:
    """Return the output of `--metrics PORT`."""
    return Metrics(context, value)
