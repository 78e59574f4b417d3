"""Every alarm and every advice has its translation, with the same placeholders, short enough."""

import ast
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.gcs_plugin.wording.test_advice_words import ADVICE, FILL, with_fault
from thrustmargin.gcs_plugin.live.alarms.alarm import GRAVEST_FIRST
from thrustmargin.gcs_plugin.live.announce import plain
from thrustmargin.gcs_plugin.wording import (
    actions,
    advice_words,
    alarm_words,
    fault_words,
    fill_words,
    live_words,
)
from thrustmargin.gcs_plugin.wording.answer import answer_of
from thrustmargin.gcs_plugin.wording.fault_words import fault_words as of_fault
from thrustmargin.gcs_plugin.wording.language import VARIABLE, say, translations
from thrustmargin.gcs_plugin.wording.view_words import LANGUAGES
from thrustmargin.models.checks.loss_of_control import LossKind, LossOfControl
from thrustmargin.models.errors import DataError
from thrustmargin.models.model.advice import Battery, FlightLevel
from thrustmargin.models.model.fault_test import RotorFault

WORDING = Path(alarm_words.__file__).parent
#: Modules all of whose sentences are of alarms, the answer and the fill.
MODULES = ("alarm_words", "fault_words", "advice_words", "answer", "fill_words")
OTHERS = [language for language in LANGUAGES if language != "en"]
#: What is for reports and commands alone, which are English.
NOT_SPOKEN = {
    *("with yaw control", "maximum fill to survive one rotor failure", "would have descended"),
    *("take-off mass", "as flown"),  # reasons, which are data
    *("holds height and heading", "holds height, but it will spin", "WOULD DESCEND"),
}


def asked_for() -> set[str]:
    """Texts of two words and more of those modules, the names of alarms, and their actions."""
    found: set[str] = set()
    for module in MODULES:
        tree = ast.parse((WORDING / f"{module}.py").read_text("utf-8"))
        inside = {id(v) for n in ast.walk(tree) if isinstance(n, ast.JoinedStr) for v in n.values}
        documents = {
            id(n.value)
            for n in ast.walk(tree)
            if isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant)
        }
        for node in ast.walk(tree):
            text = node.value if isinstance(node, ast.Constant) else None
            if not isinstance(text, str) or id(node) in inside | documents:
                continue
            if re.search("[A-Za-z]{2,} .*[a-zA-Z]{2}", text):
                found.add(text)
    used = {actions.LAND, actions.GROUND_WRECK, actions.TEST_BATTERY, actions.CHECK_LOAD}
    found |= {action.words for action in used | {actions.FLY_GENTLY}}
    found |= {*GRAVEST_FIRST, *alarm_words.MISSING.values(), *alarm_words.FAILURES.values()}
    found |= {word for word in alarm_words.ASKED if word}
    reasons = [
        value for value in vars(live_words).values() if isinstance(value, live_words.WhyUnknown)
    ]
    return found - NOT_SPOKEN | {reason.words for reason in reasons}


def placeholders(text: str) -> list[str]:
    return sorted(re.findall(r"\{(\w*)\}", text))


@pytest.mark.parametrize("language", OTHERS)
def test_no_sentence_of_an_alarm_or_advice_lacks_its_translation(language: str):
    table = translations(language)
    assert asked_for() - set(table) == set()
    for english, other in table.items():
        assert placeholders(english) == placeholders(other), english
        assert other.strip()
    assert len(asked_for()) > 100


@pytest.fixture(params=OTHERS)
def language(request, monkeypatch) -> str:
    monkeypatch.setenv(VARIABLE, request.param)
    return request.param


def alarms() -> list[str]:
    names = ("front right", "rear left", "front left", "rear right")
    faults = [
        RotorFault(kind=kind, rotor=3, size=0.12, lower=0.11, upper=upper, rotors=rotors)
        for kind in ("propeller", "motor")
        for upper in (0.13, 0.6)
        for rotors in ((), (3, 1))
    ]
    low = [
        alarm_words.margin_words(what, 0.442, 0.5, error=error, rotor=rotor)
        for what in (
            alarm_words.MEASURED_MARGIN,
            alarm_words.PREDICTED_MARGIN,
            alarm_words.MARGIN_AHEAD,
        )
        for error in (0.0, 0.05)
        for rotor in (None, 3)
    ]
    fixed = [
        v for k, v in vars(alarm_words).items() if k.isupper() and isinstance(v, str) and ":" in v
    ]
    return [
        *(of_fault(fault, names) for fault in faults),
        *low,
        *(alarm_words.control_words(kind, 1.0) for kind in LossKind if kind in CONTROL),
        *(say(text) for text in fixed if "{" not in text),
        alarm_words.at_limit(3, "rear right"),
        alarm_words.battery_words(2.91, 0.45, 0.32),
        *(alarm_words.esc_words(4, "rear right", flags) for flags in (*alarm_words.FAILURES, 128)),
        alarm_words.thrust_against_gauge(-3.4),
        alarm_words.speeds_missing([1, 2, 3]),
        *(alarm_words.change_words("", name, None, "speeds") for name in GRAVEST_FIRST),
        *(alarm_words.change_words("", name, 3, "speeds") for name in OF_ROTORS),
    ]


LOSS = LossOfControl(kind=LossKind.SPUN, time_s=61.0, value=7.0)
OF_ROTORS = ("rotor", "motor", "esc", "saturation")
CONTROL = (LossKind.NOT_AS_ASKED, LossKind.TURNED_OVER, LossKind.SPUN, LossKind.FELL)


def briefs() -> list[str]:
    of = {
        FlightLevel.LOST: replace(ADVICE, losses=(LOSS,)),
        FlightLevel.BATTERY: replace(ADVICE, battery=Battery(least_cell=2.61, at_s=3.0)),
        FlightLevel.CRITICAL: ADVICE,
        FlightLevel.OVER: replace(ADVICE, fill=replace(FILL, kg=-1.0)),
    }
    made = [answer_of(replace(advice, levels=(level,))).brief for level, advice in of.items()]
    return [*made, answer_of(with_fault()).brief]


@pytest.mark.usefixtures("language")
def test_a_statustext_holds_each_alarm_and_what_to_do_after_landing():
    for text in (*alarms(), *briefs()):
        assert text
        assert len(plain(text).encode()) <= 50 + text.count("°"), text
    assert alarms()[0] == "Rotor 4 hinten rechts 12% (11-13) schwach: landen"


@pytest.mark.usefixtures("language")
def test_the_answer_is_spoken_with_the_numbers_of_the_language():
    made = answer_of(with_fault())
    assert made.headline == "ROTOR 3, VORN LINKS: 12 % WENIGER SCHUB"
    assert made.action.endswith(
        "höchstens 8,6 kg (8,6 L) füllen: mit mehr würde es nach einem Rotorausfall sinken"
    )
    assert "the " not in " ".join(text for _, text in advice_words.facts(ADVICE))
    assert fill_words.fill_advice(replace(FILL, kg=np.nan, reason=None), 0.5).startswith("Keine")
    assert fault_words.place_words("front left upper") == "vorn links oben"


def test_a_language_that_there_is_not_is_refused(monkeypatch):
    monkeypatch.setenv(VARIABLE, "xx")
    with pytest.raises(DataError, match="no language 'xx'; there are en, de"):
        say("land")
    monkeypatch.delenv(VARIABLE)
    assert say("land") == "land"
