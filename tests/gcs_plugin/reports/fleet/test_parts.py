"""parts.csv: who was where and when."""

import pytest

from thrustmargin.gcs_plugin.reports.fleet.parts import read_parts
from thrustmargin.models.errors import DataError

HEAD = "part,aircraft,position,installed at,removed at\n"


def test_a_part_flies_between_its_days_in_utc():
    text = HEAD + "P-1,a,propeller 2,2026-05-02,2026-05-04T12:00+02:00\nB,a,Battery,,\n"
    propeller, battery = read_parts(text, "parts.csv")
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
        read_parts(text, "parts.csv")
