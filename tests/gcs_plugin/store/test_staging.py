"""Flights come into the tables whole and once, in whatever order and however often it is tried."""

from collections.abc import Callable
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.gcs_plugin.store.season import content, files, small_flight
from thrustmargin.gcs_plugin.store.season_store import SeasonStore, read_flights, read_sums
from thrustmargin.gcs_plugin.store.staging import (
    drop_replaced,
    merge,
    stage,
    staged_partitions,
)
from thrustmargin.models.errors import DataError

#: Changes of the store while three flights come into it: each staged, merged and unstaged.
CHANGES = 3 + 3 * 3 + 3


class Killed(BaseException):
    """The process ends here."""


class Dying(SeasonStore):
    """A store whose process is killed before the change of that number."""

    __slots__ = ("left",)

    def __init__(self, path: Path, changes: int) -> None:
        opened = SeasonStore.open(str(path))
        super().__init__(opened.url, opened.files, opened.root)
        object.__setattr__(self, "left", changes)

    def _change(self) -> None:
        object.__setattr__(self, "left", self.left - 1)
        if self.left < 0:
            raise Killed

    def put(self, key, write):
        self._change()
        super().put(key, write)

    def delete(self, key):
        self._change()
        super().delete(key)


def fill(store: SeasonStore, numbers: list[int]) -> None:
    for number in numbers:
        aircraft, days = "AB"[number % 2], 12.0 * (number % 3)
        stage(store, small_flight(number, aircraft=aircraft, days=days))


def merge_all(store: SeasonStore) -> None:
    for (aircraft, month), keys in staged_partitions(store).items():
        merge(store, aircraft, month, keys)


def test_files_depend_on_the_flights_and_not_on_their_order(tmp_path: Path):
    one, other = (SeasonStore.open(str(tmp_path / name)) for name in ("one", "other"))
    fill(one, [1, 2, 3, 4, 5, 6, 7])
    merge_all(one)
    fill(other, [7, 2, 5])
    merge_all(other)
    fill(other, [5, 6, 1])
    merge_all(other)
    fill(other, [4, 3])
    merge_all(other)
    assert files(tmp_path / "one") == files(tmp_path / "other")
    assert len(content(one)["flights"]) == 7
    assert len(content(one)["rows"]) == 21
    assert staged_partitions(one) == {}


@pytest.fixture(scope="module")
def unharmed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Files of a store that nobody killed."""
    folder = tmp_path_factory.mktemp("unharmed")
    whole = SeasonStore.open(str(folder))
    fill(whole, [2, 8, 3])
    merge_all(whole)
    return files(folder)


@pytest.mark.parametrize("changes", range(CHANGES + 1))
def test_killed_before_any_change_nothing_is_lost_or_doubled(
    tmp_path: Path, unharmed: dict[str, bytes], changes: int
):
    dying = Dying(tmp_path / "dying", changes)
    killed = False
    try:
        fill(dying, [2])
        merge_all(dying)
        fill(dying, [8, 3])
        merge_all(dying)
    except Killed:
        killed = True
        seen = content(dying)
        for name, rows in seen.items():
            keys = [(row["flight"], row.get("time_s")) for row in rows]
            assert len(keys) == len(set(keys)), f"{name} has a flight twice"
        stored = {row["flight"] for row in seen["flights"]}
        assert stored <= {row["flight"] for row in seen["sums"]}
        assert stored <= {row["flight"] for row in seen["rows"]}
    assert killed == (changes < CHANGES)
    again = SeasonStore.open(str(tmp_path / "dying"))
    fill(again, [2, 8, 3])
    merge_all(again)
    assert files(tmp_path / "dying") == unharmed


def test_duckdb_polars_and_pandas_read_the_same(tmp_path: Path):
    store = SeasonStore.open(str(tmp_path))
    fill(store, [1, 2, 3, 4])
    merge_all(store)
    query = f"from '{tmp_path}/flights/**/*.parquet' select aircraft, month, flight order by flight"
    by_duckdb = duckdb.execute(query).fetchall()
    by_polars = pl.scan_parquet(f"{tmp_path}/flights/").sort("flight").collect()
    by_pandas = pd.read_parquet(tmp_path / "flights").sort_values("flight")
    expected = [(r["aircraft"], r["month"], r["flight"]) for r in content(store)["flights"]]
    assert by_duckdb == expected
    assert by_polars.select("aircraft", "month", "flight").rows() == expected
    rows = by_pandas[["aircraft", "month", "flight"]].to_numpy().tolist()
    assert rows == [list(row) for row in expected]
    voltage = duckdb.execute(f"select avg(voltage) from '{tmp_path}/rows/**/*.parquet'").fetchall()
    assert voltage[0][0] == pytest.approx((51 + 52 + 53 + 54 + 4 * 49) / 8)  # unknown is no number
    assert np.isfinite(pd.read_parquet(tmp_path / "rows")["voltage"].to_numpy()).sum() == 8
    assert pl.scan_parquet(f"{tmp_path}/rows/").collect()["voltage"].null_count() == 4


@pytest.mark.parametrize(
    ("day", "part"), [(1, 1), (10, 1), (11, 2), (20, 2), (21, 3), (28, 3), (0, 3)]
)
def test_a_month_has_a_file_for_each_ten_days_and_its_last_one_more(day: int, part: int):
    """Of February; its day 0 is the 31st of January."""
    made = small_flight(1, days=day - 2.0)
    assert made.rows_file == f"rows-{part}.parquet"


def test_flights_and_sums_come_back(tmp_path: Path):
    store = SeasonStore.open(str(tmp_path))
    assert read_flights(store).num_rows == 0
    fill(store, [1, 2, 3])
    merge_all(store)
    assert read_flights(store, "B")["flight"].to_pylist() == [f"{n:016x}" for n in (3, 1)]
    (sums,) = read_sums(store, "A")
    assert (sums["flight"], sums["aircraft"]) == (f"{2:016x}", "A")
    np.testing.assert_array_equal(sums["arrays"]["gram"], 2.0 * np.eye(2))


def rewritten(path: Path, change: Callable[[pa.Table], pa.Table]) -> None:
    """A file as another version would have written it, a row group a flight."""
    table = change(pq.ParquetFile(path).read())
    pq.write_table(table, path, row_group_size=3 if path.name.startswith("rows") else 100)


@pytest.mark.parametrize(("table", "column"), [("flights", "verdict"), ("rows", "voltage")])
def test_a_column_that_an_older_version_did_not_write_is_null(tmp_path: Path, table, column):
    store = SeasonStore.open(str(tmp_path))
    fill(store, [2])
    merge_all(store)
    (path,) = (tmp_path / table).rglob("*.parquet")
    rewritten(path, lambda old: old.drop_columns([column]))
    fill(store, [8])
    merge_all(store)
    rows = content(store)[table]
    assert {row[column] for row in rows if row["flight"] == f"{2:016x}"} == {None}
    assert {row["flight"] for row in rows} == {f"{2:016x}", f"{8:016x}"}


@pytest.mark.parametrize(("table", "column"), [("flights", "verdict"), ("rows", "voltage")])
def test_a_store_in_another_layout_names_what_takes_it_in_again(tmp_path: Path, table, column):
    store = SeasonStore.open(str(tmp_path))
    fill(store, [2])
    merge_all(store)
    (path,) = (tmp_path / table).rglob("*.parquet")
    words = pa.array([["in", "words"]] * pq.ParquetFile(path).metadata.num_rows)
    place = pq.ParquetFile(path).read().column_names.index(column)
    rewritten(path, lambda old: old.set_column(place, column, words))
    with pytest.raises(DataError, match="thrustmargin learn --again --store"):
        store.table(table)
    fill(store, [8])
    with pytest.raises(DataError, match="thrustmargin learn --again --store"):
        merge_all(store)
    fill(store, [2])
    merge_all(store)
    assert len(content(store)["rows"]) == 6


@pytest.mark.parametrize("table", ["flights", "rows", "sums"])
@pytest.mark.parametrize("kept", [0, 4, 700])
def test_a_damaged_table_is_refused_by_its_name_in_one_line(tmp_path: Path, table: str, kept: int):
    store = SeasonStore.open(str(tmp_path))
    stage(store, small_flight(0))
    merge_all(store)
    (file,) = (tmp_path / table).rglob("*.parquet")
    file.write_bytes(file.read_bytes()[:kept])
    with pytest.raises(DataError, match=rf"/{table}.*") as read:
        store.table(table)
    stage(store, small_flight(0))
    with pytest.raises(DataError, match=file.name) as merged:
        merge_all(store)
    assert "\n" not in f"{read.value}{merged.value}"


def test_a_damaged_flight_that_waits_is_refused_by_its_name(tmp_path: Path):
    store = SeasonStore.open(str(tmp_path))
    stage(store, small_flight(0))
    (file,) = tmp_path.rglob("*.zip")
    whole = file.read_bytes()
    outside = whole.replace(b"flights.parquet", b"../../a.parquet")  # as long
    for cut in (b"", whole[:100], whole[:60] + bytes(200) + whole[260:], outside):
        file.write_bytes(cut)
        with pytest.raises(DataError, match=r"\.zip cannot be read"):
            merge_all(store)


def test_a_figure_that_is_unknown_is_null_and_never_a_number(tmp_path: Path):
    store = SeasonStore.open(str(tmp_path))
    fill(store, [2])
    merge_all(store)
    (flights,) = (tmp_path / "flights").rglob("*.parquet")
    table = pq.ParquetFile(flights).read()
    assert table["hectares"].null_count == 1  # NaN when it was staged
    assert table["worst_margin"].to_pylist() == [0.5]
    (rows,) = (tmp_path / "rows").rglob("*.parquet")
    table = pq.ParquetFile(rows).read()
    assert table["voltage"].to_pylist() == [52.0, None, 49.0]
    assert table["margin_1"].null_count == 3  # not given at all


@pytest.mark.parametrize("started", [None, np.nan, 1e300])
def test_a_flight_without_a_time_has_a_month_of_its_own(tmp_path: Path, started):
    store, flight = SeasonStore.open(str(tmp_path)), small_flight(0xAB)
    flight.summary["started_unix_s"] = started
    assert flight.rows_file == "rows-0.parquet"  # by the first digit of its name
    stage(store, flight)
    assert list(staged_partitions(store)) == [("A", "unknown")]
    merge_all(store)
    assert (tmp_path / "rows/aircraft=A/month=unknown/rows-0.parquet").exists()


def test_a_flight_that_is_now_another_aircraft_s_leaves_the_one_before(tmp_path: Path):
    store = SeasonStore.open(str(tmp_path))
    fill(store, [2, 4])
    merge_all(store)
    assert store.aircraft() == ["A"]
    stage(store, small_flight(2, aircraft="C", days=24.0))
    drop_replaced(store, staged_partitions(store))
    assert read_flights(store)["flight"].to_pylist() == [f"{4:016x}"]
    merge_all(store)
    assert store.aircraft() == ["A", "C"]
    assert read_flights(store, "A")["flight"].to_pylist() == [f"{4:016x}"]
    assert read_flights(store, "C")["flight"].to_pylist() == [f"{2:016x}"]
    assert [sums["aircraft"] for sums in read_sums(store)] == ["A", "C"]
    assert len(content(store)["rows"]) == 6
