"""From one flight to one object, and from many objects to the files of an aircraft's month.

A flight is staged as one zip of three tables, so that it is there whole or not at all. `merge` puts
the staged flights of one aircraft and month into that month's files: rows first, flights last, each
file in one step, then the staged objects go. Whatever dies in between, the next merge does the
same again and gets the same files, for they depend on the flights alone and not on their order.
"""

from __future__ import annotations

import errno
import io
import re
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from thrustmargin.gcs_plugin.store.schema import Columns, table_schema
from thrustmargin.gcs_plugin.store.season_store import (
    NO_MONTH,
    STAGED,
    SeasonStore,
    damaged_table,
    other_layout,
)
from thrustmargin.models.errors import DataError

if TYPE_CHECKING:
    import pyarrow as pa

FLIGHTS, SUMS = "flights.parquet", "sums.parquet"
#: What zipfile and readers of text raise over what is damaged, beside errors of pyarrow.
DAMAGED = (
    *(zipfile.BadZipFile, zlib.error, struct.error, EOFError, UnicodeDecodeError),
    *(NotImplementedError, RuntimeError),
)
_MEMBER = re.compile(r"(flights|sums|rows-[0-9a-z])\.parquet")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeasonFlight:
    """What the store keeps of one flight; a value that is unknown is None or NaN."""

    aircraft: str
    summary: dict[str, Any]  # the columns of schema.FLIGHTS
    rows: Columns  # those of `row_columns` that it has but `flight`
    sums: dict[str, Any] | None  # those of schema.SUMS

    @property
    def month(self) -> str:
        started = _started(self.summary)
        return NO_MONTH if started is None else f"{started:%Y-%m}"

    @property
    def rows_file(self) -> str:
        """One file a third of a month: large enough to read fast, small enough to write anew."""
        started = _started(self.summary)
        part = self.summary["flight"][0] if started is None else min((started.day - 1) // 10, 2) + 1
        return f"rows-{part}.parquet"


def _started(summary: dict[str, Any]) -> datetime | None:
    try:
        return datetime.fromtimestamp(summary["started_unix_s"], tz=UTC)
    except (TypeError, ValueError, OverflowError, OSError):
        return None


def stage(store: SeasonStore, flight: SeasonFlight) -> None:
    """Write one flight as one object, to be merged."""
    import pyarrow as pa

    name = flight.summary["flight"]
    tables = {
        flight.rows_file: _rows_table(name, flight.rows),
        FLIGHTS: pa.Table.from_pylist([_known(flight.summary)], schema=table_schema("flights")),
    }
    if flight.sums is not None:
        tables[SUMS] = pa.Table.from_pylist([_known(flight.sums)], schema=table_schema("sums"))

    def write(draft: Path) -> None:
        with zipfile.ZipFile(draft, "w") as whole:
            for member, table in tables.items():
                with whole.open(zipfile.ZipInfo(member), "w") as file, _writer(file, table) as out:
                    out.write_table(table, row_group_size=max(table.num_rows, 1))

    store.put(f"{STAGED}/{flight.aircraft}/{flight.month}/{name}.zip", write)


def _known(values: dict[str, Any]) -> dict[str, Any]:
    """NaN is null in the store: a database counts with NaN as if it were a number."""

    def known(value: Any) -> Any:
        if isinstance(value, list):
            return [known(one) for one in value]
        return None if isinstance(value, float) and not np.isfinite(value) else value

    return {name: known(value) for name, value in values.items()}


def _rows_table(flight: str, rows: Columns) -> pa.Table:
    import pyarrow as pa

    size = rows["time_s"].size
    columns = []
    schema = table_schema("rows")
    for field in schema:
        if field.name == "flight":
            columns.append(pa.array([flight], pa.string()).take(pa.array(np.zeros(size, np.int8))))
        elif field.name not in rows:
            columns.append(pa.nulls(size, field.type))
        else:
            values = rows[field.name]
            missing = ~np.isfinite(values) if values.dtype.kind == "f" else None
            columns.append(pa.array(values, mask=missing).cast(field.type))
    return pa.Table.from_arrays(columns, schema=schema)


def staged_partitions(store: SeasonStore) -> dict[tuple[str, str], list[str]]:
    """(aircraft, month) -> keys of the flights that wait to be merged."""
    found: dict[tuple[str, str], list[str]] = {}
    for key in store.keys(STAGED):
        if key.endswith(".zip"):
            _, aircraft, month, _ = key.split("/")
            found.setdefault((aircraft, month), []).append(key)
    return found


def drop_replaced(store: SeasonStore, waiting: dict[tuple[str, str], list[str]]) -> None:
    """Take out of the tables what staged flights replace and `merge` does not write over: that of
    another aircraft or time, sums that they have no longer, or another sortie of a log that is
    divided otherwise now. The flights wait staged meanwhile.
    """
    new = {Path(key).stem: key for keys in waiting.values() for key in keys}
    stored = store.table("flights", columns=["flight", "aircraft", "month"]).to_pylist()
    for row in stored:
        own, key = (row["aircraft"], row["month"]), new.get(row["flight"])
        kept: list[str] = []
        if key is not None:
            with _staged(store, key) as whole:
                kept = whole.namelist() if key in waiting.get(own, ()) else []
        elif row["flight"].partition("-")[0] not in new:
            continue
        for table in ("flights", "sums", "rows"):
            for target in store.keys(f"{table}/aircraft={own[0]}/month={own[1]}"):
                if target.rpartition("/")[2] not in kept:
                    _drop(store, target, row["flight"])


def _drop(store: SeasonStore, target: str, flight: str) -> None:
    """Write a file of a month anew without one flight; away with one that would be empty."""
    import pyarrow.compute as pc

    with _present(store, target) as file:
        groups = [file.read_row_group(k) for k in range(file.num_row_groups)]
    left = [group.filter(pc.field("flight") != flight) for group in groups]
    left = [group for group in left if group.num_rows]
    if sum(g.num_rows for g in left) == sum(g.num_rows for g in groups):
        return
    if not left:
        store.delete(target)
        return

    def write(draft: Path) -> None:
        with draft.open("wb") as out, _writer(out, left[0]) as writer:
            for group in left:
                writer.write_table(group, row_group_size=group.num_rows)

    store.put(target, write)


def merge(store: SeasonStore, aircraft: str, month: str, keys: list[str]) -> int:
    """Put the staged flights `keys` of one aircraft and month in place; returns how many."""
    members: dict[str, list[str]] = {}
    for key in keys:
        with _staged(store, key) as whole:
            for member in whole.namelist():
                members.setdefault(member, []).append(key)
    # A flight counts when it is among the flights: its rows and sums must stand before.
    for member in sorted(members, key=lambda m: (m == FLIGHTS, m)):
        table = member.removesuffix(".parquet").partition("-")[0]
        target = f"{table}/aircraft={aircraft}/month={month}/{member}"
        one_by_one = table == "rows"
        write = _rows_merged if one_by_one else _table_merged
        store.put(
            target, lambda draft, w=write, t=target, m=member: w(store, draft, t, m, members[m])
        )
    for key in keys:
        store.delete(key)
    return len(keys)


@contextmanager
def _readable(store: SeasonStore, key: str) -> Iterator[None]:
    """Raise DataError that names the object where what was written in it cannot be read.

    pyarrow calls a damaged file an OSError without a number; those of disks and networks have one.
    A damaged archive may ask for bytes before its start, which is EINVAL, or a method that is none.
    """
    import pyarrow as pa

    try:
        yield
    except (pa.ArrowException, *DAMAGED) as error:
        raise DataError(damaged_table(store.path(key), error)) from error
    except OSError as error:
        if error.errno not in (None, errno.EINVAL):
            raise
        raise DataError(damaged_table(store.path(key), error)) from error


@contextmanager
def _staged(store: SeasonStore, key: str) -> Iterator[zipfile.ZipFile]:
    opened: Any = store.files.open(store.path(key), "rb")
    with opened as file, _readable(store, key), zipfile.ZipFile(file) as whole:
        for member in whole.namelist():
            if not _MEMBER.fullmatch(member):  # its name becomes that of a file
                raise zipfile.BadZipFile(f"it holds {member!r:.40}")
        yield whole


def _staged_table(store: SeasonStore, key: str, member: str) -> pa.Table:
    import pyarrow.parquet as pq

    with _staged(store, key) as whole:
        return pq.read_table(io.BytesIO(whole.read(member)))


@contextmanager
def _present(store: SeasonStore, key: str) -> Iterator[Any]:
    """The Parquet file at a key; None where there is none."""
    import pyarrow.parquet as pq

    if not store.files.exists(store.path(key)):
        yield None
        return
    with store.files.open(store.path(key), "rb") as file, _readable(store, key):
        yield pq.ParquetFile(file)


def _table_merged(
    store: SeasonStore, draft: Path, target: str, member: str, keys: list[str]
) -> None:
    """All flights in one row group, by time."""
    import pyarrow as pa

    new = pa.concat_tables(_staged_table(store, key, member) for key in keys)
    with _present(store, target) as file:
        old = new.slice(0, 0) if file is None else file.read()
    newer = set(new["flight"].to_pylist())
    kept = old.filter(
        pa.array([name not in newer for name in old["flight"].to_pylist()], pa.bool_())
    )
    whole = pa.concat_tables([_as_now(kept, new, store.path(target)), new])
    whole = whole.sort_by([("started_unix_s", "ascending"), ("flight", "ascending")])
    with draft.open("wb") as out, _writer(out, whole) as writer:
        writer.write_table(whole.combine_chunks(), row_group_size=max(whole.num_rows, 1))


def _as_now(old: pa.Table, new: pa.Table, where: str) -> pa.Table:
    """In the columns of `new`: one that an older version did not write is null."""
    import pyarrow as pa

    if not old.num_rows or old.schema.equals(new.schema):
        return old if old.num_rows else new.slice(0, 0)
    try:
        both = pa.concat_tables([old, new.slice(0, 0)], promote_options="default")
        return both.select(new.column_names).cast(new.schema)
    except pa.ArrowException as error:
        raise DataError(other_layout(where, error)) from error


def _rows_merged(
    store: SeasonStore, draft: Path, target: str, member: str, keys: list[str]
) -> None:
    """A row group a flight, by the flights' names, one flight in memory at a time."""
    new = {Path(key).stem: key for key in keys}
    with _present(store, target) as file:
        old: dict[str, int] = {}
        described: Any = None if file is None else file.metadata
        for group in range(0 if file is None else described.num_row_groups):
            named = described.row_group(group).column(0).statistics
            if named is None:
                raise DataError(damaged_table(store.path(target), ValueError("no names in it")))
            old[named.min] = group
        names = sorted({*new, *old})
        with draft.open("wb") as out:
            first = _staged_table(store, keys[0], member)
            with _writer(out, first) as writer:
                for name in names:
                    if name in new:
                        rows = _staged_table(store, new[name], member)
                    else:
                        assert file is not None
                        rows = _as_now(file.read_row_group(old[name]), first, store.path(target))
                    writer.write_table(rows, row_group_size=max(rows.num_rows, 1))


def _writer(out: Any, table: pa.Table) -> Any:
    """Compressed as suits measurements: bytes of one weight side by side, few values repeat."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    numbers = [f.name for f in table.schema if pa.types.is_floating(f.type)]
    texts = [f.name for f in table.schema if pa.types.is_string(f.type)]
    encoding: Any = {"use_dictionary": texts, "use_byte_stream_split": numbers}
    return pq.ParquetWriter(out, table.schema, compression="zstd", **encoding)
