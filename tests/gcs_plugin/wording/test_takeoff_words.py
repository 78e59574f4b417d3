"""Words of the check before take-off: short enough for a STATUSTEXT, with amounts and a look."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.models.checks.test_takeoff import flight, only
from thrustmargin.gcs_plugin.wording.language import speaking
from thrustmargin.gcs_plugin.wording.takeoff_words import (
    check_line,
    finding_words,
    takeoff_alarm,
)
from thrustmargin.models.checks.takeoff import DO_NOT_LIFT, TakeoffFinding, TakeoffKind

PLACES = ("front right", "rear left", "front left", "rear right")


def finding(kind: TakeoffKind, motors: tuple[int, ...] = (2,)) -> TakeoffFinding:
    value, reference = {
        TakeoffKind.HOT: (366.15, 313.15),
        TakeoffKind.LEAD: (0.029, 0.004),
        TakeoffKind.SLOW: (900.0, 1900.0),
        TakeoffKind.FAST: (2850.0, 1900.0),
        TakeoffKind.REVERSED: (-0.8, 0.2),
        TakeoffKind.WEIGHT: (39.1, 31.1),
        TakeoffKind.YAW: (0.04, 0.1),
    }.get(kind, (1.2, 0.0))
    return TakeoffFinding(
        kind=kind, motors=motors, value=value, reference=reference, time_s=9.0, low=1140, high=2375
    )


@pytest.mark.parametrize("kind", sorted(DO_NOT_LIFT))
@pytest.mark.parametrize("language", ["en", "de"])
@pytest.mark.parametrize("motors", [(11,), (0, 1), (0, 2, 4), (1, 3, 5, 7), tuple(range(8))])
def test_an_alarm_fits_a_statustext(kind: TakeoffKind, language: str, motors: tuple[int, ...]):
    most = {TakeoffKind.REVERSED: 8, TakeoffKind.EXCHANGED: 2}.get(kind, 1)
    if len(motors) > most:
        return
    with speaking(language):
        for flying in (False, True):
            text = takeoff_alarm(finding(kind, motors), flying=flying)
            assert len(text) <= 50, text
            assert "{" not in text


def test_on_the_ground_it_says_do_not_lift_and_aloft_land():
    late = finding(TakeoffKind.LATE)
    assert takeoff_alarm(late, flying=False) == "DO NOT LIFT: motor 3 turns late (1.2 s)"
    assert takeoff_alarm(late, flying=True) == "Motor 3 turned late (1.2 s): land"
    wrong = finding(TakeoffKind.REVERSED, (0, 1))
    assert takeoff_alarm(wrong, flying=True) == "Motor 1 or 2 turns the wrong way: land"
    octo = finding(TakeoffKind.REVERSED, (0, 1, 4, 5))
    assert takeoff_alarm(octo, flying=False) == "DO NOT LIFT: a motor turns the wrong way"


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (TakeoffKind.SLOW, "motor 3 front left turned at 900 rpm, 1 140 rpm to 2 375 rpm are"),
        (TakeoffKind.HOT, "ESC 3 front left had 93 °C, the others 40 °C"),
        (TakeoffKind.LEAD, "the lead of ESC 3 front left has 29 mΩ, the others 4 mΩ"),
        (TakeoffKind.SILENT, "no speed of motor 3 front left is reported: not known"),
        (TakeoffKind.WEIGHT, "after lift-off thrust carries 39.1 kg, 31.1 kg are stated"),
        (TakeoffKind.YAW, "4 % of the yaw authority was left after lift-off"),
        (TakeoffKind.REVERSED, "yaw ran away at 46 °/s against the rotors"),
    ],
)
def test_a_finding_has_its_amount_and_what_is_sound(kind: TakeoffKind, words: str):
    assert finding_words(finding(kind), PLACES).startswith(words)


@pytest.mark.parametrize("kind", list(TakeoffKind))
def test_every_finding_has_words_in_german(kind: TakeoffKind):
    english = finding_words(finding(kind), PLACES)
    with speaking("de"):
        german = finding_words(finding(kind), PLACES)
    assert german != english
    assert "{" not in german + english


def test_the_line_of_a_run_up_says_what_is_known_and_what_is_not():
    sound = only(flight())
    assert check_line(sound).startswith(
        "4 of 4 motors turn, started within 0.0 s of each other; 58.8 V at rest"
    )
    assert "% of the yaw authority left" in check_line(sound)
    part = only(flight(silent=[2]))
    assert check_line(part).startswith(
        "3 of 4 motors turn, started within 0.0 s of each other, 1 not known"
    )
    blind = only(flight(silent=[0, 1, 2, 3]))
    assert check_line(blind).startswith("no rotor speed is reported: not known whether the motors")
    bare = replace(sound, rest_voltage=float("nan"), mass_kg=float("nan"), yaw_reserve=float("nan"))
    assert check_line(bare) == "4 of 4 motors turn, started within 0.0 s of each other"
