"""Every sentence that a pilot can meet is in gcs_plugin/wording, and sentences.txt lists them all.

After a change of words: `python -m tests.gcs_plugin.wording.test_sentences`; the difference of
sentences.txt is then what pilots will read.
"""

import ast
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
WORDING = ROOT / "gcs_plugin" / "wording"
LIST = Path(__file__).with_name("sentences.txt")
#: Rooms and files whose words reach alarms, verdicts, the bar, the gauges or a report.
SPEAKING = ("live", "view", "reports/margin", "reports/fill", "reports/shared", "mavproxy")
#: Three words on end are a sentence or a part of one; fewer are a label.
SENTENCE = re.compile(r"[A-Za-z'°]+,? [a-z']+,? [A-Za-z']+")
#: What looks like one and is none, or is for who runs the program: a file, what it may say.
ALLOWED = {
    "gcs_plugin/reports/margin/csv_rows.py": "names of columns, which are the file's format",
    "gcs_plugin/office/stations/mavproxy_worker.py": "lines of MAVProxy's console",
    "gcs_plugin/office/streams/collector.py": "what each metric is, which is the format's",
    "gcs_plugin/live/small_server.py": "refusals of strangers and of a port",
    "gcs_plugin/view/page/view_page.py": "where the page is, for who started it",
    "gcs_plugin/view/page/guard.py": "the door before the page, and refusals",
}

#: Files of sentences in an extra.
SPOKEN = "*/*_words.py"

#: The terminal's style; the text of an object, for programmers.
NO_SENTENCES = ("bold white on red", "Update(vehicle {}, margin by rotor {} %, {})")


def sentences(source: str) -> list[str]:
    """String constants of a module in order, {} for what is filled in; no docstring, no error."""
    tree = ast.parse(source)
    left_out: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Raise) or (
            isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        ):
            left_out |= {id(inner) for inner in ast.walk(node)}
        if isinstance(node, ast.JoinedStr):
            left_out |= {id(inner) for inner in node.values}
    found = []
    for node in ast.walk(tree):
        if id(node) in left_out:
            continue
        if isinstance(node, ast.JoinedStr):
            parts = (p.value if isinstance(p, ast.Constant) else "{}" for p in node.values)
            found.append((node.lineno, "".join(map(str, parts))))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.append((node.lineno, node.value))
    return [text for _, text in sorted(found)]


def spoken(text: str) -> bool:
    """Whether it has words for people once markup and styles are taken out."""
    text = re.sub(r"<[^>]*>?|[\w-]+:[^;\"]*;|\{[^}]*\}", " | ", text)
    return bool(SENTENCE.search(text))


def outside() -> list[str]:
    files = [path for room in SPEAKING for path in (ROOT / "gcs_plugin" / room).rglob("*.py")]
    return [
        f"{path.relative_to(ROOT).as_posix()}: {text}"
        for path in sorted(files)
        if path.relative_to(ROOT).as_posix() not in ALLOWED
        for text in sentences(path.read_text("utf-8"))
        if spoken(text) and text not in NO_SENTENCES
    ]


def listed() -> str:
    """All texts of two words and more of wording/ and of the words of extras, module by module."""
    lines = []
    extras = ROOT / "gcs_plugin"
    of_extras = [p for door in ("office", "workshop") for p in (extras / door).glob(SPOKEN)]
    for path in sorted([*WORDING.glob("*.py"), *of_extras], key=lambda path: path.stem):
        texts = dict.fromkeys(
            " ".join(text.split())
            for text in sentences(path.read_text("utf-8"))
            if re.search(r"[A-Za-z]{2,}[^A-Za-z]* [^A-Za-z]*[A-Za-z]{2,}", text)
        )
        lines += [f"# {path.stem}", *texts, ""]
    english = tomllib.loads((WORDING / "page_words.toml").read_text("utf-8"))
    lines += ["# page_words", *dict.fromkeys(english["words"].values()), ""]
    return "\n".join(lines)


def test_no_sentence_for_pilots_stands_outside_of_wording():
    assert outside() == []


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ('TEXT = "Rotor stands still: land"', True),
        ("x = f\"<b style='color:{c}'>figures {age} s old and late</b>\"", True),
        ('"""Rotor stands still: land"""', False),
        ('raise LogError("Rotor stands still here")', False),
        ("STYLE = \"<div style='font:700 13px system-ui'>\"", False),
        ('LABEL = "thrust margin"', False),
    ],
)
def test_a_sentence_is_found_wherever_it_is_written(source: str, found: bool):
    assert any(spoken(text) for text in sentences(source)) is found


def test_every_sentence_is_listed():
    assert LIST.read_text("utf-8") == listed(), __doc__


if __name__ == "__main__":
    LIST.write_text(listed(), encoding="utf-8")
