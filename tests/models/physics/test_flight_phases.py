"""Rows that teach and rows in a turn: small made flights counted by hand."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.models.made_flights import level_flight
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.physics.flight_phases import hover_rows, training_rows, turning_rows

NAN = float("nan")


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


def test_a_flight_that_goes_up_and_down_without_a_level_second_is_between_take_off_and_landing():
    climb = np.full(100, 1.0)
    climb[[*range(20, 30), *range(40, 50), *range(60, 100)]] = -1.0
    assert kept(climbing(climb)) == list(range(20, 60))
    assert kept(climbing(-climb)) == list(range(30, 50))  # it begins with a sink, ends with a climb
    low = np.full(100, 3.0)
    low[15:25] = 0.5
    assert kept(replace(climbing(climb), height_agl=low)) == list(range(25, 60))


def test_flight_below_half_the_usual_low_height_is_take_off_or_landing():
    height = np.full(100, 3.0)
    height[:5], height[97:] = 1.4, 1.6  # eight low rows: the tenth percentile is 3, half of it 1.5
    assert kept(level_flight(height_agl=height)) == list(range(5, 100))


def test_the_usual_low_height_is_the_tenth_percentile():
    # Heights of 1 to 101 m rise by one a row: the tenth percentile is 11, half of it 5.5.
    assert kept(level_flight(101, height_agl=np.arange(1.0, 102.0))) == list(range(5, 101))


@pytest.mark.parametrize(
    ("channel", "value", "hovers"),
    [
        ("airspeed", 1.99, True),
        ("airspeed", 2.01, False),
        ("velocity_ned", [0.0, 0.0, 0.31], False),
        ("attitude", [np.arccos(0.991), 0.0, 1.0], True),
        ("attitude", [0.0, np.arccos(0.989), 1.0], False),
        ("angular_rate_frd", [1.0, 1.0, np.radians(5.1)], False),
        ("angular_rate_frd", [1.0, 1.0, np.radians(4.9)], True),
    ],
)
def test_what_is_a_hover(channel, value, hovers):
    still: dict[str, Any] = {
        "airspeed": np.zeros(100),
        "velocity_ned": np.zeros((100, 3)),
        "attitude": np.zeros((100, 3)),
        "angular_rate_frd": np.zeros((100, 3)),
    }
    still[channel] = np.array([value] * 100)
    track = level_flight(**still)
    assert hover_rows(track).tolist() == [hovers] * 100


def test_a_hover_lasts_a_second():
    fast = np.ones(100, dtype=bool)
    fast[[*range(20, 30), *range(50, 61)]] = False  # 0.9 s and 1.0 s from first to last
    track = level_flight(
        airspeed=np.where(fast, 5.0, 0.0),
        velocity_ned=np.zeros((100, 3)),
        attitude=np.zeros((100, 3)),
    )
    assert np.flatnonzero(hover_rows(track)).tolist() == list(range(50, 61))


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


def test_without_vertical_speed_the_height_tells_and_without_both_every_row_is_level():
    velocity = np.zeros((100, 3))
    velocity[:, 2] = NAN  # north and east are known
    height = np.full(100, 3.0)
    height[:21] = np.linspace(2.0, 3.0, 21)
    assert kept(level_flight(height_agl=height, velocity_ned=velocity)) == list(range(20, 100))
    unknown = level_flight(height_agl=np.full(100, NAN), velocity_ned=velocity)
    assert kept(unknown) == list(range(100))
