"""Every column has its unit and meaning in docs/fleet.md, and the example there runs."""

import runpy
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.gcs_plugin.store.season import small_flight
from tests.import_graph import ROOT
from tests.models.made_flights import curve_model, level_flight
from thrustmargin.gcs_plugin.store.schema import (
    FLIGHTS,
    REJECTED,
    ROW_HEAD,
    SUMS,
    analysis_columns,
    column_units,
    table_schema,
)
from thrustmargin.gcs_plugin.store.season_store import SeasonStore
from thrustmargin.gcs_plugin.store.staging import merge, stage, staged_partitions
from thrustmargin.models.model.analysis import analyse

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


def test_an_analysis_fills_every_column_and_says_how_sure_a_load_is():
    track = level_flight(rows=3, tank_kg=np.full(3, 8.0))
    track = replace(track, standard_errors={"tank_kg": np.array([0.5, 0.6, 0.7])})
    made = analysis_columns(analyse(track, curve_model()), slice(1, 3))
    assert list(made) == list(column_units(track.rotor_count))
    assert made["tank_kg_error"].tolist() == [0.6, 0.7]
    assert made["rotor_speed_rpm_1_error"].tolist() == [0.0, 0.0]


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
