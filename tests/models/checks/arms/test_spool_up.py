"""A motor before lift-off against itself on earlier flights, on run-ups made by hand."""

import numpy as np
import pytest

from tests.models.checks.test_takeoff import flight
from thrustmargin.models.checks.arms.arm_figures import ArmFigures, ArmQuantity
from thrustmargin.models.checks.arms.arm_law import ArmLaw
from thrustmargin.models.checks.arms.spool_up import spool_up_figure, usual_spool_up
from thrustmargin.models.checks.takeoff import TakeoffKind, TakeoffWatch, takeoff_checks

#: Speeds at a common output: motor 2 has always been 15 % faster.
OWN = np.array([1.0, 1.15, 1.0, 1.0])


def law(flights=6, scatter=0.02):
    rng = np.random.default_rng(4)
    made = []
    for day in range(flights):
        figure = spool_up_figure([(r, 1.0) for r in OWN * np.exp(scatter * rng.normal(size=4))])
        assert figure is not None
        made.append(ArmFigures(flight=f"earlier {day}", day=day, figures=(figure,)))
    return ArmLaw(flights=tuple(made))


def found(speed, arms, **changed):
    (check,) = takeoff_checks(flight(speed=tuple(speed), **changed), None, arms)
    return [(one.kind, one.motors) for one in check.findings]


def test_what_a_motor_always_did_is_sound_and_what_it_never_did_is_not():
    """Motor 2 as fast as the others is 15 % slower than it ever was; all others are sound."""
    assert found(OWN, law()) == []
    slow = OWN * np.array([1.0, 0.78, 1.0, 1.0])
    assert found(slow, law()) == [(TakeoffKind.UNLIKE, (1,))]
    assert found(slow, None) == []
    assert found(slow, law(flights=2)) == []


def test_the_finding_has_the_speeds_of_earlier_flights_and_forbids_nothing():
    slow = OWN * np.array([1.0, 1.0, 0.75, 1.0])
    (check,) = takeoff_checks(flight(speed=tuple(slow)), None, law())
    (one,) = check.findings
    assert one.motors == (2,)
    assert one.value == pytest.approx(0.75 * one.reference, rel=0.04)
    assert one.value < one.low < one.reference < one.high
    assert not one.forbids
    assert one.time_s < check.lift_s


def test_the_ratio_of_outputs_is_taken_into_account_and_makes_it_less_sure():
    """A motor asked for 30 % less turns a quarter slower, and is itself."""
    output = np.array([1.0, 1.0, 0.7, 1.0])
    assert found(OWN, law(), output=tuple(output)) == []
    figure = spool_up_figure([(0.9, 0.9), (1.0, 1.0), (np.nan, 1.0)])
    assert figure is not None
    assert figure.quantity is ArmQuantity.SPOOL_UP
    assert figure.value[:2] == pytest.approx([0.0, 0.0])
    assert np.isnan(figure.value[2])
    assert figure.error[0] == pytest.approx(0.0105, abs=0.001)
    assert figure.error[1] == 0.0


def test_a_listener_and_its_recording_agree():
    track = flight(speed=(1.0, 0.9, 1.0, 1.0))
    watch, arms = TakeoffWatch(), law()
    for row in range(0, track.time_s.size, 5):
        watch.add(track.rows(slice(row, row + 5)), None, arms)
    (check,) = takeoff_checks(track, None, arms)
    assert watch.now is not None
    assert watch.now.findings == check.findings
    assert [one.kind for one in check.findings] == [TakeoffKind.UNLIKE]


def test_a_law_of_other_aircraft_or_of_the_flight_itself_says_nothing():
    assert usual_spool_up(law(), "new", 6) is None
    assert usual_spool_up(None, "new", 4) is None
    assert spool_up_figure([]) is None
    itself = ArmLaw(flights=law(flights=3).flights)
    assert usual_spool_up(itself, "earlier 1", 4) is None  # two are left
