"""Which aircraft flew, by what the log says: serial number, board number, system id.

SQL on a store through duckdb: it reads the store's tables and nothing else, and writes nothing.

The tables are handed over by pyarrow, so duckdb itself needs no file: reading and writing files,
attaching databases, loading extensions and changing any of that are switched off and locked.

The data set of a season in a folder or bucket: whole objects in, tables out.

    flights/aircraft=A/month=2026-05/flights.parquet   one row a flight
    sums/aircraft=A/month=2026-05/sums.parquet         one row a flight: what identification needs
    rows/aircraft=A/month=2026-05/rows-1.parquet       10 Hz rows of the days 1 to 10, and so on
    rejected/rejected.parquet                          logs of which no flight was made
    _staged/A/2026-05/FLIGHT.zip                       flights read but not merged yet
    _store.json                                        how flights are named
    _writer.lock                                       held while somebody writes

A flight counts as stored when it is in `flights`; its rows and sums are there before it.
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

from thrustmargin.gcs_plugin.store.schema import FLIGHTS, table_schema
from thrustmargin.gcs_plugin.telemetry.recording import FlightLog
from thrustmargin.gcs_plugin.telemetry.settings.pulse_range import whole_number
from thrustmargin.gcs_plugin.telemetry.settings.reported_airframe import reported_airframe
from thrustmargin.models.errors import AirframeError, DataError, require
from thrustmargin.models.whole_file import regular, whole_file

if TYPE_CHECKING:
    import duckdb
    import pyarrow as pa
    import pyarrow.dataset as pa_dataset
    from fsspec import AbstractFileSystem


#: What ArduPilot says when it starts: its board, and its serial number in three words.
_BOARD = re.compile(r"^\S.* ([0-9A-F]{8}) ([0-9A-F]{8}) ([0-9A-F]{8})$")
#: What it says of its program, as "ArduCopter V4.5.7 (2a3dc4b7)".
_PROGRAM = re.compile(r"^((?:Ardu|APM:)\w+ V\S+(?: \([0-9a-f]+\))?)")
_NAME = re.compile(r"[\w.-]{1,80}")


@dataclass(frozen=True, slots=True)
class AircraftIdentity:
    """The name of an aircraft in the store, and what it rests on."""

    name: str
    by: str  # "given", "serial", "board number", "system id", "not known"


def checked_aircraft(name: str) -> str:
    """The name as given. Raises DataError where it cannot be that of a folder everywhere."""
    if not _NAME.fullmatch(name) or not name.strip("."):
        raise DataError(f"--aircraft {name!r}: give letters, digits and . _ - such as sprayer-7")
    return name


def aircraft_identity(log: FlightLog, given: str | None = None) -> AircraftIdentity:
    """Who flew. The system id alone is that of many aircraft: 1 unless somebody set another."""
    if given is not None:
        return AircraftIdentity(given, "given")
    serial = log.hardware_id or _serial_of_texts(log)
    if serial:
        return AircraftIdentity(f"serial-{serial}", "serial")
    if board := whole_number(log.parameters, "BRD_SERIAL_NUM"):
        return AircraftIdentity(f"board-{board}", "board number")
    if not log.vehicles:
        return AircraftIdentity("unknown", "not known")
    return AircraftIdentity(f"sysid-{log.vehicle}", "system id")


def board(log: FlightLog) -> str | None:
    """The autopilot that flew, by its serial number or its board number."""
    number = whole_number(log.parameters, "BRD_SERIAL_NUM")
    return log.hardware_id or _serial_of_texts(log) or (str(number) if number else None)


def layout(log: FlightLog) -> str | None:
    """The motor layout that the autopilot reports; None where it does not, or it is not known."""
    texts = [text for _, text in log.messages]
    try:
        return reported_airframe(log.parameters, facts=log.facts, texts=texts).layout
    except AirframeError:
        return None


def _serial_of_texts(log: FlightLog) -> str:
    for _, text in log.messages:
        if found := _BOARD.match(text.strip()):
            # Each word is printed from its last byte to its first.
            return "".join(bytes.fromhex(word)[::-1].hex() for word in found.groups())
    return ""


def firmware(log: FlightLog) -> str | None:
    """The autopilot's program as it says; None where it does not."""
    programs = (found[1] for _, text in log.messages if (found := _PROGRAM.match(text.strip())))
    return log.firmware or next(programs, None)


TABLES = ("flights", "rows", "sums", "rejected")
HEARD_S = 0.1  # within which Ctrl-C is heard
#: Rows of an answer at most: more is a table to copy, and memory that nobody has.
MOST_ROWS = 1_000_000
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
    """Return the safe fills (F,) kg of stored flights, null where only an older number is stored.

    Versions before `fill_limit_kg` stored the fill at the limit as `fill_kg`. Such a row has a
    `fill_low_kg` and no `fill_limit_kg`; its safe fill is unknown.
    """
    import pyarrow.compute as pc

    older = pc.and_(pc.is_null(fill_limit_kg), pc.is_valid(fill_low_kg))
    return pc.if_else(older, None, fill_kg)


NO_WORDS: Mapping[str, Callable[[str], Any]] = MappingProxyType({})


def _create_flights(
    connection: duckdb.DuckDBPyConnection, words: Mapping[str, Callable[[str], Any]]
) -> None:
    """Create the view `flights` of `stored_flights`, with safe fills and words.

    duckdb calls these functions only for columns that a query names.
    """
    connection.create_function(
        *("safe_fill", safe_fill, ["DOUBLE"] * len(FILL_COLUMNS), "DOUBLE"),
        type="arrow",  # pyright: ignore[reportArgumentType]
        null_handling="special",  # pyright: ignore[reportArgumentType]
    )
    made = ["safe_fill(fill_kg, fill_limit_kg, fill_low_kg) as fill_kg"]
    kinds = {"text": "VARCHAR", "words": "VARCHAR[]"}
    for column in (c for c in FLIGHTS if c.name in words):
        function, result = words[column.name], kinds[column.kind]
        connection.create_function(f"words_of_{column.name}", function, ["VARCHAR"], result)
        made.append(f"coalesce(words_of_{column.name}(answer), {column.name}) as {column.name}")
    connection.execute(
        f"create view flights as select * replace ({', '.join(made)}) from stored_flights"
    )


def query(
    store: SeasonStore, sql: str, words: Mapping[str, Callable[[str], Any]] = NO_WORDS
) -> pa.Table:
    """Return the answer of one SELECT over `flights`, `rows`, `sums` and `rejected`.

    `words` maps columns of `flights` to functions that make them of the column `answer`; where
    those return None, or there is no `answer`, the stored text is shown. Raises DataError
    with duckdb's reason where `sql` is no SELECT, and for an answer of more than MOST_ROWS rows.
    Ctrl-C ends a query that runs too long.
    """
    require("--sql", "duckdb")
    import duckdb

    with duckdb.connect() as connection:
        for table in TABLES:
            held = f"stored_{table}" if table == "flights" else table
            connection.register(held, store.dataset(table))
        _create_flights(connection, words)
        for name, value in CLOSED.items():
            connection.execute(f"SET {name} = {value}")
        try:
            statements = connection.extract_statements(sql)
            if len(statements) != 1 or statements[0].type != duckdb.StatementType.SELECT:
                raise DataError("--sql takes one SELECT statement, and nothing that writes")
            answer = _interruptible(connection, sql)
        except duckdb.Error as error:
            raise DataError(f"--sql: {str(error).splitlines()[0]}") from error
    if answer.num_rows > MOST_ROWS:
        raise DataError(f"--sql: the answer has more than {MOST_ROWS} rows; add a LIMIT or a WHERE")
    return answer


def _interruptible(connection: duckdb.DuckDBPyConnection, sql: str) -> pa.Table:
    """The answer, computed in a thread: duckdb holds the one that would hear of Ctrl-C."""
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
#: Files that are being written to a disk; what a killed writer leaves there means nothing.
DRAFTS = "_drafts"
#: How flights are named.
NAMES = "_store.json"
#: Month of a flight whose log has no time.
NO_MONTH = "unknown"
Arrays = Mapping[str, np.ndarray]


@dataclass(frozen=True, slots=True)
class SeasonStore:
    """A folder, or what any address of fsspec names; `root` is the path in `files`."""

    url: str
    files: AbstractFileSystem
    root: str

    @classmethod
    def open(cls, url: str) -> Self:
        """The store at a folder or address. Raises DataError when the address is no such."""
        require("a season's store", "fsspec", "pyarrow", "filelock")
        from fsspec.core import url_to_fs

        try:
            files, root = url_to_fs(url, use_listings_cache=False)
        except (ValueError, ImportError) as error:
            raise DataError(f"--store {url}: {error}; install 'thrustmargin[fleet]'") from error
        return cls(url, files, root.rstrip("/"))

    @property
    def on_disk(self) -> bool:
        """Whether it is a folder of this machine, or one that is mounted on it."""
        protocol = self.files.protocol
        return "file" in ((protocol,) if isinstance(protocol, str) else protocol)

    def path(self, key: str) -> str:
        return f"{self.root}/{key}"

    def keys(self, folder: str) -> list[str]:
        """Every object below a folder, in order; nothing where there is none."""
        try:
            found = self.files.find(self.path(folder))
        except FileNotFoundError:
            return []
        return sorted(str(path)[len(self.root) + 1 :] for path in found)

    def aircraft(self) -> list[str]:
        """Names of the aircraft that have flights."""
        try:
            found = self.files.ls(self.path("flights"), detail=False)
        except FileNotFoundError:
            return []
        return sorted(str(p).rstrip("/").rpartition("/aircraft=")[2] for p in found)

    def read(self, key: str) -> bytes:
        """The whole of one object. Raises OSError when it is a folder, a pipe or a device."""
        if self.on_disk:
            return regular(Path(self.path(key))).read_bytes()
        held = self.files.cat_file(self.path(key))
        return held if isinstance(held, bytes) else held.encode()

    def names(self) -> str | None:
        """What the key of this store's pseudonyms is known by; None where flights have names.

        Raises DataError where the note is damaged.
        """
        key = self.path(NAMES)
        if not self.files.exists(key):
            return None
        try:
            held = json.loads(self.read(NAMES))
        except (ValueError, RecursionError):
            held = None
        names = held.get("names", 0) if isinstance(held, dict) else 0
        if names is not None and not isinstance(names, str):
            raise DataError(
                f"{self.url}/{NAMES} is damaged: it does not say how flights are named; bring it "
                "back from a copy, or take the logs into another store"
            )
        return names

    def put(self, key: str, write: Callable[[Path], Any]) -> None:
        """Let `write` fill a file and put it in place in one step: nobody sees a part of it."""
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
        with contextlib.suppress(FileNotFoundError):
            self.files.rm_file(self.path(key))

    def table(
        self, name: str, aircraft: str | None = None, *, columns: list[str] | None = None
    ) -> pa.Table:
        """Read `flights`, `rows`, `sums` or `rejected`, with the aircraft and month of each row.

        `fill_kg` is the safe fill in every row, as `safe_fill` returns it. Raises DataError for a
        store of another version whose columns do not fit the schema.
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
        """Return a table as its files contain it, without reading rows.

        `fill_kg` of rows by older versions is still the fill at the limit.
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
    """What to do about a table that cannot be read."""
    why = (str(error).splitlines() or [type(error).__name__])[0]
    return f"{where} cannot be read ({why:.200}); bring it back from a copy, or take its logs anew"


def other_layout(where: str, error: Exception) -> str:
    """What to do about a table that another version wrote."""
    return (
        f"{where} is not in the layout of this version ({str(error).splitlines()[0]}); take its "
        "logs in with thrustmargin ingest --again, into it or another --store"
    )


def read_flights(store: SeasonStore, aircraft: str | None = None) -> pa.Table:
    """One row a flight, the columns of `schema.FLIGHTS` and aircraft and month, oldest first."""
    found = store.table("flights", aircraft)
    return found.sort_by([("aircraft", "ascending"), ("started_unix_s", "ascending")])


def read_sums(store: SeasonStore, aircraft: str | None = None) -> Iterator[dict[str, Any]]:
    """flight, aircraft, started_unix_s, model_digest and `arrays` by name of each flight."""
    found = store.table("sums", aircraft)
    for row in found.sort_by(
        [("aircraft", "ascending"), ("started_unix_s", "ascending")]
    ).to_pylist():
        yield {**row, "arrays": {a["name"]: _array(a) for a in row["arrays"]}}


def _array(stored: Mapping[str, Any]) -> np.ndarray:
    return np.frombuffer(stored["data"], "<f8").reshape(stored["shape"])


def array_cells(arrays: Arrays) -> list[dict[str, Any]]:
    """Arrays as the store keeps them."""
    return [
        {
            "name": name,
            "shape": list(values.shape),
            "data": np.ascontiguousarray(values, dtype="<f8").tobytes(),
        }
        for name, values in arrays.items()
    ]
