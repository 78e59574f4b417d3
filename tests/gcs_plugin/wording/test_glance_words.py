"""The banner's few words: each level of a flight and each alarm has its own, and all are short."""

from dataclasses import replace

import numpy as np
import pytest

from tests.gcs_plugin.wording.test_advice_words import ADVICE, FAULT, FILL, USE, with_fault
from thrustmargin.gcs_plugin.wording.glance_words import (
    alarm_then,
    before_take_off,
    glance,
    in_the_air,
    short_amount,
)
from thrustmargin.models.model.advice import FlightLevel, RotorLost
from thrustmargin.models.model.fill_limits import unsound_fill

MOST_LETTERS = 42  # two lines of the banner on a phone


def of(level: FlightLevel, **changes) -> str:
    return glance(replace(ADVICE, levels=(level,), **changes))


def test_each_level_of_a_flight_has_its_action():
    assert of(FlightLevel.UNDER) == "OK, 8.6 L next"
    assert of(FlightLevel.CRITICAL) == of(FlightLevel.OVER) == "FILL 8.6 L"
    assert of(FlightLevel.CRITICAL, in_progress=True) == "NEXT FILL 8.6 L"
    assert of(FlightLevel.BATTERY) == "DO NOT FLY: battery"
    assert of(FlightLevel.LOST) == "DO NOT FLY: control was lost"
    assert of(FlightLevel.ORDER) == "CHECK THE MOTOR ORDER"
    alone = replace(USE, spent_s=5.6, spent_alone=2)
    assert of(FlightLevel.NO_THRUST, use=alone) == "DO NOT FLY: rotor 3 front left"
    assert of(FlightLevel.CRITICAL, fill=replace(FILL, kg=0.0)) == "DO NOT FILL"
    heavy = replace(FILL, kg=0.0, limit_kg=-1.0, nothing_fits="tank")
    assert of(FlightLevel.CRITICAL, fill=heavy) == "TOO HEAVY"
    light = replace(FILL, kg=0.0, limit_kg=3.0, nothing_fits="tank")
    assert of(FlightLevel.OVER, fill=light) == "FLY GENTLY"
    assert of(FlightLevel.UNDER, fill=light) == "OK"


def test_a_bad_part_is_named_with_its_place_and_what_it_means_now():
    assert glance(with_fault()) == "DO NOT FLY: rotor 3 front left"
    assert glance(with_fault(in_progress=True)) == "LAND: rotor 3 front left"
    assert (
        glance(with_fault(fault=replace(FAULT, kind="motor"))) == "DO NOT FLY: motor 3 front left"
    )
    one_of = replace(FAULT, rotors=(0, 2))
    assert glance(with_fault(fault=one_of)) == "DO NOT FLY: rotors 1 and 3"


def test_what_is_good_is_short_only_where_all_of_the_flight_is_known():
    assert of(FlightLevel.UNDER, begun_before=True) == ""
    assert of(FlightLevel.UNDER, rotor_lost=RotorLost(known_s=0.0)) == ""
    assert of(FlightLevel.UNKNOWN) == ""


def test_an_alarm_says_in_the_air_what_to_do_and_in_a_replay_that_it_was():
    assert in_the_air("rotor", (3,), "front left") == "LAND: rotor 3 front left"
    assert in_the_air("stopped", (3,)) == "LAND: rotor 3"
    assert in_the_air("esc", (2,), "rear left") == "LAND: ESC 2 rear left"
    assert in_the_air("saturation", (1,)) == "SLOW DOWN: rotor 1"
    assert in_the_air("margin", ()) == "FLY GENTLY"
    assert in_the_air("control", ()) == "CONTROL LOST"
    assert in_the_air("rotor", ()) == in_the_air("telemetry", ()) == ""
    assert alarm_then(FAULT, ADVICE.places) == "alarm then: rotor 3 front left, 12 % less thrust"
    slow = replace(FAULT, kind="motor")
    assert alarm_then(slow) == "alarm then: motor 3, 12 % slow for its output"
    assert alarm_then(replace(FAULT, kind="stopped")) == "alarm then: rotor 3 stands still"
    assert alarm_then(replace(FAULT, rotors=(0, 2))) == "alarm then: one of rotors 1 and 3"


@pytest.mark.parametrize(
    ("aboard", "headline", "red"),
    [
        (2.0, "2.0 L on board, at most 8.6 L", False),
        (8.6, "8.6 L on board, at most 8.6 L", False),
        (8.72, "TOO MUCH: 8.8 L, at most 8.6 L", True),
        (np.nan, "FILL AT MOST 8.6 L", False),
    ],
)
def test_before_take_off_the_fill_is_beside_the_largest(aboard: float, headline: str, red: bool):
    assert before_take_off(FILL, aboard) == (headline, red)
    assert len(headline) <= MOST_LETTERS


def test_without_a_fill_nothing_is_made_up():
    assert before_take_off(replace(FILL, kg=np.nan), 3.0) == ("", False)
    assert before_take_off(unsound_fill(FILL), 3.0)[1]
    assert short_amount(8.69) == "8.6 kg"
    assert short_amount(8.69, 1.1) == "7.9 L"
