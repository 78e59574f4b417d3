"""Every alarm and every advice has its translation, with the same placeholders, short enough."""

import ast
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jinja2 import Environment, nodes

from tests.gcs_plugin.wording.test_advice_words import ADVICE, FILL, with_fault
from thrustmargin.gcs_plugin.live.alarms.alarm import GRAVEST_FIRST
from thrustmargin.gcs_plugin.live.announce import plain
from thrustmargin.gcs_plugin.wording import (
    actions,
    advice_words,
    alarm_words,
    fill_words,
    live_words,
)
from thrustmargin.gcs_plugin.wording.alarm_words import fault_words as of_fault
from thrustmargin.gcs_plugin.wording.answer import answer_of
from thrustmargin.gcs_plugin.wording.language import (
    LANGUAGES,
    VARIABLE,
    clean,
    number,
    piece,
    place,
    printable,
    say,
    speaking,
    spoken,
    translations,
    within,
)
from thrustmargin.models.checks.loss_of_control import LossKind, LossOfControl
from thrustmargin.models.errors import DataError
from thrustmargin.models.model.advice import Battery, FlightLevel
from thrustmargin.models.model.fault_test import RotorFault

WORDING = Path(alarm_words.__file__).parent
#: Modules all of whose sentences a pilot can meet: alarms, answer, fill, report, plan, season.
MODULES = (
    *("alarm_words", "advice_words", "answer", "fill_words", "day_words"),
    *("report_words", "margin_verdict", "flight_words"),
    *("takeoff_words", "vehicle_words"),
    *("forecast_words", "plan_words", "../office/season/fleet_words"),
    *("effect_amounts", "effect_sentences"),
    *("../workshop/identify/identify_words", "../workshop/identify/asked_words"),
    "../workshop/learn/training_tables",
)
#: Pages that a pilot reads. That of `identify` is for engineers, and English.
PAGES = (
    *("reports/margin", "reports/fill", "reports/forecast", "reports/shared"),
    "office/season",
)
#: Tags, values and units in the text of a template are no words of it.
NO_WORDS = re.compile(r"<[^>]*>?|[^<]*>|thrustmargin|DOCTYPE|doctype|html")
OTHERS = [language for language in LANGUAGES if language != "en"]
#: Data that looks like a text; what commands for engineers say.
NOT_SPOKEN = {
    *("take-off mass", "as flown", "first part", "not known", "hidden mass"),
    *("in the air in this log", "in this log"),  # ends of sentences that are translated whole
    *("the start", "Home is taken where the first line starts; give --home for another."),
    "; the load that you state is taken for each of them",
    "RMSE rpm",
    *("predicted margin", "margin ahead"),  # names of alarms, shown by SHOWN_NAMES
    " of {rotor}",  # behind the name of an effect without words
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
        dicts = [n for n in ast.walk(tree) if isinstance(n, ast.Dict)]
        keys = {id(key) for one in dicts for key in one.keys}
        for node in ast.walk(tree):
            text = node.value if isinstance(node, ast.Constant) else None
            if not isinstance(text, str) or id(node) in inside | documents | keys:
                continue
            if re.search("[A-Za-z]{2,} .*[a-zA-Z]{2}", text) and not text.startswith("--"):
                found.add(text)
    used = {actions.LAND, actions.GROUND_WRECK, actions.TEST_BATTERY, actions.CHECK_LOAD}
    found |= {action.words for action in used | {actions.FLY_GENTLY}}
    found |= {alarm_words.SHOWN_NAMES.get(name, name) for name in GRAVEST_FIRST}
    found |= {*alarm_words.MISSING.values(), *alarm_words.FAILURES.values()}
    found |= {word for word in alarm_words.ASKED if word}
    reasons = [
        value for value in vars(live_words).values() if isinstance(value, live_words.WhyUnknown)
    ]
    return found - NOT_SPOKEN | {reason.words for reason in reasons}


def templates() -> list[nodes.Template]:
    files = [f for page in PAGES for f in sorted((WORDING.parent / page).glob("*.html"))]
    return [Environment().parse(file.read_text("utf-8")) for file in files]


def asked_by_pages() -> set[str]:
    """Texts that the templates hand to what speaks: say, spoken, and heads of tables and tiles."""
    found: set[str] = set()
    for page in templates():
        for call in page.find_all(nodes.Call):
            name = getattr(call.node, "name", "")
            first = call.args[1:2] if name == "figure" else call.args[:1]
            if name in ("say", "figure", "tile", "table", "logs"):
                texts = [c for one in first for c in (one, *getattr(one, "items", ()))]
                found |= {c.value for c in texts if isinstance(c, nodes.Const)}
            if name == "table":
                found |= {c.value for c in call.args[1:] if isinstance(c, nodes.Const)}
        for one in page.find_all(nodes.Filter):
            if one.name == "spoken" and isinstance(one.node, nodes.Const):
                found.add(one.node.value)
    return {text.removeprefix("words:") for text in found if re.search("[a-z]{3}", text)}


def test_no_words_of_a_page_are_written_past_the_table():
    for page in templates():
        for text in page.find_all(nodes.TemplateData):
            left = NO_WORDS.sub(" ", text.data)
            assert not re.search(r"[A-Za-z]{2,} [a-z]{2,}", left), left


def placeholders(text: str) -> list[str]:
    return sorted(re.findall(r"\{(\w*(?::[^}]*)?)\}", text))


@pytest.mark.parametrize("language", OTHERS)
def test_no_sentence_of_an_alarm_or_advice_lacks_its_translation(language: str):
    table = translations(language)
    assert asked_for() - set(table) == set()
    assert asked_by_pages() - set(table) == set()
    for english, other in table.items():
        assert placeholders(english) == placeholders(other), english
        assert other.strip()
    assert len(asked_for()) > 300
    assert len(asked_by_pages()) > 100


def literals() -> set[str]:
    """Texts that any module of the program hands to `say` where it is called."""
    found: set[str] = set()
    for file in WORDING.parent.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "say" and node.args:
                first = node.args[0]
                either = [first.body, first.orelse] if isinstance(first, ast.IfExp) else [first]
                texts = (one.value for one in either if isinstance(one, ast.Constant))
                found |= {text for text in texts if isinstance(text, str) and text}
    return found


@pytest.mark.parametrize("language", OTHERS)
def test_no_text_that_a_module_says_lacks_its_translation(language: str):
    assert literals() - set(translations(language)) == set()
    assert len(literals()) > 250


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
        alarm_words.margin_words(what, 0.442, 0.5, ends=ends, rotor=rotor)
        for what in (
            alarm_words.MEASURED_MARGIN,
            alarm_words.PREDICTED_MARGIN,
            alarm_words.MARGIN_AHEAD,
        )
        for ends in ((0.442, 0.442), (0.36, 0.49))
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
        *(
            alarm_words.heat_words(12, 423.0, 423.15, seconds, motor=motor)
            for seconds in (0, 60)
            for motor in (False, True)
        ),
        alarm_words.heat_past(12),
        alarm_words.lead_words(12, 140.0),
        alarm_words.lead_past(12),
        alarm_words.thrust_against_gauge(-3.4),
        alarm_words.speeds_missing([1, 2, 3]),
        *(alarm_words.change_words("", name, None, "speeds") for name in GRAVEST_FIRST),
        *(alarm_words.change_words("", name, 3, "speeds") for name in OF_ROTORS),
    ]


LOSS = LossOfControl(kind=LossKind.SPUN, time_s=61.0, value=7.0)
OF_ROTORS = ("rotor", "motor", "esc", "desync", "heat", "lead", "saturation")
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
    assert alarm_words.place_words("front left upper") == "vorn links oben"


@pytest.mark.usefixtures("language")
def test_numbers_have_the_decimal_sign_of_the_language():
    assert number(-1234.56, "kg", 2) == "\N{MINUS SIGN}1 234,56 kg"
    assert within(8.0, 7.8, 8.2, "%") == ("8 %", "(7,8 bis 8,2)")
    assert within(0.5, 0.42, 0.58, "kg") == ("0,5 kg", "(0,42 bis 0,58)")
    assert place(12.0, -40.0) == "12 m nördlich, 40 m westlich vom Start"


def test_a_language_that_there_is_not_is_refused(monkeypatch):
    monkeypatch.setenv(VARIABLE, "xx")
    with pytest.raises(DataError, match="no language 'xx'; there are en, de"):
        say("land")
    monkeypatch.delenv(VARIABLE)
    assert say("land") == "land"


def test_a_page_is_answered_in_its_own_language_and_nothing_else_changes():
    assert (spoken(), say("nothing")) == ("en", "nothing")
    with speaking("de"):
        assert (spoken(), say("nothing")) == ("de", "nichts")
        with speaking("xx"):
            assert spoken() == "en"
    assert spoken() == "en"


def test_texts_end_at_a_zero_byte_and_cannot_steer_a_terminal():
    assert printable(b"  TANK\0junk") == "TANK"
    assert piece(b" part \0x") == " part "
    assert piece(b"a\x1b[31mb\x07") == "a [31mb "
    assert piece(b"\xff\xc3\xa9") == "\ufffd\u00e9"
    assert clean("plain, \u00e9") == "plain, \u00e9"
    assert clean("a\tb\nc\u202e") == "a b c "
