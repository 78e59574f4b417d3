"""The next flight: its rows distinguish two explanations, by formulas checked the long way."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from tests.models.made_flights import curve_model, made_flight
from thrustmargin.models.effects import BY_KEY, effects_for
from thrustmargin.models.effects.compose import rotor_speed_rpm
from thrustmargin.models.identification.answer.explanations import (
    Explanation,
    ModePrediction,
    fitted_explanation,
    second_noise_rpm,
)
from thrustmargin.models.identification.answer.result import Mentioned, OneOf, SetWeight
from thrustmargin.models.identification.next_flight import next_flight as module
from thrustmargin.models.identification.next_flight.manoeuvres import (
    FlownLimits,
    flown_track,
    manoeuvres,
)
from thrustmargin.models.identification.next_flight.next_flight import (
    CHANCE,
    explanations_of,
    following_flight,
    next_flight,
)
from thrustmargin.models.identification.rows.candidates import Term
from thrustmargin.models.identification.rows.problem import assemble
from thrustmargin.models.model.predict import model_channels, table_of
from thrustmargin.models.network.records import GoodFlights

#: One fill, one speed: hidden mass is as good as a wrong gauge.
FLIGHTS = [made_flight(k, tank_kg=8.0, hidden_mass=1.0) for k in range(3)]
MODEL, LIMITS = curve_model(), FlownLimits.of(FLIGHTS)
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


def test_hidden_mass_and_gauge_are_told_apart_by_another_fill():
    chosen = next_flight(MODEL, explanations((MASS,), (GAUGE,)), limits=LIMITS, noise_rpm=NOISE)
    assert chosen.separates == ((MASS,), (GAUGE,))
    assert min(chosen.manoeuvre.fills_kg) == pytest.approx(0.8)
    assert chosen.nats > 1.0
    assert chosen.minutes <= LIMITS.minutes * len(chosen.manoeuvre.fills_kg)


def test_explanations_that_predict_the_same_everywhere_are_not_distinguished():
    mass = explanations((MASS,), ())[0]
    chosen = next_flight(MODEL, (mass, mass), limits=LIMITS, noise_rpm=NOISE)
    assert (chosen.nats, chosen.certainty) == (0.0, 0.5)


def test_the_divergence_is_that_of_two_gaussians(monkeypatch):
    """Against d' S^-1 d with S written out, of a short hover."""
    hover = manoeuvres(LIMITS)[1]
    monkeypatch.setattr(module, "ROW_S", 2.0)
    first, second = (
        Explanation(terms=r.terms, values=r.values, covariance=0.04 * np.eye(r.values.size))
        for r in explanations((MASS,), (GAUGE, LOSS))
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
    for explanation in pair:
        j = predict.columns(explanation.terms, explanation.values)
        whole += j @ explanation.covariance @ j.T
    n = predict.scatter(3.0)
    whole += n @ n.T
    assert module._distance_square(gram, 1) == pytest.approx(
        d @ np.linalg.solve(whole, d), rel=1e-6
    )
    # Twice the same rows in one flight are the same rows with half the noise.
    half = whole - 0.5 * np.eye(d.size)
    assert module._distance_square(gram, 2) == pytest.approx(d @ np.linalg.solve(half, d), rel=1e-6)


def test_a_root_of_a_covariance_gives_it_back():
    covariance = np.array([[4.0, 1.2], [1.2, 9.0]])
    root = module._root(covariance)
    np.testing.assert_allclose(root @ root.T, covariance, atol=1e-12)


def test_values_are_shared_by_fills_and_scatter_is_each_flight_s_own():
    one = module._Flown(shared=np.ones((2, 1)), apart=np.ones((2, 1)), difference=np.ones(2))
    gram = module._gram([one, one])
    # Columns: shared 1111, apart 1100 and 0011, difference 1111.
    assert gram.tolist() == [[4, 2, 2, 4], [2, 2, 0, 2], [2, 0, 2, 2], [4, 2, 2, 4]]
    # S = I + 11' + blocks: on (1, 1, 1, 1) it is 1 + 4 + 2.
    assert module._distance_square(gram, 1) == pytest.approx(4.0 / 7.0)


def test_nothing_is_an_explanation_too():
    nothing, loss = explanations((), (LOSS,))
    assert nothing.values.size == 0
    far = Explanation(terms=loss.terms, values=np.array([1.0]), covariance=0.01 * np.eye(1))
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


def left_open(**given):
    """What of an identification says what it could not tell apart."""
    nothing = {"found": (), "one_of": (), "alternatives": (), "mentioned": ()}
    return SimpleNamespace(**{**nothing, "model": MODEL, **given})


def named(term, alike=()):
    return SimpleNamespace(term=term, indistinguishable_from=alike)


def keys(found):
    pair = explanations_of(found)  # type: ignore[arg-type]
    return pair and tuple([t.key for t in side] for side in pair)


def test_explanations_are_what_the_identification_left_open():
    weak = Term(effect=BY_KEY["rotor_degradation"], rotor=2)
    assert keys(left_open()) is None
    assert keys(left_open(found=(named(MASS),))) is None
    either = OneOf(terms=(LOSS, GAUGE, MASS), probabilities=(0.1, 0.3, 0.6))
    assert keys(left_open(found=(named(weak),), one_of=(either,))) == (
        ["rotor_degradation@3", "extra_mass"],
        ["rotor_degradation@3", "tank_scale"],
    )
    sets = (SetWeight(probability=0.7, terms=(MASS,)), SetWeight(probability=0.3, terms=(GAUGE,)))
    assert keys(left_open(alternatives=sets)) == (["extra_mass"], ["tank_scale"])
    sure = (SetWeight(probability=0.97, terms=(MASS,)), SetWeight(probability=0.03, terms=()))
    assert keys(left_open(alternatives=sure)) is None
    unclear = (
        Mentioned(rotor=0, probability=0.06, loss=0.01, ci95=(0.0, 0.02)),
        Mentioned(rotor=2, probability=0.3, loss=0.02, ci95=(0.0, 0.04)),
    )
    assert keys(left_open(found=(named(MASS),), mentioned=unclear)) == (
        ["extra_mass"],
        ["extra_mass", "rotor_degradation@3"],
    )
    alike = (named(LOSS), named(MASS, ("tank_scale",)))
    assert keys(left_open(found=alike)) == (["yaw_trim", "extra_mass"], ["yaw_trim", "tank_scale"])


def test_a_flight_that_tells_no_more_than_chance_is_not_asked_for():
    def after(first, second):
        found = left_open(
            alternatives=tuple(SetWeight(probability=0.5, terms=(t,)) for t in (first, second)),
            problem=PROBLEM,
            residual_after_rpm=PROBLEM.measured_rpm - PROBLEM.measured_rpm.mean(axis=0),
        )
        return following_flight(found, FLIGHTS)  # type: ignore[arg-type]

    assert after(MASS, MASS) is None
    told = after(MASS, LOSS)
    assert told is not None
    assert told.certainty > CHANCE


def most(chosen, minutes: float) -> int:
    """How often a manoeuvre fits into flights of so many minutes, one a fill."""
    once = sum(piece.seconds for piece in chosen.manoeuvre.pieces) / 60.0
    return max(1, int(minutes / once))


@pytest.mark.parametrize(
    ("louder", "minutes"), [(1.0, 3.0), (17.33, 3.0), (32.0, 3.0), (120.0, 12.0), (1000.0, 3.0)]
)
def test_a_manoeuvre_is_flown_until_95_percent_are_sure_or_as_often_as_flights_last(
    louder, minutes
):
    """d' S^-1 d is twice the nats; half of its root, in standard errors, is how far apart."""
    limits = replace(LIMITS, minutes=minutes)
    pair = explanations((MASS,), (GAUGE,))
    chosen = next_flight(MODEL, pair, limits=limits, noise_rpm=louder * NOISE)
    assert chosen.certainty == pytest.approx(norm.cdf(np.sqrt(2.0 * chosen.nats) / 2.0))
    assert chosen.certainty >= 0.95 or chosen.repeats == most(chosen, minutes)


def test_two_fills_are_two_flights_each_as_long_as_any():
    """With values that are wide open, one fill alone tells a mass from a gauge by nothing."""
    mass, gauge = explanations((MASS,), (GAUGE,))
    wide = (
        replace(mass, covariance=100.0 * np.eye(1)),
        replace(gauge, covariance=100.0 * np.eye(1)),
    )
    limits = replace(LIMITS, minutes=12.0)
    chosen = next_flight(MODEL, wide, limits=limits, noise_rpm=100.0 * NOISE)
    assert len(chosen.manoeuvre.fills_kg) == 2
    assert chosen.repeats == most(chosen, 12.0) > 1


def test_a_manoeuvre_is_predicted_every_fifth_of_a_second():
    hover = manoeuvres(LIMITS)[0]  # 30 s
    track = flown_track(hover, MODEL, LIMITS, hover.fills_kg[0])
    flown = module._flown_once(MODEL, explanations((MASS,), (GAUGE,)), track, NOISE, 0.0)
    assert flown.difference.size == 150 * 4


def test_a_rival_that_is_far_from_nothing_is_fitted_all_the_way():
    """A quarter of a rotor's thrust: N² goes with 1/(1 - loss), which one step overshoots."""
    problem = assemble(MODEL, [made_flight(k, loss=0.25) for k in range(2)])
    worn = Term(effect=BY_KEY["rotor_degradation"], rotor=0)
    assert fitted_explanation(problem, (worn,), NOISE).values[0] == pytest.approx(0.25, abs=0.003)


@pytest.mark.parametrize(("louder", "asked_for"), [(3.0, True), (6.0, False)])
def test_a_flight_is_worth_it_from_60_percent_on(louder, asked_for):
    """Of what is left at three and six times its size a choice is right with 67 and 58 %."""
    found = left_open(
        alternatives=tuple(SetWeight(probability=0.5, terms=(t,)) for t in (MASS, GAUGE)),
        problem=PROBLEM,
        residual_after_rpm=louder * (PROBLEM.measured_rpm - PROBLEM.measured_rpm.mean(axis=0)),
    )
    told = following_flight(found, FLIGHTS)  # type: ignore[arg-type]
    assert (told is not None) == asked_for


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
