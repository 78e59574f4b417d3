"""How long `fleet` takes for many aircraft: its page, a table by duckdb, one aircraft.

    python -m tests.lab.bench.bench_fleet [--aircraft 500] [--flights 20]

Flights are drawn from the sums of recorded good flights; one aircraft in 20 wears a propeller.
Seconds are of the clock and of all processes together.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tests.gcs_plugin.office.season.made_store import flight_row
from tests.models.identification.season.made_seasons import LOSS_2, good_sums, wear, with_change
from thrustmargin.gcs_plugin.store.schema import table_schema
from thrustmargin.gcs_plugin.store.season_store import array_cells
from thrustmargin.models.identification.season.flight_sums import to_arrays


def make_store(folder: Path, aircraft: int, flights: int) -> None:
    """A store of that many aircraft, as `learn` leaves it but for the rows."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    rng, good = np.random.default_rng(1), good_sums(12)
    cells = [array_cells(to_arrays(one)) for one in good]
    for number in range(aircraft):
        drawn = rng.integers(0, len(good), flights)
        arrays = [cells[k] for k in drawn]
        if number % 20 == 0:
            lost = wear(flights, flights // 2, 0.004)
            worn = with_change([good[k] for k in drawn], LOSS_2, lost)
            arrays = [array_cells(to_arrays(one)) for one in worn]
        ohms = 0.03 + 0.001 * rng.standard_normal(flights)
        rows = [
            flight_row(k, flight=f"{number:08x}{k:08x}", battery_ohm=ohm, battery_ohm_error=0.001)
            for k, ohm in enumerate(ohms.tolist())
        ]
        keys = ("flight", "started_unix_s")
        sums = [
            {**{key: row[key] for key in keys}, "model_digest": "m", "arrays": one}
            for row, one in zip(rows, arrays, strict=True)
        ]
        for table, values in (("flights", rows), ("sums", sums)):
            path = folder / table / f"aircraft=A{number:04d}/month=2026-05/{table}.parquet"
            path.parent.mkdir(parents=True)
            pq.write_table(pa.Table.from_pylist(values, schema=table_schema(table)), path)


def seconds_of(words: list[str]) -> dict[str, float]:
    """Of the command `fleet` with these words."""
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [sys.executable, "-m", "thrustmargin.gcs_plugin.cli", "fleet", *words]
    subprocess.run(command, check=True, capture_output=True)
    after, wall = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter() - begun
    core = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"wall_s": round(wall, 1), "core_s": round(core, 1)}


def main(words: list[str]) -> None:
    given = argparse.ArgumentParser()
    given.add_argument("--aircraft", type=int, default=500)
    given.add_argument("--flights", type=int, default=20)
    asked = given.parse_args(words)
    with TemporaryDirectory() as folder:
        store, page = Path(folder) / "store", Path(folder) / "fleet.html"
        make_store(store, asked.aircraft, asked.flights)
        query = "select aircraft, count(*), min(worst_margin) from flights group by 1 order by 3"
        found = {
            "page": seconds_of([str(store), "--out", str(page)]),
            "page_mb": round(page.stat().st_size * 1e-6, 2),
            "sql": seconds_of([str(store), "--sql", query]),
            "one aircraft": seconds_of([str(store), "--aircraft", "A0000"]),
        }
    print(json.dumps({"aircraft": asked.aircraft, "flights": asked.flights, **found}))


if __name__ == "__main__":
    main(sys.argv[1:])
