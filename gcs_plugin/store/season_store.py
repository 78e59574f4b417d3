"""Keep the flights of a season as a data set in a folder or bucket, and query it with SQL.

For `learn`, which writes it, and `fleet`, which reads it. Objects are written whole and read as
tables:

    flights/aircraft=A/month=2026-05/flights.parquet   one row a flight
    sums/aircraft=A/month=2026-05/sums.parquet         one row a flight: what identification needs
    rows/aircraft=A/month=2026-05/rows-1.parquet       10 Hz rows of the days 1 to 10, and so on
    rejected/rejected.parquet                          logs of which no flight was made
    _staged/A/2026-05/FLIGHT.zip                       flights read but not merged yet
    _store.json                                        how flights are named
    _writer.lock                                       held while somebody writes

A flight counts as stored when it is in `flights`; its rows and sums are written before it.

An aircraft is named by the first of these that its log contains: serial number, board number,
system id. SQL runs in duckdb, to which pyarrow passes the tables: duckdb may not read or write
files, attach databases, load extensions or change its settings.
"""

from __future__ import annotations

import contextlib
import errno
import json
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from thrustmargin.gcs_plugin.store.aircraft_marks import serial_of_texts
from thrustmargin.gcs_plugin.store.schema import FLIGHTS, table_schema
from thrustmargin.gcs_plugin.telemetry.recording import FlightLog
from thrustmargin.gcs_plugin.telemetry.settings.pulse_range import whole_number
from thrustmargin.models.errors import DataError, require
from thrustmargin.models.whole_file import regular, whole_file

if TYPE_CHECKING:
    import duckdb
    import pyarrow as pa
    import pyarrow.dataset as pa_dataset
    from fsspec import AbstractFileSystem


#: ArduPilot's text with its version, such as "ArduCopter V4.5.7 (2a3dc4b7)".
_PROGRAM = re.compile(r"^((?:Ardu|APM:)\w+ V\S+(?: \([0-9a-f]+\))?)")


@dataclass(frozen=True, slots=True)
class AircraftIdentity:
    """The name of an aircraft in the store, and the source of that name."""

    name: str
    by: str  # "given", "serial", "board number", "system id", "not known"


def aircraft_identity(log: FlightLog, given: str | None = None) -> AircraftIdentity:
    """Return the aircraft's name in the store, and what it is made of.

    It is `given`, or made of the log's serial number, board number or MAVLink system id, the first
    that the log has. A system id is unreliable: it is 1 on every aircraft whose owner did not
    change it.
    """
    if given is not None:
        return AircraftIdentity(given, "given")
    serial = log.hardware_id or serial_of_texts(log)
    if serial:
        return AircraftIdentity(f"serial-{serial}", "serial")
    if board := whole_number(log.parameters, "BRD_SERIAL_NUM"):
        return AircraftIdentity(f"board-{board}", "board number")
    if not log.vehicles:
        return AircraftIdentity("unknown", "not known")
    return AircraftIdentity(f"sysid-{log.vehicle}", "system id")


def firmware(log: FlightLog) -> str | None:
    """Return the autopilot's program and version as reported; None if not reported."""
    programs = (found[1] for _, text in log.messages if (found := _PROGRAM.match(text.strip())))
    return log.firmware or next(programs, None)


TABLES = ("flights", "rows", "sums", "rejected")
HEARD_S = 0.1  # s between two checks for Ctrl-C
#: Rows of an answer, at most: more would not fit into the memory of a usual computer.
MOST_ROWS = 1_000_000
#: duckdb settings that deny files, networks and extensions, and lock themselves.
CLOSED = {
    "memory_limit": "'2GB'",
    "autoinstall_known_extensions": "false",
    "autoload_known_extensions": "false",
    "python_enable_replacements": "false",
    "enable_external_access": "false",
    "lock_configuration": "true",
}


#: Columns that `safe_fill` reads, in its order.
FILL_COLUMNS = ("fill_kg", "fill_limit_kg", "fill_low_kg")


def safe_fill(fill_kg: Any, fill_limit_kg: Any, fill_low_kg: Any) -> Any:
    """Return the safe fill of each stored flight, kg, as an Arrow array (F,); null for older
    versions.

    The arguments are columns (F,) of the table `flights`. In versions without `fill_limit_kg`,
    `fill_kg` was the fill at the limit, which is not safe. Such a row has a `fill_low_kg` but a
    null `fill_limit_kg`.
    """
    import pyarrow.compute

    pc: Any = pyarrow.compute  # its functions are made when it is imported
    older = pc.and_(pc.is_null(fill_limit_kg), pc.is_valid(fill_low_kg))
    return pc.if_else(older, None, fill_kg)


NO_WORDS: Mapping[str, Callable[[str], Any]] = MappingProxyType({})


def _create_flights(
    connection: duckdb.DuckDBPyConnection, words: Mapping[str, Callable[[str], Any]]
) -> None:
    """Create the SQL view `flights` of the table `stored_flights`.

    Its column `fill_kg` has the safe fills, and the columns in `words` are made by these functions
    of the column `answer`. duckdb calls a function only if a query names its column.
    """
    create: Any = connection.create_function  # it takes names of types, too
    numbers = ["DOUBLE"] * len(FILL_COLUMNS)
    create("safe_fill", safe_fill, numbers, "DOUBLE", type="arrow", null_handling="special")
    made = ["safe_fill(fill_kg, fill_limit_kg, fill_low_kg) as fill_kg"]
    kinds = {"text": "VARCHAR", "words": "VARCHAR[]", "wholes": "BIGINT[]"}
    for column in (c for c in FLIGHTS if c.name in words):
        function, result = words[column.name], kinds[column.kind]
        create(f"words_of_{column.name}", function, ["VARCHAR"], result)
        made.append(f"coalesce(words_of_{column.name}(answer), {column.name}) as {column.name}")
    connection.execute(
        f"create view flights as select * replace ({', '.join(made)}) from stored_flights"
    )


def query(
    store: SeasonStore, sql: str, words: Mapping[str, Callable[[str], Any]] = NO_WORDS
) -> pa.Table:
    """Return the result of one SELECT over the tables `flights`, `rows`, `sums` and `rejected`.

    `words` maps columns of `flights` to functions of the column `answer` (JSON) that return the
    column's text; where one returns None, or `answer` is null, the stored text is used. Raises
    DataError with duckdb's reason if `sql` is no SELECT or fails, and for more than MOST_ROWS rows.
    Ctrl-C ends the query.
    """
    require("--sql", "duckdb")
    import duckdb

    with duckdb.connect() as connection:
        for table in TABLES:
            name = f"stored_{table}" if table == "flights" else table
            connection.register(name, store.dataset(table))
        _create_flights(connection, words)
        for name, value in CLOSED.items():
            connection.execute(f"SET {name} = {value}")
        try:
            statements = connection.extract_statements(sql)
            if len(statements) != 1 or statements[0].type != duckdb.StatementType.SELECT:
                raise DataError("--sql takes one SELECT statement, and nothing that writes")
            answer = _run_interruptibly(connection, sql)
        except duckdb.Error as error:
            raise DataError(f"--sql: {str(error).splitlines()[0]}") from error
    if answer.num_rows > MOST_ROWS:
        raise DataError(f"--sql: the answer has more than {MOST_ROWS} rows; add a LIMIT or a WHERE")
    return answer


def _run_interruptibly(connection: duckdb.DuckDBPyConnection, sql: str) -> pa.Table:
    """Run the SELECT `sql` in a thread and return at most MOST_ROWS + 1 rows.

    duckdb blocks its thread; the main thread, which receives Ctrl-C, can so interrupt it.
    KeyboardInterrupt is raised then.
    """
    with ThreadPoolExecutor(max_workers=1) as worker:
        answer = worker.submit(lambda: connection.sql(sql).limit(MOST_ROWS + 1).to_arrow_table())
        try:
            while not answer.done():
                wait((answer,), timeout=HEARD_S)
        except KeyboardInterrupt:
            connection.interrupt()
            raise
    return answer.result()


STAGED = "_staged"
#: Folder of files that are being written on a disk; what a killed writer left there is deleted.
DRAFTS = "_drafts"
#: Object that contains the naming of flights: plain, or by pseudonyms of a key.
NAMES = "_store.json"
#: Month of a flight whose log has no time.
NO_MONTH = "unknown"
Arrays = Mapping[str, np.ndarray]


@dataclass(frozen=True, slots=True)
class SeasonStore:
    """A season's data set in a folder, or in a bucket at an address of fsspec.

    `root` is its path within the file system `files`.
    """

    url: str
    files: AbstractFileSystem
    root: str

    @classmethod
    def open(cls, url: str) -> Self:
        """Return the store at a folder or an fsspec address; neither has to exist yet.

        Raises DataError for an address with an unknown protocol, InstallError if a library is
        missing.
        """
        require("a season's store", "fsspec", "pyarrow", "filelock")
        from fsspec.core import url_to_fs

        try:
            files, root = url_to_fs(url, use_listings_cache=False)
        except (ValueError, ImportError) as error:
            raise DataError(f"--store {url}: {error}; install 'thrustmargin[fleet]'") from error
        return cls(url, files, root.rstrip("/"))

    @property
    def on_disk(self) -> bool:
        """Return True if the store is in a folder of this machine, mounted ones included."""
        protocol = self.files.protocol
        return "file" in ((protocol,) if isinstance(protocol, str) else protocol)

    def path(self, key: str) -> str:
        """Return the path of an object in `files`, by its key: the path below `root`."""
        return f"{self.root}/{key}"

    def keys(self, folder: str) -> list[str]:
        """List the keys of all objects below a folder, sorted; empty if the folder is missing."""
        try:
            found = self.files.find(self.path(folder))
        except FileNotFoundError:
            return []
        return sorted(str(path)[len(self.root) + 1 :] for path in found)

    def aircraft(self) -> list[str]:
        """List the names of the aircraft with flights in the store, sorted."""
        try:
            found = self.files.ls(self.path("flights"), detail=False)
        except FileNotFoundError:
            return []
        return sorted(str(p).rstrip("/").rpartition("/aircraft=")[2] for p in found)

    def read(self, key: str) -> bytes:
        """Return the content of one object. Raises OSError for a folder, a pipe or a device."""
        if self.on_disk:
            return regular(Path(self.path(key))).read_bytes()
        content = self.files.cat_file(self.path(key))
        return content if isinstance(content, bytes) else content.encode()

    def naming_key(self) -> str | None:
        """Return the name of the key with which the flights' pseudonyms were made; None without
        pseudonyms.

        None too in an empty store. Raises DataError if the object `_store.json` is damaged.
        """
        key = self.path(NAMES)
        if not self.files.exists(key):
            return None
        try:
            content = json.loads(self.read(NAMES))
        except (ValueError, RecursionError):
            content = None
        names = content.get("names", 0) if isinstance(content, dict) else 0
        if names is not None and not isinstance(names, str):
            raise DataError(
                f"{self.url}/{NAMES} is damaged: it does not say how flights are named; bring it "
                "back from a copy, or take the logs into another store"
            )
        return names

    def put(self, key: str, write: Callable[[Path], Any]) -> None:
        """Call `write` with the path of a temporary file, then move that file to the object `key`
        at once.

        Readers see the old object or the new one, never a part. Raises OSError if a disk or bucket
        refuses.
        """
        if self.on_disk:
            path = Path(self.path(key))
            path.parent.mkdir(parents=True, exist_ok=True)
            drafts = Path(self.path(DRAFTS))
            drafts.mkdir(exist_ok=True)
            # A folder of its own: machines that share the disk may have the same process ids.
            with (
                tempfile.TemporaryDirectory(dir=drafts) as own,
                whole_file(path, drafts=Path(own)) as draft,
            ):
                write(draft)
            return
        with tempfile.TemporaryDirectory() as folder:
            draft = Path(folder) / "object"
            write(draft)
            try:
                # An object appears when its last part has come.
                self.files.put_file(str(draft), self.path(key))
            except Exception as error:  # each kind of bucket has errors of its own
                words = f"{type(error).__name__}: {error}"
                raise OSError(errno.EIO, words, f"{self.url}/{key}") from error

    def delete(self, key: str) -> None:
        """Delete an object; do nothing if it is missing."""
        with contextlib.suppress(FileNotFoundError):
            self.files.rm_file(self.path(key))

    def table(
        self, name: str, aircraft: str | None = None, *, columns: list[str] | None = None
    ) -> pa.Table:
        """Read the table `name`: `flights`, `rows`, `sums` or `rejected`.

        `aircraft` limits it to one aircraft, `columns` to some columns. Each row also has aircraft
        and month, except in `rejected`. `fill_kg` is the safe fill, null where `safe_fill` does not
        know it. Raises DataError for a damaged file, and for another version whose columns do not
        fit.
        """
        import pyarrow as pa

        read, masked = columns, name == "flights" and (columns is None or "fill_kg" in columns)
        if masked and columns is not None:
            read = list(dict.fromkeys((*columns, *FILL_COLUMNS)))
        try:
            found = self.dataset(name, aircraft).to_table(columns=read)
            if not masked:
                return found
            place = found.column_names.index("fill_kg")
            fills = safe_fill(*(found[column] for column in FILL_COLUMNS))
            found = found.set_column(place, "fill_kg", fills)
            return found if columns is None else found.select(columns)
        except (pa.ArrowException, TypeError) as error:
            raise DataError(other_layout(f"{self.url}/{name}", error)) from error
        except (OSError, UnicodeDecodeError) as error:  # as pyarrow calls a damaged file, too
            raise DataError(damaged_table(f"{self.url}/{name}", error)) from error

    def dataset(self, name: str, aircraft: str | None = None) -> pa_dataset.Dataset:
        """Return the table `name` as an Arrow dataset, without reading its rows; empty if it has no
        file.

        `aircraft` limits it to one aircraft. In rows by older versions `fill_kg` is the fill at the
        limit, not the safe fill.
        """
        import pyarrow as pa
        import pyarrow.dataset as ds

        folders = pa.schema({"aircraft": pa.string(), "month": pa.string()})
        schema = table_schema(name)
        if name != "rejected":
            schema = pa.schema([*schema, *folders])
        folder = name if aircraft is None else f"{name}/aircraft={aircraft}"
        found = [self.path(key) for key in self.keys(folder) if key.endswith(".parquet")]
        if not found:
            return ds.dataset(schema.empty_table())
        return ds.dataset(
            found,
            schema=schema,
            filesystem=None if self.on_disk else self.files,
            format="parquet",
            partitioning=ds.HivePartitioning(folders),
        )


def damaged_table(where: str, error: Exception) -> str:
    """Return the error message, with its remedy, for a table that cannot be read."""
    why = (str(error).splitlines() or [type(error).__name__])[0]
    return f"{where} cannot be read ({why:.200}); bring it back from a copy, or take its logs anew"


def other_layout(where: str, error: Exception) -> str:
    """Return the error message, with its remedy, for a table with another version's columns."""
    return (
        f"{where} is not in the layout of this version ({str(error).splitlines()[0]}); take its "
        "logs in with thrustmargin learn --again --store, into it or another one"
    )


def read_flights(store: SeasonStore, aircraft: str | None = None) -> pa.Table:
    """Read one row per flight, sorted by aircraft and start time; of one aircraft or of all.

    The columns are those of `schema.FLIGHTS`, and `aircraft` and `month`.
    """
    found = store.table("flights", aircraft)
    return found.sort_by([("aircraft", "ascending"), ("started_unix_s", "ascending")])


def read_sums(store: SeasonStore, aircraft: str | None = None) -> Iterator[dict[str, Any]]:
    """Yield each flight's row of the table `sums`, sorted by aircraft and start time.

    `aircraft` limits them to one aircraft. A row has the columns of `schema.SUMS`, and `aircraft`
    and `month`; its `arrays` are a dict of name -> float64 array.
    """
    found = store.table("sums", aircraft)
    for row in found.sort_by(
        [("aircraft", "ascending"), ("started_unix_s", "ascending")]
    ).to_pylist():
        yield {**row, "arrays": {a["name"]: _decode_array(a) for a in row["arrays"]}}


def _decode_array(stored: Mapping[str, Any]) -> np.ndarray:
    """Return the array of one cell of `array_cells`; it is read-only."""
    return np.frombuffer(stored["data"], "<f8").reshape(stored["shape"])


def array_cells(arrays: Arrays) -> list[dict[str, Any]]:
    """Return a list of dicts, one for each named array, to be stored in a column.

    `name` is the array's name, `shape` a list of int, and `data` its values as bytes: little-endian
    float64 in C order. Arrays of other types are converted.
    """
    return [
        {
            "name": name,
            "shape": list(values.shape),
            "data": np.ascontiguousarray(values, dtype="<f8").tobytes(),
        }
        for name, values in arrays.items()
    ]
