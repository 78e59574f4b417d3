"""The floor: a law of the channels is learnt, noise and what only a flight knows are not."""

import numpy as np
import pytest

from tests.models.made_flights import curve_model, made_flights
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.identification.answer.floor import _columns, floor_rpm
from thrustmargin.models.identification.rows.problem import assemble
from thrustmargin.models.identification.sets.free_form import hats
from thrustmargin.models.model.model_file import shipped_model


@pytest.fixture(scope="module")
def problem():
    return assemble(curve_model(), made_flights(4))


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


@pytest.mark.parametrize("flights", [2, 3, 1])
def test_it_is_ridge_regression_with_each_flight_or_fifth_left_out(flights):
    of = assemble(curve_model(), made_flights(flights, duration=60.0))
    residual = np.random.default_rng(6).normal(size=of.measured_rpm.shape)
    residual += 100.0 * (of.channels.load_factor - 1.0)[:, None]
    blocks = of.block_flight.size
    fold = of.flight if flights > 1 else of.block * 5 // blocks
    columns, wanted = _columns(of.channels), of.in_modes(residual)
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


def test_its_columns_are_curves_along_the_present_rates_and_waves_of_size_one(problem):
    columns = _columns(problem.channels)
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


@pytest.mark.slow
def test_boosted_trees_on_the_same_channels_do_not_undercut_it(sitl_logs):
    ensemble = pytest.importorskip("sklearn.ensemble")
    model = shipped_model()
    names = [f"worn_prop_{k}.tlog" for k in (1, 2, 3)]
    tracks = [read_log(sitl_logs / "dev" / n, airframe=model.airframe).track for n in names]
    problem = assemble(model, tracks)
    x, residual = problem.channels, problem.measured_rpm - problem.speeds()
    every = [x.airspeed, x.tank_kg, x.time_s, x.voltage, x.advance_ratio, x.load_factor, x.heading]
    tables = [x.load_factor_shifts, *x.rate_shifts, *x.acceleration_shifts]
    columns = np.concatenate([np.stack(every, axis=1), *(t[:, ::4] for t in tables)], axis=1)
    modes = problem.in_modes(residual)
    left = np.empty_like(modes)
    for f in range(3):
        out = problem.flight == f
        for k in range(4):
            trees = ensemble.HistGradientBoostingRegressor(max_iter=80, learning_rate=0.06)
            left[out, k] = modes[out, k] - trees.fit(columns[~out], modes[~out, k]).predict(
                columns[out]
            )
    assert floor_rpm(problem, residual) < 1.02 * rms(left)
