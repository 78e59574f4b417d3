"""Left-out errors, intervals and chance on small linear problems, worked out by hand."""

from typing import Any

import numpy as np
import pytest
from scipy import stats

from thrustmargin.models.effects.base import Parameter
from thrustmargin.models.identification.cross_validation import (
    difference_is_uncertain,
    held_out_cost,
    intervals,
    left_out_values,
)
from thrustmargin.models.identification.fit import Fit, Statistics
from thrustmargin.models.identification.problem import Background
from thrustmargin.models.identification.terms import FitLayout


def parameter(**given) -> Parameter:
    usual: dict[str, Any] = {"absent": 0.0, "start": 0.0, "lower": -1e6, "upper": 1e6, "scale": 1.0}
    return Parameter(name="p", unit="1", **(usual | given))


def statistics(owner, gradient, hessian, cost, *, per_flight=False, prior=0.0) -> Statistics:
    """One parameter: sums of j e, j² and e² of every block."""
    owner, flights = np.array(owner), max(owner) + 1
    size = flights if per_flight else 1
    places = np.arange(flights)[:, None] % size
    layout = FitLayout(parameters=(parameter(per_flight=per_flight),), places=places, size=size)
    return Statistics(
        layout=layout,
        owner=owner,
        hessian=np.array(hessian, dtype=float)[:, None, None],
        gradient=np.array(gradient, dtype=float)[:, None],
        cost=np.array(cost, dtype=float),
        prior=np.full(size, prior),
        pull=np.zeros(size),
    )


def fitted(s: Statistics, value: float = 0.0, **given) -> Fit:
    """A fit with these statistics, one row a block."""
    blocks = s.owner.size
    layout = FitLayout(parameters=(parameter(**given),), places=s.layout.places, size=s.layout.size)
    return Fit(
        terms=(),
        layout=layout,
        values=np.full(layout.size, value),
        residual_rpm=np.zeros((blocks, 1)),
        whitened=np.zeros((blocks, 1)),
        jacobian=np.sqrt(s.hessian),
        prediction_rpm=np.zeros((blocks, 1)),
        statistics=s,
        block=np.arange(blocks),
        scales=np.ones(1),
        converged=True,
    )


def cost_under(value: float, gradient: float, hessian: float, cost: float) -> float:
    """Sum of (e - j value)²."""
    return cost - 2.0 * value * gradient + value**2 * hessian


def test_a_flight_is_scored_under_the_value_that_the_other_flights_give_alone():
    g, h, c = [6.0, 2.0, 20.0], [2.0, 2.0, 5.0], [30.0, 40.0, 90.0]
    s = statistics([0, 1, 2], g, h, c)
    others = [(2.0 + 20.0) / 7.0, (6.0 + 20.0) / 7.0, (6.0 + 2.0) / 4.0]
    assert [values[0] for _, values in left_out_values(s)] == pytest.approx(others)
    assert held_out_cost(s) == pytest.approx(
        [cost_under(v, *block) for v, block in zip(others, zip(g, h, c, strict=True), strict=True)]
    )


def test_a_flight_left_out_can_hold_anything_without_a_change_of_its_own_value():
    wild = statistics([0, 1, 2], [1e6, 2.0, 4.0], [1.0, 1.0, 1.0], [1e12, 9.0, 25.0])
    assert left_out_values(wild)[0][1] == pytest.approx([3.0])


def test_all_blocks_of_a_flight_are_left_out_together():
    s = statistics([0, 0, 1, 1], [6.0, 8.0, 1.0, 3.0], [1.0] * 4, [99.0] * 4)
    for blocks, values in left_out_values(s):
        assert values == pytest.approx([2.0 if blocks[0] < 2 else 7.0])


def test_of_a_single_flight_every_fifth_is_left_out_whole():
    g = np.arange(10.0)
    s = statistics([0] * 10, g, [1.0] * 10, [100.0] * 10)
    found = left_out_values(s)
    assert [blocks.tolist() for blocks, _ in found] == [[2 * k, 2 * k + 1] for k in range(5)]
    for blocks, values in found:
        assert values == pytest.approx([np.delete(g, blocks).mean()])


def test_a_value_of_one_flight_comes_from_its_other_blocks():
    g = [1.0, 10.0, 3.0, 30.0, 5.0, 50.0]
    s = statistics([0, 0, 0, 0, 1, 1], g, [1.0] * 6, [0.0] * 6, per_flight=True, prior=1e-12)
    expected = np.empty(6)
    expected[[0, 2]] = [cost_under(20.0, g[b], 1.0, 0.0) for b in (0, 2)]  # mean of 10 and 30
    expected[[1, 3]] = [cost_under(2.0, g[b], 1.0, 0.0) for b in (1, 3)]
    expected[4], expected[5] = cost_under(50.0, 5.0, 1.0, 0.0), cost_under(5.0, 50.0, 1.0, 0.0)
    assert held_out_cost(s) == pytest.approx(expected)


def test_a_prior_holds_the_value_back():
    s = statistics([0, 1], [4.0, 6.0], [1.0, 1.0], [0.0, 0.0], prior=1.0)
    assert [values[0] for _, values in left_out_values(s)] == pytest.approx([3.0, 2.0])


def test_other_residuals_are_judged_on_the_same_derivatives():
    s = statistics([0, 1, 2], [6.0, 2.0, 20.0], [2.0, 2.0, 5.0], [30.0, 40.0, 90.0])
    twice = held_out_cost(s, 2.0 * s.gradient[:, :, None], 4.0 * s.cost[:, None])
    assert twice[:, 0] == pytest.approx(4.0 * held_out_cost(s))


@pytest.mark.parametrize("blocks", [2, 6, 21])
def test_an_interval_from_blocks_has_half_as_many_degrees_of_freedom_as_blocks(blocks):
    g = np.where(np.arange(blocks) % 2, 3.0, -3.0)
    s = statistics([0] * blocks, g, [4.0] * blocks, [10.0] * blocks)
    # Sandwich: sum of g² over (sum of j²)², with blocks / (blocks - 1) for the mean taken.
    variance = 9.0 * blocks / (4.0 * blocks) ** 2 * blocks / (blocks - 1)
    half = stats.t(max(2, blocks // 2)).ppf(0.975) * np.sqrt(variance)
    found = intervals(fitted(s, 7.0))
    assert found.covariance[0, 0] == pytest.approx(variance)
    assert (found.lower[0], found.upper[0]) == pytest.approx((7.0 - half, 7.0 + half))


def test_flights_that_disagree_widen_the_interval_with_one_degree_of_freedom_less_than_flights():
    owner, g = [0, 0, 1, 1, 2, 2], [2.0, 2.0, -1.0, -1.0, -1.0, -1.0]
    s = statistics(owner, g, [1.0] * 6, [9.0] * 6)
    by_block, by_flight = 12.0 / 36.0 * 6 / 5, (16.0 + 4.0 + 4.0) / 36.0 * 3 / 2
    assert by_flight > by_block
    found = intervals(fitted(s))
    assert found.upper[0] == pytest.approx(stats.t(2).ppf(0.975) * np.sqrt(by_flight))
    told_from_nothing = intervals(fitted(s), few=False)
    assert told_from_nothing.upper[0] == pytest.approx(stats.t(3).ppf(0.975) * np.sqrt(by_flight))


def test_flights_that_agree_leave_the_interval_of_blocks():
    s = statistics([0, 0, 1, 1, 2, 2], [2.0, -2.0] * 3, [1.0] * 6, [9.0] * 6)
    half = stats.t(3).ppf(0.975) * np.sqrt(24.0 / 36.0 * 6 / 5)
    assert intervals(fitted(s)).upper[0] == pytest.approx(half)


def test_what_the_base_model_does_not_know_is_added_in_squares_and_no_block_teaches_it():
    s = statistics([0, 0, 1, 1], [1.0, -1.0, 1.0, -1.0], [4.0] * 4, [9.0] * 4)
    # Each row moves by 0.5 of its own in each flight: per flight 2 rows of j = 2.
    background = Background(constant=np.array([0.5]), directions=np.zeros((0, 4, 1)))
    own = 2 * (2 * 2.0 * 0.5) ** 2 / 16.0**2
    alone = stats.t(2).ppf(0.975) ** 2 * 4.0 / 16.0**2 * 4 / 3
    found = intervals(fitted(s), background)
    assert found.upper[0] ** 2 == pytest.approx(alone + stats.norm.ppf(0.975) ** 2 * own)
    # The same sign in all flights, as a member of an ensemble has it: 4 rows add up.
    shared = Background(constant=np.zeros(1), directions=np.full((1, 4, 1), 0.5))
    found = intervals(fitted(s), shared)
    own = (4 * 2.0 * 0.5) ** 2 / 16.0**2
    assert found.upper[0] ** 2 == pytest.approx(alone + stats.norm.ppf(0.975) ** 2 * own)


def test_an_interval_is_never_finer_than_the_parameter_can_be():
    s = statistics([0] * 4, [0.0] * 4, [4.0] * 4, [0.0] * 4)
    found = intervals(fitted(s, 10.0, resolution=0.3, accuracy=0.01))
    assert (found.lower[0], found.upper[0]) == pytest.approx((9.6, 10.4))


def test_a_difference_is_uncertain_within_two_standard_errors_of_blocks_or_of_flights():
    first, owner = np.zeros(8), np.zeros(8, dtype=np.intp)
    gap = np.tile([1.0, 3.0], 4)  # sum 16, standard error sqrt(8) * 1.069 = 3.02
    assert not difference_is_uncertain(first, gap, owner)
    assert difference_is_uncertain(first, gap - 1.5, owner)  # sum 4
    # Four flights of which one has it all: its scatter counts, though halved.
    assert difference_is_uncertain(first, np.repeat([16.0, 0, 0, 0], 2), np.repeat(range(4), 2))
