"""What `monitor` takes on a companion computer: processor and memory over one recorded flight.

The command line is that of the container and the service; the flight comes by UDP at its own speed.
"""

import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.gcs_plugin.live.live_vehicle import ROOT
from tests.gcs_plugin.peers.ports import free_port, free_udp_port

SETTLED_S, SECONDS = 40.0, 20.0  # the aircraft is recognised before; measured after that
TICK_S = 0.01


def used(pid: int) -> tuple[float, float]:
    """Processor s so far, and the most memory, MB."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    status = Path(f"/proc/{pid}/status").read_text()
    peak = re.search(r"VmHWM:\s+(\d+) kB", status)
    assert peak is not None
    return (int(fields[11]) + int(fields[12])) * TICK_S, int(peak[1]) / 1e3


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_one_aircraft_on_board(benchmark, tmp_path):
    dockerfile = (ROOT / "gcs_plugin/office/stations/companion/Dockerfile").read_text("utf-8")
    words = json.loads(re.search(r"^CMD (\[.*\])$", dockerfile, re.M)[1])  # type: ignore[index]
    words[words.index("--record") + 1] = str(tmp_path)
    words[words.index("--bar") + 1] = str(free_port())
    port = free_udp_port()
    program = (sys.executable, "-m", "thrustmargin.gcs_plugin.cli")
    told = {}

    def measure() -> None:
        none = subprocess.DEVNULL
        link = f"udpin:127.0.0.1:{port}"
        with subprocess.Popen(
            [*program, "monitor", link, *words], cwd=tmp_path, stdout=none, stderr=none
        ) as ours:
            time.sleep(3.0)
            send = [*program, "stream", "demo", "--to", f"udpout:127.0.0.1:{port}"]
            with subprocess.Popen(send, cwd=tmp_path, stdout=none, stderr=none) as sender:
                time.sleep(SETTLED_S)
                before, _ = used(ours.pid)
                time.sleep(SECONDS)
                after, memory = used(ours.pid)
                told.update(processor=(after - before) / SECONDS, memory=memory)
                sender.send_signal(signal.SIGINT)
            ours.send_signal(signal.SIGINT)

    benchmark.pedantic(measure, rounds=1)
    print(
        f"\none aircraft on board: {told['processor']:.1%} of a core in flight, "
        f"{told['memory']:.0f} MB at most"
    )
    benchmark.extra_info.update(told)
