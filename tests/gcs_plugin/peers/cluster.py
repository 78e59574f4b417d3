"""A Dask scheduler and workers as processes of their own on loopback."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.gcs_plugin.peers.ports import free_port
from tests.import_graph import ROOT


@contextmanager
def cluster(folder: Path, workers: int) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """The scheduler's address, and its workers, each one thread and ready."""
    from distributed import Client

    address = f"tcp://127.0.0.1:{free_port()}"
    paths = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": paths}
    own = ["--host", "127.0.0.1", "--no-dashboard"]
    port = address.rpartition(":")[2]
    place = str(folder)

    def begin(module: str, *words: str) -> subprocess.Popen[bytes]:
        line = [sys.executable, "-m", f"distributed.cli.{module}", *own, *words]
        with (folder / f"{module}.txt").open("ab") as said:
            return subprocess.Popen(line, env=environment, stdout=said, stderr=said)

    running = [begin("dask_scheduler", "--port", port)]
    try:
        options = ["--nthreads", "1", "--no-nanny", "--local-directory", place]
        running += [begin("dask_worker", address, *options) for _ in range(workers)]
        with Client(address, timeout=100) as client:
            client.wait_for_workers(workers, timeout=100)
        yield address, running[1:]
    finally:
        for process in running:
            process.kill()
            process.wait()
