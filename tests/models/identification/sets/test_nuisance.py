"""Nuisances leave the Gram matrices as they leave a dense normal distribution."""

import numpy as np
import pytest

from thrustmargin.models.identification.rows.noise import Whitening
from thrustmargin.models.identification.rows.value_columns import ValueColumns, concatenate_columns
from thrustmargin.models.identification.sets.discrepancy import learn_variances
from thrustmargin.models.identification.sets.linear_sets import FilteredColumns
from thrustmargin.models.identification.sets.nuisance import Nuisance

#: As the code has them, written down by hand: a change there is to be seen here.
ALL_FLIGHTS = -1
LEAST = 0.05

MODES, ROWS, FLIGHTS = 2, 60, 2


def made(seed=0, rows=ROWS, uncertainty=2):
    """Two flights with 3 scatters, doubts, and 4 hats; the filter leaves everything as it is."""
    rng = np.random.default_rng(seed)
    n = rows * FLIGHTS
    whitening = Whitening(
        rows=np.arange(n) + 2,
        flight=np.repeat(np.arange(FLIGHTS), rows),
        unfiltered=np.zeros(n, dtype=bool),
        coefficients=np.zeros((MODES, 2)),
        scale=np.ones((n, MODES)),
        weight=np.ones((n, MODES)),
    )
    nuisance = Nuisance(
        whitening=whitening,
        flights=tuple(slice(f * rows, (f + 1) * rows) for f in range(FLIGHTS)),
        scatter=rng.standard_normal((n, MODES, 3)),
        uncertainty=rng.standard_normal((n, MODES, uncertainty)),
        free=rng.standard_normal((MODES, n, 4)),
    )
    return nuisance, rng


def dense(nuisance: Nuisance, factor: float = 1.0) -> np.ndarray:
    """The covariance of all (means x modes) by the definition of the model, with curves that are
    `factor` times their size on a sound aircraft."""
    n = nuisance.scatter.shape[0]
    covariance = np.eye(n * MODES)
    for part in nuisance.flights:
        own = np.zeros((n, MODES, nuisance.scatter.shape[2]))
        own[part] = nuisance.scatter[part]
        flat = own.reshape(n * MODES, -1)
        covariance += flat @ flat.T
    flat = nuisance.uncertainty.reshape(n * MODES, -1)
    covariance += flat @ flat.T
    for mode in range(MODES):
        hats = np.zeros((n, MODES, 4))
        sizes = [2.0, factor, factor, factor]  # the first is a constant
        hats[:, mode] = nuisance.free[mode] * sizes
        flat = hats.reshape(n * MODES, -1)
        covariance += flat @ flat.T
    return covariance


def columns_of(rng, count=3, rows=ROWS):
    return np.concatenate(
        [np.zeros((2, MODES, count)), rng.standard_normal((2 * rows, MODES, count))]
    )


@pytest.mark.parametrize("factor", [1.0, 4.0, 16.0])
def test_the_gram_matrix_is_that_of_the_dense_model(factor):
    nuisance, rng = made()
    z = columns_of(rng)
    solved = nuisance.marginalise(factor)
    gram = solved.reduce(nuisance.sums(z))
    covariance = dense(nuisance, factor)
    flat = z[2:].reshape(-1, 3)
    assert gram == pytest.approx(flat.T @ np.linalg.solve(covariance, flat), rel=1e-9)


def test_a_flight_left_out_is_not_in_the_answer():
    nuisance, rng = made()
    z = columns_of(rng)
    other = z.copy()
    other[2 : 2 + ROWS] *= 7.0  # the first flight
    first = nuisance.select_means(nuisance.whitening.flight == 0)
    rest = nuisance.select_means(nuisance.whitening.flight == 1)
    left = [
        [whole - part for whole, part in zip(nuisance.sums(of), first.sums(of), strict=True)]
        for of in (z, other)
    ]
    one = nuisance.marginalise(less=first)
    expected = rest.marginalise().reduce(rest.sums(z))
    for shared, own in left:
        assert one.reduce((shared, own)) == pytest.approx(expected)


def test_without_doubt_or_hats_nothing_breaks():
    nuisance, rng = made(uncertainty=0)
    assert nuisance.marginalise().reduce(nuisance.sums(columns_of(rng))).shape == (3, 3)


def test_sets_are_weighed_with_curves_as_large_as_on_a_sound_aircraft():
    assert made()[0].marginalise().factor == 1.0


def test_sizes_are_learnt_from_what_was_drawn():
    """Three times the scatter's size and half of the hats', over many flights' draws."""
    found = []
    for seed in range(12):
        nuisance, rng = made(seed, rows=120)
        n = nuisance.scatter.shape[0]
        y = rng.standard_normal((n, MODES))
        for part in nuisance.flights:
            y[part] += nuisance.scatter[part] @ (3.0 * rng.standard_normal(3))
        for mode in range(MODES):
            y[:, mode] += nuisance.free[mode] @ (0.5 * rng.standard_normal(4))
        residual = np.concatenate([np.zeros((2, MODES)), y])
        learnt = learn_variances(nuisance, residual, ("a",) * 4, np.zeros(3, dtype=int))
        found.append([learnt.scatter[0], *learnt.free[:, 0]])
    scatter, *free = np.sqrt(np.mean(np.square(found), axis=0))
    assert scatter == pytest.approx(3.0, rel=0.3)
    assert free == pytest.approx([0.5, 0.5], rel=0.4)


def test_components_that_keep_their_size_keep_it_and_none_vanishes():
    nuisance, rng = made()
    residual = np.concatenate([np.zeros((2, MODES)), rng.standard_normal((2 * ROWS, MODES))])
    learnt = learn_variances(nuisance, residual, ("a",) * 4, np.array([-1, 0, 0]))
    assert learnt.scatter[0] == 1.0
    assert np.all(learnt.scatter >= LEAST)
    assert learnt.scatter[1] == learnt.scatter[2] < 0.5


def refit_flight_values(rng) -> ValueColumns:
    """A column of both flights, and two values of which each flight has its own."""
    owners = np.array([ALL_FLIGHTS, 0, 1, 0, 1])
    values = columns_of(rng)
    return ValueColumns.with_source(values, np.array([0, 1, 1, 2, 2]), owners)


def test_a_value_of_one_flight_is_summed_there_alone_and_fits_in_among_the_others():
    nuisance, rng = made()
    columns = refit_flight_values(rng)
    sums = nuisance.sums(columns)
    flight = np.repeat([0, 0, 1], [2, ROWS, ROWS])
    wide = columns.dense(flight)
    assert not wide[flight == 1, :, 1].any()
    assert not wide[flight == 0, :, 4].any()
    solved = nuisance.marginalise(4.0)
    flat = wide[2:].reshape(-1, 5)
    expected = flat.T @ np.linalg.solve(dense(nuisance, 4.0), flat)
    np.testing.assert_allclose(solved.reduce(sums), expected, rtol=1e-8, atol=1e-9)


def test_a_residual_beside_columns_that_were_prepared_is_one_more_column():
    nuisance, rng = made()
    columns, residual = refit_flight_values(rng), columns_of(rng, 1)
    of_modes = ValueColumns.with_source(
        columns_of(rng, 2), np.array([0, 1, 1]), mode=np.array([0, 0, 1])
    )
    columns = concatenate_columns([columns, of_modes])
    both = concatenate_columns([columns, ValueColumns.from_values(residual)])
    flight = np.repeat([0, 0, 1], [2, ROWS, ROWS])
    flat = both.dense(flight)[2:].reshape(-1, columns.count + 1)
    for factor in (1.0, 4.0):
        expected = flat.T @ np.linalg.solve(dense(nuisance, factor), flat)
        prepared = FilteredColumns.from_columns(nuisance, nuisance.marginalise(factor), columns)
        np.testing.assert_allclose(prepared.gram(residual[:, :, 0]), expected, rtol=1e-8, atol=1e-9)


def test_a_column_of_one_mode_is_nothing_in_the_others():
    rng = np.random.default_rng(3)
    columns = ValueColumns.with_source(columns_of(rng, 1), np.array([0, 0]), mode=np.array([1, 0]))
    wide = columns.dense(np.repeat([0, 0, 1], [2, ROWS, ROWS]))
    np.testing.assert_array_equal(wide[:, 1, 0], columns.values[:, 1, 0])
    assert not wide[:, 0, 0].any()
    assert not wide[:, 1, 1].any()


def test_sums_of_some_means_are_those_of_a_nuisance_of_them():
    nuisance, rng = made()
    columns = columns_of(rng)
    kept = np.ones(2 * ROWS, dtype=bool)
    kept[10:40] = False
    some = nuisance.select_means(kept)
    assert [f.stop - f.start for f in some.flights] == [ROWS - 30, ROWS]
    flat = columns[2:][kept].reshape(-1, 3)
    expected = flat.T @ np.linalg.solve(dense(some), flat)
    np.testing.assert_allclose(some.marginalise().reduce(some.sums(columns)), expected, rtol=1e-8)
