"""The noise filter on made noise of known coefficients, and by hand."""

import numpy as np
import pytest

from thrustmargin.models.identification.rows.noise import Whitening, whitening_of

#: As the code has them, written down by hand: a change there is to be seen here.
FEWEST = 15
HUBER = 3.0

SPEED = 2000.0


def made(seed=0, count=6000, size=(4.0, 2.0)):
    """Autoregressive noise of two flights, twice as large in the first, and its innovations."""
    rng = np.random.default_rng(seed)
    flight = np.repeat([0, 1], count // 2)
    e, w = np.zeros(count), rng.standard_normal(count) * np.array(size)[flight]
    for t in range(2, count):
        e[t] = 0.4 * e[t - 1] + 0.2 * e[t - 2] + w[t]
    follows = np.ones(count, dtype=bool)
    follows[[0, count // 2]] = False
    return e[:, None], flight, follows


def test_coefficients_and_sizes_are_found_and_leave_noise_of_size_one():
    residual, flight, follows = made()
    calm = np.zeros(flight.size, dtype=bool)
    found = whitening_of(residual, flight, follows, calm, SPEED)
    assert found.coefficients[0] == pytest.approx([0.4, 0.2], abs=0.04)
    sizes = [np.median(found.scale[found.flight == f]) for f in (0, 1)]
    assert sizes == pytest.approx([4.0, 2.0], rel=0.06)
    white = found.apply(residual)[:, 0]
    assert white.std() == pytest.approx(1.0, abs=0.04)
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 0.04


def test_a_filter_by_hand():
    filter_ = Whitening(
        rows=np.array([2, 3]),
        flight=np.array([0, 0]),
        unfiltered=np.zeros(2, dtype=bool),
        coefficients=np.array([[0.5, 0.25]]),
        scale=np.full((2, 1), 2.0),
        weight=np.ones((2, 1)),
    )
    # (7 - .5 x 5 - .25 x 3) / 2 and (8 - .5 x 7 - .25 x 5) / 2
    white = filter_.apply(np.array([[3.0], [5.0], [7.0], [8.0]]))
    assert white[:, 0] == pytest.approx([1.875, 1.625])


def test_means_after_a_pause_have_no_past():
    residual, flight, follows = made(count=400)
    follows[100] = False
    calm = np.zeros(flight.size, dtype=bool)
    rows = whitening_of(residual, flight, follows, calm, SPEED).rows
    assert not {0, 1, 100, 101, 200, 201} & set(rows)
    assert rows.size == 400 - 6


def test_manoeuvres_have_a_size_of_their_own_where_there_are_enough():
    residual, flight, follows = made()
    busy = np.zeros(flight.size, dtype=bool)
    busy[1000:1200] = True
    residual[busy] *= 5.0
    found = whitening_of(residual, flight, follows, busy, SPEED)
    loud = np.isin(found.rows, np.flatnonzero(busy))
    ratio = np.median(found.scale[loud]) / np.median(found.scale[~loud & (found.flight == 0)])
    assert 3.0 < ratio < 7.0
    few = np.zeros(flight.size, dtype=bool)
    few[1000 : 1000 + FEWEST - 1] = True
    assert np.unique(whitening_of(residual, flight, follows, few, SPEED).scale).size == 2


def test_one_wild_mean_counts_linearly():
    residual, flight, follows = made()
    residual[3000 + 50] += 400.0
    calm = np.zeros(flight.size, dtype=bool)
    found = whitening_of(residual, flight, follows, calm, SPEED)
    k = int(np.searchsorted(found.rows, 3050))
    plain = found.apply(residual)[k, 0] / found.weight[k, 0]
    assert found.apply(residual)[k, 0] ** 2 == pytest.approx(HUBER * abs(plain), rel=1e-6)


def of_one_mode(residual, busy=None):
    rows = len(residual)
    flight, follows = np.zeros(rows, dtype=int), np.ones(rows, dtype=bool)
    follows[0] = False
    busy = np.zeros(rows, dtype=bool) if busy is None else busy
    return whitening_of(np.asarray(residual, float)[:, None], flight, follows, busy, SPEED)


def test_no_sensor_is_better_than_a_ten_thousandth_of_the_speed():
    assert of_one_mode(np.zeros(100)).scale.max() == pytest.approx(0.2)  # of 2000 rpm


@pytest.mark.parametrize(("count", "sizes"), [(14, 1), (15, 2)])
def test_fifteen_means_of_a_manoeuvre_have_a_size_of_their_own(count, sizes):
    busy = np.zeros(200, dtype=bool)
    busy[100 : 100 + count] = True
    noise = np.random.default_rng(1).normal(size=200) * np.where(busy, 20.0, 1.0)
    assert np.unique(of_one_mode(noise, busy).scale).size == sizes


def test_a_constant_does_not_vanish():
    """A random walk has a memory of 1, of which 0.98 is kept."""
    walk = np.cumsum(np.random.default_rng(2).normal(size=4000))
    assert of_one_mode(walk).coefficients.sum() == pytest.approx(0.98, abs=1e-6)


def test_a_size_is_about_the_median_and_coefficients_have_the_doubt_of_one_mean():
    """Of 1, -1, 1, .. and 3 more: median 3 or so, each 1 from it; a1 by hand with a ridge of 1."""
    e = 3.0 + np.tile([1.0, -1.0], 20)
    found = of_one_mode(e)
    over = e / 1.4826  # the size of the two values 4 and 2 about their median of 3
    past = np.stack([over[1:-1], over[:-2]], axis=1)
    kept = np.max(np.column_stack([over[2:], past]), axis=1) < HUBER
    assert kept.all()
    by_hand = np.linalg.solve(past.T @ past + np.eye(2), past.T @ over[2:])
    by_hand *= min(1.0, 0.98 / by_hand.sum())
    np.testing.assert_allclose(found.coefficients[0], by_hand)


def test_a_flight_whose_means_rarely_follow_each_other_counts_unfiltered():
    """Of its means each fifth has two before it; noise of memory .5 is taken as wider by root 3."""
    rng = np.random.default_rng(4)
    flight = np.repeat([0, 1], 400)
    e = rng.standard_normal(800)
    for t in range(1, 800):
        e[t] = 0.5 * e[t - 1] + np.sqrt(0.75) * e[t]
    follows = np.ones(800, dtype=bool)
    follows[[0, 400]] = False
    slow = np.flatnonzero(flight == 1)
    follows[slow[slow % 5 > 1]] = False
    found = whitening_of(e[:, None], flight, follows, np.zeros(800, dtype=bool), 1.0)
    assert np.sum(found.flight == 1) == 400
    assert found.unfiltered.tolist() == (found.flight == 1).tolist()
    assert np.median(found.scale[found.unfiltered]) == pytest.approx(np.sqrt(3.0), rel=0.25)
    # Of size one before the filter, whose noise is .87 of it.
    white = found.apply(e[:, None])[:, 0]
    assert white[~found.unfiltered].std() == pytest.approx(1.0, abs=0.1)
    assert white[found.unfiltered] == pytest.approx(e[400:] / found.scale[found.unfiltered, 0])


def test_a_filter_without_any_mean_after_another_is_none():
    e = np.random.default_rng(5).standard_normal((60, 2))
    none = np.zeros(60, dtype=bool)
    found = whitening_of(e, np.zeros(60, dtype=np.intp), none, none, 1.0)
    assert not found.coefficients.any()
    assert found.rows.size == 60
    assert found.scale.min() > 0.7
