"""Every language says the same things, and the page asks for nothing that is not there."""

import re
from pathlib import Path

import pytest

from thrustmargin.gcs_plugin.wording.live_words import page_words

LANGUAGES = ("en", "de")
ROOT = Path(__file__).parents[3] / "gcs_plugin"
PAGE = (ROOT / "view/figures/screen.html").read_text("utf-8")
OTHERS = [language for language in LANGUAGES if language != "en"]
#: Keys that the page makes of a code of the state, not of its own text.
OF_LOST = {"holds", "spins", "sinks", "cannot_tell", "bad_part", "no_data"}
BY_CODE = {*OF_LOST, "aircraft", "field", "charts", "check_power", "check_sent", "check_port"}


def placeholders(text: str) -> set[str]:
    return set(re.findall(r"\{(\w+)\}", text))


@pytest.mark.parametrize("language", OTHERS)
def test_a_translation_has_the_same_keys_and_placeholders(language: str):
    english, other = page_words("en"), page_words(language)
    for part in ("words", "names"):
        assert list(other[part]) == list(english[part])
        for key, text in english[part].items():
            assert placeholders(other[part][key]) == placeholders(text), key
            assert other[part][key].strip()
    # It is one: what is the same in both is a name or a number.
    same = [key for key, text in english["words"].items() if other["words"][key] == text]
    assert len(same) < 0.2 * len(english["words"]), same


def test_every_file_of_a_language_is_offered():
    files = sorted(path.stem for path in ROOT.rglob("*.po"))
    assert files == sorted(OTHERS)


def test_the_page_asks_for_words_that_are_there_and_all_are_asked_for():
    asked = set(re.findall(r"\bwords\.(\w+)", PAGE)) | set(re.findall(r'\bsay\(\s*"(\w+)"', PAGE))
    asked |= {key for pair in re.findall(r'\? "(\w+)" : "(\w+)"', PAGE) for key in pair}
    asked |= set(re.findall(r'"(\w+_rpm)"', PAGE)) | set(
        re.findall(r'\["tm[\w-]*", "(\w+)"\]', PAGE)
    )
    there = set(page_words("en")["words"])
    assert set(re.findall(r"\bwords\.(\w+)", PAGE)) <= there
    assert set(re.findall(r'\bsay\(\s*"(\w+)"', PAGE)) <= there
    assert there - asked <= BY_CODE, there - asked - BY_CODE


def test_no_sentence_of_the_page_stands_outside_of_the_catalogue():
    script = PAGE[PAGE.index("<script>") :]
    texts = re.findall(r'"([^"\n]*)"', re.sub(r"//.*", "", script))
    spoken = [t for t in texts if re.fullmatch(r"[A-Za-z]+ [a-z]+ [a-z ]+", t)]
    assert [t for t in spoken if t != "use strict"] == []
