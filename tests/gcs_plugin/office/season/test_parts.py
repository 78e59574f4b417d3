"""parts.csv: who was where and when."""

import pytest

from thrustmargin.gcs_plugin.office.season.parts import read_parts
from thrustmargin.models.errors import DataError

HEAD = "part,aircraft,position,installed at,removed at\n"


def test_a_part_flies_between_its_days_in_utc():
    text = HEAD + "P-1,a,propeller 2,2026-05-02,2026-05-04T12:00+02:00\nB,a,Battery,,\n"
    propeller, battery = read_parts(text.encode(), "parts.csv")
    assert propeller.rotor == 2
    assert battery.rotor is None
    day = 86400.0
    second = 1777680000.0  # 2 May 2026, 0:00 UTC
    started = [second - 1, second, second + 2 * day, second + 2.5 * day, None]
    assert propeller.flights(started) == [1, 2]  # 4 May, 10:00 UTC is the end
    assert battery.flights(started) == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("part,aircraft\n", "has no column 'position'"),
        (HEAD + "P,a,wing 2,,\n", "line 2: position 'wing 2'"),
        (HEAD + "P,a,motor 2,soon,\n", "line 2: installed at 'soon' is no time"),
        (HEAD + "P,a,motor 2,2026-05-04,2026-05-02\n", "removed before it is installed"),
        (HEAD + "P,a,motor 2,,\nQ,a,motor 2,2026-05-04,\n", "line 3: P is still at motor 2 of a"),
        (HEAD + "B,a,battery,,\nB,b,battery,2026-05-04,\n", "line 3: B is still at battery of a"),
    ],
)
def test_a_wrong_line_is_named(text: str, words: str):
    with pytest.raises(DataError, match=words):
        read_parts(text.encode(), "parts.csv")


def test_a_table_in_another_encoding_is_named_by_its_line():
    """As a spreadsheet saves it in the encoding of its country."""
    ansi = (HEAD + "P-1,M\u00fchle,motor 2,,\n").encode("cp1252")
    with pytest.raises(DataError, match=r"parts.csv line 2: byte 0xfc is not UTF-8; save it as"):
        read_parts(ansi, "parts.csv")


def test_a_cell_that_is_none_is_named_by_its_line():
    long = HEAD + "P" * 131_073 + ",a,motor 2,,\n"
    with pytest.raises(DataError, match=r"parts.csv line 1: .*is it a table of parts"):
        read_parts(long.encode(), "parts.csv")


def test_a_byte_order_mark_is_no_part_of_a_column():
    (part,) = read_parts((HEAD + "P-1,a,motor 2,,\n").encode("utf-8-sig"), "parts.csv")
    assert part.name == "P-1"


@pytest.mark.parametrize("encoding", ["utf-16", "utf-32", "latin-1"])
def test_another_encoding_is_one_line_whatever_it_is(encoding: str):
    text = f"{HEAD}pé,A,propeller 1,,\n"
    with pytest.raises(DataError, match="is not UTF-8; save it as CSV in UTF-8"):
        read_parts(text.encode(encoding), "parts.csv")


@pytest.mark.parametrize("length", [131_000, 131_072, 131_073])
@pytest.mark.parametrize("column", [0, 2, 3])
def test_a_cell_without_end_is_one_short_line(length: int, column: int):
    cells = ["p", "A", "propeller 1", "2026-01-01", ""]
    cells[column] = "9" * length
    with pytest.raises(DataError) as refused:
        read_parts((HEAD + ",".join(cells) + "\n").encode(), "parts.csv")
    assert str(refused.value).startswith("parts.csv line")
    assert len(str(refused.value)) < 200
