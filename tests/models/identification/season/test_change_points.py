"""Change points of one value: numbers by hand, by scipy, and counted over many seasons."""

import numpy as np
import pytest
from scipy.stats import linregress, norm

from thrustmargin.models.identification.season.change_points import (
    _ConstantOrLine,
    changes,
    drawn_in,
    penalty_of,
    segments,
    spread_beyond,
    spread_of,
)

ONE = np.ones(100)


def test_the_penalty_is_bonferronis_of_all_that_is_tried():
    # 100 flights, 5 values, steps and slopes: 1,000 tests share 1 %.
    assert penalty_of(100, 5) == pytest.approx(norm.ppf(1 - 0.01 / 1000 / 2) ** 2)
    assert penalty_of(100, 5) < penalty_of(100, 50) < penalty_of(1000, 50)


def test_a_segment_is_its_weighted_mean_or_its_regression_line():
    rng = np.random.default_rng(1)
    values = np.asarray(rng.normal(0.0, 1.0, 12) + np.arange(12), dtype=np.float64)
    errors = rng.uniform(0.5, 2.0, 12)
    line = _ConstantOrLine(values, errors, 1.0).fitted(2, 11)
    slope, mean = np.polyfit(np.arange(2, 11), values[2:11], 1, w=1.0 / errors[2:11])
    assert (line.slope, line.at(0.0)) == pytest.approx((slope, mean))
    left = values[2:11] - mean - slope * np.arange(2, 11)
    assert line.squares == pytest.approx(np.sum((left / errors[2:11]) ** 2))
    assert line.cost == pytest.approx(line.squares + 1.0)
    flat = _ConstantOrLine(values, errors, 1e9).fitted(2, 11)
    assert flat.at(5) == pytest.approx(np.average(values[2:11], weights=errors[2:11] ** -2.0))
    assert flat.slope == 0.0


def test_the_error_of_a_slope_is_that_of_a_regression():
    values, errors = np.arange(20.0), np.full(20, 0.3)
    found = _ConstantOrLine(values, errors, 1.0).fitted(0, 20)
    noisy = values + 0.3 * np.random.default_rng(2).standard_normal(20)
    assert found.slope_error == pytest.approx(0.3 / np.sqrt(np.sum((np.arange(20) - 9.5) ** 2)))
    assert found.slope_error == pytest.approx(linregress(np.arange(20), noisy)[4], rel=0.5)


def test_one_cost_is_asked_for_in_two_ways_with_one_answer():
    rng = np.random.default_rng(3)
    sums = _ConstantOrLine(rng.normal(0, 1, 40) + 2.0 * np.arange(40), rng.uniform(1, 2, 40), 1.0)
    for start, end in ((0, 40), (3, 6), (3, 7), (10, 30), (35, 40), (34, 40)):
        one = sums.costs(np.array([start]), np.array([end]))[0]
        assert sums.fitted(start, end).cost == pytest.approx(one)


@pytest.mark.parametrize(("penalty", "cost"), [(9.5, 9.5), (10.5, 10.0)])
def test_a_line_is_worth_no_more_than_its_penalty(penalty, cost):
    """0 to 4 about their mean have 10 squares, of which a line takes all."""
    sums = _ConstantOrLine(np.arange(9.0), np.ones(9), penalty)
    assert sums.costs(np.array([2]), np.array([7])) == pytest.approx([cost])
    assert sums.fitted(2, 7).cost == pytest.approx(cost)


def test_a_step_is_cut_where_it_is():
    values = np.where(np.arange(100) < 37, 0.0, 3.0)
    values += np.tile([0.5, -0.5], 50)
    assert segments(values, ONE, 20.0) == [(0, 37), (37, 100)]
    (step,), curve = changes(values, ONE, 20.0)
    assert (step.ramp, step.flight, step.until) == (False, 37, 100)
    assert step.size == pytest.approx(3.0, abs=0.05)
    assert step.size_error == pytest.approx(np.sqrt(1 / 37 + 1 / 63), rel=0.01)
    assert curve[0] == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("seed", range(20))
def test_wear_is_dated_at_its_hinge_and_a_swap_ends_it(seed: int):
    rng = np.random.default_rng(seed)
    loss = np.where(np.arange(100) < 85, 0.5 * np.maximum(np.arange(100) - 49.0, 0.0), 0.0)
    wears, swap = changes(loss + rng.standard_normal(100), ONE, penalty_of(100, 20))[0]
    assert wears.ramp
    assert abs(wears.flight - 50) <= 4
    assert wears.earliest <= wears.flight <= wears.latest
    assert wears.per_flight == pytest.approx(0.5, abs=5 * wears.per_flight_error)
    assert not swap.ramp
    assert swap.flight == 85
    assert swap.size == pytest.approx(-17.5, abs=5 * swap.size_error)


def test_a_date_is_within_its_interval_as_often_as_it_says():
    inside = 0
    for seed in range(200):
        values = np.random.default_rng(seed).standard_normal(60) + 0.5 * np.maximum(
            np.arange(60) - 29.0, 0.0
        )
        first = changes(values, np.ones(60), 25.0)[0][0]
        inside += first.earliest <= 30 <= first.latest
    assert inside / 200 > 0.9


def test_seasons_without_a_change_have_no_more_entries_than_wanted():
    false = sum(
        bool(changes(np.random.default_rng(k).standard_normal(100), ONE, penalty_of(100))[0])
        for k in range(1000)
    )
    assert false <= 10 + 3 * np.sqrt(10)  # 1 %


def test_one_wild_flight_is_no_change():
    values = np.random.default_rng(4).standard_normal(100)
    values[[20, 60]] = 40.0
    assert changes(values, ONE, penalty_of(100))[0] == []
    assert drawn_in(values, ONE)[20] < 6.0


def test_a_sure_flight_among_unsure_ones_keeps_its_value():
    errors = np.where(np.arange(40) % 4 == 0, 0.1, 30.0)
    values = np.where(np.arange(40) % 4 == 0, 1.0, 20.0)
    np.testing.assert_array_equal(drawn_in(values, errors), values)


def test_scatter_beyond_the_errors_is_seen_and_less_is_not_believed():
    noise = np.random.default_rng(5).standard_normal(4000)
    assert spread_beyond(3.0 * noise, np.ones(4000)) == pytest.approx(3.0, rel=0.05)
    assert spread_beyond(0.1 * noise, np.ones(4000)) == 1.0
    assert spread_of(3.0 * noise) == pytest.approx(3.0, rel=0.05)
    assert spread_of(3.0 * noise + 0.1 * np.arange(4000)) == pytest.approx(3.0, rel=0.05)


def test_few_flights_have_no_changes():
    assert changes(np.array([0.0, 0.0, 9.0, 9.0]), np.ones(4), 10.0)[0] == []
    assert changes(np.zeros(0), np.ones(0), 10.0)[0] == []
