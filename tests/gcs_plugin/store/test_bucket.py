"""A store in a bucket is the store on a disk, and has one writer too."""

import time
from pathlib import Path

import pytest

from tests.gcs_plugin.peers.bucket import bucket
from tests.gcs_plugin.store.season import content, small_flight
from thrustmargin.gcs_plugin.store import writer_lock as lock_module
from thrustmargin.gcs_plugin.store.season_store import SeasonStore
from thrustmargin.gcs_plugin.store.staging import merge, stage, staged_partitions
from thrustmargin.gcs_plugin.store.writer_lock import writer_lock
from thrustmargin.models.errors import DataError


@pytest.fixture(scope="module")
def season_bucket():
    with pytest.MonkeyPatch.context() as patch, bucket("season", patch) as url:
        yield url


def filled(store: SeasonStore) -> SeasonStore:
    for numbers in ([1, 2, 3], [3, 4]):
        for number in numbers:
            stage(store, small_flight(number, aircraft="AB"[number % 2]))
        for (aircraft, month), keys in staged_partitions(store).items():
            merge(store, aircraft, month, keys)
    return store


@pytest.mark.slow
def test_a_bucket_holds_what_a_folder_holds(season_bucket: str, tmp_path: Path):
    there = filled(SeasonStore.open(f"{season_bucket}/one"))
    here = filled(SeasonStore.open(str(tmp_path)))
    assert content(there) == content(here)
    assert len(content(there)["flights"]) == 4
    assert staged_partitions(there) == {}


def test_a_second_writer_of_a_bucket_is_refused_until_the_first_ends(season_bucket: str):
    store = SeasonStore.open(f"{season_bucket}/two")
    with writer_lock(store) as check_lock:
        check_lock()
        with (
            pytest.raises(DataError, match="written by another command \\(process"),
            writer_lock(store),
        ):
            pass
    with writer_lock(store):
        pass


def test_a_writer_that_died_is_followed_and_stops_when_it_wakes(
    season_bucket: str, monkeypatch: pytest.MonkeyPatch
):
    store = SeasonStore.open(f"{season_bucket}/three")
    with writer_lock(store) as check_lock:
        monkeypatch.setattr(lock_module, "STALE_S", 0.0)
        with writer_lock(store), pytest.raises(DataError, match="taken over by another"):
            check_lock()


@pytest.mark.parametrize("off_s", [-1e6, 1e6])
def test_a_computer_s_clock_neither_frees_a_lock_nor_keeps_it(
    season_bucket: str, monkeypatch: pytest.MonkeyPatch, off_s: float
):
    store = SeasonStore.open(f"{season_bucket}/four{off_s:+.0f}")
    now = time.time()
    with writer_lock(store):
        monkeypatch.setattr(time, "time", lambda: now + off_s)
        with pytest.raises(DataError, match="written by another"), writer_lock(store):
            pass
        time.sleep(1.1)  # the bucket's times have whole seconds
        monkeypatch.setattr(lock_module, "STALE_S", 1.0)
        with writer_lock(store) as check_lock:
            check_lock()


@pytest.mark.slow
def test_an_address_of_nothing_is_one_line():
    with pytest.raises(DataError, match="--store nothing://x"):
        SeasonStore.open("nothing://x")
