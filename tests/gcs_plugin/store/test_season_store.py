"""The note on how the flights of a store are named: read, or refused in one line."""

import json
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
