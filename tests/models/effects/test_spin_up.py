"""Rotors that take time to spin up follow a yaw moment late: lags against their closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.effects.test_hand_values import AIRFRAME, HOVER, SPIN, effect, steady
from tests.models.known_effects import known_effect
from thrustmargin.models.effects.channels import lag_weights
from thrustmargin.models.effects.compose import placed_from
from thrustmargin.models.effects.moment_effects import slowed_yaw_rate
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.rotor_model import physics_model

TIME = np.arange(400) / 50.0
LEVER = 4 * 0.05 * 73.549875  # N m of yaw by 100 % more thrust on the rotors that push right
SPIN_UPS = 0.025 * np.sqrt(2.0) ** np.arange(12)  # s: from a fortieth to just over a second
INERTIA, DAMPING, SWAY = 5.0, 2.0, 3.0  # kg m², N m s, rad/s of the yaw rate's own swing


def turning(rate: Floats, **given) -> FlightTrack:
    """A hover in rows of 0.02 s with a yaw rate, rad/s."""
    rates = np.zeros((rate.size, 3))
    rates[:, 2] = rate
    track = steady(rate.size, angular_rate_frd=rates, **given)
    return replace(track, time_s=TIME[: rate.size])


def yaw_moment(track: FlightTrack, **values: float) -> Floats:
    """(T,) N m that the rotors make, from their predicted speeds."""
    record = effect("manoeuvre_moment", None, inertia_yaw=INERTIA, damping_yaw=DAMPING, **values)
    model = replace(physics_model(AIRFRAME), effects=(record,))
    speeds = analyse(track, model).prediction.rotor_speed_rpm
    return ((speeds / HOVER) ** 2 @ SPIN) / 4.0 * LEVER


def test_a_rate_that_grows_is_followed_by_as_much_as_the_lag():
    # r = 0.5 t behind a lag of c: 0.5 (t - c (1 - exp(-t / c))).
    slowed, last = slowed_yaw_rate(turning(0.5 * TIME), AIRFRAME)
    by_hand = 0.5 * (TIME[:, None] - SPIN_UPS * (1.0 - np.exp(-TIME[:, None] / SPIN_UPS)))
    np.testing.assert_allclose(slowed, by_hand, atol=1e-12)
    np.testing.assert_allclose(last, by_hand[-1], atol=1e-12)


def test_a_flight_in_two_parts_is_the_flight():
    track = turning(np.sin(SWAY * TIME))
    whole, _ = slowed_yaw_rate(track, AIRFRAME)
    first, state = slowed_yaw_rate(track.rows(slice(0, 151)), AIRFRAME)
    second, _ = slowed_yaw_rate(track.rows(slice(150, None)), AIRFRAME, state)
    np.testing.assert_allclose(np.concatenate([first[:-1], second]), whole, atol=1e-12)


def test_a_rate_that_is_not_known_for_a_while_is_a_line_and_no_value():
    rate = 0.5 * TIME
    rate[100:110] = np.nan
    slowed, _ = slowed_yaw_rate(turning(rate), AIRFRAME)
    whole, _ = slowed_yaw_rate(turning(0.5 * TIME), AIRFRAME)
    assert np.isnan(slowed[100:110]).all()
    np.testing.assert_allclose(slowed[110:], whole[110:], atol=1e-12)
    none, state = slowed_yaw_rate(turning(np.full(TIME.size, np.nan)), AIRFRAME)
    assert np.isnan(none).all()
    np.testing.assert_array_equal(state, 0.0)


@pytest.mark.parametrize("constant", [0.015, 0.1, 0.3, 0.45])
@pytest.mark.parametrize("lag", [0.0, 0.1])
def test_rotors_follow_a_swaying_yaw_as_a_first_order_lag_does(constant, lag):
    # M = Re (i w I + D) exp(i w (t + lag)) behind a lag of c is M / (1 + i w c).
    moment = yaw_moment(turning(np.cos(SWAY * TIME)), spin_up=constant, lag=lag)
    turn = (1j * SWAY * INERTIA + DAMPING) / (1.0 + 1j * SWAY * constant)
    by_hand = np.real(turn * np.exp(1j * SWAY * (TIME + lag)))
    settled = np.flatnonzero((5.0 * constant + 1.0 < TIME) & (TIME[-1] - 1.0 > TIME))
    assert settled.size > 100
    np.testing.assert_allclose(moment[settled], by_hand[settled], atol=0.04 * abs(turn))


def test_without_a_time_constant_the_moment_is_there_at_once():
    track = turning(np.cos(SWAY * TIME))
    old = effect("manoeuvre_moment", inertia_yaw=INERTIA, damping_yaw=DAMPING)
    del old.parameters["spin_up"]  # as a file from before it was known has it
    (placed,) = placed_from((old,), 4)
    assert placed.values["spin_up"] == 0.0
    late = yaw_moment(track, spin_up=0.3) - yaw_moment(track)
    assert np.abs(late[100:300]).max() > 3.0


def test_the_weights_of_a_lag_are_a_mean_over_what_came_before():
    weights = lag_weights(0.0, time_constant=0.3)
    assert weights.sum() == pytest.approx(1.0)
    lags = np.arange(-18, 8) / 10.0
    assert weights @ lags == pytest.approx(-0.3, abs=0.02)
    assert weights[lags > 0.15] == pytest.approx(0.0)


def test_how_fast_rotors_spin_up_shapes_the_moments_of_turning():
    shape = {p.name: p for p in known_effect("manoeuvre_moment").parameters}["spin_up"]
    assert (shape.detail, shape.absent, shape.start, shape.unit) == (True, 0.0, 0.0, "s")
