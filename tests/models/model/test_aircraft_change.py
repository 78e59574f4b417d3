"""How a flight differs from those of its aircraft before it: mode, size, mass, and by chance."""

from dataclasses import replace
from typing import Any

import pytest

from thrustmargin.models.model.aircraft_change import (
    ChangeKind,
    ChangeMode,
    aircraft_change,
    least_coverage,
)
from thrustmargin.models.model.mode_walk import FlightOffsets, WalkSizes, walk
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.offset_total import RotorTotal

DAY_S = 86_400.0
MODEL: Any = shipped_model()
SIZES = WalkSizes(flight=0.004, day=0.004)
SPEED, WEIGHT = 2000.0, 30.0 * 9.80665  # rpm, N


def step(last, error=0.0005):
    """The last step of a walk over five sound flights and one with other offsets."""
    rows = [(0.0, 0.0, 0.0, 0.0)] * 5 + [last]
    flights = [
        FlightOffsets(
            flight=f"{k}", start_unix_s=k * DAY_S, longitude_deg=0.0, offset=row,
            error=(error,) * 4, rows=900,
        )
        for k, row in enumerate(rows)
    ]  # fmt: skip
    return walk(flights, SIZES)[-1]


def change(last, coverage=0.93, rotor=None) -> Any:
    model = MODEL
    return aircraft_change(
        step(last), model.airframe, speed_rpm=SPEED, weight=WEIGHT, coverage=coverage,
        interval=model.interval, rotor=rotor,
    )  # fmt: skip


def test_a_flight_within_the_walk_is_no_change():
    assert change((0.004, -0.003, 0.003, 0.006)) is None


def test_all_rotors_faster_is_a_mass_with_its_interval():
    found = change((0.035, 0.0, 0.0, 0.0))
    assert found.kind is ChangeKind.OFFSET
    (mode,) = found.modes
    assert mode.mode is ChangeMode.COLLECTIVE
    assert mode.rpm == pytest.approx(70.0)
    assert mode.faster == (0, 1, 2, 3)
    assert mode.slower == ()
    # Thrust goes with the square of the speed: 30 kg times 1.035² - 1.
    assert found.mass_kg == pytest.approx(2.137, abs=0.001)
    assert found.mass_low_kg < found.mass_kg < found.mass_high_kg
    # The state is known to .05 % after five flights, and so is the flight.
    assert mode.high_rpm - mode.rpm == pytest.approx(2000 * 1.645 * 0.0005 * 2**0.5, rel=0.02)


def test_a_moment_names_the_rotors_of_either_side_and_no_mass():
    found = change((0.0, 0.0, 0.0, -0.03))
    (mode,) = found.modes
    assert mode.mode is ChangeMode.YAW
    assert mode.rpm == pytest.approx(-60.0)
    assert len(mode.faster) == len(mode.slower) == 2
    assert found.mass_kg != found.mass_kg
    both = change((0.03, 0.0, 0.0, -0.04))
    assert [one.mode for one in both.modes] == [ChangeMode.YAW, ChangeMode.COLLECTIVE]


def test_a_flight_whose_speeds_leave_their_interval_is_a_change_of_coverage():
    least = least_coverage(MODEL.interval)
    assert 0.71 < least < 0.86  # 27 flights held 87 to 99 %
    assert change((0.0,) * 4, coverage=least + 0.01) is None
    found = change((0.0,) * 4, coverage=least - 0.01)
    assert found.kind is ChangeKind.COVERAGE
    assert found.modes == ()
    no_flights = replace(MODEL.interval, measured=None)
    # 2.807 times 6 % below 90 %: once in 400 flights
    assert least_coverage(no_flights) == pytest.approx(0.7316, abs=0.0005)


def test_a_weak_rotor_stands_before_all_else():
    total = RotorTotal(
        rotor=2, loss=0.05, low=0.04, high=0.06, since_unix_s=0.0, flights=9, probability=0.99
    )
    found = change((0.03, 0.0, 0.0, 0.0), rotor=total)
    assert found.kind is ChangeKind.WEAK_ROTOR
    assert found.rotor == total
    assert found.modes
