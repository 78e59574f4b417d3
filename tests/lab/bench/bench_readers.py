"""How fast and how lean the log readers are, beside pymavlink's and pyulog's in the same run.

Speeds are of reading the messages that a FlightTrack needs (checksums tried in a .tlog), and of
`read_log` with the finished table. pymavlink reads the recorded flight once with `recv_match()`,
as ground tools do. Times are of the processor, so that a busy machine does not tilt the ratio. The
long logs are the recorded flight many times over; the .ulg is made, and pyulog reads all of it.
"""

import time
import tracemalloc
from pathlib import Path

import pytest

from tests.gcs_plugin.logs.log_files import long_bin, long_tlog
from tests.gcs_plugin.logs.test_ulog import px4_log
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.logs.dataflash.binary import dataflash_boots
from thrustmargin.gcs_plugin.logs.tlog import tlog_boots

TICKS = 6000  # tenths of a second of the made .ulg
RECORDED = {"tlog": "campaign/v4_m10_q2.5.tlog", "BIN": "formats/v4_m10_q2.5.BIN"}
READERS = {
    "tlog": lambda path: list(tlog_boots(path)),
    "BIN": lambda path: list(dataflash_boots(path)),
}
TIMES = {"tlog": 60, "BIN": 10}


def _pymavlink_seconds(path: Path) -> float:
    from pymavlink import DFReader, mavutil

    begin = time.process_time()
    if path.suffix == ".BIN":
        log = DFReader.DFReader_binary(str(path))
    else:
        log = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    while log.recv_match() is not None:
        pass
    return time.process_time() - begin


@pytest.fixture(params=["tlog", "BIN"])
def logs(request, sitl_logs, tmp_path) -> tuple[str, Path, Path]:
    kind = request.param
    recorded = sitl_logs / RECORDED[kind]
    longer = tmp_path / f"long.{kind}"
    make = long_tlog if kind == "tlog" else long_bin
    longer.write_bytes(make(recorded, TIMES[kind]))
    return kind, recorded, longer


@pytest.mark.benchmark(timer=time.process_time)
def test_reading_a_ulg(benchmark, tmp_path):
    from pyulog import ULog

    path = tmp_path / "made.ulg"
    path.write_bytes(px4_log(ticks=TICKS))
    ULog(str(path))
    begin = time.process_time()
    ULog(str(path))
    theirs = _megabytes(path) / (time.process_time() - begin)
    benchmark.pedantic(read_log, args=(path,), rounds=3, warmup_rounds=1)
    ours = _megabytes(path) / benchmark.stats.stats.min
    print(f"\n.ulg: read_log at {ours:.0f} MB/s, pyulog {theirs:.0f} MB/s: {ours / theirs:.2f} x")


def _megabytes(path: Path) -> float:
    return path.stat().st_size * 1e-6


@pytest.mark.benchmark(timer=time.process_time)
def test_reading_messages(benchmark, logs):
    kind, recorded, longer = logs
    theirs = _megabytes(recorded) / _pymavlink_seconds(recorded)
    benchmark.pedantic(READERS[kind], args=(longer,), rounds=5, warmup_rounds=1)
    ours = _megabytes(longer) / benchmark.stats.stats.min
    ratio = ours / theirs
    benchmark.extra_info.update(ours_mb_s=ours, pymavlink_mb_s=theirs, ratio=ratio)
    print(
        f"\n.{kind}: messages at {ours:.0f} MB/s, pymavlink's recv_match {theirs:.1f} MB/s: "
        f"{ratio:.0f} x"
    )


@pytest.mark.benchmark(timer=time.process_time)
def test_reading_a_flight(benchmark, logs):
    kind, recorded, longer = logs
    theirs = _megabytes(recorded) / _pymavlink_seconds(recorded)
    benchmark.pedantic(read_log, args=(longer,), rounds=3, warmup_rounds=1)
    ours = _megabytes(longer) / benchmark.stats.stats.min
    print(f"\n.{kind}: read_log at {ours:.0f} MB/s: {ours / theirs:.0f} x pymavlink's recv_match")


def test_memory(benchmark, logs):
    kind, _, longer = logs
    peaks = {}

    def measure() -> None:
        for name, reader in (("messages", READERS[kind]), ("read_log", read_log)):
            tracemalloc.start()
            reader(longer)
            peaks[name] = tracemalloc.get_traced_memory()[1] * 1e-6 / _megabytes(longer)
            tracemalloc.stop()

    read_log(longer)
    benchmark.pedantic(measure, rounds=1)
    benchmark.extra_info.update(peaks)
    listed = ", ".join(f"{name} {peak:.2f} x the file" for name, peak in peaks.items())
    print(f"\n.{kind}: peak memory {listed}")
