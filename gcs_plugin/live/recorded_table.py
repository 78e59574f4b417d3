"""The recorded table of samples: one row a moment and vehicle, every column one number, SI units.

Columns: `vehicle`, `boot` (restarts heard), `unix_s` (ground's clock), `clock_s` (vehicle's, since
boot), `time_s` (since the first row of this boot), each channel of a FlightTrack (vectors as _n _e
_d, _x _y _z or _roll _pitch _yaw, rotors as _1 _2 ...), the standard errors of channels that may be
inferred (_error), `flying`, then what the analysis made of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from thrustmargin.gcs_plugin.live.update import Update
from thrustmargin.models.flight import TRACK_CHANNELS

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
        names = TRACK_CHANNELS[channel].column_names(channel, rotors)
        _spread(table, [f"{name}_error" for name in names], error[new])
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
    return pa.RecordBatch.from_arrays([_column(v) for v in table.values()], names=list(table))


def _column(values: np.ndarray) -> pa.Array:
    """Numbers as an Arrow column; pyarrow's own way of an array first imports pandas, if it can."""
    import pyarrow as pa

    kinds = {"f8": pa.float64(), "i2": pa.int16(), "i1": pa.int8(), "b1": pa.bool_()}
    kind = kinds[values.dtype.str[1:]]
    packed = np.packbits(values, bitorder="little") if kind == pa.bool_() else values
    data = pa.py_buffer(np.ascontiguousarray(packed))
    return pa.Array.from_buffers(kind, values.size, [None, data])


def _spread(table: dict[str, Any], names: list[str], values: np.ndarray) -> None:
    columns = values[:, None] if values.ndim == 1 else values
    for number, name in enumerate(names):
        table[name] = columns[:, number]
