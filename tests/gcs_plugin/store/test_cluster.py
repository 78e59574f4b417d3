"""Workers of a Dask cluster make the store that one machine makes, to the last bit."""

import threading
from pathlib import Path

import pytest

from tests.gcs_plugin.peers.bucket import bucket
from tests.gcs_plugin.peers.cluster import cluster
from tests.gcs_plugin.store.season import content, files
from tests.import_graph import ROOT
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.store.season_store import SeasonStore

DRAFTS, STAGED = "_drafts", "_staged"  # folders of a store
CAMPAIGN = ROOT / "sitl_logs/campaign"
LOGS = [str(CAMPAIGN / f"v{v}_m{m}_q2.5.tlog") for v in (2, 4) for m in (4, 16)]


@pytest.mark.slow
def test_a_worker_that_dies_loses_nothing_and_the_result_is_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    alone, shared = tmp_path / "alone", tmp_path / "shared"
    assert run(["learn", *LOGS, "--store", str(alone), "--workers", "2"]) == 0
    with bucket("fleet", monkeypatch) as url, cluster(tmp_path, 2) as (scheduler, workers):

        def kill_one() -> None:
            while not list((shared / STAGED).rglob("*.zip")):
                ended.wait(0.02)
            workers[0].kill()

        ended = threading.Event()
        killer = threading.Thread(target=kill_one)
        killer.start()
        assert run(["learn", *LOGS, "--store", str(shared), "--cluster", scheduler]) == 0
        killer.join()
        assert workers[0].wait() != 0
        assert run(["learn", *LOGS[:2], "--store", f"{url}/s", "--cluster", scheduler]) == 0
        first = content(SeasonStore.open(f"{url}/s"))["flights"]
    assert files(shared) == files(alone)
    assert not list((shared / DRAFTS).rglob("*.parquet"))
    stored = {row["flight"]: row for row in content(SeasonStore.open(str(alone)))["flights"]}
    assert len(stored) == 4
    assert first == [stored[row["flight"]] for row in first]
    assert len(first) == 2


@pytest.mark.slow
def test_no_scheduler_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    words = [LOGS[0], "--store", str(tmp_path / "s"), "--cluster", "tcp://127.0.0.1:9"]
    assert run(["learn", *words]) == 1
    said = capsys.readouterr().err
    assert said.startswith("thrustmargin: no Dask scheduler answers at tcp://127.0.0.1:9")
    assert said.count("\n") == 1
