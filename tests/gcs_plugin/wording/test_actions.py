"""What is asked of people stands once in a table, with when it is safe, and never hurts anybody."""

import re
from pathlib import Path

import pytest

from thrustmargin.gcs_plugin.live.alarms.alarm import severity_of
from thrustmargin.gcs_plugin.office.season import fleet_words
from thrustmargin.gcs_plugin.wording import actions, alarm_words, effect_sentences
from thrustmargin.gcs_plugin.wording.actions import Action, When
from thrustmargin.models.effects import CATALOGUE
from thrustmargin.models.model.advice import FlightLevel
from thrustmargin.models.model.model_misfit import Caveat
from thrustmargin.models.model.rotor_faults import RotorFault

ROOT = Path(__file__).parents[3]
TABLE = {name: one for name, one in vars(actions).items() if isinstance(one, Action)}
TABLE |= {
    "change_propeller": actions.change_propeller(3),
    "inspect_rotors": actions.inspect_rotors((2,)),
    "not_before_looked_at": actions.not_before_looked_at((1, 3)),
}
#: Go on after another action, which has said that the battery is off.
GO_ON = ("THEN_MOTOR", "UNSTEADY")
OFF = re.compile(r"battery off|disarmed")
#: A hand at or near a rotor.
TOUCHED = re.compile(
    r"\b(?<!thrustmargin )"
    r"(inspect|feel|level|clean|swap|exchange|fit|change|replace|heat|look (at|for|there))\b"
)
EXCHANGE = re.compile(r"\b(swap|exchang|interchang|switch|trade|move|put)\w*\b", re.I)
PROPELLERS = re.compile(r"\b(propellers?|props?|blades?|rotor pair)\b", re.I)
ACROSS = re.compile(
    r"\b(pairs?|clockwise|each other|another|other (arm|motor|rotor|side|direction)|two)\b", re.I
)
WITHIN = re.compile(r"\b(of|within) (one|the same) (direction|kind)\b|\bnever\b", re.I)


def crosses(sentence: str) -> bool:
    """Whether it asks for propellers to change places, and not within one direction."""
    found = (EXCHANGE.search(sentence), PROPELLERS.search(sentence), ACROSS.search(sentence))
    return all(found) and not WITHIN.search(sentence)


def read_by_people() -> list[str]:
    """All sentences: the list of wording and the documents."""
    listed = (ROOT / "tests/gcs_plugin/wording/sentences.txt").read_text("utf-8").splitlines()
    texts = [one.text for one in TABLE.values()]
    for path in sorted((ROOT / "docs").glob("*.md")):
        whole = " ".join(path.read_text("utf-8").split())
        texts += re.split(r"(?<=[.:|])\s", whole)
    return [*listed, *texts]


def test_no_sentence_moves_propellers_across_the_directions_of_rotation():
    assert [text for text in read_by_people() if crosses(text)] == []


@pytest.mark.parametrize(
    ("sentence", "dangerous"),
    [
        ("swap two propellers between the clockwise and counter-clockwise pairs", True),
        ("Exchange its propeller with another arm's", True),
        ("put the propeller on another motor", True),
        ("hover 60 s full, then swap the rotor pair in question", True),
        ("swap two propellers of one direction of rotation", False),
        ("fit a new propeller of the same kind", False),
        ("motors 3 and 4 look swapped", False),
    ],
)
def test_an_exchange_across_is_told_from_others(sentence: str, dangerous: bool):
    assert crosses(sentence) is dangerous


@pytest.mark.parametrize("name", sorted(TABLE.keys() - set(GO_ON)))
def test_hands_on_the_aircraft_are_asked_for_with_motors_off(name: str):
    one = TABLE[name]
    if one.when in (When.BATTERY_OFF, When.DISARMED):
        assert OFF.search(one.text)
    if TOUCHED.search(one.words):
        assert OFF.search(one.text)
        assert one.when in (When.BATTERY_OFF, When.NEXT_FLIGHT)
    assert one.when is When.IN_FLIGHT or not one.text.startswith("land")


def test_every_effect_and_every_value_of_a_season_takes_its_action_from_the_table():
    known = set(TABLE.values())
    for effect in CATALOGUE:
        words = effect_sentences.WORDS.get(effect.key) or effect_sentences.WORDS[effect.name]
        assert words.action in known
    for name in (
        *fleet_words.VALUES,
        *fleet_words.TRENDS,
        "rotor_degradation.loss@3",
        "parasite_drag.area",
    ):
        assert fleet_words.value_words(name).action in known


@pytest.mark.parametrize("kind", ["propeller", "motor"])
def test_a_rotor_alarm_asks_to_land_and_fits_a_statustext(kind):
    fault = RotorFault(kind=kind, rotor=11, size=0.12, lower=0.1, upper=0.15)
    said = alarm_words.fault_words(fault)
    assert said.endswith(actions.LAND.text)
    assert len(said) <= 50


def test_no_advice_stands_twice():
    words = [one.words for one in TABLE.values()]
    assert len(set(words)) == len(words)
    others = "".join(
        p.read_text("utf-8") for p in (ROOT / "gcs_plugin").rglob("*.py") if p.name != "actions.py"
    )
    assert [w for w in words if len(w) > 12 and f'"{w}' in others] == []


#: By hand: finding -> how soon after the flight and in it, and words of its action and its proof.
ASKED = {
    "bad rotor or motor": ("stop", "stop", "propellers, motors and ESCs", "the loss must be gone"),
    "lost control": ("stop", "stop", "known why", "hover it low"),
    "collapsed battery": ("stop", "stop", "test it, or retire it", "no cell may fall below 3.0 V"),
    "battery resistance": ("soon", "nothing", "test it, or retire it", "no cell may fall"),
    "no thrust left": ("stop", "stop", "then fill less", "below the limit"),
    "too heavy to lose a rotor": ("stop", "soon", "fill less", "below the limit"),
    "above the limit, or near it": ("soon", "soon", "fill less", "below the limit"),
    "motor order": ("soon", "soon", "motor test", "motor order must be right"),
    "load not reported": ("soon", "soon", "empty mass", "gauge, pump and thrust must agree"),
    "load not known": ("soon", "nothing", "connect a tank gauge", "must agree"),
    "tank gauge": ("soon", "soon", "check the tank gauge", "must agree"),
    "scale of the tank gauge": ("soon", "nothing", "set the gauge", "must agree"),
    "mass not reported in all flights": ("soon", "nothing", "weigh it", "must agree"),
    "battery voltage": ("soon", "soon", "voltmeter", "fall as the current rises"),
    "rotor speeds": ("soon", "soon", "telemetry of the ESCs", "ESC telemetry"),
    "barometer": ("soon", "nothing", "weather station", "left out"),
    "model": ("soon", "soon", "identify", "speeds and model must agree"),
    "weak rotors not looked for": ("soon", "nothing", "every propeller", "ESC telemetry"),
    "sound rotors not learnt": ("soon", "nothing", "every propeller", "three sound flights"),
    "part of the flight not in the log": ("soon", "nothing", "how the flight ended", "whole log"),
    "repair that nobody noted": ("soon", "nothing", "is repaired", "the loss must be gone"),
    "wind": ("soon", "nothing", "airspeed sensor", "left out"),
    "lost telemetry": ("nothing", "stop", "radio", "must not stop"),
}
SOON = {"stop": "STOP", "soon": "BEFORE_NEXT", "nothing": "NOTHING"}


def test_every_finding_has_an_urgency_an_action_and_a_proof():
    assert {str(one) for one in actions.Trouble} == set(ASKED)
    for trouble in actions.Trouble:
        after, in_flight, action, proof = ASKED[trouble]
        found = actions.answer_to(trouble)
        assert (found.urgency.name, trouble) == (SOON[after], trouble)
        assert action in found.action.text, trouble
        assert proof in found.proof.text, trouble
        assert found == actions.answer_to(trouble, actions.Phase.LANDED)
        flying = actions.answer_to(trouble, actions.Phase.IN_FLIGHT)
        assert (flying.urgency.name, trouble) == (SOON[in_flight], trouble)
        if in_flight == "stop":
            assert flying.action.text in ("land", "fly by sight")


def test_every_level_and_every_caveat_has_a_finding():
    assert set(actions.OF_LEVEL) == set(FlightLevel) - {FlightLevel.UNDER, FlightLevel.UNKNOWN}
    assert set(actions.OF_CAVEAT) == set(Caveat)


@pytest.mark.parametrize(
    ("level", "left_open", "urgency"),
    [
        ("under", False, "NOTHING"),
        ("under", True, "BEFORE_NEXT"),
        ("critical", True, "STOP"),
        ("near", False, "BEFORE_NEXT"),
    ],
)
def test_a_good_flight_that_leaves_something_open_is_no_green_one(level, left_open, urgency):
    found = actions.urgency_of(FlightLevel(level), left_open=left_open)
    assert found is not None
    assert found.name == urgency
    assert actions.urgency_of(FlightLevel.UNKNOWN, left_open=left_open) is None


@pytest.mark.parametrize(
    ("trouble", "severity"),
    [("lost control", 2), ("bad rotor or motor", 2), ("collapsed battery", 2), ("tank gauge", 4),
     ("above the limit, or near it", 4), ("lost telemetry", 2), ("barometer", 5)],
)  # fmt: skip
def test_an_alarm_is_as_severe_as_its_finding_is_urgent_in_flight(trouble, severity):
    """MAV_SEVERITY: 2 critical, 4 warning, 5 notice."""
    assert severity_of(actions.Trouble(trouble)) == severity
