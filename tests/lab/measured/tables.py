"""Tables of measured data as numpy columns, with errors that say which file and which column."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from thrustmargin.models.errors import DataError

Columns = dict[str, np.ndarray]


def csv_columns(
    path: Path, names: Sequence[str], *, words: Sequence[str] = (), delimiter: str = ","
) -> Columns:
    """The named columns of a CSV file: float64, NaN where empty, and those in `words` as text.

    A byte order mark before the first name is ignored. Raises DataError when the file is missing,
    is no table, lacks a column, holds no rows, or has words where there should be numbers.
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
    return _columns(table, path, names, words)


def parquet_columns(path: Path, names: Sequence[str], *, words: Sequence[str] = ()) -> Columns:
    """The named columns of a Parquet file, as `csv_columns` gives them."""
    try:
        table = pyarrow.parquet.read_table(path)
    except (OSError, pa.ArrowInvalid) as error:
        raise _unreadable(path, error) from error
    return _columns(table, path, names, words)


def _columns(table: Any, path: Path, names: Sequence[str], words: Sequence[str]) -> Columns:
    missing = [name for name in (*words, *names) if name not in table.column_names]
    if missing:
        raise DataError(
            f"{path.name} has no column {missing[0]!r}; it has {', '.join(table.column_names)}"
        )
    if not table.num_rows:
        raise DataError(f"{path.name} holds no rows")
    numbers = {name: _numbers(table[name], path, name) for name in names}
    return numbers | {
        name: np.array([str(cell) for cell in table[name].to_pylist()], dtype=object)
        for name in words
    }


def _numbers(column: Any, path: Path, name: str) -> np.ndarray:
    kind = column.type
    if pa.types.is_null(kind):
        return np.full(len(column), np.nan)
    if not (pa.types.is_integer(kind) or pa.types.is_floating(kind)):
        raise DataError(f"{path.name}: column {name!r} holds words where numbers are expected")
    return column.combine_chunks().to_numpy(zero_copy_only=False).astype(np.float64)


def _unreadable(path: Path, error: Exception) -> DataError:
    if not path.exists():
        return DataError(f"no file {path}")
    return DataError(f"cannot read {path} as a table: {' '.join(str(error).split())}")
