"""The recorded table of samples: one row a moment and vehicle, every column one number, SI units.

Columns: `vehicle`, `boot` (restarts heard), `unix_s` (ground's clock), `clock_s` (vehicle's, since
boot), `time_s` (since the first row of this boot), those of `store/row_table`, then what only a
listener knows.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from thrustmargin.gcs_plugin.live.watch.update import Update
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
    # pyarrow's own way of an array first imports pandas, if it can. Doubles, which most columns
    # are, lie in one buffer: each array of its own would take as long as all of them.
    doubles = [values for values in table.values() if values.dtype == np.float64]
    joined = pa.py_buffer(np.array(doubles))
    whole = pa.Array.from_buffers(pa.float64(), rows * len(doubles), [None, joined])
    kinds = {"i2": pa.int16(), "i1": pa.int8(), "b1": pa.bool_()}
    columns, place = [], 0
    for values in table.values():
        if values.dtype == np.float64:
            columns.append(whole.slice(place, rows))
            place += rows
        else:
            buffers = [None, pa.py_buffer(_packed(values))]
            columns.append(pa.Array.from_buffers(kinds[values.dtype.str[1:]], rows, buffers))
    return pa.RecordBatch.from_arrays(columns, names=list(table))


def _packed(values: np.ndarray) -> bytes:
    """A column's bytes as Arrow has them."""
    return (np.packbits(values, bitorder="little") if values.dtype == bool else values).tobytes()
