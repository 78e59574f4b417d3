"""The note on how the flights of a store are named: read, or refused in one line."""

import json
import os
import threading
from pathlib import Path

import pytest

from thrustmargin.gcs_plugin.store.season_store import SeasonStore
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
        SeasonStore.open(str(tmp_path)).names()
    assert "\n" not in str(refused.value)


def test_a_whole_note_is_read_and_none_is_none(tmp_path: Path):
    store = SeasonStore.open(str(tmp_path))
    assert store.names() is None
    (tmp_path / "_store.json").write_text(json.dumps({"names": "k"}))
    assert store.names() == "k"
    (tmp_path / "_store.json").write_text('{"names": null}')  # flights keep their names
    assert store.names() is None


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_pipe_in_place_of_the_note_is_refused(tmp_path):
    note = tmp_path / "_store.json"
    os.mkfifo(note)
    # Who reads it all the same gets an answer, and the test fails instead of waiting.
    threading.Thread(target=note.write_text, args=('{"names": null}',), daemon=True).start()
    with pytest.raises(OSError, match="it is a pipe or a device"):
        SeasonStore.open(str(tmp_path)).names()
