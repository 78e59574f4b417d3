"""The 3D view of the MAVProxy module: `thrustmargin monitor` as a process of its own.

It hears what MAVProxy hears, frame by frame over loopback UDP, and can send nothing to the vehicle.
"""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys

MAIN = "import sys; from thrustmargin.gcs_plugin.cli import main; main(sys.argv[1:])"


class ViewProcess:
    """One running monitor. `send` gives it a frame; `address` is its page. Ends with `close`."""

    def __init__(self, options: list[str]) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._port, page = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_STREAM)
        self.address = f"http://127.0.0.1:{page}"
        url = f"udpin:127.0.0.1:{self._port}"
        self._process = subprocess.Popen(
            [sys.executable, "-c", MAIN, "monitor", url, "--port", str(page), *options],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )

    @property
    def running(self) -> bool:
        return self._process.poll() is None

    def send(self, data: bytes) -> None:
        """One frame; lost when the process has ended, as on the air."""
        with contextlib.suppress(OSError):
            self._socket.sendto(data, ("127.0.0.1", self._port))

    def last_words(self) -> str:
        """What it said when it ended by itself; empty while it runs."""
        if self.running or self._process.stderr is None:
            return ""
        lines = [line for line in self._process.stderr.read().splitlines() if line.strip()]
        return lines[-1] if lines else f"exit code {self._process.returncode}"

    def close(self) -> None:
        """End the process; may be called again."""
        self._process.terminate()
        try:
            self._process.wait(3.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._socket.close()


def free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]
