"""Each piece of the manoeuvres, and each limit of the flights, counted by hand."""

from typing import Any

import numpy as np
import pytest

from tests.models.made_flights import curve_model
from thrustmargin.gcs_plugin.workshop.identify.identify_words import manoeuvre_words
from thrustmargin.models.flight import FlightTrack, Origin
from thrustmargin.models.identification.next_flight.manoeuvres import (
    FlownLimits,
    Manoeuvre,
    Piece,
    corners_ned,
    flown_track,
    manoeuvres,
)

NAN = float("nan")
FAST = np.radians(45.0)  # the quickest turn: half a turn in 4 s, a corner in 2 s


def limits(**given: Any) -> FlownLimits:
    usual = {
        "origin": None,
        "place_ne": (0.0, 0.0),
        "reach": 100.0,
        "height": (3.0, 20.0),
        "speed": 6.0,
        "climb": 3.0,
        "turn_rate": 1.0,
        "fill_kg": (NAN, NAN),
        "minutes": 10.0,
        "wind_ne": (0.0, 0.0),
        "voltage": (NAN, NAN),
        "typical": {"pressure": NAN, "temperature": NAN, "altitude": NAN},
    }
    return FlownLimits(**{**usual, **given})


def pieces(**given: Any) -> dict[str, tuple[Piece, ...]]:
    return {m.name: m.pieces for m in manoeuvres(limits(**given))}


def as_numbers(made: tuple[Piece, ...]) -> list[list[float]]:
    return [[p.seconds, p.speed, p.climb, p.turn] for p in made]


def go(seconds: float, speed: float) -> list[float]:
    return [seconds, speed, 0.0, 0.0]


def turn(seconds: float, rate: float) -> list[float]:
    return [seconds, 0.0, 0.0, rate]


def test_every_piece_of_the_library():
    made = pieces()
    assert made["hover"] == (Piece(seconds=30.0),)
    half_turn = turn(4.0, FAST)
    # Legs of 20 s; 2 m/s² stop from 3 m/s in 1.5 s and from 6 in 3.
    legs = [
        row
        for pace, stop in ((3.0, 1.5), (6.0, 3.0))
        for row in 2 * [go(20.0, pace), go(stop, 0.0), half_turn]
    ]
    np.testing.assert_allclose(as_numbers(made["legs"]), legs)
    third = 20.0 / 3.0
    steps = [go(third, 3.0), go(third, 6.0), go(third, 3.0), go(3.0, 0.0), half_turn]
    np.testing.assert_allclose(as_numbers(made["speed steps"]), 2 * steps)
    sides = [
        row for way in (FAST, -FAST) for row in 4 * [go(4.0, 3.0), go(1.5, 0.0), turn(2.0, way)]
    ]
    np.testing.assert_allclose(as_numbers(made["squares"]), sides)
    # 17 m at 2 m/s at most, and back, with 5 s to hold.
    up, down = [8.5, 0.0, 2.0, 0.0], [8.5, 0.0, -2.0, 0.0]
    climbs = 2 * [go(5.0, 0.0), up, go(5.0, 0.0), down]
    np.testing.assert_allclose(as_numbers(made["climb and descent"]), climbs)


@pytest.mark.parametrize("heading", [0.0, np.pi / 2])
def test_what_is_flown_lies_about_the_middle_of_where_was_flown(heading):
    """40 m ahead, a turn to the right and 10 m more: from -20 to 20 m and -5 to 5 m about it."""
    made = Manoeuvre(
        name="a corner",
        numbers=(),
        load="",
        pieces=(
            Piece(seconds=10.0, speed=4.0),
            Piece(seconds=2.0, turn=np.pi / 4),
            Piece(seconds=5.0, speed=2.0, climb=1.0),
        ),
        height=7.0,
        heading=heading,
        fills_kg=(0.0,),
    )
    ahead = np.array([[-20.0, -5.0], [20.0, -5.0], [20.0, -5.0], [20.0, 5.0]])
    north_east = ahead if heading == 0.0 else np.column_stack([-ahead[:, 1], ahead[:, 0]])
    expected = np.column_stack([north_east + np.array([100.0, -30.0]), [-7.0, -7.0, -7.0, -12.0]])
    found = corners_ned(made, limits(place_ne=(100.0, -30.0)))
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_in_a_small_field_legs_are_shorter_and_slower():
    # 30 m in at least 6 s: 5 m/s. At half of it 12 s.
    made = pieces(reach=15.0)
    assert as_numbers(made["legs"])[0] == go(12.0, 2.5)
    assert as_numbers(made["legs"])[6] == go(6.0, 5.0)
    np.testing.assert_allclose(as_numbers(made["speed steps"])[1], go(2.0, 5.0))


@pytest.mark.parametrize(("flown", "rate"), [(0.05, 0.1), (0.3, 0.3), (NAN, 0.1), (2.0, FAST)])
def test_turns_are_as_quick_as_was_flown_within_bounds(flown, rate):
    made = pieces(turn_rate=flown)
    np.testing.assert_allclose(as_numbers(made["legs"])[2], turn(np.pi / rate, rate))
    np.testing.assert_allclose(as_numbers(made["squares"])[2], turn(np.pi / 2 / rate, rate))


@pytest.mark.parametrize(
    ("given", "left_out"),
    [
        ({"speed": 0.31}, set()),
        ({"speed": 0.29}, {"legs", "speed steps", "squares"}),
        ({"climb": 0.31}, set()),
        ({"climb": 0.29}, {"climb and descent"}),
        ({"height": (3.0, 9.1)}, set()),  # 6 s at half of 2 m/s
        ({"height": (3.0, 8.9)}, {"climb and descent"}),
        ({"climb": 0.5, "height": (3.0, 4.51)}, set()),  # 3 s at 0.5 m/s
        ({"climb": 0.5, "height": (3.0, 4.49)}, {"climb and descent"}),
    ],
)
def test_what_was_hardly_flown_is_left_out(given, left_out):
    assert set(pieces()) - set(pieces(**given)) == left_out


def test_limits_are_those_of_the_rows_in_flight():
    """101 rows from 0 to 100 in each channel: a share q of them lies below 100 q."""
    ramp = np.arange(101.0)
    zero = np.zeros(101)
    track = FlightTrack.of(
        name="x",
        time_s=np.arange(103) / 10.0,
        rotor_count=4,
        flying=np.arange(103) < 101,
        origin=Origin(latitude_deg=1.0, longitude_deg=2.0, altitude=3.0),
        **{
            name: np.concatenate([values, values[:2] + 900.0])
            for name, values in {
                "position_ned": np.stack([ramp - 20.0, 0.5 * ramp, zero], axis=1),
                "velocity_ned": np.stack([0.06 * ramp, 0.08 * ramp, -0.05 * ramp], axis=1),
                "angular_rate_frd": np.stack([zero, zero, -0.01 * ramp], axis=1),
                "height_agl": 0.2 * ramp,
                "tank_kg": 5.0 + 0.1 * ramp,
                "wind_ned": np.stack([0.02 * ramp, zero - 3.0, zero], axis=1),
                "voltage": 58.0 - 0.1 * ramp,
                "pressure": 95_000.0 + ramp,
                "temperature": np.full(101, NAN),
                "altitude": 300.0 + ramp,
            }.items()
        },
    )
    found = FlownLimits.from_tracks([track])
    assert found.place_ne == pytest.approx((30.0, 25.0))
    assert found.reach == pytest.approx(49.0)  # 1 to 99 m in the longer way
    assert found.height == pytest.approx((1.0, 19.0))
    assert (found.speed, found.climb, found.turn_rate) == pytest.approx((9.8, 4.9, 0.99))
    assert found.fill_kg == pytest.approx((1.5, 15.0))  # a tenth, for no flight was emptier
    assert found.minutes == pytest.approx(10.0 / 60.0)
    assert found.wind_ne == pytest.approx((1.0, -3.0))
    assert found.voltage == pytest.approx((57.5, 48.5))
    assert found.typical["pressure"] == 95_050.0
    assert found.typical["altitude"] == 350.0
    assert np.isnan(found.typical["temperature"])
    assert found.origin == track.origin


def test_speed_comes_at_two_metres_a_second_squared_over_a_smooth_second():
    order = Manoeuvre(
        name="x",
        numbers=(),
        load="",
        pieces=(Piece(seconds=10.0, speed=4.0), Piece(seconds=10.0, turn=0.5)),
        height=5.0,
        heading=0.0,
        fills_kg=(0.0,),
    )
    speed = np.hypot(*flown_track(order, curve_model(), limits(), 0.0).velocity_ned[:, :2].T)
    # 0.2 m/s a row, a mean of ten rows: 5 before to 4 after, of which the first half is 0.
    ramp = np.clip(0.2 * np.arange(1, 40), 0.0, 4.0)
    assert speed[10] == pytest.approx(np.mean(ramp[5:15]))
    assert speed[0] == pytest.approx(np.mean([ramp[0]] * 6 + list(ramp[1:5])))
    assert speed[50] == pytest.approx(4.0)


def test_turns_begin_at_two_radians_a_second_squared():
    order = Manoeuvre(
        name="x",
        numbers=(),
        load="",
        pieces=(Piece(seconds=10.0), Piece(seconds=10.0, turn=0.5)),
        height=5.0,
        heading=0.2,
        fills_kg=(0.0,),
    )
    track = flown_track(order, curve_model(), limits(), 0.0)
    # 0.2 rad/s a row: 0.2, 0.4, 0.5 from 10 s on, so 0.05 s and 0.01 s less of turn than ordered.
    assert track.attitude[0, 2] == pytest.approx(0.2)
    rate = np.concatenate([np.zeros(100), [0.2, 0.4], np.full(98, 0.5)])
    mean = np.convolve(np.pad(rate, (5, 4), mode="edge"), np.full(10, 0.1), mode="valid")
    np.testing.assert_allclose(track.attitude[:, 2], 0.2 + 0.1 * np.cumsum(mean), atol=1e-9)


def test_what_is_flown_is_said_in_words():
    said = {m.name: manoeuvre_words(m) for m in manoeuvres(limits())}
    assert said == {
        "hover": "hover 30 s",
        "legs": "fly a leg into the wind and back at 3.0 and at 6.0 m/s",
        "speed steps": "change speed in steps between 0, 3.0 and 6.0 m/s",
        "squares": "fly a small square to the right, then one to the left, nose ahead",
        "climb and descent": "climb from 3 to 20 m and descend, twice",
    }
    loads = [
        manoeuvre_words(m) for m in manoeuvres(limits(fill_kg=(1.23, 15.0))) if m.name == "hover"
    ]
    assert loads == [
        "hover 30 s, with 15 kg in the tank",
        "hover 30 s, with 1.2 kg in the tank",
        "hover 30 s, once with 15 and once with 1.2 kg in the tank",
    ]
