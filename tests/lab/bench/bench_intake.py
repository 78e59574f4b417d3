"""How a season's store grows: time beside bare pymavlink on the same bytes, memory, disk, queries.

    python -m tests.lab.bench.bench_intake FLIGHTS [FOLDER]

makes FLIGHTS telemetry logs of 12 aircraft over half a year from the recorded ones (real bytes, so
that every reader and check runs), takes them in with one process a core, and prints a line of JSON.
Seconds are of the processor: those of every process of `learn`, and those of pymavlink's
`recv_match()` over 100 of the same files, which decodes and keeps nothing. A `learn` that is
ended by Ctrl-C counts with what it has taken by then, which the next one puts into the store.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.gcs_plugin.logs.log_files import other_flight
from tests.import_graph import ROOT

AIRCRAFT, DAY_US, DAYS = 12, 86_400_000_000, 180
MODULE = (sys.executable, "-m", "thrustmargin.gcs_plugin.cli")
QUERIES = {
    "fleet": "select aircraft, count(*), sum(flying_s), min(worst_margin), sum(hectares) "
    "from read_parquet('{store}/flights/**/*.parquet') group by aircraft order by 4",
    "one aircraft": "select * from read_parquet('{store}/flights/**/*.parquet', "
    "hive_partitioning = true) where aircraft = 'sysid-1' order by started_unix_s",
    "rows of a month": "select flight, max(1 - margin_1), avg(voltage) from read_parquet("
    "'{store}/rows/**/*.parquet', hive_partitioning = true) where aircraft = 'sysid-1' "
    "and flying group by flight",
}


def make_logs(folder: Path, flights: int) -> list[Path]:
    """That many telemetry logs, each of its own content."""
    recorded = sorted((ROOT / "sitl_logs/campaign").glob("*.tlog"))
    made = []
    for number in range(flights):
        later = number * (DAYS * DAY_US // flights)  # no aircraft flies twice at one time
        data = other_flight(
            recorded[number % len(recorded)], later_us=later, system=1 + number % AIRCRAFT
        )
        made.append(folder / f"{number:06d}.tlog")
        made[-1].write_bytes(data)
    return made


def seconds_of_pymavlink(logs: list[Path]) -> float:
    """Processor seconds in which pymavlink reads every message of the logs."""
    from pymavlink import mavutil

    begun = time.process_time()
    for path in logs:
        link = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
        while link.recv_match() is not None:
            pass
        link.close()
    return time.process_time() - begun


def seconds_of_queries(store: Path) -> dict[str, float]:
    """Name -> least wall seconds of three of a query by duckdb."""
    import duckdb

    found = {}
    for name, query in QUERIES.items():
        times = []
        for _ in range(3):
            begun = time.perf_counter()
            duckdb.connect().execute(query.format(store=store)).fetchall()
            times.append(time.perf_counter() - begun)
        found[name] = round(min(times), 3)
    return found


def main(flights: int, folder: Path) -> None:
    logs, store = folder / "logs", folder / "store"
    logs.mkdir()
    made = make_logs(logs, flights)
    megabytes = sum(path.stat().st_size for path in made) * 1e-6
    words = [*MODULE, "learn", str(logs), "--store", str(store), "--quiet"]
    whole, wall, core = timed(words)
    largest = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    if whole:
        staged = len(list((store / "_staged").rglob("*.zip"))), count_of(store)
        print(json.dumps({"ended_by": whole, "wall_s": wall, "core_s": core, "taken": staged}))
        return
    sample = made[:: max(1, flights // 100)]
    bare = seconds_of_pymavlink(sample)
    sampled = sum(path.stat().st_size for path in sample) * 1e-6
    sizes = {
        table: sum(p.stat().st_size for p in (store / table).rglob("*.parquet"))
        for table in ("flights", "sums", "rows")
    }
    page = [*MODULE, "fleet", str(store), "--quiet", "--out", str(folder / "fleet.html")]
    print(
        json.dumps(
            {
                "flights": count_of(store),
                "megabytes": round(megabytes, 1),
                "wall_s": wall,
                "core_s": core,
                "flights_per_core_s": round(flights / core, 2),
                "mb_per_core_s": round(megabytes / core, 2),
                "pymavlink_mb_per_core_s": round(sampled / bare, 2),
                "largest_process_mb": round(largest / 1024.0, 0),
                "bytes_a_flight": {k: round(v / flights) for k, v in sizes.items()},
                "files": sum(1 for _ in store.rglob("*.parquet")),
                "again_wall_core_s": timed(words)[1:],
                "query_s": seconds_of_queries(store),
                "fleet_wall_core_s": timed(page)[1:],
                "cores": os.cpu_count(),
            }
        )
    )


def timed(words: list[str]) -> tuple[int, float, float]:
    """Exit code of a command, its wall seconds and the processor's, of all its processes."""
    import subprocess

    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    code = subprocess.run(words, check=False).returncode
    after, wall = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter() - begun
    core = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return code, round(wall, 2), round(core, 2)


def count_of(store: Path) -> int:
    """Flights in the store."""
    import duckdb

    if not any((store / "flights").rglob("*.parquet")):
        return 0
    asked = f"select count(*) from read_parquet('{store}/flights/**/*.parquet')"
    return duckdb.connect().execute(asked).fetchall()[0][0]


if __name__ == "__main__":
    if len(sys.argv) > 2:
        main(int(sys.argv[1]), Path(sys.argv[2]))
    else:
        with TemporaryDirectory() as scratch:
            main(int(sys.argv[1]), Path(scratch))
