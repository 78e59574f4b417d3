"""For tests of the monitor: its model, its recordings, and whether rows agree."""

from contextlib import AbstractContextManager
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tests.flight_channels import assert_same_channels
from thrustmargin.gcs_plugin.link import listener
from thrustmargin.gcs_plugin.live.live_monitor import MonitorStatus
from thrustmargin.gcs_plugin.live.watch.vehicle_monitor import VehicleMonitor
from thrustmargin.gcs_plugin.office.streams.collector import MonitorCollector
from thrustmargin.models.flight import TRACK_CHANNELS, FlightTrack
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

AIRFRAME = load_airframe("topxgun-f16-sitl")
MODEL = physics_model(AIRFRAME)


class Ground:
    """In place of a listener's clock: time passes only when a test moves `us` on."""

    def __init__(self, us: int = 1_700_000_000_000_000) -> None:
        self.us = us

    def now_us(self) -> int:
        return self.us

    def in_listeners(self) -> AbstractContextManager[object]:
        """Meanwhile, listeners that are made have this clock."""
        return patch.object(listener, "SteadyClock", lambda: self)


def same(ours: FlightTrack, theirs: FlightTrack, after: float = 1.0) -> None:
    """Rows agree in every channel.

    In the first second another source may stand in live, and the origin settles at take-off.
    """
    assert np.allclose(ours.time_s, theirs.time_s, rtol=0, atol=1e-4)
    start = ours.time_s > after
    airborne = np.arange(ours.time_s.size) >= int(np.argmax(theirs.flying))
    assert_same_channels(ours.rows(start), theirs.rows(start), but=["position_ned"])
    settled = start & airborne
    np.testing.assert_array_equal(ours.position_ned[settled], theirs.position_ned[settled])


def metrics_of(watch: VehicleMonitor) -> dict[str, list[tuple[dict[str, str], float]]]:
    """Name of each metric of one vehicle, at its newest row -> labels and value of its samples."""
    assert watch.last is not None
    now_us = int(watch.last.stamp_us[-1])
    fleet = SimpleNamespace(vehicles={watch.system: watch}, max_utilisation=0.5, old_s=1.5)
    counts = {field.name: 0 for field in fields(MonitorStatus)} | {"recorder": None}
    monitor: Any = SimpleNamespace(
        fleet=fleet, now_us=lambda: now_us, status=lambda: SimpleNamespace(**counts)
    )
    return {
        family.name: [(sample.labels, sample.value) for sample in family.samples]
        for family in MonitorCollector(monitor).collect()
    }


def recording_in(folder: Path) -> Path:
    (session,) = folder.iterdir()
    return session


def sample_table(folder: Path) -> pa.Table:
    """All samples of a recording's folder, in order; it may still be written to."""
    tables = []
    for part in sorted((folder / "samples").glob("*.parquet")):
        # `read_table` opens a file twice, and another may stand in its place by the second time.
        with pq.ParquetFile(part) as opened:
            tables.append(opened.read())
    return pa.concat_tables(tables, promote_options="default")


def read_samples(folder: Path, vehicle: int, boot: int = 0) -> FlightTrack:
    """One vehicle's rows as they were seen live."""
    table = sample_table(folder)
    chosen = (table["vehicle"].to_numpy() == vehicle) & (table["boot"].to_numpy() == boot)
    table = table.take(np.flatnonzero(chosen))
    predicted = [name for name in table.column_names if name.startswith("predicted_rpm_")]
    rotors = sum(table[name].null_count < table.num_rows for name in predicted)
    channels: dict[str, Any] = {}
    errors: dict[str, Any] = {}
    for channel, column in TRACK_CHANNELS.items():
        for found, ending in ((channels, ""), (errors, "_error")):
            names = [f"{name}{ending}" for name in column.column_names(channel, rotors)]
            if names and names[0] in table.column_names:
                values = np.column_stack([table[name].to_numpy() for name in names])
                found[channel] = values.reshape(column.shape(table.num_rows, rotors))
    return FlightTrack.of(
        name=f"{folder.name}, vehicle {vehicle}",
        time_s=table["time_s"].to_numpy(),
        rotor_count=rotors,
        flying=table["flying"].to_numpy(zero_copy_only=False),
        start_unix_s=float(table["unix_s"][0].as_py()),
        standard_errors={c: error for c, error in errors.items() if np.any(error > 0.0)},
        **channels,
    )
