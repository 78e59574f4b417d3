"""The field's words: those that were replaced stand nowhere in source and documents."""

import re
from functools import cache
from pathlib import Path

import pytest

from tests.import_graph import ROOT, modules

#: A word that is unmistakable -> what is written instead.
INSTEAD = {
    r"\b(doubts?|rivals?)\b": "model uncertainty; explanations, confounded alternatives",
    r"\b(told|tells)\b": "reported, described, distinguished",
    r"\bjudg(e|es|ed|ing|ment)\b": "checked, cross-validated, scored",
    r"\bwitness(es)?\b": "independent estimates",
    r"\blingering\b": "autocorrelated",
    r"\bcarried on\b": "extrapolated",
    r"\bmailbox\b": "bounded queue",
    r"\bbrim\b": "full tank",
    r"\blet_through\b": "delivery factor",
    r"\bquickness\b": "Froude time scale",
    r"\bspeaker\b": "sender",
    r"\brhythm\b": "row trigger",
    r"\bmend(s|ed)?\b": "repaired",
    r"\byaw[ _]free\b(?!_)": "yaw uncontrolled",
    r"\bheading given up\b": "yaw uncontrolled",
    r"\bpack voltage\b|\bbattery pack\b": "battery voltage",
}
#: Spellings of formats that stay, and places in which the word is that of a file.
KEPT = (
    "JSON, which keep their spelling: `capacity_use` is thrust utilisation, `yaw_free` yaw "
    "uncontrolled.",
)


@cache
def sources() -> list[tuple[Path, str]]:
    """All source and all documents, each with its text."""
    documents = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")]
    return [(path, path.read_text("utf-8")) for path in (*modules().values(), *documents)]


def found(word: str) -> list[str]:
    """Place and line of each use."""
    uses = []
    for path, text in sources():
        if not re.search(word, text):  # of all lines at once it is soon said
            continue
        for number, line in enumerate(text.splitlines(), 1):
            if line.strip() not in KEPT and re.search(word, line):
                uses.append(f"{path.relative_to(ROOT)}:{number}: {line.strip()}")
    return uses


@pytest.mark.parametrize("word", INSTEAD)
def test_a_word_that_was_replaced_stands_nowhere(word: str):
    assert found(word) == [], INSTEAD[word]


def test_a_word_that_stands_somewhere_is_found():
    assert any(use.startswith("README.md:1:") for use in found("thrustmargin"))
