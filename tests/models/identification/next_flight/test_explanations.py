"""Explanations fitted to flown rows, and how far a sound aircraft may be off."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.identification.known_terms import curve_term, known_term
from tests.models.made_flights import curve_model, made_flight
from thrustmargin.models.identification.next_flight.next_flight import (
    FittedExplanation,
    fitted_explanation,
    scatter_columns,
    second_noise_rpm,
)
from thrustmargin.models.identification.rows.candidates import (
    TrialEffect,
    candidate,
    derivatives,
)
from thrustmargin.models.identification.rows.problem import assemble
from thrustmargin.models.network.records import GoodFlights

#: One fill, one speed: hidden mass is as good as a wrong gauge.
FLIGHTS = [made_flight(k, tank_kg=8.0, hidden_mass=1.0) for k in range(3)]
MODEL = curve_model()
PROBLEM = assemble(MODEL, FLIGHTS)
NOISE = np.array([4.0, 3.0, 2.5, 2.5])
MASS, GAUGE, LOSS = (known_term(key) for key in ("extra_mass", "tank_scale", "yaw_trim"))


def explanations(first, second) -> tuple[FittedExplanation, FittedExplanation]:
    return fitted_explanation(PROBLEM, first, NOISE), fitted_explanation(PROBLEM, second, NOISE)


def value(found: FittedExplanation) -> float:
    """The only value of the only effect, on the only flight that it stands for."""
    ((number,),) = found.trials[0].values
    return float(number)


def test_a_rival_is_fitted_to_the_flown_rows():
    mass, gauge = explanations((MASS,), (GAUGE,))
    assert value(mass) == pytest.approx(1.0, abs=0.06)
    # The tank was 8.0 to 5.3 kg: 1 kg more is a gain of about 1.15.
    assert value(gauge) == pytest.approx(1.15, abs=0.04)


def test_the_scatter_of_good_flights_takes_the_place_of_the_usual_one():
    usual = scatter_columns(PROBLEM, 0.0)
    good = GoodFlights(flights=5, scatter={"extra_mass.mass": 0.0, "yaw_trim.moment": 1.0})
    shown = scatter_columns(replace(PROBLEM, model=replace(MODEL, good_flights=good)), 0.0)
    assert shown.shape[2] == usual.shape[2] - 1
    one = candidate(LOSS, PROBLEM.flights)
    moment = derivatives(PROBLEM, [one.initial_effect], 0)
    assert np.isclose(shown - moment, 0.0).all(axis=(0, 1)).any()


def test_the_scatter_of_effects_behind_those_that_begin_in_flight_counts_too():
    good = GoodFlights(flights=5, scatter={"translational_lift.gain": 0.0})
    without = scatter_columns(replace(PROBLEM, model=replace(MODEL, good_flights=good)), 0.0)
    assert without.shape[2] == scatter_columns(PROBLEM, 0.0).shape[2] - 1


def test_a_sound_flight_s_mean_is_off_in_each_mode_by_its_own_scatter():
    rpm = np.array([8.0, 3.0, 5.0, 1.0])
    means = scatter_columns(PROBLEM, rpm)[:, :, :4]
    np.testing.assert_allclose(means, [np.diag(rpm)] * len(means), atol=1e-12)


def test_a_step_in_flight_counts_as_it_is_afterwards():
    onset = known_term("rotor_degradation:onset", rotor=1)
    assert fitted_explanation(PROBLEM, (onset,), NOISE).terms[0].key == "rotor_degradation@2"


def test_a_cause_without_a_name_goes_along_what_the_flights_have_of_its_channel():
    term = curve_term("collective", "airspeed")
    (trial,) = fitted_explanation(PROBLEM, (term,), NOISE).trials
    speed = PROBLEM.channels.airspeed
    assert trial.values[0, -2:] == pytest.approx(np.quantile(speed, [0.02, 0.98]), abs=0.02)


def test_values_stay_within_their_bounds():
    heavy = assemble(MODEL, [made_flight(1, tank_kg=4.0, hidden_mass=9.0)])
    assert value(fitted_explanation(heavy, (GAUGE,), NOISE)) == pytest.approx(2.0)


def test_what_is_open_of_a_value_is_in_its_unit_and_no_less_than_sound_flights_scatter_by():
    usual = MASS.effect.parameters[0].smallest
    open_kg = np.sqrt(fitted_explanation(PROBLEM, (MASS,), NOISE).covariance[0, 0])
    assert 0.95 * usual < open_kg < 5.0 * usual


def test_a_rival_that_is_far_from_nothing_is_fitted_all_the_way():
    """A quarter of a rotor's thrust: N² goes with 1/(1 - loss), which one step overshoots."""
    problem = assemble(MODEL, [made_flight(k, loss=0.25) for k in range(2)])
    worn = known_term("rotor_degradation", rotor=0)
    loss = fitted_explanation(problem, (worn,), NOISE).trials[0].values[0, 0]
    assert loss == pytest.approx(0.25, abs=0.003)


def test_a_value_is_half_of_what_rows_say_where_they_weigh_as_much_as_what_is_usual():
    """1 kg is hidden; noise such that the rows know it to one usual size of a hidden mass."""
    size = MASS.effect.parameters[0].scale
    one = candidate(MASS, PROBLEM.flights)
    trials = TrialEffect(candidate=one, values=np.full_like(one.start, 0.5))
    column = derivatives(PROBLEM, [trials], 0)[:, :, 0]
    row_s = float(PROBLEM.durations.sum()) / PROBLEM.measured_rpm.shape[0]
    rows_know = float(np.linalg.norm(column / (NOISE / np.sqrt(row_s))))
    found = fitted_explanation(PROBLEM, (MASS,), NOISE * rows_know * size)
    assert value(found) == pytest.approx(0.5, abs=0.03)


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
