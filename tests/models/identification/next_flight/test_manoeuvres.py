"""The library of manoeuvres obeys mechanics and the limits of what was flown."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.made_flights import curve_model, made_flight, made_flights
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import down_axis
from thrustmargin.models.identification.next_flight.manoeuvres import (
    FlownLimits,
    corners_ned,
    flown_track,
    lightest_manoeuvres,
    manoeuvres,
)

#: As the code has them, written down by hand: a change there is to be seen here.
ACCELERATION = 2.0

LIMITS = replace(
    FlownLimits.from_tracks(made_flights(3)),
    height=(3.0, 20.0),
    climb=2.0,
    turn_rate=1.0,
    wind_ne=(0.0, 3.0),
)
LIBRARY = manoeuvres(LIMITS)
NAMES = ("hover", "legs", "speed steps", "squares", "climb and descent")


def flown(name: str, **changed):
    limits = replace(LIMITS, **changed)
    one = next(m for m in LIBRARY if m.name == name)
    return flown_track(one, curve_model(), limits, 9.0), one


def test_an_aircraft_of_a_hand_s_breadth_flies_the_same_library_in_a_room():
    room = replace(LIMITS, reach=1.2, speed=0.8, height=(0.3, 1.5), climb=0.35)
    found = {m.name: m for m in manoeuvres(room)}
    assert set(found) == set(NAMES)
    for one in found.values():
        assert np.ptp(corners_ned(one, room)[:, :2], axis=0).max() <= 2.0 * room.reach + 1e-6
    still = replace(room, reach=0.2, climb=np.nan)
    assert {m.name for m in manoeuvres(still)} == {"hover"}


@pytest.mark.parametrize("name", NAMES)
def test_a_manoeuvre_obeys_mechanics(name: str):
    track, _ = flown(name)
    step = track.time_s[1]
    moved = np.cumsum(track.velocity_ned, axis=0) * step
    np.testing.assert_allclose(
        np.diff(track.position_ned, axis=0), np.diff(moved, axis=0), atol=1e-9
    )
    gained = np.gradient(track.velocity_ned, step, axis=0)
    size = np.linalg.norm(gained - [0.0, 0.0, 9.80665], axis=1)
    np.testing.assert_allclose(np.linalg.norm(track.specific_force_frd, axis=1), size)
    # Without drag the rotors' force is all there is: it points along the body's axis.
    np.testing.assert_allclose(track.specific_force_frd[:, :2], 0.0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(down_axis(track.attitude), axis=1), 1.0)
    wind = np.array(LIMITS.wind_ne)
    through = np.linalg.norm(track.velocity_ned[:, :2] - wind, axis=1)
    np.testing.assert_allclose(track.airspeed, through)
    if name in ("legs", "squares"):
        assert track.angular_rate_frd[:, 2].max() == pytest.approx(np.radians(45.0), abs=0.03)
    assert (
        np.abs(np.diff(np.hypot(*track.velocity_ned[:, :2].T))).max() <= ACCELERATION * step + 1e-9
    )


@pytest.mark.parametrize("name", NAMES)
def test_a_manoeuvre_stays_within_what_was_flown(name: str):
    track, one = flown(name)
    low, high = LIMITS.height
    assert track.height_agl.min() >= low - 0.1
    assert track.height_agl.max() <= high + 0.1
    assert np.hypot(*track.velocity_ned[:, :2].T).max() <= LIMITS.speed + 1e-9
    assert np.abs(track.velocity_ned[:, 2]).max() <= LIMITS.climb + 1e-9
    assert np.abs(track.angular_rate_frd[:, 2]).max() <= LIMITS.turn_rate
    corners = corners_ned(one, LIMITS)
    assert np.ptp(corners[:, :2], axis=0).max() <= 2.0 * LIMITS.reach + 1e-6


def test_legs_are_flown_into_the_wind_first():
    track, _ = flown("legs")
    leaving = track.airspeed[: track.time_s.size // 8].max()
    assert leaving == pytest.approx(LIMITS.speed / 2 + 3.0, abs=0.05)


def test_the_battery_goes_down_as_it_did_in_the_flights():
    track, _ = flown("legs", voltage=(58.0, 52.0), minutes=10.0)
    assert track.voltage[0] == 58.0
    assert track.voltage[-1] == pytest.approx(58.0 - 0.01 * track.time_s[-1])


def test_air_liquid_and_wind_are_those_of_the_flights_in_every_row():
    typical = {"pressure": 95000.0, "temperature": 290.0, "altitude": 540.0}
    track, one = flown("speed steps", typical=typical)
    for channel, value in typical.items():
        np.testing.assert_array_equal(getattr(track, channel), value)
    np.testing.assert_array_equal(track.tank_kg, 9.0)
    np.testing.assert_array_equal(track.wind_ned, [[0.0, 3.0, 0.0]] * track.time_s.size)
    np.testing.assert_allclose(track.height_agl, -track.position_ned[:, 2])
    np.testing.assert_allclose(track.velocity_ned[:, 2], 0.0)
    assert track.height_agl[0] == pytest.approx(one.height)
    lasts = sum(piece.seconds for piece in one.pieces)
    assert track.time_s[-1] == pytest.approx(lasts, abs=0.2)
    assert one.minutes == pytest.approx(len(one.fills_kg) * lasts / 60.0)


def test_drag_tilts_the_aircraft_into_the_wind():
    from thrustmargin.models.physics.forward_flight import ForwardFlight

    drag = ForwardFlight(rotor_drag=0.1, drag_area=0.3, lift_gain=0.0, known_airspeed=8.0)
    hover = next(m for m in LIBRARY if m.name == "hover")
    track = flown_track(hover, replace(curve_model(), forward_flight=drag), LIMITS, 9.0)
    slowing = (0.1 + 0.5 * 1.225 * 0.3 / (21.1 + 9.0) * 3.0) * 3.0
    assert track.attitude[-1, 1] == pytest.approx(-np.arctan(slowing / 9.80665), rel=0.01)
    assert track.attitude[-1, 0] == pytest.approx(0.0, abs=1e-9)


def test_flights_that_never_left_the_ground_bound_nothing():
    track = replace(made_flight(1), flying=np.zeros(600, dtype=np.bool_))
    with pytest.raises(DataError, match="in flight"):
        FlownLimits.from_tracks([track])


def test_an_aircraft_that_may_have_a_bad_rotor_is_asked_for_the_least_fill_alone():
    asked = lightest_manoeuvres(LIBRARY)
    assert {m.name for m in asked} == set(NAMES) - {"speed steps"}
    assert {m.fills_kg for m in asked} == {(1.5,)}
