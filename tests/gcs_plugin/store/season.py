"""Small flights for tests of the store, and what a store holds in a form that can be compared."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.store.ingest_run import LogSource
from thrustmargin.gcs_plugin.store.season_store import SeasonStore, array_cells
from thrustmargin.gcs_plugin.store.staging import SeasonFlight, stage
from thrustmargin.models.errors import LogError

FEBRUARY = 1_770_000_000.0  # Unix s, 2026-02-02 02:40 UTC


def small_flight(number: int, *, aircraft: str = "A", days: float = 0.0) -> SeasonFlight:
    """A flight of three rows that is known by its number; the second row's voltage is unknown."""
    name = f"{number:016x}"
    started = FEBRUARY + days * 86_400.0 + number
    head = {"flight": name, "started_unix_s": started}
    rows = {
        "time_s": np.arange(3) * 0.1,
        "voltage": np.array([50.0 + number, np.nan, 49.0]),
        "flying": np.array([False, True, True]),
    }
    sums = head | {"model_digest": "m", "arrays": array_cells({"gram": np.eye(2) * number})}
    summary = head | {"verdict": "under", "worst_margin": 0.5, "hectares": np.nan, "alarms": []}
    return SeasonFlight(aircraft=aircraft, summary=summary, rows=rows, sums=sums)


def stage_number(
    log: LogSource, content: str, *, store: str, slow: Path | None = None
) -> list[str]:
    """Stage the small flight of the number in a file; what else stands there goes wrong."""
    words = Path(log.path).read_text().split()
    if words[0] == "die" or (words[0] == "die-once" and not Path(words[1]).exists()):
        Path(words[1]).touch()
        os._exit(9)
    if words[0] == "bad":
        raise LogError(f"{log.path}: nothing in it")
    if words[0] == "bug":
        raise ZeroDivisionError("a fault of ours")
    if slow is not None:
        (slow / words[-1]).touch()
        time.sleep(0.3)
    flight = small_flight(int(words[-1]), aircraft="AB"[int(words[-1]) % 2])
    assert flight.sums is not None
    flight.summary["flight"] = flight.sums["flight"] = content
    stage(SeasonStore.open(store), flight)
    return [content]


def log_files(folder: Path, **words: str) -> list[LogSource]:
    """A file for each name, with its words in it."""
    found = []
    for name, text in words.items():
        path = folder / f"{name}.tlog"
        path.write_text(text)
        found.append(LogSource(str(path), path.name, len(text)))
    return found


def content(store: SeasonStore) -> dict[str, list[dict[str, Any]]]:
    """Every row of every table that flights go into, in an order of its own."""
    tables = {name: store.table(name).to_pylist() for name in ("flights", "sums", "rows")}
    return {
        name: sorted(rows, key=lambda row: (row["flight"], row.get("time_s") or 0.0))
        for name, rows in tables.items()
    }


def files(folder: Path) -> dict[str, bytes]:
    """Path -> bytes of every Parquet file of a store."""
    found = sorted(folder.rglob("*.parquet"))
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}
