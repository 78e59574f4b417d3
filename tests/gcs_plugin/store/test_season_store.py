"""The note on how the flights of a store are named: read, or refused in one line."""

import json
import os
import threading
import uuid
from contextlib import ExitStack
from pathlib import Path

import pytest

from thrustmargin.gcs_plugin.store import writer_lock as lock_module
from thrustmargin.gcs_plugin.store.season_store import SeasonStore
from thrustmargin.gcs_plugin.store.writer_lock import writer_lock
from thrustmargin.models.errors import DataError


@pytest.mark.parametrize(
    "held",
    [
        b"",
        b"{",
        b"\xff\xfe",
        b"[]",
        b"{}",
        b'{"names": {"names": "k"}}',
        b"[" * 100_000,
        b"1",
        b'"k"',
    ],
)
def test_a_damaged_note_is_refused_with_what_to_do(tmp_path: Path, held: bytes):
    (tmp_path / "_store.json").write_bytes(held)
    with pytest.raises(DataError, match=r"_store.json is damaged: .*bring it back") as refused:
        SeasonStore.open(str(tmp_path)).naming_key()
    assert "\n" not in str(refused.value)


def test_a_whole_note_is_read_and_none_is_none(tmp_path: Path):
    store = SeasonStore.open(str(tmp_path))
    assert store.naming_key() is None
    (tmp_path / "_store.json").write_text(json.dumps({"names": "k"}))
    assert store.naming_key() == "k"
    (tmp_path / "_store.json").write_text('{"names": null}')  # flights keep their names
    assert store.naming_key() is None


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_pipe_in_place_of_the_note_is_refused(tmp_path):
    note = tmp_path / "_store.json"
    os.mkfifo(note)
    # Who reads it all the same gets an answer, and the test fails instead of waiting.
    threading.Thread(target=note.write_text, args=('{"names": null}',), daemon=True).start()
    with pytest.raises(OSError, match="it is a pipe or a device"):
        SeasonStore.open(str(tmp_path)).naming_key()


@pytest.fixture(params=["folder", "bucket"])
def store(request, tmp_path: Path) -> SeasonStore:
    """A store on the disk, and one in memory, which is written as a bucket is."""
    folder = request.param == "folder"
    return SeasonStore.open(str(tmp_path) if folder else f"memory://{uuid.uuid4().hex}")


def test_what_is_written_is_there_whole_or_not_at_all(store: SeasonStore):
    store.put("a/one", lambda draft: draft.write_bytes(b"before"))

    def breaks(draft: Path) -> None:
        draft.write_bytes(b"half")
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        store.put("a/one", breaks)
    assert store.read("a/one") == b"before"
    store.put("a/two", lambda draft: draft.write_bytes(b"2"))
    assert store.keys("a") == ["a/one", "a/two"]
    store.delete("a/one")
    store.delete("a/one")  # it may be gone already
    assert store.keys("a") == ["a/two"]
    assert store.keys("b") == []


def test_a_second_writer_is_refused_with_who_writes_and_the_next_is_not(store: SeasonStore):
    with writer_lock(store) as check_lock:
        check_lock()
        with (
            pytest.raises(DataError, match=rf"another command \(process {os.getpid()} on "),
            writer_lock(store),
        ):
            pass
        check_lock()  # who was refused took nothing away
    with writer_lock(store) as check_lock:
        check_lock()


def test_a_lock_in_a_bucket_that_nobody_can_read_or_renews_is_taken_over(
    monkeypatch: pytest.MonkeyPatch,
):
    store = SeasonStore.open(f"memory://{uuid.uuid4().hex}")
    store.files.pipe_file(store.path("_writer.lock"), b"{")
    with ExitStack() as later:
        with writer_lock(store) as first:
            first()
            monkeypatch.setattr(lock_module, "STALE_S", -1.0)
            second = later.enter_context(writer_lock(store))
            second()
            with pytest.raises(DataError, match="taken over by another command"):
                first()
        second()  # the first, when it ended, took nothing of the second's
    assert store.keys("") == []
