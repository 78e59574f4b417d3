"""Starts the vehicles of this folder as processes of their own."""

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PEERS = Path(__file__).parent

#: ArduPilot's list for a small field: home, take-off, speed, a waypoint, sprayer on, jump, return.
ARDUPILOT_ITEMS = [
    (0, 16, 0, 1, 0, 0, 0, 0, 366500000, 1169000000, 12.25, 0),
    (3, 22, 0, 1, 0, 0, 0, 0, 0, 0, 3.1, 0),
    (3, 178, 0, 1, 1, 4.5, 0, 0, 0, 0, 0, 0),
    (3, 16, 0, 1, 0, 0, 0, 0, 366509881, 1169000559, 3.1, 0),
    (2, 216, 0, 1, 1, 0, 0, 0, 7, 0, 0, 0),
    (2, 177, 0, 1, 3, 2, 0, 0, 0, 0, 0, 0),
    (2, 20, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0),
]


@contextmanager
def process(script: str, *arguments: object, orders: object = None) -> Iterator[subprocess.Popen]:
    peer = subprocess.Popen(
        [sys.executable, str(PEERS / script), *map(str, arguments)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert peer.stdin is not None
    assert peer.stdout is not None
    try:
        if orders is not None:
            peer.stdin.write(json.dumps(orders) + "\n")
            peer.stdin.flush()
        assert any(line == "ready\n" for line in peer.stdout)
        yield peer
    finally:
        peer.stdin.close()
        peer.wait(100)


def vehicle(**orders: object):
    return process("vehicle.py", orders=orders)
