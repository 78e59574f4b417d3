"""Every column has its unit and meaning in docs/fleet.md, and the example there runs."""

import runpy
import sys
from pathlib import Path

import pytest

from tests.gcs_plugin.store.season import small_flight
from tests.import_graph import ROOT
from thrustmargin.gcs_plugin.store.row_table import column_units
from thrustmargin.gcs_plugin.store.schema import FLIGHTS, REJECTED, ROW_HEAD, SUMS, table_schema
from thrustmargin.gcs_plugin.store.season_store import SeasonStore
from thrustmargin.gcs_plugin.store.staging import merge, stage, staged_partitions

#: As the code has them, written down by hand: a change there is to be seen here.
ROTORS = 12

TEXT = (ROOT / "docs/fleet.md").read_text("utf-8")


def test_every_column_is_in_the_document_with_unit_and_meaning():
    for column in (*FLIGHTS, *ROW_HEAD, *SUMS, *REJECTED):
        assert f"| `{column.name}` | {column.unit} | {column.words} |" in TEXT
    by_unit: dict[str, list[str]] = {}
    for name, unit in column_units(1).items():
        by_unit.setdefault(unit, []).append(f"`{name}`")
    for unit, names in by_unit.items():
        assert f"| {unit} | {', '.join(names)} |" in TEXT


def test_rows_have_the_columns_of_every_rotor():
    names = table_schema("rows").names
    assert names == [*(c.name for c in ROW_HEAD), *column_units(ROTORS)]
    assert f"margin_{ROTORS}" in names


def test_the_example_asks_a_store_with_duckdb_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    store = SeasonStore.open(str(tmp_path))
    for number in (1, 2, 3):
        stage(store, small_flight(number, aircraft="AB"[number % 2]))
    for (aircraft, month), keys in staged_partitions(store).items():
        merge(store, aircraft, month, keys)
    monkeypatch.setattr(sys, "argv", ["season_queries.py", str(tmp_path)])
    runpy.run_path(str(ROOT / "docs/season_queries.py"), run_name="__main__")
    said = capsys.readouterr().out
    assert "  B | 2 | unknown | unknown | 0.5 | 0 | 0" in said
