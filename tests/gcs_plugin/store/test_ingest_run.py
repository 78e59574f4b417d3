"""A run over many logs: bad ones are listed, dead processes lose nothing, one writer at a time."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from tests.gcs_plugin.store.season import content, files, log_files, small_flight, stage_number
from tests.import_graph import ROOT
from tests.waiting import until
from thrustmargin.gcs_plugin.store.ingest_run import (
    IngestOutcome,
    LogSource,
    ingest_logs,
    known_contents,
)
from thrustmargin.gcs_plugin.store.season_store import SeasonStore
from thrustmargin.gcs_plugin.store.staging import (
    SeasonFlight,
    drop_replaced,
    merge,
    stage,
    staged_partitions,
)
from thrustmargin.gcs_plugin.store.worker_processes import process_pool
from thrustmargin.gcs_plugin.store.writer_lock import writer_lock
from thrustmargin.models.errors import DataError

#: One run in a process of its own, to be killed: folder of logs, store, folder of marks.
RUN = """
import sys
from functools import partial
from pathlib import Path
from tests.gcs_plugin.store.season import stage_number
from tests.gcs_plugin.store.test_ingest_run import run
from thrustmargin.gcs_plugin.store.ingest_run import LogSource

if __name__ == "__main__":
    logs = [LogSource(str(p), p.name, 1) for p in sorted(Path(sys.argv[1]).iterdir())]
    run(Path(sys.argv[2]), logs, slow=Path(sys.argv[3]))
"""


def run(
    folder: Path,
    logs: list[LogSource],
    slow: Path | None = None,
    refused: Sequence[tuple[str, str]] = (),
    workers: tuple[Callable[[], Executor], int] | None = None,
) -> IngestOutcome:
    store = SeasonStore.open(str(folder))
    make, at_once = workers or (partial(process_pool, 2), 4)
    with writer_lock(store) as check_lock:
        return ingest_logs(
            store,
            logs,
            partial(stage_number, store=str(folder), slow=slow),
            executor=make,
            at_once=at_once,
            check_lock=check_lock,
            show=lambda *_: None,
            refused=refused,
        )


@pytest.mark.slow
def test_what_goes_wrong_is_listed_and_stops_nothing(tmp_path: Path):
    logs = log_files(
        tmp_path,
        one="1",
        two="2",
        twice="1",
        bad="bad 3",
        bug="bug 4",
        deadly=f"die {tmp_path / 'mark'}",
        once=f"die-once {tmp_path / 'marked'} 5",
        six="6",
    )
    gone = LogSource(str(tmp_path / "gone.tlog"), "gone.tlog", 1)
    outcome = run(tmp_path / "store", [*logs, gone])
    assert len(outcome.flights) == 4
    assert outcome.already == 1
    reasons = {row["log_name"]: row["reason"] for row in outcome.rejected}
    assert set(reasons) == {"bad.tlog", "bug.tlog", "deadly.tlog", "gone.tlog"}
    assert reasons["bad.tlog"] == "nothing in it"
    assert "ZeroDivisionError while reading it" in reasons["bug.tlog"]
    assert "process that read it died" in reasons["deadly.tlog"]
    store = SeasonStore.open(str(tmp_path / "store"))
    assert len(content(store)["flights"]) == 4
    listed = store.table("rejected").to_pylist()
    assert {row["log_name"]: row["reason"] for row in listed} == reasons

    (tmp_path / "bad.tlog").write_text("7")
    again = run(tmp_path / "store", logs)
    assert (len(again.flights), again.already) == (1, 5)
    left = store.table("rejected")["log_name"].to_pylist()
    assert "bug.tlog" in left
    assert len(content(store)["flights"]) == 5


def test_a_rejected_log_is_known_by_what_it_holds_and_a_refused_name_by_itself(tmp_path: Path):
    refused = [("north.zip", "no log"), ("south.zip", "no log")]
    for name in ("first", "renamed"):
        logs = log_files(tmp_path, **{name: "bad 3", "other": "bad 4"})
        workers = (partial(ThreadPoolExecutor, 1), 1)
        run(tmp_path / "store", logs, refused=refused, workers=workers)
    listed = SeasonStore.open(str(tmp_path / "store")).table("rejected")["log_name"].to_pylist()
    assert listed == ["north.zip", "other.tlog", "renamed.tlog", "south.zip"]


def test_sums_that_a_flight_has_no_longer_are_gone(tmp_path: Path):
    store = SeasonStore.open(str(tmp_path))
    for number in (1, 3):
        stage(store, small_flight(number))
    for again in range(2):
        waiting = staged_partitions(store)
        drop_replaced(store, waiting)
        for where, keys in waiting.items():
            merge(store, *where, keys)
        assert len(content(store)["sums"]) == 2 - again
        stage(store, replace(small_flight(3), sums=None))
    assert [len(rows) for rows in content(store).values()] == [2, 1, 6]


def test_a_second_writer_is_refused_with_who_writes(tmp_path: Path):
    store = SeasonStore.open(str(tmp_path))
    with writer_lock(store):
        other = SeasonStore.open(str(tmp_path))
        mine = f"another command \\(process {os.getpid()} on "
        with pytest.raises(DataError, match=mine), writer_lock(other):
            pass
    with writer_lock(store):
        pass


@pytest.mark.slow
def test_killed_and_run_again_it_is_as_if_never_killed(tmp_path: Path):
    logs, marks = tmp_path / "logs", tmp_path / "marks"
    logs.mkdir()
    marks.mkdir()
    given = log_files(logs, **{f"log{n}": str(n) for n in range(6)})
    code = tmp_path / "run.py"
    code.write_text(RUN)
    words = [sys.executable, str(code), str(logs), str(tmp_path / "killed"), str(marks)]
    paths = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    with subprocess.Popen(words, env={**os.environ, "PYTHONPATH": paths}) as process:
        while len(list(marks.iterdir())) < 5:
            assert process.poll() is None
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
    again = run(tmp_path / "killed", given)
    assert len(again.flights) + again.already == 6
    run(tmp_path / "whole", given)
    assert files(tmp_path / "killed") == files(tmp_path / "whole")
    assert staged_partitions(SeasonStore.open(str(tmp_path / "killed"))) == {}


@pytest.mark.slow
def test_ctrl_c_ends_the_processes_too_and_the_rest_follows(tmp_path: Path):
    logs = sorted((ROOT / "sitl_logs/campaign").glob("v2*q2.5.tlog"))
    command = [sys.executable, "-m", "thrustmargin.gcs_plugin.cli", "learn", *map(str, logs)]
    command += ["--store", str(tmp_path), "--workers", "2"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        while len(list(tmp_path.rglob("*.zip"))) < 1:
            assert process.poll() is None
            time.sleep(0.01)
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=120)
    assert process.returncode == 130
    assert said == "thrustmargin: stopped; files that were finished are whole\n"
    assert children
    until(lambda: not any(Path(f"/proc/{child}").exists() for child in children))
    assert subprocess.run(command, check=False).returncode == 0
    assert len(content(SeasonStore.open(str(tmp_path)))["flights"]) == len(logs)


def _sortie(number: int, sortie: int) -> SeasonFlight:
    """A small flight as a sortie of the log of that number."""
    made = small_flight(number)
    name = made.summary["flight"] + (f"-sortie-{sortie}" if sortie > 1 else "")
    return replace(made, summary=made.summary | {"flight": name}, sums=None)


def test_a_sortie_that_a_log_has_no_longer_is_gone(tmp_path: Path):
    store = SeasonStore.open(str(tmp_path))
    stage(store, small_flight(3))
    for sorties in (3, 2):
        for sortie in range(1, sorties + 1):
            stage(store, _sortie(1, sortie))
        waiting = staged_partitions(store)
        drop_replaced(store, waiting)
        for where, keys in waiting.items():
            merge(store, *where, keys)
        names = [row["flight"].lstrip("0") for row in content(store)["flights"]]
        assert names == [*["1", "1-sortie-2", "1-sortie-3"][:sorties], "3"]
        assert len(content(store)["rows"]) == 3 * (sorties + 1)


def test_a_log_of_which_only_a_later_sortie_is_stored_is_read_again(tmp_path: Path):
    store = SeasonStore.open(str(tmp_path))
    stage(store, _sortie(1, 2))
    assert known_contents(store) == set()
    stage(store, _sortie(1, 1))
    assert known_contents(store) == {f"{1:016x}"}
