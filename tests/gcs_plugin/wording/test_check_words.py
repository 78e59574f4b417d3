"""Every kind of statement that a check can make has a sentence, and each sentence its German."""

import ast
import re
from pathlib import Path

import pytest

from thrustmargin.gcs_plugin.wording.check_words import (
    SENTENCES,
    airframe_match_words,
    remedy_words,
    statement_words,
)
from thrustmargin.gcs_plugin.wording.language import translations
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.statement import state

ROOT = Path(__file__).resolve().parents[3]


def texts(node: ast.AST) -> set[str]:
    """The texts of an argument, whichever of them is chosen; not those that it is chosen by."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return {node.value}
    if isinstance(node, (ast.JoinedStr, ast.Compare, ast.Attribute, ast.Name)):
        return set()
    return {text for inner in ast.iter_child_nodes(node) for text in texts(inner)}


#: What makes a statement, and what hands its first argument on to it.
MAKERS = ("state", "_flying_by")


def kinds_in_calls() -> set[str]:
    """The kinds and clauses written where a module below the edge calls `state`."""
    found: set[str] = set()
    rooms = ("models", "mission", "gcs_plugin/mavlink", "gcs_plugin/telemetry", "gcs_plugin/logs")
    for file in (file for room in rooms for file in (ROOT / room).rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") in MAKERS:
                found |= {text for one in node.args for text in texts(one)}
    return found


def test_every_kind_has_a_sentence_and_every_sentence_is_translated():
    assert len(kinds_in_calls()) > 150
    assert kinds_in_calls() - set(SENTENCES) == set()
    words = {s for s in SENTENCES.values() if re.search("[a-z]{3}", re.sub(r"\{.*?\}", "", s))}
    assert words - set(translations("de")) == set()


def test_numbers_are_written_as_the_language_does(monkeypatch):
    speed = state("speed", speed=2043.4, of=state("for mass", mass=34.0, percent=1.0))
    assert statement_words(speed) == "rotors at 2,043 rpm for 34 kg within 1 %"
    monkeypatch.setenv("THRUSTMARGIN_LANGUAGE", "de")
    assert statement_words(speed) == "Rotoren mit 2 043 U/min für 34 kg auf 1 %"
    assert statement_words(state("volts", volts=55.52)) == "55,5 V"


def test_a_clause_follows_its_sentence_and_lists_are_joined():
    units = state(
        "units of motion",
        "table in seconds",
        changes=(state("position changes", factor=3.3), state("heading changes", factor=57.0)),
        step=0.1,
    )
    assert statement_words(units) == (
        "position changes 3.3 times as much as velocity says and heading changes 57 times as much "
        "as yaw rate says, with rows 0.1 s apart: time_s must be in s"
    )
    listed = tuple(state("is motor", rotor=k, motor=k % 3 + 1) for k in (1, 2, 3))
    assert statement_words(state("out of order", listed=listed)) == (
        "rotor speeds look out of order (1 is motor 2, 2 is motor 3, 3 is motor 1)"
    )


def test_a_kind_without_a_sentence_is_an_error():
    with pytest.raises(KeyError, match="riddle"):
        statement_words(state("riddle"))


def test_names_are_kept_and_the_grounds_of_a_claim_are_translated(monkeypatch):
    given = AirframeMatch(airframe="octo-v1.5", guessed=("empty_mass",), source="a.1.tlog")
    assert airframe_match_words(given) == "airframe octo-v1.5, given; guessed in it: mass"
    monkeypatch.setenv("THRUSTMARGIN_LANGUAGE", "de")
    assert airframe_match_words(given) == "Fluggerät octo-v1.5, angegeben; geschätzt darin: Masse"
    assert "airframe new --from a.1.tlog`" in remedy_words(given)
