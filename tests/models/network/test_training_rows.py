"""Rows that teach, and splits of flights: small made flights counted by hand."""

from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.network.training_rows import (
    Samples,
    gather,
    member_splits,
    split_by_flight,
    split_by_samples,
    training_rows,
    turning_rows,
)

NAN = float("nan")


def level_flight(rows: int = 100, name: str = "level", **channels) -> FlightTrack:
    """Ten rows a second at 3 m, all known."""
    velocity = np.zeros((rows, 3))
    given = {
        "velocity_ned": velocity,
        "airspeed": np.full(rows, 4.0),
        "tank_kg": np.full(rows, 9.0),
        "rotor_speed_rpm": np.full((rows, 4), 1900.0) + np.arange(rows)[:, None],
        "height_agl": np.full(rows, 3.0),
        "angular_rate_frd": np.zeros((rows, 3)),
        **channels,
    }
    return FlightTrack.of(name=name, time_s=np.arange(rows) / 10.0, rotor_count=4, **given)


def kept(track: FlightTrack) -> list[int]:
    return np.flatnonzero(training_rows(track)).tolist()


def climbing(climb_m_s: np.ndarray) -> FlightTrack:
    velocity = np.zeros((climb_m_s.size, 3))
    velocity[:, 2] = -climb_m_s
    return level_flight(climb_m_s.size, velocity_ned=velocity)


@pytest.mark.parametrize(("rate", "first"), [(0.29, 0), (0.31, 20), (-0.31, 20), (-0.29, 0)])
def test_level_is_below_three_tenths_of_a_metre_a_second(rate, first):
    climb = np.zeros(100)
    climb[:20] = rate
    assert kept(climbing(climb)) == list(range(first, 100))


@pytest.mark.parametrize(("rows", "first"), [(11, 5), (10, 40)])
def test_a_second_of_level_flight_ends_the_take_off_and_less_does_not(rows, first):
    climb = np.full(100, 1.0)
    climb[5 : 5 + rows] = 0.0  # 11 rows are a second from first to last
    climb[40:60] = 0.0
    assert kept(climbing(climb)) == list(range(first, 60))


def test_a_flight_that_is_never_level_teaches_nothing():
    assert kept(climbing(np.full(100, 1.0))) == []


def test_flight_below_half_the_usual_low_height_is_take_off_or_landing():
    height = np.full(100, 3.0)
    height[:5], height[97:] = 1.4, 1.6  # eight low rows: the tenth percentile is 3, half of it 1.5
    assert kept(level_flight(height_agl=height)) == list(range(5, 100))


def test_each_stretch_of_flight_has_its_own_take_off_and_landing():
    climb = np.zeros(120)
    climb[[*range(0, 5), *range(50, 60), *range(60, 70), *range(115, 120)]] = 1.0
    flying = np.ones(120, dtype=bool)
    flying[55:65] = False
    track = replace(climbing(climb), flying=flying)
    assert kept(track) == [*range(5, 50), *range(70, 115)]


def test_a_stretch_without_level_flight_does_not_end_the_others():
    climb = np.zeros(100)
    climb[:20] = 1.0
    flying = np.ones(100, dtype=bool)
    flying[20:25] = False
    assert kept(replace(climbing(climb), flying=flying)) == list(range(25, 100))


def test_the_slope_of_the_height_is_the_climb_rate_where_none_is_reported():
    height = np.full(100, 3.0)
    height[:21] = np.linspace(2.0, 3.0, 21)  # 0.5 m/s; half of it at the corner, row 20
    track = level_flight(height_agl=height, velocity_ned=np.full((100, 3), NAN))
    assert kept(track) == list(range(20, 100))


@pytest.mark.parametrize(("rate_deg", "turns"), [(5.1, True), (4.9, False), (-5.1, True)])
def test_a_turn_is_more_than_five_degrees_a_second(rate_deg, turns):
    rate = np.zeros((100, 3))
    rate[50, 2] = np.radians(rate_deg)
    rows = np.flatnonzero(turning_rows(level_flight(angular_rate_frd=rate)))
    assert rows.tolist() == (list(range(40, 61)) if turns else [])
    rate[:, 2], rate[:, 0] = 0.0, 1.0  # rolling is no turn
    assert not turning_rows(level_flight(angular_rate_frd=rate)).any()


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
