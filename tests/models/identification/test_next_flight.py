"""The next flight is the one whose rows tell two rivals apart, by formulas checked the long way."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.made_flights import curve_model, made_flight
from thrustmargin.models.effects import BY_KEY, effects_for
from thrustmargin.models.effects.compose import rotor_speed_rpm
from thrustmargin.models.identification import next_flight as module
from thrustmargin.models.identification.manoeuvres import (
    FlownLimits,
    flown_track,
    manoeuvres,
)
from thrustmargin.models.identification.next_flight import next_flight
from thrustmargin.models.identification.problem import assemble
from thrustmargin.models.identification.rivals import (
    ModePrediction,
    Rival,
    fitted_rival,
    second_noise_rpm,
)
from thrustmargin.models.identification.terms import Term
from thrustmargin.models.model.flown import model_channels, table_of
from thrustmargin.models.model.good_flights import GoodFlights

#: One fill, one speed: hidden mass is as good as a wrong gauge.
FLIGHTS = [made_flight(k, tank_kg=8.0, hidden_mass=1.0) for k in range(3)]
MODEL, LIMITS = curve_model(), FlownLimits.of(FLIGHTS)
PROBLEM = assemble(MODEL, FLIGHTS)
NOISE = np.array([4.0, 3.0, 2.5, 2.5])
MASS, GAUGE, LOSS = (Term(effect=BY_KEY[key]) for key in ("extra_mass", "tank_scale", "yaw_trim"))


def rivals(first, second) -> tuple[Rival, Rival]:
    return fitted_rival(PROBLEM, first, NOISE), fitted_rival(PROBLEM, second, NOISE)


def test_a_rival_is_fitted_to_the_flown_rows():
    mass, gauge = rivals((MASS,), (GAUGE,))
    assert mass.values == pytest.approx([1.0], abs=0.06)
    # The tank was 8.0 to 5.3 kg: 1 kg more is a gain of about 1.15.
    assert gauge.values == pytest.approx([1.15], abs=0.04)


def test_hidden_mass_and_gauge_are_told_apart_by_another_fill():
    chosen = next_flight(MODEL, rivals((MASS,), (GAUGE,)), limits=LIMITS, noise_rpm=NOISE)
    assert chosen.separates == ((MASS,), (GAUGE,))
    assert min(chosen.manoeuvre.fills_kg) == pytest.approx(0.8)
    assert chosen.nats > 1.0
    assert chosen.minutes <= LIMITS.minutes * len(chosen.manoeuvre.fills_kg)


def test_rivals_that_predict_the_same_everywhere_are_not_told_apart():
    mass = rivals((MASS,), ())[0]
    chosen = next_flight(MODEL, (mass, mass), limits=LIMITS, noise_rpm=NOISE)
    assert (chosen.nats, chosen.certainty) == (0.0, 0.5)


def test_the_divergence_is_that_of_two_gaussians(monkeypatch):
    """Against d' S^-1 d with S written out, of a short hover."""
    hover = manoeuvres(LIMITS)[1]
    monkeypatch.setattr(module, "ROW_S", 2.0)
    first, second = (
        Rival(terms=r.terms, values=r.values, covariance=0.04 * np.eye(r.values.size))
        for r in rivals((MASS,), (GAUGE, LOSS))
    )
    pair = (first, second)
    track = flown_track(hover, MODEL, LIMITS, hover.fills_kg[0])
    gram = module._gram([module._flown_once(MODEL, pair, track, NOISE, 3.0)])
    x = model_channels(MODEL, track, effects=effects_for(MODEL.airframe))
    x = x.rows(slice(None, None, 20))
    predict = ModePrediction.of(MODEL, table_of(MODEL), x, NOISE / np.sqrt(2.0))
    d = (
        predict.modes(pair[0].terms, pair[0].values) - predict.modes(pair[1].terms, pair[1].values)
    ).ravel()
    whole = np.eye(d.size)
    for rival in pair:
        j = predict.columns(rival.terms, rival.values)
        whole += j @ rival.covariance @ j.T
    n = predict.scatter(3.0)
    whole += n @ n.T
    assert module._distance_square(gram, 1) == pytest.approx(
        d @ np.linalg.solve(whole, d), rel=1e-6
    )
    # Twice the same rows in one flight are the same rows with half the noise.
    half = whole - 0.5 * np.eye(d.size)
    assert module._distance_square(gram, 2) == pytest.approx(d @ np.linalg.solve(half, d), rel=1e-6)


def test_values_are_shared_by_fills_and_scatter_is_each_flight_s_own():
    one = module._Flown(shared=np.ones((2, 1)), apart=np.ones((2, 1)), difference=np.ones(2))
    gram = module._gram([one, one])
    # Columns: shared 1111, apart 1100 and 0011, difference 1111.
    assert gram.tolist() == [[4, 2, 2, 4], [2, 2, 0, 2], [2, 0, 2, 2], [4, 2, 2, 4]]
    # S = I + 11' + blocks: on (1, 1, 1, 1) it is 1 + 4 + 2.
    assert module._distance_square(gram, 1) == pytest.approx(4.0 / 7.0)


def test_nothing_is_an_explanation_too():
    nothing, loss = rivals((), (LOSS,))
    assert nothing.values.size == 0
    far = Rival(terms=loss.terms, values=np.array([1.0]), covariance=0.01 * np.eye(1))
    chosen = next_flight(MODEL, (nothing, far), limits=LIMITS, noise_rpm=NOISE)
    assert chosen.certainty > 0.9


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


def test_derivatives_are_those_of_the_prediction():
    predict = ModePrediction.of(MODEL, PROBLEM.base, PROBLEM.channels, np.ones(4))
    column = predict.columns((MASS,), np.array([1.0]))[:, 0].reshape(-1, 4)
    # N = sqrt(N0² (1 + m/M)), so dN/dm = N0² / (2 M N).
    base = rotor_speed_rpm(PROBLEM.base, (), PROBLEM.channels, np)
    now = base * np.sqrt(1.0 + 1.0 / PROBLEM.channels.total_mass)[:, None]
    slope = base**2 / (2.0 * PROBLEM.channels.total_mass[:, None] * now)
    np.testing.assert_allclose(column @ PROBLEM.modes.directions.T, slope, rtol=1e-4)


def test_noise_of_a_second_is_that_of_blocks_about_their_flight():
    rng = np.random.default_rng(3)
    white = 5.0 * rng.standard_normal(PROBLEM.measured_rpm.shape) + 100.0 * (
        PROBLEM.flight[:, None] == 1
    )
    found = second_noise_rpm(PROBLEM, white)
    # 24 free blocks: a standard deviation from so few is good to 15 %.
    assert found == pytest.approx(np.full(4, 5.0 * np.sqrt(0.1)), rel=0.45)


def test_a_step_in_flight_counts_as_it_is_afterwards():
    onset = Term(effect=BY_KEY["rotor_degradation:onset"], rotor=1)
    assert fitted_rival(PROBLEM, (onset,), NOISE).terms[0].key == "rotor_degradation@2"
