"""The recorded table of samples: one row a moment and vehicle, every column one number, SI units.

Columns: `vehicle`, `boot` (restarts heard), `unix_s` (ground's clock), `clock_s` (vehicle's, since
boot), `time_s` (since the first row of this boot), each channel of a FlightTrack (vectors as _n _e
_d, _x _y _z or _roll _pitch _yaw, rotors as _1 _2 ...), the standard errors of channels that may be
inferred (_error), `flying`, then what the analysis made of it.
`read_samples` gives them back as a FlightTrack.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from thrustmargin.gcs_plugin.live.vehicle_monitor import Update
from thrustmargin.models.errors import LogError
from thrustmargin.models.flight import TRACK_CHANNELS, FlightTrack

if TYPE_CHECKING:
    import pyarrow as pa


#: Channels that may be inferred, each with columns of its standard error.
INFERRED = ("rotor_speed_rpm", "tank_kg")


def sample_batch(update: Update, new: slice) -> pa.RecordBatch:
    """The rows `new` of an update as a record batch; one schema for one number of rotors."""
    import pyarrow as pa

    analysis, track = update.analysis, update.analysis.track
    rotors = track.rotor_count
    rows = track.time_s[new].size
    table: dict[str, Any] = {
        "vehicle": np.full(rows, update.vehicle, dtype=np.int16),
        "boot": np.full(rows, update.boot, dtype=np.int16),
        "unix_s": update.stamp_us[new] * 1e-6,
        "clock_s": update.clock_s[new],
        "time_s": track.time_s[new],
    }
    for channel, column in TRACK_CHANNELS.items():
        _spread(table, column.column_names(channel, rotors), getattr(track, channel)[new])
    for channel in INFERRED:  # standard errors, 0 where it was measured
        error = track.standard_errors.get(channel, np.zeros_like(getattr(track, channel)))
        _spread(table, _error_names(channel, rotors), error[new])
    table["flying"] = track.flying[new]
    prediction = analysis.prediction
    for name, values in (
        ("predicted_rpm", prediction.rotor_speed_rpm),
        ("lower_rpm", prediction.lower_rpm),
        ("upper_rpm", prediction.upper_rpm),
        ("margin", analysis.margin),
        ("margin_predicted", analysis.margin_predicted),
    ):
        _spread(table, [f"{name}_{k + 1}" for k in range(rotors)], values[new])
    table |= {
        "basis": prediction.basis[new],
        "density": analysis.density[new],
        "max_rotor_speed_rpm": analysis.max_rotor_speed_rpm[new],
        "weight": analysis.weight[new],
        "redundancy_yaw_kept": analysis.redundancy_yaw_kept[new],
        "redundancy_yaw_free": analysis.redundancy_yaw_uncontrolled[new],
        "trimmable_loss": analysis.trimmable_loss[new],
        "tank_by_thrust_kg": update.virtual_kg[new],
        "pumped_kg": update.pumped_kg[new],
        "margin_ahead": np.full(rows, update.outlook.margin_ahead),
        "seconds_to_empty": np.full(rows, update.outlook.seconds_to_empty),
    }
    return pa.record_batch({name: np.ascontiguousarray(v) for name, v in table.items()})


def _error_names(channel: str, rotors: int) -> list[str]:
    names = TRACK_CHANNELS[channel].column_names(channel, rotors)
    return [f"{name}_error" for name in names]


def _spread(table: dict[str, Any], names: list[str], values: np.ndarray) -> None:
    columns = values[:, None] if values.ndim == 1 else values
    for number, name in enumerate(names):
        table[name] = columns[:, number]


def sample_table(folder: Path) -> pa.Table:
    """All samples of a recording's folder, in order. Raises LogError when there are none."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    parts = sorted((folder / "samples").glob("*.parquet"))
    if not parts:
        raise LogError(f"{folder}: no samples in it; is it a folder that monitor recorded?")
    return pa.concat_tables([pq.read_table(p) for p in parts], promote_options="default")


def read_samples(folder: Path, vehicle: int, boot: int = 0) -> FlightTrack:
    """One vehicle's rows as they were seen live.

    Raises LogError when the folder holds no samples, or none of this vehicle.
    """
    table = sample_table(folder)
    chosen = (table["vehicle"].to_numpy() == vehicle) & (table["boot"].to_numpy() == boot)
    table = table.take(np.flatnonzero(chosen))
    if table.num_rows == 0:
        raise LogError(f"{folder}: no samples of vehicle {vehicle} after {boot} restarts")
    predicted = [name for name in table.column_names if name.startswith("predicted_rpm_")]
    rotors = sum(table[name].null_count < table.num_rows for name in predicted)
    channels: dict[str, Any] = {}
    for channel, column in TRACK_CHANNELS.items():
        names = column.column_names(channel, rotors)
        values = np.column_stack([table[name].to_numpy() for name in names])
        channels[channel] = values.reshape(column.shape(table.num_rows, rotors))
    errors: dict[str, Any] = {}
    for channel in INFERRED:
        names = [n for n in _error_names(channel, rotors) if n in table.column_names]
        values = np.column_stack([table[name].to_numpy() for name in names]) if names else None
        if values is not None and np.any(values > 0.0):
            errors[channel] = values.reshape(channels[channel].shape)
    return FlightTrack.of(
        name=f"{folder.name}, vehicle {vehicle}",
        time_s=table["time_s"].to_numpy(),
        rotor_count=rotors,
        flying=table["flying"].to_numpy(zero_copy_only=False),
        start_unix_s=float(table["unix_s"][0].as_py()),
        standard_errors=errors,
        **channels,
    )
