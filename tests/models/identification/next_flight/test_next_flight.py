"""The next flight: its rows distinguish two explanations, by formulas checked the long way."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from tests.models.identification.known_terms import known_term
from tests.models.identification.next_flight.test_explanations import (
    FLIGHTS,
    GAUGE,
    LOSS,
    MASS,
    MODEL,
    NOISE,
    PROBLEM,
    explanations,
)
from thrustmargin.models.identification.answer.result import Mentioned, OneOf, SetWeight
from thrustmargin.models.identification.next_flight import next_flight as module
from thrustmargin.models.identification.next_flight.manoeuvres import (
    FlownLimits,
    flown_track,
    manoeuvres,
)
from thrustmargin.models.identification.next_flight.next_flight import (
    explanations_of,
    next_flight,
    plan_next_flight,
    rows_of,
    scatter_columns,
)
from thrustmargin.models.identification.rows.candidates import derivatives, predicted_modes

#: As the code has them, written down by hand: a change there is to be seen here.
CHANCE = 0.6

LIMITS = FlownLimits.from_tracks(FLIGHTS)


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
        replace(one, covariance=0.04 * np.eye(len(one.covariance)))
        for one in explanations((MASS,), (GAUGE, LOSS))
    )
    track = flown_track(hover, MODEL, LIMITS, hover.fills_kg[0])
    gram = module._gram([module._fly_once(MODEL, (first, second), track, NOISE, 3.0, False)])
    rows = rows_of(MODEL, track, [t.effect for t in (MASS, GAUGE, LOSS)], False)
    noise = (NOISE / np.sqrt(2.0))[None, :]
    d = (
        (predicted_modes(rows, first.trials) - predicted_modes(rows, second.trials)) / noise
    ).ravel()
    whole = np.eye(d.size)
    for trials in (first.trials, second.trials):
        for k in range(len(trials)):
            j = (derivatives(rows, trials, k)[:, :, 0] / noise).ravel()
            whole += 0.04 * np.outer(j, j)
    n = (scatter_columns(rows, 3.0) / noise[:, :, None]).reshape(d.size, -1)
    whole += n @ n.T
    assert module._distance_square(gram, 1) == pytest.approx(
        d @ np.linalg.solve(whole, d), rel=1e-6
    )
    # Twice the same rows in one flight are the same rows with half the noise.
    half = whole - 0.5 * np.eye(d.size)
    assert module._distance_square(gram, 2) == pytest.approx(d @ np.linalg.solve(half, d), rel=1e-6)


def test_a_root_of_a_covariance_gives_it_back():
    covariance = np.array([[4.0, 1.2], [1.2, 9.0]])
    root = module._covariance_root(covariance)
    np.testing.assert_allclose(root @ root.T, covariance, atol=1e-12)


def test_values_are_shared_by_fills_and_scatter_is_each_flight_s_own():
    one = module._FlownManoeuvre(
        shared=np.ones((2, 1)), scatter=np.ones((2, 1)), difference=np.ones(2)
    )
    gram = module._gram([one, one])
    # Columns: shared 1111, apart 1100 and 0011, difference 1111.
    assert gram.tolist() == [[4, 2, 2, 4], [2, 2, 0, 2], [2, 0, 2, 2], [4, 2, 2, 4]]
    # S = I + 11' + blocks: on (1, 1, 1, 1) it is 1 + 4 + 2.
    assert module._distance_square(gram, 1) == pytest.approx(4.0 / 7.0)


def test_nothing_is_an_explanation_too():
    nothing, loss = explanations((), (LOSS,))
    assert (nothing.trials, nothing.covariance.size) == ((), 0)
    strong = replace(loss.trials[0], values=np.array([[1.0]]))
    far = replace(loss, trials=(strong,), covariance=0.01 * np.eye(1))
    chosen = next_flight(MODEL, (nothing, far), limits=LIMITS, noise_rpm=NOISE)
    assert chosen.certainty > 0.9


def left_open(**given):
    """What of an identification says what it could not tell apart."""
    nothing = {"found": (), "one_of": (), "alternatives": (), "mentioned": ()}
    return SimpleNamespace(**{**nothing, "model": MODEL, **given})


def named(term):
    return SimpleNamespace(term=term)


def keys(found):
    pair = explanations_of(found)  # type: ignore[arg-type]
    return pair and tuple([t.key for t in side] for side in pair)


def test_explanations_are_what_the_identification_left_open():
    weak = known_term("rotor_degradation", rotor=2)
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


def test_a_flight_that_tells_no_more_than_chance_is_not_asked_for():
    def after(first, second):
        found = left_open(
            alternatives=tuple(SetWeight(probability=0.5, terms=(t,)) for t in (first, second)),
            problem=PROBLEM,
            residual_after_rpm=PROBLEM.measured_rpm - PROBLEM.measured_rpm.mean(axis=0),
        )
        return plan_next_flight(found, FLIGHTS)  # type: ignore[arg-type]

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
    flown = module._fly_once(MODEL, explanations((MASS,), (GAUGE,)), track, NOISE, 0.0, False)
    assert flown.difference.size == 150 * 4


@pytest.mark.parametrize(("louder", "asked_for"), [(3.0, True), (6.0, False)])
def test_a_flight_is_worth_it_from_60_percent_on(louder, asked_for):
    """Of what is left at three and six times its size a choice is right with 67 and 58 %."""
    found = left_open(
        alternatives=tuple(SetWeight(probability=0.5, terms=(t,)) for t in (MASS, GAUGE)),
        problem=PROBLEM,
        residual_after_rpm=louder * (PROBLEM.measured_rpm - PROBLEM.measured_rpm.mean(axis=0)),
    )
    told = plan_next_flight(found, FLIGHTS)  # type: ignore[arg-type]
    assert (told is not None) == asked_for


def test_outputs_show_shares_alone_so_that_what_all_rotors_have_in_common_tells_nothing():
    pair = explanations((MASS,), (LOSS,))
    of = {
        outputs: module._fly_once(
            MODEL, pair, flown_track(h, MODEL, LIMITS, 8.0), NOISE, 0.0, outputs
        )
        for h in manoeuvres(LIMITS)[:1]
        for outputs in (False, True)
    }
    collective = {outputs: one.difference.reshape(-1, 4)[:, 0] for outputs, one in of.items()}
    assert np.abs(collective[False]).min() > 1.0
    assert np.abs(collective[True]).max() < 0.02 * np.abs(collective[False]).min()
