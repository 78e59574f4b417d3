"""The arms of a flight in progress against those of the whole flight, on flights of a plant."""

from dataclasses import replace
from functools import cache

import pytest

from tests.models.checks.arms.arm_plant import F16, Bad, arm_flight
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
from thrustmargin.models.model.flight_arms import (
    ArmsSoFar,
    flight_arm_answer,
    learnt_arms,
)
from thrustmargin.models.model.rotor_model import physics_model

MODEL = physics_model(F16)


@cache
def known():
    good = [arm_flight(k, day=k, aircraft=3) for k in range(8)]
    return replace(MODEL, arms=learnt_arms(MODEL, good))


def so_far(analysis: FlightAnalysis, piece: int):
    watch, answers = ArmsSoFar(), []
    for first in range(0, analysis.track.time_s.size, piece):
        answers += watch.add(analysis, slice(first, first + piece))
    return answers


def bad_flight(cause: str, size: float) -> FlightTrack:
    return arm_flight(71, 30, Bad(cause=cause, size=size, arm=2), aircraft=3)


def arms_of(answer):
    return [] if answer is None else [(one.arm, one.cause) for one in answer.findings]


@pytest.mark.parametrize(("cause", "size"), [("telemetry", 0.12), ("shaken", 0.3), ("motor", 0.12)])
def test_a_flight_in_progress_ends_at_the_answer_of_its_file(cause, size):
    analysis = analyse(bad_flight(cause, size), known())
    whole, last = flight_arm_answer(analysis), so_far(analysis, 40)[-1]
    assert last is not None
    assert arms_of(last) == arms_of(whole)
    assert (last.shaken is None) == (whole.shaken is None) == (cause != "shaken")


def test_how_the_rows_are_cut_changes_no_answer():
    analysis = analyse(bad_flight("telemetry", 0.12), known())
    some, others = (so_far(analysis, piece) for piece in (7, 300))
    assert [arms_of(one) for one in some] == [arms_of(one) for one in others]
    # Half a minute of flight has the six blocks that a figure needs.
    first = next(k for k, one in enumerate(some) if arms_of(one))
    assert 35.0 < analysis.track.time_s[first] < 50.0


def test_another_flight_begins_anew_and_a_sound_one_says_nothing():
    lossy, sound = bad_flight("telemetry", 0.12), arm_flight(72, 31, aircraft=3)
    watch = ArmsSoFar()
    first = watch.add(analyse(lossy, known()), slice(None))
    assert arms_of(first[-1])
    later = replace(sound, time_s=sound.time_s + 1000.0)
    second = watch.add(analyse(later, known()), slice(None))
    took_off = int((~later.flying).argmin())
    assert second[took_off] is None
    assert not any(map(arms_of, second[took_off:]))
