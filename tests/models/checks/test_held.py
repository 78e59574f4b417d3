"""On a bench or in hands nothing moves as thrust and tilt ask; in the air everything does."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from thrustmargin.models.checks.held import (
    HeldSoFar,
    attitude_denied,
    drop_held,
    flag_held,
    is_held,
    may_hover,
)
from thrustmargin.models.physics.airframe import load_airframe

TIME_S = np.arange(0.0, 60.0, 0.1)
G0 = 9.80665
NAN = float("nan")


def body(
    height: Any = 0.0, roll: Any = 0.0, east: Any = 0.0, squares: Any = NAN, output: Any = NAN
) -> np.ndarray:
    """(T, 15) of an aircraft that points north, a little restless about pitch, without an
    accelerometer, a barometer and an attitude that is asked for."""
    rows = np.full((TIME_S.size, 15), NAN)
    rows[:, :9] = 0.0
    rows[:, 2] = 0.02 * np.sin(5.0 * TIME_S)
    for column, values in ((0, height), (1, roll), (5, east), (7, squares), (8, output)):
        rows[:, column] = values
    return rows


SWAYS = 0.3 * np.sin(TIME_S / 3.0)  # rad: 2.9 m/s² to each side, and slow beside 3 s
#: m/s of what flies so: the integral of g tan(roll)
FOLLOWS = np.cumsum(G0 * np.tan(SWAYS)) * 0.1
FOLLOWS -= FOLLOWS.mean()


def test_what_leans_to_and_fro_and_stays_is_in_hands():
    assert is_held(TIME_S, body(height=1.2, roll=SWAYS))
    # One that flies is pushed by it: 9 m/s at most, faster than anybody runs; a third of it is 3.
    assert not is_held(TIME_S, body(height=1.2, roll=SWAYS, east=FOLLOWS))
    assert not is_held(TIME_S, body(height=1.2, roll=SWAYS / 6.0, east=FOLLOWS / 6.0))
    # Steady wind asks for a steady lean.
    assert not is_held(TIME_S, body(height=1.2, roll=0.3))
    # 0.1 rad is 1 m/s² to each side: a gust does it.
    assert not is_held(TIME_S, body(height=1.2, roll=SWAYS / 3.0))
    # Nobody reaches 2.5 m above where it was, and turned over it is no longer held.
    assert not is_held(TIME_S, body(height=np.where(TIME_S > 30.0, 2.5, 0.0), roll=SWAYS))
    assert is_held(TIME_S, body(height=np.where(TIME_S > 30.0, 2.4, 0.0), roll=SWAYS))
    assert not is_held(TIME_S, body(height=1.2, roll=1.2 * np.sign(SWAYS)))
    # Without height or speed nothing is known of it.
    assert not is_held(TIME_S, body(height=NAN, roll=SWAYS))
    assert not is_held(TIME_S, body(height=1.2, roll=SWAYS, east=NAN))


@pytest.mark.parametrize("of", ["squares", "output"])
def test_thrust_that_does_not_lift_is_that_of_a_bench(of):
    steps = np.where(TIME_S < 30.0, 1.0, 1.6)
    assert is_held(TIME_S, body(**{of: steps}))
    assert not is_held(TIME_S, body(**{of: np.where(TIME_S < 30.0, 1.0, 1.45)}))
    # Less than half stands on its legs, and a moment at it is no state.
    assert not is_held(TIME_S, body(**{of: np.where(TIME_S < 30.0, 0.45, 1.0)}))
    assert not is_held(TIME_S, body(**{of: np.where(TIME_S % 10.0 < 1.0, 1.6, 1.0)}))
    # A tank that empties over minutes is no step: 1 to 1.6 over ten minutes.
    slow, each = np.arange(0.0, 600.0, 0.5), np.full((1200, 15), NAN)
    each[:, :9] = 0.0
    each[:, 2], each[:, 7] = 0.02 * np.sin(5.0 * slow), np.linspace(1.6, 1.0, 1200)
    assert not is_held(slow, each)


def test_a_tilt_that_stands_still_is_clamped():
    # Between the 5th and the 95th percentile of a sine lie 1.975 of its height.
    still = body(height=0.5)
    still[:, 2] *= np.radians(0.24) / 0.02
    assert is_held(TIME_S, still)
    still[:, 2] *= 0.26 / 0.24
    assert not is_held(TIME_S, still)
    # Above a metre the air may be as calm: then only what stands as on the ground.
    still[:, 0] = np.linspace(0.0, 1.5, TIME_S.size)
    still[:, 2] *= 0.24 / 0.26
    assert not is_held(TIME_S, still)
    still[:, 2] *= 0.04 / 0.24
    assert is_held(TIME_S, still)
    assert not is_held(TIME_S[:190], still[:190])  # 19 s


def test_only_stretches_from_the_ground_on_are_left_out():
    flying = np.ones(TIME_S.size, dtype=np.bool_)
    swayed = body(height=1.2, roll=SWAYS)
    whole = [(0, TIME_S.size)]
    assert drop_held(flying, whole, TIME_S, swayed).all()  # begun in the air
    flying[0] = False
    assert drop_held(flying, [(1, TIME_S.size)], TIME_S, swayed).sum() == 0
    low = body(height=0.9, roll=SWAYS)
    flying[0] = True
    assert drop_held(flying, whole, TIME_S, low).sum() == 0


def test_speeds_below_four_fifths_of_the_empty_weight_do_not_hover():
    # 0.8 x 10 kg are 78.45 N: four rotors of 2e-5 N² make it at 980,665 rpm².
    ours = replace(load_airframe("topxgun-f16"), empty_mass=10.0, thrust_coefficient=2e-5)
    found = may_hover(np.array([980_000.0, 981_000.0]), 4, ours)
    assert np.isnan(found[0])
    assert found[1] == 981_000.0
    assert np.isnan(may_hover(np.array([1e6]), 4, None)).all()


def listened(rows: np.ndarray, pieces: int, off_s: float = 2.0) -> np.ndarray:
    """Rows found held by a listener, in so many pieces; the motors are off at first."""
    now, found = HeldSoFar(), []
    for part in np.array_split(np.arange(TIME_S.size), pieces):
        off = TIME_S[part] < off_s
        down, now = flag_held(now, TIME_S[part], ~off, off, rows[part], clear=0.2)
        found.append(down)
    return np.concatenate(found)


@pytest.mark.parametrize("pieces", [1, 7, 600])
def test_a_listener_finds_it_within_the_first_lean_to_and_fro(pieces):
    rows = body(height=np.where(TIME_S < 2.0, 0.0, 1.2), roll=SWAYS)
    found = TIME_S[listened(rows, pieces)]
    assert found[0] < 20.0
    assert np.allclose(np.diff(found), 0.1)
    assert found[-1] == TIME_S[-1]
    # Once it is higher than hands reach it flies, and flew.
    rows[400:, 0] = 3.0
    found = TIME_S[listened(rows, pieces)]
    assert found[-1] == pytest.approx(39.9)


def test_a_listener_waits_until_it_is_clear_of_where_its_motors_were_off():
    rows = body(height=np.where(TIME_S < 30.0, 5.2, 5.31))
    rows[TIME_S < 2.0, 0] = 5.1
    found = TIME_S[listened(rows, 5)]
    assert (found[0], found[-1]) == (2.0, pytest.approx(29.9))
    assert not listened(body(height=NAN), 5).any()  # where the ground is, is not known


def with_force(rows: np.ndarray, force: Any = 0.0, asked: Any = NAN, barometer: Any = NAN):
    """The same with an accelerometer that feels gravity and `force` m/s² more about its axis of
    thrust, an attitude that is asked for, and a barometer."""
    rows = rows.copy()
    rows[:, 9:11] = 0.0
    rows[:, 11] = -G0 + force
    rows[:, 12] = asked
    rows[:, 13] = 0.0
    rows[:, 14] = barometer
    return rows


TREMBLES = 0.03 * np.sin(40.0 * TIME_S)


@pytest.mark.parametrize("of", ["squares", "output"])
def test_thrust_that_the_accelerometer_does_not_feel_carries_nothing(of):
    """Whatever the height says: an estimate drifts."""
    runs_up = {of: np.linspace(1.0, 2.0, TIME_S.size), "height": np.linspace(0.0, 40.0, 600)}
    assert is_held(TIME_S, with_force(body(**runs_up), TREMBLES))
    # What is carried by it feels the half of it that is more.
    assert not is_held(TIME_S, with_force(body(**runs_up), 0.5 * np.sin(TIME_S / 5.0)))
    # Thrust of a hover alone, steady within a third, shows nothing.
    steady = {of: 1.0 + 0.1 * np.sin(TIME_S), "height": 1.8}
    assert not is_held(TIME_S, with_force(body(**steady), TREMBLES))


def test_a_run_up_on_the_legs_before_a_flight_does_not_make_the_flight_held():
    """20 s at two thirds of the thrust with which it then hovers: its accelerometer shakes."""
    thrust = np.where(TIME_S < 20.0, 0.65, 1.0)
    shakes = 0.4 * np.sin(TIME_S / 2.0) * (TIME_S > 20.0)
    flight = with_force(body(height=np.where(TIME_S < 20.0, 0.0, 1.5), output=thrust), shakes)
    assert not is_held(TIME_S, flight)
    unknown = flight.copy()
    unknown[:, 9:12] = NAN
    assert is_held(TIME_S, unknown)


def test_a_tilt_that_is_asked_for_and_not_done_is_that_of_a_bench():
    asked = np.radians(45.0) * (np.sin(TIME_S / 3.0) > 0.0)
    assert is_held(TIME_S, with_force(body(height=0.2), TREMBLES, asked=asked))
    followed = with_force(body(height=30.0, roll=asked, east=NAN), TREMBLES, asked=asked)
    assert not is_held(TIME_S, followed)


def test_an_attitude_that_turns_while_nothing_falls_is_of_a_gyro_and_not_of_the_aircraft():
    """0.42 rad/s of offset: upside down for 5 of 15 s, which is a fall of hundreds of metres."""
    roll = (0.42 * TIME_S + np.pi) % (2.0 * np.pi) - np.pi
    still = with_force(body(roll=roll, height=np.linspace(0.0, 30.0, 600)), barometer=0.1)
    assert is_held(TIME_S, still)
    assert attitude_denied(TIME_S, still[:, 1:4], still[:, 9:12], still[:, 14]).mean() > 0.5
    # It falls as the attitude says, or no barometer speaks.
    falls = with_force(body(roll=roll, height=40.0), barometer=-0.5 * G0 * TIME_S**2)
    assert not attitude_denied(TIME_S, falls[:, 1:4], falls[:, 9:12], falls[:, 14]).any()
    unknown = with_force(body(roll=roll, height=40.0))
    assert not attitude_denied(TIME_S, unknown[:, 1:4], unknown[:, 9:12], unknown[:, 14]).any()


def test_runs_that_are_each_too_short_are_held_together():
    """Five runs of 3 s each without propellers."""
    flying = (TIME_S % 12.0) < 3.0
    rows = with_force(body(output=np.linspace(0.3, 1.0, TIME_S.size)), TREMBLES)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flying.astype(int), [0]])))
    runs = list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
    assert not drop_held(flying, runs, TIME_S, rows).any()
