"""The recorded table of samples: one row a moment and vehicle, every column one number, SI units.

Columns: `vehicle`, `boot` (restarts heard), `unix_s` (ground's clock), `clock_s` (vehicle's, since
boot), `time_s` (since the first row of this boot), those of `store/row_table`, then what only a
listener knows.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from thrustmargin.gcs_plugin.live.update import Update
from thrustmargin.gcs_plugin.store.row_table import analysis_columns

if TYPE_CHECKING:
    import pyarrow as pa


def sample_batch(update: Update, new: slice) -> pa.RecordBatch:
    """The rows `new` of an update as a record batch; one schema for one number of rotors."""
    import pyarrow as pa

    analysis, track = update.analysis, update.analysis.track
    rows = track.time_s[new].size
    table: dict[str, Any] = {
        "vehicle": np.full(rows, update.vehicle, dtype=np.int16),
        "boot": np.full(rows, update.boot, dtype=np.int16),
        "unix_s": update.stamp_us[new] * 1e-6,
        "clock_s": update.clock_s[new],
        "time_s": track.time_s[new],
    }
    table |= analysis_columns(analysis, new)
    table |= {
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
