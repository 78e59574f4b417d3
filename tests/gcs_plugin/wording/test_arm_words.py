"""What is said of an arm: the part, how much, how sure, what else, and what settles it."""

from dataclasses import replace

import pytest

from thrustmargin.gcs_plugin.wording.arm_words import (
    AMOUNTS,
    LOOKS,
    PARTS,
    amount_words,
    arm_sentence,
    arm_sentences,
    shaken_sentence,
    trend_sentence,
)
from thrustmargin.gcs_plugin.wording.language import speaking
from thrustmargin.models.checks.arms.arm_causes import PATTERNS, Cause
from thrustmargin.models.checks.arms.arm_posterior import (
    ArmAnswer,
    ArmFinding,
    PossibleCause,
    Shaken,
)
from thrustmargin.models.checks.arms.arm_trend import PowerTrend


def possible(cause, probability=1.0, size=0.06):
    low, high = sorted((0.7 * size, 1.3 * size))
    return PossibleCause(cause=cause, probability=probability, size=size, lower=low, upper=high)


def finding(*causes, arm=2, probability=0.98):
    return ArmFinding(arm=arm, probability=probability, causes=causes, shown=())


def test_one_cause_is_said_with_its_amount_interval_probability_and_look():
    assert arm_sentence(finding(possible(Cause.LEAD))) == (
        "arm 3: its lead or a lug takes 6 % (4 to 8) more of the voltage under load, 98 % sure; "
        "with the battery off, right after landing, feel its lugs and connectors for heat"
    )


def test_the_others_that_it_may_be_are_listed_with_their_probability():
    several = finding(possible(Cause.MOTOR, 0.6), possible(Cause.CURRENT_READING, 0.37))
    assert arm_sentence(several) == (
        "arm 3: its motor takes 6 % (4 to 8) more power at its speed, 59 % sure; else the reading "
        "of its current (37 %); with the battery off, turn its motor by hand: it must run as "
        "freely as the others"
    )


SHAKEN = Shaken(ratio=1.65, lower=1.4, upper=1.9, deviations=5.0)


def test_the_sign_of_a_size_changes_the_words():
    assert "less thrust" in amount_words(possible(Cause.PROPELLER))
    assert "6 % (4 to 8) more thrust" in amount_words(possible(Cause.PROPELLER, size=-0.06))
    assert "too little voltage" in amount_words(possible(Cause.VOLTAGE_READING))


@pytest.mark.parametrize("language", ["en", "de"])
def test_every_cause_has_words_in_every_language(language):
    assert set(AMOUNTS) == set(PARTS) == set(LOOKS) == set(Cause) == set(PATTERNS)
    with speaking(language):
        said = {cause: arm_sentence(finding(possible(cause))) for cause in Cause}
        assert len(set(said.values())) == len(Cause)
        aircraft = shaken_sentence(SHAKEN)
        assert ("das Fluggerät" if language == "de" else "the aircraft") in aircraft
        assert "65 % (40 to 90)" in aircraft or "65 % (40 bis 90)" in aircraft
        for cause, pattern in PATTERNS.items():
            assert bool(AMOUNTS[cause][1]) == pattern.both_ways
    assert ("Arm 3" if language == "de" else "arm 3") in said[Cause.MOTOR]


def test_a_voltage_reading_alone_is_left_to_the_check_of_every_log():
    answer = ArmAnswer(
        findings=(finding(possible(Cause.VOLTAGE_READING)), finding(possible(Cause.MOTOR), arm=0)),
        quantities=(),
        flights=5,
        days=2,
    )
    assert [words[:5] for words in arm_sentences(answer)] == ["arm 1"]
    assert arm_sentences(None) == ()
    weak = replace(answer, findings=(finding(possible(Cause.PROPELLER), arm=0),))
    assert len(arm_sentences(weak)) == 1
    assert arm_sentences(weak, weak=[0]) == ()


def test_what_shakes_the_aircraft_comes_after_its_arms():
    arms = (finding(possible(Cause.MOTOR)),)
    answer = ArmAnswer(findings=arms, quantities=(), flights=5, days=2, shaken=SHAKEN)
    assert [words[:12] for words in arm_sentences(answer)] == ["arm 3: its m", "the aircraft"]


def test_a_trend_says_since_when_and_what_to_look_at():
    trend = PowerTrend(arm=2, change=0.06, lower=0.04, upper=0.08, flights=21)
    assert trend_sentence(trend) == (
        "arm 3 needs 6 % (4 to 8) more power at its speed than 20 flights ago; with the battery "
        "off, turn its motor by hand: it must run as freely as the others"
    )


def test_an_interval_that_includes_zero_says_so():
    unsure = replace(possible(Cause.PROPELLER), lower=-0.02, upper=0.04)
    assert "6 % (0 to 4)" in amount_words(unsure)
