"""In German no sentence of the catalogue is left in English, of any kind of bundled log."""

import re
from html import unescape
from pathlib import Path

import pytest

from thrustmargin.gcs_plugin import cli
from thrustmargin.gcs_plugin.wording.language import translations

LOGS = Path(__file__).resolve().parents[3] / "sitl_logs"
#: A log of each kind: DataFlash, a worn propeller, a fault on the way, and another airframe.
KINDS = [
    ("formats/v4_m10_q2.5.BIN", ()),
    ("dev/worn_prop_1.tlog", ()),
    ("onset/worn_prop_onset.tlog", ()),
    ("voltage/sag_real_rpm.tlog", ("--airframe", "agras-t20")),
]
#: What is long enough to be English and nothing else.
LEAST_WORDS, LEAST_LETTERS = 3, 12


def english() -> set[str]:
    """The longest part without a placeholder of each English sentence of the catalogue."""
    found = set()
    for sentence, german in translations("de").items():
        longest = max(re.split(r"\{[^}]*\}", sentence), key=len).strip()
        enough = len(longest.split()) >= LEAST_WORDS and len(longest) >= LEAST_LETTERS
        if enough and longest not in german:
            found.add(longest)
    assert len(found) > 500
    return found


def left_in_english(text: str) -> list[str]:
    flat = " ".join(text.split())
    return sorted(part for part in english() if part in flat)


def told(argv: list[str], capsys, monkeypatch) -> str:
    monkeypatch.setenv("THRUSTMARGIN_LANGUAGE", "de")
    monkeypatch.setenv("COLUMNS", "5000")
    with pytest.raises(SystemExit) as ended:
        cli.main(argv)
    assert ended.value.code in (0, 1)  # 1: no verdict with another airframe
    return capsys.readouterr().out


@pytest.mark.parametrize(("log", "options"), KINDS, ids=[log for log, _ in KINDS])
def test_inspect_leaves_no_sentence_in_english(log, options, capsys, monkeypatch):
    assert left_in_english("rotor speeds fit the weight (ratio 1.00)") != []
    text = told(["inspect", str(LOGS / log), *options], capsys, monkeypatch)
    assert "Fahrzeug: Multirotor nach" in text
    assert left_in_english(text) == []


@pytest.mark.parametrize(("log", "options"), KINDS[:2], ids=[log for log, _ in KINDS[:2]])
def test_a_report_leaves_no_sentence_in_english(log, options, capsys, monkeypatch, tmp_path):
    page = tmp_path / "x.html"
    text = told(["report", str(LOGS / log), *options, "--out", str(page)], capsys, monkeypatch)
    html = re.sub(r"<(script|style).*?</\1>", " ", page.read_text("utf-8"), flags=re.DOTALL)
    assert left_in_english(text) == []
    assert left_in_english(unescape(re.sub(r"<[^>]+>", " | ", html))) == []
