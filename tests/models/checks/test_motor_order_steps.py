"""Steps of the motor-order check against numpy's own least squares, and small cases by hand."""

from dataclasses import replace
from math import comb, factorial

import numpy as np
import pytest

from tests.models.checks.test_motor_order import made_flight
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.checks.motor_order import (
    assignments,
    check_motor_order,
    decide_order,
    detrend,
    response_correlations,
    response_samples,
)
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.physics.airframe import load_airframe

#: As the code has them, written down by hand: a change there is to be seen here.
DECISIVE = 10.0
FEWEST_ROWS = 100

F16 = load_airframe("topxgun-f16-sitl")


def test_all_orders_of_up_to_eight_rotors_and_two_exchanges_beyond():
    for rotors in (3, 4, 8):
        found = list(assignments(rotors))
        assert found[0] == tuple(range(rotors))
        assert len(set(found)) == len(found) == factorial(rotors)
    found = list(assignments(9))
    assert found[0] == tuple(range(9))
    # One exchange: 9 over 2; two that share no rotor: (9 over 2)(7 over 2)/2.
    count = 1 + comb(9, 2) + comb(9, 2) * comb(7, 2) // 2
    assert len(set(found)) == len(found) == count == 415
    assert max(sum(a != b for a, b in enumerate(places)) for places in found) == 4


def test_an_exchange_and_its_words():
    places = np.array([(0, 1, 2, 3), (0, 3, 2, 1), (1, 2, 0, 3)])
    two, three = (
        decide_order(F16, places, np.array([likely, [0.0] * 3]), (0.9, 0.9, 0.9), 500).found
        for likely in ([0.0, 30.0, 0.0], [0.0, 0.0, 30.0])
    )
    against = " against airframe topxgun-f16-sitl"
    assert statement_words(two) == f"motors 2 and 4 look swapped{against}"
    assert statement_words(three) == (
        f"rotor speeds look out of order (1 is motor 2, 2 is motor 3, 3 is motor 1){against}"
    )


def samples_flight(rows=FEWEST_ROWS + 2, **given) -> FlightTrack:
    time_s = np.arange(rows) / 10.0
    # rate = t² on roll: its central difference over 0.2 s is exactly 2 t
    rate = np.column_stack([time_s**2, np.sin(time_s), np.zeros(rows)])
    given = {"angular_rate_frd": rate, "rotor_speed_rpm": np.full((rows, 4), 2000.0), **given}
    return FlightTrack.of(name="s", time_s=time_s, rotor_count=4, **given)


def test_acceleration_is_the_central_difference_without_its_running_mean():
    acceleration, rate, squares, step = response_samples(samples_flight())
    inner = np.arange(1, FEWEST_ROWS + 1) / 10.0
    np.testing.assert_allclose(step, 0.2)
    np.testing.assert_allclose(acceleration[:, 0], detrend((2.0 * inner)[:, None])[:, 0], atol=1e-9)
    np.testing.assert_allclose(rate[:, 0], detrend((inner**2)[:, None])[:, 0], atol=1e-9)
    np.testing.assert_allclose(squares, 0.0, atol=1e-12)  # 4e6 rpm² throughout


def test_squared_speeds_are_smoothed_by_a_quarter_a_half_and_a_quarter():
    speeds = np.zeros((FEWEST_ROWS + 2, 4))
    speeds[60, 2] = 3000.0  # 9e6 rpm²
    squares = response_samples(samples_flight(rotor_speed_rpm=speeds))[2]
    # A row of 9 becomes 2.25, 4.5, 2.25; the mean of 51 rows about it has 9/51 of it.
    np.testing.assert_allclose(
        squares[58:61, 2], np.array([2.25, 4.5, 2.25]) - 9.0 / 51.0, atol=1e-12
    )
    np.testing.assert_allclose(squares[:, [0, 1, 3]], 0.0, atol=1e-12)


@pytest.mark.parametrize("channel", ["angular_rate_frd", "rotor_speed_rpm"])
def test_a_gap_in_any_channel_takes_three_rows(channel):
    full = response_samples(samples_flight(140))[3].size
    values = getattr(samples_flight(140), channel).copy()
    values[70, 1] = np.nan
    assert response_samples(samples_flight(140, **{channel: values}))[3].size == full - 3
    flying = np.ones(140, dtype=bool)
    flying[70] = False
    assert response_samples(samples_flight(140, flying=flying))[3].size == full - 3


def test_rows_far_apart_are_not_differentiated_and_too_few_rows_are_none():
    track = samples_flight(140)
    time_s = track.time_s.copy()
    time_s[70:] += 0.85  # a step of 0.95 s, and 1.05 s over two rows
    assert response_samples(replace(track, time_s=time_s))[3].size == 138 - 2
    time_s[70:] -= 0.1  # 0.95 s over two rows is still differentiated
    assert response_samples(replace(track, time_s=time_s))[3].size == 138
    assert response_samples(samples_flight(FEWEST_ROWS + 1))[3].size == 0
    assert response_samples(samples_flight(2))[3].size == 0


def test_the_trend_of_five_seconds_is_marginalised():
    ramp = np.arange(200.0)[:, None]
    np.testing.assert_allclose(detrend(ramp)[25:-25], 0.0, atol=1e-9)
    alternating = np.where(np.arange(201) % 2 == 0, 1.0, -1.0)[:, None]
    # 51 rows about a +1 hold 25 or 26 of each sign: a mean of -+ 1/51.
    assert abs(detrend(alternating)[100, 0]) == pytest.approx(1.0 + 1.0 / 51.0, abs=2.1 / 51.0)
    assert detrend(np.empty((0, 3))).shape == (0, 3)


def test_correlations_are_those_of_least_squares_residuals():
    rng = np.random.default_rng(1)
    rows = 400
    squares = rng.normal(size=(rows, 4)).cumsum(axis=0) * 0.1 + 4.0
    rate = rng.normal(size=rows).cumsum() * 0.1
    weights = np.array([[1.0, -1.0, 1.0, -1.0], [0.3, 0.2, -0.5, 0.4]])
    acceleration = squares @ weights[0] + 0.5 * rate + 0.2 * rng.normal(size=rows)
    told, effective = response_correlations(
        acceleration, rate, squares, weights, np.full(rows, 0.2)
    )
    known = np.column_stack([np.ones(rows), rate, squares.sum(axis=1)])

    def rest(values):
        return values - known @ np.linalg.lstsq(known, values, rcond=None)[0]

    response = rest(acceleration)
    for k, weight in enumerate(weights):
        moment = rest(squares @ weight)
        assert told[k] == pytest.approx(np.corrcoef(moment, response)[0, 1], rel=1e-9)
        # Bartlett: n (1 - r1 r2)/(1 + r1 r2) of lag-one autocorrelations, rows overlapping by half
        r1, r2 = (x[1:] @ x[:-1] / (x @ x) for x in (moment, response))
        by_hand = 0.5 * rows * (1.0 - r1 * r2) / (1.0 + r1 * r2)
        assert effective[k] == pytest.approx(by_hand, rel=1e-9)
    assert told[0] > 0.95
    assert 1.0 < effective[0] < 0.5 * rows


def test_speeds_that_do_not_move_tell_nothing_and_alternating_ones_are_not_worth_more_than_all():
    rows = 200
    rng = np.random.default_rng(2)
    told, effective = response_correlations(
        rng.normal(size=rows),
        rng.normal(size=rows),
        np.full((rows, 4), 4.0),
        np.array([[1.0, -1.0, 1.0, -1.0]]),
        np.full(rows, 0.2),
    )
    assert told[0] == 0.0
    flip = np.where(np.arange(rows) % 2 == 0, 1.0, -1.0)
    slow = np.sin(np.arange(rows) / 30.0)
    squares = np.outer(flip, [1.0, -1.0, 0.0, 0.0])
    _, effective = response_correlations(
        slow, rng.normal(size=rows), squares, np.array([[1.0, -1.0, 0.0, 0.0]]), np.full(rows, 0.2)
    )
    assert effective[0] == pytest.approx(0.5 * rows)  # a negative product counts as none


def test_effectiveness_of_lower_rotors_is_part_of_the_moments():
    octo = load_airframe("agras-t40")
    track = made_flight(octo)
    order = check_motor_order(track, octo)
    assert order.verdict == "agrees"
    assert min(order.correlation) > 0.999
    exchanged = replace(octo, rotor_effectiveness=octo.rotor_effectiveness[::-1].copy())
    assert max(check_motor_order(track, exchanged).correlation) < 0.98


def test_upper_and_lower_rotors_are_told_by_their_spin_and_not_by_how_much_they_make():
    """An aircraft of which the lower rotors make more has all places exchanged and spins reversed
    by its moments alone: it was refused."""
    octo = load_airframe("agras-t40")
    other = replace(octo, rotor_effectiveness=octo.rotor_effectiveness[::-1].copy())
    order = check_motor_order(made_flight(octo), other)
    assert (order.verdict, order.places) == ("agrees", tuple(range(8)))


def test_more_effort_leads_further_and_decisive_is_a_threshold():
    leads = [check_motor_order(made_flight(F16, effort=e), F16).lead for e in (2.0, 10.0, 100.0)]
    assert leads == sorted(leads)
    assert DECISIVE == 10.0
    for effort in (1.0, 2.0, 3.0, 5.0, 8.0, 100.0):
        order = check_motor_order(made_flight(F16, effort=effort), F16)
        assert (order.verdict == "unclear") == (order.lead < DECISIVE)


def test_swapped_and_reversed_is_said_of_both():
    track = made_flight(F16)
    swapped = replace(track, rotor_speed_rpm=track.rotor_speed_rpm[:, [1, 0, 2, 3]])
    reversed_spins = replace(F16, rotor_spin=-F16.rotor_spin)
    order = check_motor_order(swapped, reversed_spins)
    assert statement_words(order.found) == (
        "motors 1 and 2 look swapped, with every spin reversed against airframe topxgun-f16-sitl"
    )
    assert order.places == (1, 0, 2, 3)


def test_however_alike_neighbouring_rows_are_they_count_for_something():
    """A product of correlations of 0.99999 counts as 0.999: 0.5 n (1 - 0.999)/(1 + 0.999)."""
    rows = 20_000
    slow = np.sin(2.0 * np.pi * np.arange(rows) / 40_000.0 * 3.0)
    squares = np.outer(slow, [1.0, -1.0, 0.0, 0.0])
    step = np.full(rows, 0.2)
    rate = np.random.default_rng(1).normal(size=rows)
    _, effective = response_correlations(
        slow, rate, squares, np.array([[1.0, -1.0, 0.0, 0.0]]), step
    )
    assert effective[0] == pytest.approx(0.5 * rows * 0.001 / 1.999)
