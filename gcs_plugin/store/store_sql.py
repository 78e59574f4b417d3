"""SQL on a store through duckdb: it reads the store's tables and nothing else, and writes nothing.

The tables are handed over by pyarrow, so duckdb itself needs no file: reading and writing files,
attaching databases, loading extensions and changing any of that are switched off and locked.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.store.season_store import SeasonStore
from thrustmargin.models.errors import DataError

if TYPE_CHECKING:
    import pyarrow as pa

TABLES = ("flights", "rows", "sums", "rejected")
CLOSED = {
    "autoinstall_known_extensions": "false",
    "autoload_known_extensions": "false",
    "python_enable_replacements": "false",
    "enable_external_access": "false",
    "lock_configuration": "true",
}


def query(store: SeasonStore, sql: str) -> pa.Table:
    """The answer of one SELECT over `flights`, `rows`, `sums` and `rejected`.

    Raises DataError with duckdb's reason where it is none.
    """
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
            return connection.sql(sql).to_arrow_table()
        except duckdb.Error as error:
            raise DataError(f"--sql: {str(error).splitlines()[0]}") from error
