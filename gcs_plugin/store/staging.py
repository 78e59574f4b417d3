"""Stage each flight as one object, and merge staged objects into the files of a month.

A staged flight is one zip with a table for rows, sums and flights, so that it is stored completely
or not at all. `merge` adds the staged flights of one aircraft and month to the files of that month:
rows first, flights last, each file in one step. Then it deletes the staged objects. After an
interruption the next merge writes the same files again, because their content depends on the
flights alone and not on the order of merging.
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
#: Errors that zipfile and text decoders raise for damaged data, in addition to pyarrow's.
DAMAGED = (
    *(zipfile.BadZipFile, zlib.error, struct.error, EOFError, UnicodeDecodeError),
    *(NotImplementedError, RuntimeError),
)
_MEMBER = re.compile(r"(flights|sums|rows-[0-9a-z])\.parquet")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeasonFlight:
    """The data of one flight to be stored; an unknown value is None or NaN."""

    aircraft: str
    summary: dict[str, Any]  # the columns of schema.FLIGHTS
    rows: Columns  # columns of `schema.row_columns`, without `flight`; missing ones become null
    sums: dict[str, Any] | None  # the columns of schema.SUMS; None without evidence

    @property
    def month(self) -> str:
        """Return the month of the start, UTC, such as 2026-05; NO_MONTH if unknown."""
        started = _start_time(self.summary)
        return NO_MONTH if started is None else f"{started:%Y-%m}"

    @property
    def rows_file(self) -> str:
        """Return the name of the file in which the flight's 10 Hz rows are stored.

        Flights of one third of a month share a file: large enough to be read fast, small enough to
        be rewritten. Undated flights are divided by the first digit of their name.
        """
        started = _start_time(self.summary)
        part = self.summary["flight"][0] if started is None else min((started.day - 1) // 10, 2) + 1
        return f"rows-{part}.parquet"


def _start_time(summary: dict[str, Any]) -> datetime | None:
    """Return the start of a flight, UTC; None if it is unknown or no date."""
    try:
        return datetime.fromtimestamp(summary["started_unix_s"], tz=UTC)
    except (TypeError, ValueError, OverflowError, OSError):
        return None


def stage(store: SeasonStore, flight: SeasonFlight) -> None:
    """Write one flight as an archive into the store's staging area, from which `merge` takes it."""
    import pyarrow as pa

    name = flight.summary["flight"]
    tables = {
        flight.rows_file: _rows_table(name, flight.rows),
        FLIGHTS: pa.Table.from_pylist(
            [_nan_as_none(flight.summary)], schema=table_schema("flights")
        ),
    }
    if flight.sums is not None:
        tables[SUMS] = pa.Table.from_pylist(
            [_nan_as_none(flight.sums)], schema=table_schema("sums")
        )

    def write(draft: Path) -> None:
        with zipfile.ZipFile(draft, "w") as whole:
            for member, table in tables.items():
                with whole.open(zipfile.ZipInfo(member), "w") as file, _writer(file, table) as out:
                    out.write_table(table, row_group_size=max(table.num_rows, 1))

    store.put(f"{STAGED}/{flight.aircraft}/{flight.month}/{name}.zip", write)


def _nan_as_none(values: dict[str, Any]) -> dict[str, Any]:
    """Return the values with None in place of NaN and infinity, also inside lists.

    Databases take NaN for a number, for example in a mean.
    """

    def known(value: Any) -> Any:
        if isinstance(value, list):
            return [known(one) for one in value]
        return None if isinstance(value, float) and not np.isfinite(value) else value

    return {name: known(value) for name, value in values.items()}


def _rows_table(flight: str, rows: Columns) -> pa.Table:
    """Return a flight's rows as a table with all columns of the schema, in its types.

    A column that `rows` lacks is null, and so is NaN. `flight` is the flight's name.
    """
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
    """Return the keys of all staged flights, by (aircraft, month)."""
    found: dict[tuple[str, str], list[str]] = {}
    for key in store.keys(STAGED):
        if key.endswith(".zip"):
            _, aircraft, month, _ = key.split("/")
            found.setdefault((aircraft, month), []).append(key)
    return found


def drop_replaced(store: SeasonStore, waiting: dict[tuple[str, str], list[str]]) -> None:
    """Delete stored data that the staged flights replace, but that `merge` would not overwrite.

    These are flights stored under another aircraft or month, sums of flights that now have none,
    and sorties of a log that is now divided differently. `waiting` maps (aircraft, month) to the
    keys of staged flights.
    """
    new = {Path(key).stem: key for keys in waiting.values() for key in keys}
    stored = store.table("flights", columns=["flight", "aircraft", "month"]).to_pylist()
    for row in stored:
        own, key = (row["aircraft"], row["month"]), new.get(row["flight"])
        kept: list[str] = []
        if key is not None:
            with _open_staged(store, key) as whole:
                kept = whole.namelist() if key in waiting.get(own, ()) else []
        elif row["flight"].partition("-")[0] not in new:
            continue
        for table in ("flights", "sums", "rows"):
            for target in store.keys(f"{table}/aircraft={own[0]}/month={own[1]}"):
                if target.rpartition("/")[2] not in kept:
                    _drop_flight(store, target, row["flight"])


def drop_flight(store: SeasonStore, flight: str) -> None:
    """Delete the flight named `flight` from all tables and from the staging area, if present."""
    for key in store.keys(STAGED):
        if Path(key).stem == flight:
            store.delete(key)
    # A flight counts as stored when it is in `flights`: its rows and sums go after it.
    for table in ("flights", "sums", "rows"):
        for target in store.keys(table):
            _drop_flight(store, target, flight)


def _drop_flight(store: SeasonStore, target: str, flight: str) -> None:
    """Rewrite the object `target` of a table without one flight; delete it if no row remains.

    Nothing is written if the flight is not in it.
    """
    import pyarrow.compute as pc

    with _open_table(store, target) as file:
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
    """Move the staged flights `keys`, all of one aircraft and month, into the tables.

    Return their number. Rows and sums are written before the table `flights`, in which a flight
    counts as stored.
    """
    members: dict[str, list[str]] = {}
    for key in keys:
        with _open_staged(store, key) as whole:
            for member in whole.namelist():
                members.setdefault(member, []).append(key)
    # A flight counts as stored when it is in `flights`: its rows and sums must be there before.
    for member in sorted(members, key=lambda m: (m == FLIGHTS, m)):
        table = member.removesuffix(".parquet").partition("-")[0]
        target = f"{table}/aircraft={aircraft}/month={month}/{member}"
        one_by_one = table == "rows"
        write = _merge_rows if one_by_one else _merge_table
        store.put(
            target, lambda draft, w=write, t=target, m=member: w(store, draft, t, m, members[m])
        )
    for key in keys:
        store.delete(key)
    return len(keys)


@contextmanager
def _damage_as_data_error(store: SeasonStore, key: str) -> Iterator[None]:
    """Raise DataError, with the object's path, for an error of damaged data within the `with`
    block.

    pyarrow raises OSError without an errno for a damaged file; errors of disks and networks have
    one. A damaged archive may seek before its start (EINVAL) or name an unknown compression.
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
def _open_staged(store: SeasonStore, key: str) -> Iterator[zipfile.ZipFile]:
    """Yield the archive of a staged flight. Raises DataError if it is damaged."""
    opened: Any = store.files.open(store.path(key), "rb")
    with opened as file, _damage_as_data_error(store, key), zipfile.ZipFile(file) as whole:
        for member in whole.namelist():
            if not _MEMBER.fullmatch(member):  # a member's name becomes the name of a file
                raise zipfile.BadZipFile(f"it holds {member!r:.40}")
        yield whole


def _staged_table(store: SeasonStore, key: str, member: str) -> pa.Table:
    """Read one table of a staged flight."""
    import pyarrow.parquet as pq

    with _open_staged(store, key) as whole:
        return pq.read_table(io.BytesIO(whole.read(member)))


@contextmanager
def _open_table(store: SeasonStore, key: str) -> Iterator[Any]:
    """Yield the Parquet file at `key`; None if there is no such object.

    Raises DataError if it is damaged.
    """
    import pyarrow.parquet as pq

    if not store.files.exists(store.path(key)):
        yield None
        return
    with store.files.open(store.path(key), "rb") as file, _damage_as_data_error(store, key):
        yield pq.ParquetFile(file)


def _merge_table(
    store: SeasonStore, draft: Path, target: str, member: str, keys: list[str]
) -> None:
    """Write to `draft` the table at `target` with the staged flights added or replaced.

    `target` is the table's key in the store, `keys` are those of the staged archives, and `member`
    is the table's file name in the archives. The result has one row group, sorted by start time.
    """
    import pyarrow as pa

    new = pa.concat_tables(_staged_table(store, key, member) for key in keys)
    with _open_table(store, target) as file:
        old = new.slice(0, 0) if file is None else file.read()
    newer = set(new["flight"].to_pylist())
    kept = old.filter(
        pa.array([name not in newer for name in old["flight"].to_pylist()], pa.bool_())
    )
    whole = pa.concat_tables([_cast_to_schema(kept, new, store.path(target)), new])
    whole = whole.sort_by([("started_unix_s", "ascending"), ("flight", "ascending")])
    with draft.open("wb") as out, _writer(out, whole) as writer:
        writer.write_table(whole.combine_chunks(), row_group_size=max(whole.num_rows, 1))


def _cast_to_schema(old: pa.Table, new: pa.Table, where: str) -> pa.Table:
    """Return the table `old` with the columns and types of `new`.

    A column that `old` lacks, being of an older version, is null. `where` is its path for errors.
    Raises DataError if the types do not fit.
    """
    import pyarrow as pa

    if not old.num_rows or old.schema.equals(new.schema):
        return old if old.num_rows else new.slice(0, 0)
    try:
        both = pa.concat_tables([old, new.slice(0, 0)], promote_options="default")
        return both.select(new.column_names).cast(new.schema)
    except pa.ArrowException as error:
        raise DataError(other_layout(where, error)) from error


def _merge_rows(store: SeasonStore, draft: Path, target: str, member: str, keys: list[str]) -> None:
    """Write to `draft` the 10 Hz rows at `target` with the staged flights added or replaced.

    `target` is the table's key in the store, `keys` are those of the staged archives, and `member`
    is the table's file name in the archives. The result has one row group per flight, sorted by
    name; one flight is in memory at a time. Raises DataError if the table is damaged.
    """
    new = {Path(key).stem: key for key in keys}
    with _open_table(store, target) as file:
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
                        rows = _cast_to_schema(
                            file.read_row_group(old[name]), first, store.path(target)
                        )
                    writer.write_table(rows, row_group_size=max(rows.num_rows, 1))


def _writer(out: Any, table: pa.Table) -> Any:
    """Return a Parquet writer to `out` with the schema of `table`, compressed as suits
    measurements.

    Byte-stream split puts bytes of equal significance together, since few values repeat exactly.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    numbers = [f.name for f in table.schema if pa.types.is_floating(f.type)]
    texts = [f.name for f in table.schema if pa.types.is_string(f.type)]
    encoding: Any = {"use_dictionary": texts, "use_byte_stream_split": numbers}
    return pq.ParquetWriter(out, table.schema, compression="zstd", **encoding)
