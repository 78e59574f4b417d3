"""Bytes made to be slow to search beside an honest link, in the scanner and the live splitter.

Times are of the processor. What counts is that the ratio does not grow with the bytes.
"""

import time

import numpy as np
import pytest

from tests.gcs_plugin.live.live_vehicle import Vehicle
from thrustmargin.gcs_plugin.mavlink.frame import FrameSplitter
from thrustmargin.gcs_plugin.mavlink.scan import scan

PADDING = 512  # bytes behind the data that a scan may look at
#: Long frames of unknown id over each other, version 1 and 2; and of a known id, 131.
UNITS = {"unknown 1": "FEFFFEFFFE03", "unknown 2": "FDFF000000000000FE", "known": "FE83"}
SIZES = (250_000, 1_000_000)


def _honest(size: int) -> bytes:
    vehicle = Vehicle()
    flight = b"".join(frame.data for _ in range(100) for frame in vehicle.tick())
    return (flight * (size // len(flight) + 1))[:size]


def _scan(data: bytes) -> None:
    scan(np.frombuffer(data + bytes(PADDING), np.uint8).copy(), len(data), stamp=0)


def _feed(data: bytes) -> None:
    splitter = FrameSplitter()
    for at in range(0, len(data), 256):
        splitter.feed(data[at : at + 256], 0)


@pytest.mark.parametrize("work", [_scan, _feed], ids=["scanner", "splitter"])
def test_hostile_beside_honest(benchmark, work):
    def seconds_a_megabyte(data: bytes) -> float:
        begin = time.process_time()
        work(data)
        return (time.process_time() - begin) / (len(data) * 1e-6)

    def measure() -> None:
        for size in SIZES:
            honest = seconds_a_megabyte(_honest(size))
            for name, unit in UNITS.items():
                raw = bytes.fromhex(unit)
                hostile = seconds_a_megabyte((raw * (size // len(raw) + 1))[:size])
                print(
                    f"\n{work.__name__[1:]}, {size * 1e-6:.2g} MB, {name}: {hostile:.2f} s a MB, "
                    f"honest {honest:.3f}: {hostile / honest:.0f} x",
                    end="",
                )

    benchmark.pedantic(measure, rounds=1)
