"""The answer of a flight in words: the gravest first, the amount, the place and what to do."""

from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.gcs_plugin.wording.advice_words import (
    action,
    facts,
    headline,
    several_headline,
)
from thrustmargin.gcs_plugin.wording.answer import answer_of
from thrustmargin.gcs_plugin.wording.margin_verdict import verdict_facts
from thrustmargin.models.checks.loss_of_control import LossKind, LossOfControl
from thrustmargin.models.model.advice import Advice, Battery, FlightLevel, RotorLost
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.analysis import ThrustUse
from thrustmargin.models.model.fault_test import RotorFault
from thrustmargin.models.model.fill_limits import NextFill, unsound_fill
from thrustmargin.models.model.model_misfit import Caveat
from thrustmargin.models.model.rotor_faults import FaultEpisode

NO = np.zeros(3, dtype=np.bool_)
USE = ThrustUse(
    lasting_most=0.54,
    lasting_low=0.54,
    lasting_high=0.54,
    lasting_above_limit_s=162.2,
    above_limit_s=172.0,
    known_s=200.0,
    step_s=0.1,
    peak=0.733,
    passing=5,
    passing_longest_s=7.0,
    spent_s=0.0,
    spent_alone=None,
    lasting=np.full(3, 0.54),
    reach=np.zeros(3),
    surely_above=~NO,
    maybe_above=~NO,
)
FILL = NextFill(
    kg=8.6,
    limit_kg=9.7,
    low_kg=8.6,
    high_kg=10.8,
    fresh_kg=12.0,
    reason="one rotor lost",
    start_kg=16.0,
    liquid_density=1.0,
)
ADVICE = Advice(
    levels=(FlightLevel.CRITICAL,),
    limit=0.5,
    airborne_s=200.0,
    use=USE,
    rotor_lost=RotorLost(
        redundancy_min=0.92,
        redundancy_min_low=0.91,
        redundancy_min_high=0.93,
        not_survivable_s=180.0,
        known_s=200.0,
    ),
    battery=Battery(),
    fill=FILL,
    faults=(),
    repaired=(),
    losses=(),
    rotor_count=4,
    rotor_names=("front right", "rear left", "front left", "rear right"),
    unseen_from_s=float("nan"),
    begun_before=False,
    paused_s=0.0,
    in_progress=False,
    unsought_s=0.0,
    by_outputs_s=0.0,
    predicted_alone=False,
    no_verdict=False,
)
FAULT = RotorFault(kind="propeller", rotor=2, size=0.12, lower=0.11, upper=0.13)


def with_fault(*levels: FlightLevel, fault: RotorFault = FAULT, **changed: object) -> Advice:
    episode = FaultEpisode(begin_s=145.0, end_s=None, fault=fault)
    return replace(ADVICE, levels=(FlightLevel.DAMAGED, *levels), faults=(episode,), **changed)


def test_a_flight_below_the_limit_is_not_told_nothing_and_to_fill_nothing():
    none = replace(FILL, kg=0.0, limit_kg=-1.0, low_kg=-2.0, high_kg=-0.5, reason="utilisation")
    within = replace(ADVICE, levels=(FlightLevel.UNDER,), fill=none)
    assert action(within).startswith("disarmed on the ground, check the airspeed sensor; do not ")
    assert action(replace(within, fill=FILL)).startswith("nothing; you may fill up to 8.6 kg")


def test_the_first_line_of_each_level():
    def say(level: FlightLevel, **changed: object) -> str:
        return headline(replace(ADVICE, levels=(level,), **changed))

    assert say(FlightLevel.CRITICAL) == (
        "FILL LESS: FOR 3 MIN A FAILED ROTOR WOULD HAVE BROUGHT IT DOWN"
    )
    whole = replace(ADVICE.rotor_lost, not_survivable_s=200.0)
    assert "ALL FLIGHT A FAILED ROTOR" in say(FlightLevel.CRITICAL, rotor_lost=whole)
    assert say(FlightLevel.CRITICAL, fill=replace(FILL, nothing_fits="tank")).startswith(
        "TOO HEAVY:"
    )
    assert say(FlightLevel.OVER) == "THRUST LEFT BELOW THE 50 % LIMIT FOR 2 MIN 42 S"
    assert say(FlightLevel.OVER, use=replace(USE, lasting_above_limit_s=200.0)) == (
        "THRUST LEFT BELOW THE 50 % LIMIT ALL FLIGHT"
    )
    assert say(FlightLevel.NEAR) == "THRUST LEFT NEAR THE 50 % LIMIT: CANNOT TELL"
    assert say(FlightLevel.UNDER) == "THRUST LEFT ABOVE THE 50 % LIMIT"
    assert say(FlightLevel.UNDER, limit=0.6) == "THRUST LEFT ABOVE THE 40 % LIMIT"
    assert say(FlightLevel.UNKNOWN) == "NO VERDICT"
    assert say(FlightLevel.UNDER, unseen_from_s=108.0) == (
        "THRUST LEFT ABOVE THE 50 % LIMIT UP TO 1:48 (LOG ENDS IN FLIGHT)"
    )
    assert say(FlightLevel.OVER, unseen_from_s=108.0) == (
        "THRUST LEFT BELOW THE 50 % LIMIT FOR 2 MIN 42 S (LOG ENDS IN FLIGHT)"
    )
    assert say(FlightLevel.UNDER, begun_before=True) == (
        "THRUST LEFT ABOVE THE 50 % LIMIT (LOG BEGINS IN FLIGHT)"
    )
    assert say(FlightLevel.UNDER, begun_before=True, unseen_from_s=108.0) == (
        "THRUST LEFT ABOVE THE 50 % LIMIT UP TO 1:48 (LOG BEGINS AND ENDS IN FLIGHT)"
    )
    assert say(FlightLevel.UNDER, paused_s=61.0) == (
        "THRUST LEFT ABOVE THE 50 % LIMIT (NOTHING IN THE LOG FOR 1 MIN 1 S OF IT)"
    )
    assert say(FlightLevel.UNKNOWN, begun_before=True) == "NO VERDICT"
    part = replace(ADVICE.rotor_lost, not_survivable_s=13.0, known_s=24.0)
    assert say(FlightLevel.CRITICAL, rotor_lost=part) == (
        "FILL LESS: FOR 13 S OF 24 S WITH A KNOWN LOAD A FAILED ROTOR WOULD HAVE BROUGHT IT DOWN"
    )
    assert say(FlightLevel.NO_THRUST, use=replace(USE, spent_s=14.0)) == "NO THRUST LEFT FOR 14 S"
    weak = replace(USE, spent_s=5.6, spent_alone=2)
    assert say(FlightLevel.NO_THRUST, use=weak) == "ROTOR 3 ALONE HAD NO THRUST LEFT FOR 5.6 S"
    assert say(FlightLevel.NO_THRUST, use=weak, rotor_names=()) == "NO THRUST LEFT FOR 5.6 S"
    collapsed = Battery(least_cell=2.61, at_s=190.0)
    assert action(replace(ADVICE, levels=(FlightLevel.NO_THRUST,), use=weak)) == (
        "do not fly it before propeller, motor and ESC of rotor 3 were looked at, battery off; "
        "then fill at most 8.6 kg (8.6 L): with more it would descend after losing a rotor"
    )
    assert say(FlightLevel.BATTERY, battery=collapsed) == "BATTERY COLLAPSED: 2.61 V A CELL AT 3:10"


def test_the_first_line_is_no_surer_than_what_it_rests_on():
    good = replace(ADVICE, levels=(FlightLevel.UNDER,))
    assert headline(good) == "THRUST LEFT ABOVE THE 50 % LIMIT"
    short = replace(good, rotor_lost=replace(good.rotor_lost, known_s=14.0))
    assert headline(short) == "THRUST LEFT ABOVE THE 50 % LIMIT (KNOWN FOR 14 S OF 3 MIN 20 S)"
    brief_use = replace(good, use=replace(USE, known_s=110.0))
    assert (
        headline(brief_use)
        == "THRUST LEFT ABOVE THE 50 % LIMIT (KNOWN FOR 1 MIN 50 S OF 3 MIN 20 S)"
    )
    near = replace(good, levels=(FlightLevel.NEAR,), rotor_lost=RotorLost())
    assert headline(near) == "THRUST LEFT NEAR THE 50 % LIMIT: CANNOT TELL (LOAD NOT KNOWN)"


def test_a_bad_rotor_comes_first_with_its_place_and_amount():
    assert headline(with_fault(FlightLevel.CRITICAL)) == "ROTOR 3, FRONT LEFT: 12 % LESS THRUST"
    growing = replace(FAULT, upper=0.6, lower=0.4)
    assert headline(with_fault(fault=growing)) == "ROTOR 3, FRONT LEFT: OVER 40 % LESS THRUST"
    motor = replace(FAULT, kind="motor")
    assert headline(with_fault(fault=motor)) == "MOTOR 3, FRONT LEFT: 12 % SLOW FOR ITS OUTPUT"
    one_of = replace(FAULT, rotors=(3, 1))
    assert headline(with_fault(fault=one_of)) == "ROTOR 4 OR 2: LESS THRUST"
    assert headline(with_fault(rotor_names=())) == "A ROTOR: LESS THRUST"


def test_a_loss_of_control_stands_in_the_first_line_beside_the_rotor():
    loss = LossOfControl(kind=LossKind.TURNED_OVER, time_s=34.0, value=2.0)
    lost = with_fault(FlightLevel.LOST, losses=(loss,))
    assert headline(lost) == "ROTOR 3, FRONT LEFT: 12 % LESS THRUST; LOST CONTROL AT 0:34"
    assert "kg" not in action(lost)  # what was left before it went wrong advises no fill
    assert action(lost).startswith("do not fly it before it is known why")
    alone = replace(ADVICE, levels=(FlightLevel.LOST,), losses=(loss,))
    assert headline(alone) == "LOST CONTROL AT 0:34"
    # Without a moment before it there is no line of it.
    facts = verdict_facts(None, alone, AirframeMatch(airframe="x"), "readings")
    assert [label for label, _ in facts] == ["what to do", "from", "airframe"]


def test_what_to_do_follows_the_same_order():
    said = action(with_fault(FlightLevel.CRITICAL, fill=unsound_fill(FILL)))
    assert said == (
        "do not fly it before propeller, motor and ESC of rotor 3 were looked at, battery off; "
        "no fill before the bad rotor or motor is repaired"
    )
    # While it flies it is to land, and the fill waits; without a damage nobody is asked to land.
    flying = action(with_fault(FlightLevel.CRITICAL, in_progress=True))
    assert flying.startswith("land; do not fly it before propeller, motor and ESC of rotor 3")
    assert "kg" not in flying
    assert action(replace(ADVICE, in_progress=True)) == action(ADVICE)
    assert action(ADVICE).startswith("fill at most 8.6 kg (8.6 L)")
    within = replace(ADVICE, levels=(FlightLevel.UNDER,))
    assert action(within).startswith("nothing; you may fill up to 8.6 kg (8.6 L)")
    unordered = action(with_fault(rotor_names=()))
    assert "of rotors 1, 2, 3 and 4 were looked at" in unordered
    assert "motor test" not in unordered  # all of them are looked at first
    which = action(replace(within, rotor_names=()))
    assert which.startswith("with the battery off, take the propellers off; then find by a motor")
    assert which.endswith(
        "then you may fill up to 8.6 kg (8.6 L): with more it would descend after losing a rotor"
    )
    empty = action(replace(ADVICE, levels=(FlightLevel.BATTERY, FlightLevel.OVER)))
    assert empty.startswith("with the battery off, take the battery out and test it")
    assert "then fill at most 8.6 kg" in empty
    spent = action(replace(ADVICE, levels=(FlightLevel.NO_THRUST, FlightLevel.OVER)))
    assert spent.endswith("fly turns and climbs more gently")
    tankless = replace(FILL, kg=0.0, limit_kg=3.0, low_kg=2.0, reason="tank", nothing_fits="tank")
    near = action(replace(ADVICE, levels=(FlightLevel.NEAR,), fill=tankless))
    assert near.endswith(
        "it has no tank; fly turns and climbs more gently; carry less than the "
        "16.0 kg of this flight"
    )
    asked = action(replace(within, rotor_names=(), fill=tankless))
    assert "find by a motor" in asked
    assert "tank" not in asked  # where something else is to be done
    gauge = action(replace(ADVICE, fill=replace(FILL, beyond_gauge_kg=3.4)))
    assert "thrust shows 3.4 kg more than was reported" in gauge
    assert "until then fill at most 8.6 kg" in gauge
    assert action(replace(ADVICE, levels=(FlightLevel.UNKNOWN,))) == ""


def test_the_facts_say_how_much_and_how_long():
    said = dict(facts(ADVICE))
    assert said == {
        "steady flight": "thrust left down to 46 %, below 50 % for 2 min 42 s of 3 min 20 s",
        "turns and gusts": "thrust left down to 26 %, below 50 % 5 times for 7.0 s at most",
        "one rotor lost": "would have brought it down for 3 min of 3 min 20 s (at worst the "
        "others carry 0.92 × its weight)",
        "fill, how sure": "the limit is most likely at 9.7 kg (8.6 to 10.8); at most 12.0 kg "
        "(12.0 L) with the battery as at the start",
    }
    unsure = replace(USE, lasting_above_limit_s=0.0, lasting_low=0.45, lasting_high=0.53)
    near = replace(ADVICE, use=replace(unsure, lasting_most=0.49, passing=0, surely_above=NO))
    assert dict(facts(near))["steady flight"] == (
        "thrust left down to 51 % (47 to 55), never below 50 %; the limit lies within the error"
    )
    assert "turns and gusts" not in dict(facts(near))
    seldom = replace(near, use=replace(near.use, step_s=2.0))
    unseen = "readings come every 2 s: peaks between them are not seen"
    assert dict(facts(seldom))["turns and gusts"] == unseen
    passed = replace(seldom, use=replace(seldom.use, passing=1))
    assert dict(facts(passed))["turns and gusts"].endswith(f" at most; {unseen}")
    assert "turns and gusts" not in dict(facts(replace(near, use=replace(near.use, step_s=1.0))))
    doubt = RotorLost(redundancy_min=1.03, redundancy_min_low=0.96, redundancy_min_high=1.1)
    assert dict(facts(replace(ADVICE, rotor_lost=doubt)))["one rotor lost"] == (
        "cannot tell whether the others would have carried it (1.03 ×, 0.96 to 1.10; 1 just "
        "carries it)"
    )
    safe = RotorLost(redundancy_min=1.1, redundancy_min_low=1.1, redundancy_min_high=1.1)
    assert dict(facts(replace(ADVICE, rotor_lost=safe)))["one rotor lost"] == (
        "the others could have carried it all flight, without yaw control, it will spin (at least "
        "1.10 × its weight)"
    )
    seen = replace(ADVICE, rotor_lost=replace(safe, known_s=14.0))
    assert dict(facts(seen))["one rotor lost"] == (
        "the others could have carried it for 14 s, without yaw control, it will spin (at least "
        "1.10 × its weight); "
        "of 3 min 20 s the load is unknown for the rest"
    )
    for unseen in ({"begun_before": True}, {"paused_s": 60.0}, {"unseen_from_s": 9.0}):
        words = dict(facts(replace(ADVICE, rotor_lost=safe, **unseen)))["one rotor lost"]
        assert words.startswith("the others could have carried it as long as the log goes, ")
    assert (
        "tank level is unknown"
        in dict(facts(replace(ADVICE, rotor_lost=RotorLost())))["one rotor lost"]
    )


@pytest.mark.parametrize(
    ("levels", "said"),
    [
        (
            [FlightLevel.UNDER, FlightLevel.CRITICAL, FlightLevel.OVER, FlightLevel.CRITICAL],
            "2 OF 4 FLIGHTS: TOO HEAVY TO",
        ),
        ([FlightLevel.UNDER, FlightLevel.DAMAGED], "1 OF 2 FLIGHTS: A BAD ROTOR OR MOTOR"),
        ([FlightLevel.UNDER] * 3, "ALL 3 FLIGHTS: THRUST LEFT ABOVE THE 50 % LIMIT"),
        ([FlightLevel.UNKNOWN] * 2, "ALL 2 FLIGHTS: NO VERDICT"),
        (
            [FlightLevel.UNKNOWN, FlightLevel.UNDER],
            "1 OF 2 FLIGHTS: THRUST LEFT ABOVE THE 50 % LIMIT",
        ),
    ],
)
def test_several_flights_are_counted_by_the_gravest(levels, said):
    level, words = several_headline(levels, 0.5)
    assert words.startswith(said)
    assert level in levels


def test_a_flight_without_a_verdict_says_why_in_its_line():
    unknown = replace(ADVICE, levels=(FlightLevel.UNKNOWN,), predicted_alone=True)
    said = "Last flight: NO VERDICT: predicted: for most of the flight no rotor speed was measured"
    assert answer_of(unknown).line.startswith(said)
    assert answer_of(replace(unknown, predicted_alone=False)).line == "Last flight: NO VERDICT"
    assert not answer_of(replace(ADVICE, levels=(FlightLevel.UNDER,), predicted_alone=True)).why


@pytest.mark.parametrize("said", [False, True])
def test_that_no_weak_rotor_could_be_looked_for_is_a_fact(said):
    advice = replace(ADVICE, caveats=(Caveat.ROTORS_NOT_SOUGHT,) if said else ())
    assert ("weak rotors" in dict(facts(advice))) is said


@pytest.mark.parametrize("said", [False, True])
def test_that_outputs_alone_show_the_rotors_is_a_fact(said):
    """Unsought rotors come before."""
    advice = replace(ADVICE, caveats=(Caveat.ROTORS_BY_OUTPUTS,) if said else ())
    assert (dict(facts(advice)).get("weak rotors", "").startswith("by motor outputs")) is said
    unsought = replace(advice, caveats=(Caveat.ROTORS_NOT_SOUGHT,))
    assert dict(facts(unsought))["weak rotors"].startswith("not looked for")
