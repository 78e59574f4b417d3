"""SQL on a store through duckdb: it reads the store's tables and nothing else, and writes nothing.

The tables are handed over by pyarrow, so duckdb itself needs no file: reading and writing files,
attaching databases, loading extensions and changing any of that are switched off and locked.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor, wait
from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.store.season_store import SeasonStore
from thrustmargin.models.errors import DataError, require

if TYPE_CHECKING:
    import duckdb
    import pyarrow as pa

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


def query(store: SeasonStore, sql: str) -> pa.Table:
    """The answer of one SELECT over `flights`, `rows`, `sums` and `rejected`.

    Raises DataError with duckdb's reason where it is none, or where it has more than MOST_ROWS.
    Ctrl-C ends a query that does not.
    """
    require("--sql", "duckdb")
    import duckdb

    with duckdb.connect() as connection:
        for table in TABLES:
            connection.register(table, store.dataset(table))
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
