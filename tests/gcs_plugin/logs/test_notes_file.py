"""An engineer's notes beside a log: times of every kind, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.gcs_plugin.reports.margin.report_flight import HOSTILE, log
from thrustmargin.gcs_plugin.logs.notes_file import notes_file_of, with_notes
from thrustmargin.models.errors import LogError


def written(folder: Path, text: str, name: str = "notes.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def noted(folder: Path, text: str) -> list[tuple[float, str]]:
    (made,) = with_notes([log()], written(folder, text))
    return [(note.time_s, note.text) for note in made.engineer_notes]


def test_times_are_seconds_clocks_or_dates_and_come_in_order(tmp_path: Path):
    start = log().track.start_unix_s
    assert start is not None
    text = "time,text\n1:42,gust\n30.5,hum\n\n0:01:03,turn\n"
    assert noted(tmp_path, text) == [(30.5, "hum"), (63.0, "turn"), (102.0, "gust")]


def test_a_date_counts_from_the_log_s_own(tmp_path: Path):
    track = replace(log().track, start_unix_s=1_777_885_950.0)  # 2026-05-04T09:12:30Z
    text = "Time,Text\n2026-05-04T09:12:40Z,one\n2026-05-04T11:12:50+02:00,two\n"
    (made,) = with_notes([replace(log(), track=track)], written(tmp_path, text))
    assert [(note.time_s, note.text) for note in made.engineer_notes] == [
        (10.0, "one"),
        (20.0, "two"),
    ]


def test_of_several_sorties_each_has_the_notes_of_its_time(tmp_path: Path):
    first = log()
    second = replace(first, clock_start_s=first.clock_start_s + 1000.0, sortie=2, sorties=2)
    made = with_notes([first, second], written(tmp_path, "time,text\n10,a\n1010,b\n5000,c\n"))
    assert [[(n.time_s, n.text) for n in one.engineer_notes] for one in made] == [
        [(10.0, "a")],
        [(10.0, "b")],
    ]


def test_commas_and_control_characters_in_a_text(tmp_path: Path):
    text = 'time,text\n1,"a, b"\n2,c, d\n3,\x1b[31mred\n'
    assert noted(tmp_path, text) == [(1.0, "a, b"), (2.0, "c, d"), (3.0, " [31mred")]
    assert noted(tmp_path, f"time,text\n1,{HOSTILE.replace(',', '')}\n")[0][0] == 1.0


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "its first line must be time,text"),
        ("when,what\n1,a\n", "its first line must be time,text"),
        ("time,text\n1,a\nnoon,b\n", "line 3: 'noon' is no time"),
        ("time,text\nnan,b\n", "line 2: 'nan' is no time"),
        ("time,text\n2026-05-04T09:12:40,b\n", "is no time"),  # of which zone?
        ("time,text\n" + "1,a\n" * 6000, "more than 5000 lines"),
    ],
)
def test_what_is_no_table_of_notes_is_refused(tmp_path: Path, text: str, why: str):
    with pytest.raises(LogError, match=why):
        noted(tmp_path, text)


def test_dates_need_a_log_with_a_date(tmp_path: Path):
    track = replace(log().track, start_unix_s=None)
    path = written(tmp_path, "time,text\n2026-05-04T09:12:40Z,one\n")
    with pytest.raises(LogError, match="has no date"):
        with_notes([replace(log(), track=track)], path)


def test_bytes_that_are_no_text_are_refused(tmp_path: Path):
    path = tmp_path / "notes.csv"
    path.write_bytes(b"time,text\n1,\xff\xfe\n")
    with pytest.raises(LogError, match="cannot be read as UTF-8"):
        with_notes([log()], path)


def test_the_file_beside_a_log_is_found(tmp_path: Path):
    flight = tmp_path / "flight.tlog"
    assert notes_file_of(flight) is None
    path = written(tmp_path, "time,text\n")
    assert notes_file_of(flight) == path
    assert notes_file_of(path) is None
