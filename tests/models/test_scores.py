"""Figures of agreement and their intervals: worked out by hand, by scipy, and by their coverage."""

import math

import numpy as np
import pytest
from scipy import stats
from scipy.special import stdtrit

from thrustmargin.models.scores import (
    N,
    bias,
    by_block,
    by_flight,
    by_moving_block,
    coverage,
    error_terms,
    estimate,
    mean_r2,
    percentiles,
    r2,
    rmse,
    score,
    t_quantile,
)

#: As the code has them, written down by hand: a change there is to be seen here.
FEWEST_BLOCKS = 5
INSIDE = 5

NAN = float("nan")
# Errors 3, -4, 0, 5: squares 50; measured about 105: -5, -5, 5, 5: squares 100.
MEASURED = np.array([[100.0], [100.0], [110.0], [110.0]])
PREDICTED = np.array([[97.0], [104.0], [110.0], [105.0]])


def test_the_figures_are_those_worked_out_by_hand():
    whole = error_terms(MEASURED, PREDICTED).sum(axis=0)
    assert rmse(whole) == pytest.approx([np.sqrt(12.5)])
    assert bias(whole) == pytest.approx([1.0])
    assert r2(whole) == pytest.approx([0.5])


def test_coverage_counts_the_ends_of_an_interval_and_only_rows_that_have_one():
    lower, upper = PREDICTED - 4.0, PREDICTED + np.array([[3.0, 4.0, 4.0, NAN]]).T
    whole = error_terms(MEASURED, PREDICTED, lower=lower, upper=upper).sum(axis=0)
    assert coverage(whole) == pytest.approx([1.0])  # 3 at the upper, -4 at the lower end, 0
    whole = error_terms(MEASURED, PREDICTED, lower=lower + 0.1, upper=upper).sum(axis=0)
    assert coverage(whole) == pytest.approx([2 / 3])


def test_rows_that_are_missing_or_do_not_count_change_nothing():
    measured = np.vstack([MEASURED, [[NAN]], [[500.0]], [[500.0]]])
    predicted = np.vstack([PREDICTED, [[1.0]], [[NAN]], [[1.0]]])
    rows = np.array([True] * 6 + [False])
    more = error_terms(measured, predicted, rows=rows).sum(axis=0)
    assert more == pytest.approx(error_terms(MEASURED, PREDICTED).sum(axis=0))


def test_r2_is_the_square_of_the_correlation_for_a_least_squares_line():
    rng = np.random.default_rng(0)
    x = rng.normal(size=50)
    y = 1900.0 + 40.0 * x + rng.normal(0.0, 30.0, 50)
    slope, intercept = np.polyfit(x, y, 1)
    whole = error_terms(y[:, None], (intercept + slope * x)[:, None]).sum(axis=0)
    assert r2(whole) == pytest.approx([np.corrcoef(x, y)[0, 1] ** 2])


def test_the_overall_r2_is_the_mean_of_the_rotors_that_have_one():
    measured = np.hstack([MEASURED, MEASURED, np.full((4, 1), 7.0)])
    predicted = np.hstack([PREDICTED, MEASURED, np.full((4, 1), 7.0)])
    whole = error_terms(measured, predicted).sum(axis=0)
    assert np.isnan(r2(whole)[2])
    assert mean_r2(whole) == pytest.approx(0.75)
    found = score(measured[:, :2], predicted[:, :2], np.arange(4))
    assert found.r2 == pytest.approx(0.75)
    assert found.rmse_rpm == pytest.approx(2.5)
    assert found.bias_per_rotor_rpm == pytest.approx((1.0, 0.0))
    assert (found.rows, found.flights) == (4, 4)


def test_nothing_measured_has_no_figures():
    found = score(np.full((3, 2), NAN), np.ones((3, 2)), np.arange(3))
    assert np.isnan([found.r2, found.rmse_rpm, *found.bias_per_rotor_rpm]).all()
    assert score(np.empty((0, 2)), np.empty((0, 2)), np.empty(0)).rows == 0


def test_flights_are_drawn_whole():
    terms = error_terms(np.repeat([1.0, 10.0, 100.0], 5)[:, None], np.zeros((15, 1)))
    drawn = by_flight(terms, np.repeat([7, 3, 5], 5), seed=1)[:, 0]
    assert set(drawn[:, N]) == {15.0}
    # 5 errors a flight: sums of ones, tens and hundreds that are multiples of 5, three in all.
    counts = np.stack([drawn[:, 1] / 5 // 10**k % 10 for k in range(3)])
    assert np.all(counts.sum(axis=0) == 3)
    expected = 2000 * np.array([8, 12, 6, 1]) / 27  # binomial of 3 draws at 1/3
    drawn_often = np.bincount(counts[0].astype(int), minlength=4)
    assert np.abs(drawn_often - expected).max() < 4.0 * np.sqrt(expected.max())


def test_blocks_are_drawn_within_their_flight_and_lone_ones_among_themselves():
    owner = np.array([0, 0, 1, 2])
    terms = np.array([[1.0], [2.0], [100.0], [1000.0]])
    drawn = by_block(terms, np.arange(4), owner)[:, 0]
    first, rest = drawn % 100, drawn - drawn % 100
    assert set(first) == {2.0, 3.0, 4.0}
    assert set(rest) == {200.0, 1100.0, 2000.0}


def test_a_moving_block_is_a_stretch_of_time_and_too_few_say_nothing():
    time_s = np.arange(100.0)
    terms = np.zeros((100, 1, 7))
    terms[:, 0, N], terms[:, 0, INSIDE] = 1.0, np.arange(100)
    drawn, blocks = by_moving_block(terms, time_s, block_s=10.0, draws=50)
    assert blocks == 9
    assert np.all(drawn[:, 0, N] == 90.0)
    # Ten rows in order that begin at k sum to 10 k + 45.
    assert np.all((drawn[:, 0, INSIDE] - 9 * 45) % 10 == 0)
    few, blocks = by_moving_block(terms, time_s, block_s=99.0 / (FEWEST_BLOCKS - 0.5))
    assert blocks == FEWEST_BLOCKS - 1
    assert np.isnan(few).all()


def test_percentiles_leave_out_a_fortieth_at_each_end():
    assert percentiles(np.arange(1001.0)) == pytest.approx((25.0, 975.0))


def test_an_interval_is_students_t_with_one_degree_of_freedom_less_than_blocks():
    whole = error_terms(MEASURED, PREDICTED).sum(axis=0)[0]
    drawn = np.tile(whole, (200, 1))
    drawn[:, 1] += np.where(np.arange(200) % 2, 2.0, -2.0)  # bias +- 0.5
    found = estimate(bias, whole, drawn, 6)
    half = stats.t(5).ppf(0.975) * 0.5 * np.sqrt(6 / 5)
    assert (found.value, found.low, found.high) == pytest.approx((1.0, 1.0 - half, 1.0 + half))
    assert np.isnan(estimate(bias, whole, drawn, FEWEST_BLOCKS - 1).low)


def test_intervals_stay_where_the_figure_can_be():
    whole = error_terms(MEASURED, PREDICTED, lower=PREDICTED - 3, upper=PREDICTED + 6).sum(axis=0)[
        0
    ]
    drawn = whole * np.random.default_rng(0).uniform(0.2, 1.0, (200, 7))
    assert estimate(rmse, whole, drawn, 5).low > 0.0
    assert estimate(r2, whole, drawn, 5).high < 1.0
    covered = estimate(coverage, whole, drawn, 5)
    assert (covered.low, covered.high) == (0.0, 1.0)


def test_the_interval_of_r2_holds_the_value_and_narrows_with_flights():
    rng = np.random.default_rng(8)
    widths = []
    for flights in (6, 60):
        flight = np.repeat(np.arange(flights), 40)
        truth = rng.normal(1900, 100, flights)[flight][:, None]
        predicted = truth + rng.normal(0, 40, flights)[flight][:, None]
        found = score(truth, predicted, flight, seed=0)
        low, high = found.r2_ci95
        assert low <= found.r2 <= high
        widths.append(high - low)
    assert widths[1] < 0.6 * widths[0]
    assert np.isnan(score(truth[:80], predicted[:80], flight[:80], seed=0).r2_ci95).all()


#: Fisher and Yates, table III: degrees, two-sided level, t.
PRINTED = [(1, 0.975, 12.706), (2, 0.975, 4.303), (5, 0.95, 2.015), (30, 0.995, 2.750)]


@pytest.mark.parametrize(("degrees", "level", "t"), PRINTED)
def test_a_quantile_is_that_of_the_table(degrees, level, t):
    assert t_quantile(degrees, level) == pytest.approx(t, abs=5e-4)


@pytest.mark.parametrize("degrees", [1, 2, 3, 4, 9, 50, 333])
@pytest.mark.parametrize("level", [0.5, 0.6, 0.9, 0.975, 0.9995])
def test_a_quantile_is_that_of_scipy(degrees, level):
    assert t_quantile(degrees, level) == pytest.approx(stdtrit(degrees, level), rel=1e-9, abs=1e-15)


def test_without_a_degree_of_freedom_there_is_none():
    assert math.isnan(t_quantile(0, 0.9))
