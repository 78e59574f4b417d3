"""Explanations fitted to flown rows, their derivatives and how far a sound aircraft may be off."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.made_flights import curve_model, made_flight
from thrustmargin.models.effects import BY_KEY
from thrustmargin.models.effects.compose import rotor_speed_rpm
from thrustmargin.models.identification.answer.explanations import (
    Explanation,
    ModePrediction,
    fitted_explanation,
    second_noise_rpm,
)
from thrustmargin.models.identification.rows.candidates import Term
from thrustmargin.models.identification.rows.problem import assemble
from thrustmargin.models.network.records import GoodFlights

#: As the code has them, written down by hand: a change there is to be seen here.
STEP = 0.05

#: One fill, one speed: hidden mass is as good as a wrong gauge.
FLIGHTS = [made_flight(k, tank_kg=8.0, hidden_mass=1.0) for k in range(3)]
MODEL = curve_model()
PROBLEM = assemble(MODEL, FLIGHTS)
NOISE = np.array([4.0, 3.0, 2.5, 2.5])
MASS, GAUGE, LOSS = (Term(effect=BY_KEY[key]) for key in ("extra_mass", "tank_scale", "yaw_trim"))


def explanations(first, second) -> tuple[Explanation, Explanation]:
    return fitted_explanation(PROBLEM, first, NOISE), fitted_explanation(PROBLEM, second, NOISE)


def test_a_rival_is_fitted_to_the_flown_rows():
    mass, gauge = explanations((MASS,), (GAUGE,))
    assert mass.values == pytest.approx([1.0], abs=0.06)
    # The tank was 8.0 to 5.3 kg: 1 kg more is a gain of about 1.15.
    assert gauge.values == pytest.approx([1.15], abs=0.04)


def test_the_scatter_of_good_flights_takes_the_place_of_the_usual_one():
    predict = ModePrediction.of(MODEL, PROBLEM.base, PROBLEM.channels, np.ones(4))
    usual = predict.scatter(0.0)
    good = GoodFlights(flights=5, scatter={"extra_mass.mass": 0.0, "yaw_trim.moment": 1.0})
    shown = ModePrediction.of(
        replace(MODEL, good_flights=good), PROBLEM.base, PROBLEM.channels, np.ones(4)
    ).scatter(0.0)
    assert shown.shape[1] == usual.shape[1] - 1
    moment = predict.columns((LOSS,), np.zeros(1))[:, 0]
    assert np.isclose(shown - moment[:, None], 0.0).all(axis=0).any()


def test_a_sound_flight_s_mean_is_off_in_each_mode_by_its_own_scatter_over_its_noise():
    noise, scatter = np.array([4.0, 3.0, 2.5, 2.0]), np.array([8.0, 3.0, 5.0, 1.0])
    predict = ModePrediction.of(MODEL, PROBLEM.base, PROBLEM.channels, noise)
    rows = PROBLEM.channels.time_s.size
    means = predict.scatter(scatter)[:, :4].reshape(rows, 4, 4)
    np.testing.assert_allclose(means, [np.diag(scatter / noise)] * rows, atol=1e-12)


def test_derivatives_are_those_of_the_prediction():
    predict = ModePrediction.of(MODEL, PROBLEM.base, PROBLEM.channels, np.ones(4))
    column = predict.columns((MASS,), np.array([1.0]))[:, 0].reshape(-1, 4)
    # N = sqrt(N0² (1 + m/M)), so dN/dm = N0² / (2 M N).
    base = rotor_speed_rpm(PROBLEM.base, (), PROBLEM.channels)
    now = base * np.sqrt(1.0 + 1.0 / PROBLEM.channels.total_mass)[:, None]
    slope = base**2 / (2.0 * PROBLEM.channels.total_mass[:, None] * now)
    np.testing.assert_allclose(column @ PROBLEM.modes.directions.T, slope, rtol=1e-4)


def test_derivatives_are_over_a_twentieth_of_the_usual_size_on_both_sides():
    predict = ModePrediction.of(MODEL, PROBLEM.base, PROBLEM.channels, np.ones(4))
    sag = Term(effect=BY_KEY["battery_voltage"])
    values = np.array([1.5, 0.0])
    for k, p in enumerate(sag.effect.parameters):
        step = np.zeros(2)
        step[k] = STEP * p.scale
        ends = [predict.modes((sag,), values + side * step).ravel() for side in (1.0, -1.0)]
        assert np.abs(ends[0] - ends[1]).max() > 0.1
        column = predict.columns((sag,), values, [k])[:, 0]
        np.testing.assert_allclose(column, (ends[0] - ends[1]) / (2.0 * 0.05 * p.scale), rtol=1e-9)


def test_noise_of_a_second_is_that_of_blocks_about_their_flight():
    rng = np.random.default_rng(3)
    white = 5.0 * rng.standard_normal(PROBLEM.measured_rpm.shape) + 100.0 * (
        PROBLEM.flight[:, None] == 1
    )
    found = second_noise_rpm(PROBLEM, white)
    # 24 free blocks: a standard deviation from so few is good to 15 %.
    assert found == pytest.approx(np.full(4, 5.0 * np.sqrt(0.1)), rel=0.45)


def test_the_scatter_of_effects_behind_those_that_begin_in_flight_counts_too():
    good = GoodFlights(flights=5, scatter={"translational_lift.gain": 0.0})
    shown = [
        ModePrediction.of(m, PROBLEM.base, PROBLEM.channels, np.ones(4)).scatter(0.0).shape[1]
        for m in (MODEL, replace(MODEL, good_flights=good))
    ]
    assert shown[1] == shown[0] - 1


def test_an_explanation_is_of_all_rows_and_not_of_the_first():
    odd = PROBLEM.measured_rpm.copy()
    odd[:4] += 200.0
    found = fitted_explanation(replace(PROBLEM, measured_rpm=odd), (MASS,), NOISE)
    # 4 of 840 rows, which 10 % of rotor speed would make 8 kg heavier.
    assert found.values == pytest.approx([1.0], abs=0.15)


def test_a_step_in_flight_counts_as_it_is_afterwards():
    onset = Term(effect=BY_KEY["rotor_degradation:onset"], rotor=1)
    assert fitted_explanation(PROBLEM, (onset,), NOISE).terms[0].key == "rotor_degradation@2"


def test_values_stay_within_their_bounds():
    heavy = assemble(MODEL, [made_flight(1, tank_kg=4.0, hidden_mass=9.0)])
    assert fitted_explanation(heavy, (GAUGE,), NOISE).values == pytest.approx([2.0])


def test_what_is_open_of_a_value_is_in_its_unit_and_no_less_than_sound_flights_scatter_by():
    usual = MASS.effect.parameters[0].smallest
    open_kg = np.sqrt(fitted_explanation(PROBLEM, (MASS,), NOISE).covariance[0, 0])
    assert 0.95 * usual < open_kg < 5.0 * usual


def test_a_rival_that_is_far_from_nothing_is_fitted_all_the_way():
    """A quarter of a rotor's thrust: N² goes with 1/(1 - loss), which one step overshoots."""
    problem = assemble(MODEL, [made_flight(k, loss=0.25) for k in range(2)])
    worn = Term(effect=BY_KEY["rotor_degradation"], rotor=0)
    assert fitted_explanation(problem, (worn,), NOISE).values[0] == pytest.approx(0.25, abs=0.003)


def test_a_value_is_half_of_what_rows_say_where_they_weigh_as_much_as_what_is_usual():
    """1 kg is hidden; noise such that the rows know it to one usual size of a hidden mass."""
    size = MASS.effect.parameters[0].scale
    rows = PROBLEM.measured_rpm.shape[0]
    seconds = float(PROBLEM.durations.sum()) / rows  # of a row: its noise is that of a second more
    predict = ModePrediction.of(MODEL, PROBLEM.base, PROBLEM.channels, NOISE / np.sqrt(seconds))
    column = predict.columns((MASS,), np.array([0.5]))
    noise = NOISE * float(np.linalg.norm(column)) * size
    assert fitted_explanation(PROBLEM, (MASS,), noise).values[0] == pytest.approx(0.5, abs=0.03)


def test_noise_of_a_second_is_the_sum_of_squares_of_blocks_over_those_that_are_free():
    residual = np.random.default_rng(4).normal(size=PROBLEM.measured_rpm.shape)
    modes = residual @ PROBLEM.modes.directions
    squares, blocks = np.zeros(4), PROBLEM.block_flight.size
    for flight in range(PROBLEM.flights):
        mine = np.flatnonzero(PROBLEM.block_flight == flight)
        means = np.stack([modes[PROBLEM.block == b].mean(axis=0) for b in mine])
        squares += np.sum((means - means.mean(axis=0)) ** 2, axis=0)
    by_hand = np.sqrt(squares / (blocks - PROBLEM.flights) * 10.0) + 1e-3
    np.testing.assert_allclose(second_noise_rpm(PROBLEM, residual), by_hand)
