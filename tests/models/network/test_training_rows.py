"""Rows that teach, and splits of flights: small made flights counted by hand."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.made_flights import level_flight
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.network.records import (
    Samples,
    gather,
    member_splits,
    split_by_flight,
    split_by_samples,
)

NAN = float("nan")


def test_gathered_columns_by_hand():
    wind = np.tile([3.0, -4.0, 1.0], (20, 1))
    one = level_flight(20, "one", wind_ned=wind, voltage=np.full(20, 50.0))
    rate = np.zeros((30, 3))
    rate[0, 2] = 1.0
    other = level_flight(30, "other", angular_rate_frd=rate, spraying=np.ones(30))
    other = replace(other, rotor_speed_rpm=other.rotor_speed_rpm + 0.5)
    samples = gather([one, level_flight(10, "nothing", airspeed=np.full(10, NAN)), other])
    assert samples.flights == ("one", "other")
    np.testing.assert_array_equal(samples.flight, [0] * 20 + [1] * 30)
    np.testing.assert_allclose(samples.wind_speed[:20], 5.0)  # the level part of it
    assert np.isnan(samples.wind_speed[20:]).all()
    np.testing.assert_array_equal(samples.turning[:20], 0.0)
    np.testing.assert_array_equal(np.flatnonzero(samples.turning), range(20, 31))
    np.testing.assert_array_equal(samples.inputs, np.tile([4.0, 9.0], (50, 1)))
    np.testing.assert_array_equal(samples.voltage[:20], 50.0)
    np.testing.assert_array_equal(samples.spraying[20:], 1.0)
    np.testing.assert_array_equal(samples.of_flights(np.array([1])), np.arange(20, 50))
    unknown = level_flight(20, "one", angular_rate_frd=np.full((20, 3), NAN))
    assert np.isnan(gather([unknown]).turning).all()


def test_flights_of_two_aircraft_do_not_mix():
    six = FlightTrack.of(
        name="six",
        time_s=np.arange(20) / 10.0,
        rotor_count=6,
        airspeed=np.full(20, 4.0),
        tank_kg=np.full(20, 9.0),
        rotor_speed_rpm=np.full((20, 6), 1900.0),
    )
    with pytest.raises(DataError, match=r"have \[4, 6\] rotors; train on flights of one aircraft"):
        gather([level_flight(20), six])


def table(flights: int, rows: int = 10) -> Samples:
    count = flights * rows
    nothing = np.zeros(count)
    return Samples(
        airspeed=nothing,
        tank_kg=nothing,
        rotor_speed_rpm=np.zeros((count, 4)),
        flight=np.repeat(np.arange(flights), rows),
        flights=tuple(f"flight {k}" for k in range(flights)),
        density=nothing,
        height_agl=nothing,
        wind_speed=nothing,
        voltage=nothing,
        spraying=nothing,
        turning=nothing,
    )


@pytest.mark.parametrize(
    ("flights", "sizes"),
    [(3, (1, 1, 1)), (10, (6, 2, 2)), (13, (9, 2, 2)), (20, (14, 3, 3)), (27, (19, 4, 4))],
)
def test_sizes_of_a_split_by_flight(flights, sizes):
    # 15 % of the flights, rounded, at least one: 1.5 -> 2, 1.95 -> 2, 3, 4.05 -> 4
    split = split_by_flight(table(flights), 0)
    assert tuple(r.size // 10 for r in (split.training, split.validation, split.test)) == sizes


def test_sizes_of_a_split_by_samples():
    split = split_by_samples(table(20), 0)
    assert (split.training.size, split.validation.size, split.test.size) == (140, 30, 30)
    assert all(np.all(np.diff(r) > 0) for r in (split.training, split.validation, split.test))


@pytest.mark.parametrize(
    ("flights", "members", "sizes"),
    [
        # 20 flights in 5 folds of 4; 15 % of 20 stop early; 13 are left
        (20, 5, [(13, 3, 4)] * 5),
        # 3 flights: one left out, one to stop on, one to learn; folds repeat from the fourth on
        (3, 5, [(1, 1, 1)] * 5),
        # 7 flights in 3 folds of 3, 2 and 2; 15 % of 7 is one
        (7, 3, [(3, 1, 3), (4, 1, 2), (4, 1, 2)]),
    ],
)
def test_sizes_of_the_members_splits(flights, members, sizes):
    splits = member_splits(table(flights), members, 0)
    found = [tuple(r.size // 10 for r in (s.training, s.validation, s.test)) for s in splits]
    assert found == sizes
    for split in splits:
        seen = np.concatenate([split.training, split.validation, split.test])
        np.testing.assert_array_equal(np.sort(seen), np.arange(flights * 10))


def test_two_flights_cannot_be_split():
    for split in (split_by_flight(table(3), 0), *member_splits(table(3), 3, 0)):
        assert split.test.size
    with pytest.raises(DataError, match="2 flights with usable rows"):
        split_by_flight(table(2), 0)
    with pytest.raises(DataError, match="2 flights with usable rows"):
        member_splits(table(2), 3, 0)
