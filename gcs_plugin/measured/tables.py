"""Tables of measured data as numpy columns, with errors that say which file and which column."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from models.errors import DataError

Columns = dict[str, np.ndarray]


def csv_columns(path: Path, names: Sequence[str], *, delimiter: str = ",") -> Columns:
    """The named columns of a CSV file: numbers as float64 (NaN where empty), text as object.

    A byte order mark before the first name is ignored. Raises DataError when the file is missing,
    is no table, or lacks a column.
    """
    try:
        # pyarrow guesses a column's type from its first block: numbers come back as numbers.
        table = pyarrow.csv.read_csv(
            path,
            read_options=pyarrow.csv.ReadOptions(encoding="utf-8-sig"),
            parse_options=pyarrow.csv.ParseOptions(delimiter=delimiter),
        )
    except (OSError, pa.ArrowInvalid, UnicodeDecodeError) as error:
        raise _unreadable(path, error) from error
    return _columns(table, path, names)


def parquet_columns(path: Path, names: Sequence[str]) -> Columns:
    """The named columns of a Parquet file, as `csv_columns` gives them."""
    try:
        table = pyarrow.parquet.read_table(path)
    except (OSError, pa.ArrowInvalid) as error:
        raise _unreadable(path, error) from error
    return _columns(table, path, names)


def _columns(table: Any, path: Path, names: Sequence[str]) -> Columns:
    missing = [name for name in names if name not in table.column_names]
    if missing:
        raise DataError(
            f"{path.name} has no column {missing[0]!r}; it has {', '.join(table.column_names)}"
        )
    return {name: _values(table[name]) for name in names}


def _values(column: Any) -> np.ndarray:
    column = column.combine_chunks()
    if pa.types.is_dictionary(column.type):
        column = column.dictionary_decode()
    if pa.types.is_integer(column.type) or pa.types.is_floating(column.type):
        return column.to_numpy(zero_copy_only=False).astype(np.float64)
    return np.array(column.to_pylist(), dtype=object)


def _unreadable(path: Path, error: Exception) -> DataError:
    if not path.exists():
        return DataError(f"no file {path}")
    return DataError(f"cannot read {path} as a table: {error}")
