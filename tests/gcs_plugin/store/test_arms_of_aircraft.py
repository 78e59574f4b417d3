"""What is expected of the arms of a known aircraft: its sound flights since the last repair."""

from dataclasses import replace
from pathlib import Path

from tests.gcs_plugin.wording.test_advice_words import ADVICE
from thrustmargin.gcs_plugin.store.hangar import AircraftFlight, Event, KnownAircraft, NotTaught
from thrustmargin.gcs_plugin.store.learnt_flight import bad_arms
from thrustmargin.models.checks.arms.arm_causes import Cause
from thrustmargin.models.checks.arms.arm_figures import ArmFigure, ArmFigures, ArmQuantity
from thrustmargin.models.checks.arms.arm_posterior import (
    ArmAnswer,
    ArmFinding,
    PossibleCause,
    Shaken,
)


def row(k, **more):
    power = ArmFigure(quantity=ArmQuantity.POWER, value=(0.0,) * 4, error=(0.001,) * 4)
    arms = ArmFigures(flight=f"f{k}", day=k, figures=(power,))
    return AircraftFlight(
        flight=f"f{k}", log_name=f"{k}.BIN", started_unix_s=1000.0 * k, arms=arms, **more
    )


def names(law):
    return None if law is None else [one.flight for one in law.flights]


AIRCRAFT = KnownAircraft(folder=Path(), name="x", marks=(), flights=tuple(map(row, range(5))))


def test_only_earlier_flights_are_expected_again():
    assert names(AIRCRAFT.arms_before(3000.0)) == ["f0", "f1", "f2"]
    assert names(AIRCRAFT.arms_before()) == ["f0", "f1", "f2", "f3", "f4"]
    assert AIRCRAFT.arms_before(0.0) is None


def test_a_fault_does_not_become_what_is_expected():
    flights = list(AIRCRAFT.flights)
    flights[1] = row(1, bad_arms=(2,))
    flights[3] = row(3, not_taught=NotTaught.FAULT)
    assert names(replace(AIRCRAFT, flights=tuple(flights)).arms_before()) == ["f0", "f2", "f4"]


def test_after_a_repair_learning_begins_anew():
    repaired = replace(AIRCRAFT, events=(Event(unix_s=1500.0, changed="motor 3"),))
    assert names(repaired.arms_before()) == ["f2", "f3", "f4"]
    assert names(repaired.arms_before(1200.0)) == ["f0", "f1"]
    assert [one.flight for one in repaired.arms_since_repair] == ["f2", "f3", "f4"]


def test_of_a_shaken_aircraft_any_arm_may_be_bad_and_of_a_wrong_reading_none():
    def finding(arm, cause):
        one = PossibleCause(cause=cause, probability=1.0, size=0.5, lower=0.4, upper=0.6)
        return ArmFinding(arm=arm, probability=0.99, causes=(one,), shown=())

    def bad(arms, shaken=None):
        answer = ArmAnswer(findings=arms, quantities=(), flights=5, days=3, shaken=shaken)
        return bad_arms(replace(ADVICE, arms=answer), 4)

    assert bad((finding(2, Cause.MOTOR), finding(1, Cause.TELEMETRY))) == (2,)
    shaken = Shaken(ratio=3.0, lower=2.0, upper=4.5, deviations=6.0)
    assert bad((), shaken) == (0, 1, 2, 3)
    assert bad_arms(replace(ADVICE, arms=None), 4) == ()
