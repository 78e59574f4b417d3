"""The floor: a law of the channels is learnt, noise and what only a flight knows are not."""

import numpy as np
import pytest

from tests.models.made_flights import curve_model, made_flights, table
from thrustmargin.models.identification.answer.floor import floor_rpm, learner_columns
from thrustmargin.models.identification.loop import identify
from thrustmargin.models.identification.rows.problem import assemble
from thrustmargin.models.identification.sets.discrepancy import hats


@pytest.fixture(scope="module")
def problem():
    return assemble(curve_model(), made_flights(4, duration=90.0))


def rms(values) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_smooth_laws_of_two_channels_are_learnt_from_other_flights(problem):
    x = problem.channels
    law = 20.0 * np.cos(x.time_s / 20.0) + 100.0 * (x.load_factor - 1.0)
    law = np.repeat(law[:, None], 4, axis=1)
    assert floor_rpm(problem, law) < 0.35 * rms(law)


def test_noise_is_not_learnt(problem):
    noise = np.random.default_rng(4).normal(0.0, 10.0, problem.measured_rpm.shape)
    assert 0.95 * rms(noise) < floor_rpm(problem, noise) <= rms(noise)


def test_what_only_the_flight_itself_shows_is_not_learnt(problem):
    """Each flight has a curve of its own over time: rows of the flight would give it away."""
    sign = np.array([1.0, -1.0, 1.0, -1.0])[problem.flight]
    own = sign * 20.0 * np.sin(problem.channels.time_s / 10.0)
    own = np.repeat(own[:, None], 4, axis=1)
    assert floor_rpm(problem, own) > 0.9 * rms(own)


def test_of_one_flight_a_law_is_learnt_from_its_other_fifths():
    """And what repeats in each fifth alone is not: over fifths that are left out it is new."""
    one = assemble(curve_model(), made_flights(1, duration=200.0))
    law = np.repeat(100.0 * (one.channels.load_factor - 1.0)[:, None], 4, axis=1)
    assert floor_rpm(one, law) < 0.5 * rms(law)
    fifth = one.block * 5 // (one.block[-1] + 1)
    steps = np.array([20.0, -20.0, 20.0, -20.0, 20.0])[fifth]
    steps = np.repeat(steps[:, None], 4, axis=1)
    assert floor_rpm(one, steps) > 0.9 * rms(steps)


def test_the_floor_is_never_above_what_is_left(problem):
    left = np.random.default_rng(5).normal(size=problem.measured_rpm.shape)
    for size in ([1.0, 1.0, 1.0, 1.0], [9.0, 0.1, 1.0, 1.0]):
        assert floor_rpm(problem, left * size) <= rms(left * size)


@pytest.mark.parametrize("flights", [2, 1])
def test_it_is_ridge_regression_with_each_flight_or_fifth_left_out(flights):
    of = assemble(curve_model(), made_flights(flights, duration=60.0))
    residual = np.random.default_rng(6).normal(size=of.measured_rpm.shape)
    residual += 100.0 * (of.channels.load_factor - 1.0)[:, None]
    blocks = of.block_flight.size
    fold = of.flight if flights > 1 else of.block * 5 // blocks
    columns, wanted = learner_columns([of.channels]), of.mode_amplitudes(residual)
    rows = columns.shape[0]
    left = np.zeros((5, 4))
    for k in range(fold.max() + 1):
        rest, out = fold != k, fold == k
        for i, ridge in enumerate((0.001, 0.01, 0.1, 1.0, 10.0)):
            seen = columns[rest]
            system = seen.T @ seen + ridge * rows * np.eye(columns.shape[1])
            weights = np.linalg.solve(system, seen.T @ wanted[rest])
            left[i] += np.sum((wanted[out] - columns[out] @ weights) ** 2, axis=0)
    least = np.minimum(left.min(axis=0), np.sum(wanted**2, axis=0))
    by_hand = np.sqrt(least.sum() / wanted.size)
    assert by_hand < 0.95 * rms(residual)
    assert floor_rpm(of, residual) == pytest.approx(by_hand, rel=1e-4)


def of_flight(problem, flight):
    return problem.rows(np.flatnonzero(problem.flight == flight))


def law_of(problem):
    return np.repeat(100.0 * (problem.channels.load_factor - 1.0)[:, None], 4, axis=1)


def test_a_law_is_learnt_from_flights_that_are_not_scored(problem):
    """The flight itself shows none of it: every other row has the opposite law."""
    one, others = of_flight(problem, 0), problem.rows(np.flatnonzero(problem.flight > 0))
    law = law_of(one)
    assert floor_rpm(one, law, (others, law_of(others))) < 0.35 * rms(law)
    half = np.where(np.arange(len(law)) % 2, 1.0, -1.0)[:, None]
    assert floor_rpm(one, half * law, (others, law_of(others))) > 0.95 * rms(law)


def test_nothing_is_learnt_from_the_flight_itself_where_others_are_beside_it(problem):
    one, others = of_flight(problem, 0), problem.rows(np.flatnonzero(problem.flight > 0))
    nothing = np.zeros(others.measured_rpm.shape)
    assert floor_rpm(one, law_of(one), (others, nothing)) == pytest.approx(rms(law_of(one)))
    # Of two flights that are scored, each may learn from the other.
    two = problem.rows(np.flatnonzero(problem.flight < 2))
    rest = problem.rows(np.flatnonzero(problem.flight == 2))
    law, nothing = law_of(two), np.zeros(rest.measured_rpm.shape)
    assert floor_rpm(two, law, (rest, nothing)) < 0.6 * rms(law)


def test_what_others_show_wrongly_does_not_raise_it_above_what_is_left(problem):
    one, others = of_flight(problem, 0), problem.rows(np.flatnonzero(problem.flight > 0))
    law = law_of(one)
    assert floor_rpm(one, law, (others, -5.0 * law_of(others))) <= rms(law) + 1e-9


def test_it_is_ridge_regression_from_every_other_row_of_flights_beside():
    every = assemble(curve_model(), made_flights(3, duration=60.0))
    one, others = of_flight(every, 2), every.rows(np.flatnonzero(every.flight < 2))
    residual = np.random.default_rng(6).normal(size=every.measured_rpm.shape) + law_of(every)
    mine, theirs = residual[every.flight == 2], residual[every.flight < 2]
    thin = others.rows(np.arange(0, len(theirs), 2))
    columns = learner_columns([one.channels, thin.channels])
    own, seen = columns[: len(mine)], columns[len(mine) :]
    wanted, left = one.mode_amplitudes(mine), []
    for ridge in (0.001, 0.01, 0.1, 1.0, 10.0):
        system = seen.T @ seen + ridge * len(columns) * np.eye(columns.shape[1])
        weights = np.linalg.solve(system, seen.T @ others.mode_amplitudes(theirs)[::2])
        left.append(np.sum((wanted - own @ weights) ** 2, axis=0))
    least = np.minimum(np.min(left, axis=0), np.sum(wanted**2, axis=0))
    by_hand = np.sqrt(least.sum() / wanted.size)
    assert by_hand < 0.95 * rms(mine)
    assert floor_rpm(one, mine, (others, theirs)) == pytest.approx(by_hand, rel=1e-4)


def test_identify_learns_the_floor_of_held_out_flights_from_the_flights_of_the_fit():
    flights = made_flights(3, duration=60.0, loss=0.08, hidden_mass=1.0)
    few = table(["rotor_degradation"])
    found = identify(flights[:2], curve_model(), held_out=flights[2:], catalogue=few)
    unused = found.unseen[-1]
    beside = found.problem, found.residual_after_rpm
    assert found.floor_rpm == floor_rpm(unused.problem, unused.after_rpm, beside)
    assert found.floor_rpm != floor_rpm(unused.problem, unused.after_rpm)


def test_what_the_imu_feels_to_the_side_is_among_the_columns(problem):
    force = problem.channels.side_load
    assert force.shape[1] == 2
    track = made_flights(1)[0]
    x = assemble(curve_model(), [track]).channels
    rows = np.searchsorted(track.time_s, x.time_s - 1e-6)
    np.testing.assert_allclose(x.side_load * 9.80665, track.specific_force_frd[rows, :2])
    x = x.with_changed(side_load=np.random.default_rng(1).normal(size=x.side_load.shape))
    columns = learner_columns([x])
    for one in x.side_load.T:
        even = (one - one.mean()) / one.std()
        assert np.abs(columns - even[:, None]).max(axis=0).min() < 1e-9


def test_its_columns_are_curves_along_the_present_rates_and_waves_of_size_one(problem):
    columns = learner_columns([problem.channels])
    ahead = np.cos(problem.channels.heading)
    even = (ahead - ahead.mean()) / ahead.std()
    assert np.abs(columns - even[:, None]).max(axis=0).min() < 1e-9
    for shifts in problem.channels.rate_shifts:
        now = shifts[:, shifts.shape[1] // 2]
        curves = hats((now - now.mean()) / now.std(), 9)
        off = [np.abs(columns - one[:, None]).max(axis=0).min() for one in curves.T]
        assert max(off) < 1e-9
    # 150 waves of each of two lengths, as sqrt(2) cos: between -1.41 and 1.41.
    waves = columns[:, (np.abs(columns).max(axis=0) <= np.sqrt(2.0)) & (columns.min(axis=0) < -1.3)]
    assert waves.shape[1] > 100
    assert np.mean(waves**2) == pytest.approx(1.0, abs=0.15)
