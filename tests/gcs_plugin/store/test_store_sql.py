"""SQL on a store reads its tables, and can neither write nor read anything else."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.gcs_plugin.office.season.made_store import empty_store
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.store.season_store import query, read_flights
from thrustmargin.models.errors import DataError


def test_a_select_reads_the_tables(tmp_path: Path):
    store = empty_store(tmp_path / "season")
    assert query(store, "select count(*) as n from flights").to_pylist() == [{"n": 0}]
    assert "worst_margin" in query(store, "select * from flights").column_names


def test_the_fill_of_an_older_version_is_not_shown_as_the_safe_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """Older rows have the amount at the limit, 9.8 kg, as `fill_kg`, and no `fill_limit_kg`."""
    store = empty_store(tmp_path / "season")
    for month, row in (
        ("2026-01", {"flight": ["old"], "fill_kg": [9.8], "fill_low_kg": [8.6]}),
        (
            "2026-02",
            {"flight": ["new"], "fill_kg": [8.6], "fill_low_kg": [8.6], "fill_limit_kg": [9.8]},
        ),
        ("2026-03", {"flight": ["unknown"], "fill_kg": [0.0]}),
    ):
        folder = tmp_path / "season" / "flights" / "aircraft=a" / f"month={month}"
        folder.mkdir(parents=True)
        pq.write_table(pa.table(row), folder / "flights.parquet")
    found = query(store, "select flight, fill_kg, fill_limit_kg from flights order by month")
    assert found.to_pylist() == [
        {"flight": "old", "fill_kg": None, "fill_limit_kg": None},
        {"flight": "new", "fill_kg": 8.6, "fill_limit_kg": 9.8},
        {"flight": "unknown", "fill_kg": 0.0, "fill_limit_kg": None},
    ]
    rows = [store.table("flights"), store.table("flights", columns=["flight", "fill_kg"])]
    rows.append(read_flights(store))
    for table in rows:
        fills = {row["flight"]: row["fill_kg"] for row in table.to_pylist()}
        assert fills == {"old": None, "new": 8.6, "unknown": 0.0}
    assert rows[1].column_names == ["flight", "fill_kg"]
    season = str(tmp_path / "season")
    assert run(["fleet", season, "--compare", "old", "new"]) == 0
    (line,) = (x for x in capsys.readouterr().out.splitlines() if "fill_kg" in x)
    assert line.split() == ["fill_kg", "8.6"]


@pytest.mark.parametrize(
    "sql",
    [
        "copy (select 1) to '{}/out.csv'",
        "copy flights to '{}/season/out.parquet'",
        "attach '{}/x.db'",
        "export database '{}/all'",
        "select 1; copy (select 1) to '{}/out.csv'",
        "create table t as select 1",
        "set enable_external_access = true",
        "install httpfs",
        "load httpfs",
        "select * from read_csv('{}/secret.csv')",
        "select * from read_text('{}/secret.csv')",
        "select * from '{}/secret.csv'",
        "select * from glob('{}/*')",
        "select * from store",
        "no sql at all",
        "",
    ],
)
def test_nothing_else_is_read_or_written(tmp_path: Path, sql: str):
    store = empty_store(tmp_path / "season")
    (tmp_path / "secret.csv").write_text("a\n1\n")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(DataError, match="--sql"):
        query(store, sql.format(tmp_path))
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="Ctrl-C of a console is another one there")
def test_ctrl_c_ends_a_query_that_does_not(tmp_path: Path):
    empty_store(tmp_path / "season")
    code = (
        "import sys; from thrustmargin.gcs_plugin.store.season_store import SeasonStore; "
        "from thrustmargin.gcs_plugin.store.season_store import query; print('begun', flush=True); "
        "query(SeasonStore.open(sys.argv[1]), 'with recursive t(n) as (select 1 union all select "
        "n + 1 from t) select count(*) from t')"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "season")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as running:
        assert running.stdout is not None
        running.stdout.readline()
        with pytest.raises(subprocess.TimeoutExpired):
            running.wait(2.0)
        running.send_signal(signal.SIGINT)
        try:
            _, said = running.communicate(timeout=120)
        finally:
            running.kill()
    assert b"KeyboardInterrupt" in said


def test_an_answer_without_end_is_bounded(tmp_path: Path):
    store = empty_store(tmp_path / "season")
    assert query(store, "SELECT * FROM range(1000000)").num_rows == 1_000_000
    with pytest.raises(DataError, match="more than 1000000 rows; add a LIMIT"):
        query(store, "SELECT * FROM range(1000000000000)")


def test_the_order_that_was_asked_for_stays(tmp_path: Path):
    answer = query(
        empty_store(tmp_path / "season"), "SELECT * FROM range(5000) AS t(n) ORDER BY n DESC"
    )
    assert answer.column(0).to_pylist() == list(range(4999, -1, -1))


def test_memory_is_bounded(tmp_path: Path):
    (row,) = query(
        empty_store(tmp_path / "season"), "SELECT current_setting('memory_limit') AS most"
    ).to_pylist()
    assert row["most"] == "1.8 GiB"  # 2 GB
