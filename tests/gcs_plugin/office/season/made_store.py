"""Rows of a store and small stores for tests of the fleet page, without a log."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.store.schema import FLIGHTS
from thrustmargin.gcs_plugin.store.season_store import SeasonStore, array_cells
from thrustmargin.gcs_plugin.store.staging import SeasonFlight, merge, stage, staged_partitions
from thrustmargin.models.identification.season.flight_sums import FlightEvidence, to_arrays

START, DAY = 1.7776224e9, 86400.0  # 1 May 2026


def flight_row(k: int, **known: Any) -> dict[str, Any]:
    """One row of the table of flights; what is not given is unknown."""
    row: dict[str, Any] = {c.name: None for c in FLIGHTS}
    usual = {
        "flight": f"{k:016x}",
        "started_unix_s": START + k * DAY,
        "log_name": f"flight_{k + 1}.tlog",
        "verdict": "under",
        "worst_margin": 0.6,
        "flying_s": 600.0,
    }
    return row | usual | known


def rows_of(flights: int, **known: Any) -> list[dict[str, Any]]:
    return [flight_row(k, **known) for k in range(flights)]


def sums_of(flights: Sequence[FlightEvidence], digest: str = "m") -> list[dict[str, Any]]:
    """What `read_sums` gives of flights with the names of `rows_of`."""
    return [
        {"flight": f"{k:016x}", "model_digest": digest, "arrays": to_arrays(one)}
        for k, one in enumerate(flights)
    ]


def empty_store(folder: Path) -> SeasonStore:
    folder.mkdir()
    return SeasonStore.open(str(folder))


def made_store(folder: Path, aircraft: dict[str, Sequence[FlightEvidence]], **known: Any) -> str:
    """A store on disk with the flights of some aircraft."""
    store, rows = empty_store(folder), {"time_s": np.arange(2.0)}
    for place, (name, flights) in enumerate(aircraft.items()):
        for k, one in enumerate(flights):
            summary = flight_row(k, **known) | {
                "flight": f"{place:08x}{k:08x}",
                "model_digest": "m",
            }
            head = {key: summary[key] for key in ("flight", "started_unix_s", "model_digest")}
            kept = head | {"arrays": array_cells(to_arrays(one))}
            stage(store, SeasonFlight(aircraft=name, summary=summary, rows=rows, sums=kept))
    for where, keys in staged_partitions(store).items():
        merge(store, *where, keys)
    return str(folder)
