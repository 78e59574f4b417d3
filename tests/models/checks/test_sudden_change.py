"""Every step of the likelihood ratio against values by hand, dense algebra or simulation."""

import math

import numpy as np
import pytest
from scipy.stats import norm

from thrustmargin.models.checks.sudden_change import (
    Prior,
    SuddenChange,
    log_likelihood,
    log_own,
)

#: As the code has them, written down by hand: a change there is to be seen here.
MEMORY = 300.0
SELDOM = 60.0
SETTLE = 2
WINDOW = 10.0
SIZES = (0.01, 0.03, 0.1, 0.3, 1.0)

BLOCK = 0.7
NOTHING = np.zeros((2, 0))


def watch(trim=0.0, noise=0.01, inputs=(), signals=2, **given) -> SuddenChange:
    prior = Prior(
        trim=np.full(signals, trim),
        noise=np.full(signals, noise),
        inputs=np.tile(inputs, (signals, 1)).reshape(signals, len(inputs)),
        **given,
    )
    return SuddenChange(prior, BLOCK)


def frozen(**given) -> SuddenChange:
    """As `watch`, with a noise that is known and does not follow the data."""
    test = watch(**given)
    test._keep, test._blocks = 1.0 - 1e-12, 10**12
    return test


def run(test: SuddenChange, values: np.ndarray, inputs=None) -> None:
    for row, u in zip(
        values, inputs if inputs is not None else [NOTHING] * len(values), strict=True
    ):
        test.add(row, u)


@pytest.mark.parametrize("width", [0.0, 0.03, 0.5])
def test_the_likelihood_of_a_change_is_that_of_two_normal_densities(width):
    # A = 100, B = 20: one measurement of 0.2 with a standard error of 0.1.
    step = 0.25
    value = log_likelihood(np.array(100.0), np.array(20.0), np.array(step), np.array(width))
    by_hand = norm.logpdf(0.2, step, math.hypot(0.1, width)) - norm.logpdf(0.2, 0.0, 0.1)
    assert float(value) == pytest.approx(by_hand, abs=1e-12)


def test_a_change_of_any_size_is_the_mean_over_the_sizes():
    expected = np.mean([norm.pdf(0.2, 0.0, math.hypot(0.1, s)) for s in SIZES])
    found = log_own(np.array([100.0]), np.array([20.0]))
    assert found[0] == pytest.approx(math.log(expected / norm.pdf(0.2, 0.0, 0.1)), abs=1e-12)


def test_the_two_sums_are_those_of_generalised_least_squares():
    """Trim of standard deviation 0.05, noise of autocorrelation 0.5: by one dense covariance."""
    test = frozen(trim=0.05, noise=0.02)
    y = np.random.default_rng(1).normal(0.1, 0.03, (9, 2))
    run(test, y)
    t = np.arange(9)
    covariance = 0.05**2 + 0.02**2 / 0.75 * 0.5 ** abs(t[:, None] - t)
    seen = slice(SETTLE, None)
    inverse = np.linalg.inv(covariance[seen, seen])
    assert test._sums[0][1] == pytest.approx(inverse.sum())
    assert test._sums[1][1] == pytest.approx(inverse.sum(axis=0) @ y[seen])
    assert test._sums[2][1] == pytest.approx(np.einsum("im,ij,jm->m", y[seen], inverse, y[seen]))


def test_a_start_in_flight_is_sought_against_all_that_came_before_it():
    """The same with the start at block 6: before it no change, two blocks not seen, then all."""
    test = frozen(noise=0.02)
    y = np.random.default_rng(2).normal(0.0, 0.03, (12, 2))
    run(test, y)
    t = np.arange(12)
    covariance = 1.0 + 0.02**2 / 0.75 * 0.5 ** abs(t[:, None] - t)
    seen = np.r_[0:6, 6 + SETTLE : 12]
    inverse = np.linalg.inv(covariance[np.ix_(seen, seen)])
    step = (seen >= 6).astype(float)
    which = int(np.flatnonzero(test._age == 6)[-1])
    assert test._sums[0][which] == pytest.approx(step @ inverse @ step)
    assert test._sums[1][which] == pytest.approx(step @ inverse @ y[seen])


def test_the_noise_is_learnt_white_or_not():
    rng = np.random.default_rng(3)
    y = np.zeros((600, 2))
    for k in range(1, 600):
        y[k] = [0.0, 0.8] * y[k - 1] + rng.normal(0.0, 0.02, 2)
    test = watch()
    run(test, y)
    assert test.lag == pytest.approx([0.0, 0.8], abs=0.12)
    assert np.sqrt(test.noise) == pytest.approx([0.02, 0.02], rel=0.12)


def test_a_standing_trim_that_was_not_known_is_not_taken_for_slow_noise():
    test = watch(trim=0.0)
    run(test, np.random.default_rng(10).normal(0.1, 0.01, (300, 2)))
    assert test.lag == pytest.approx([0.0, 0.0], abs=0.15)
    assert np.sqrt(test.noise) == pytest.approx([0.01, 0.01], rel=0.12)


def test_one_odd_block_teaches_no_more_than_three_standard_errors():
    test = watch()
    run(test, np.zeros((20, 2)))
    before = test.noise.copy()
    test.add(np.array([0.5, 0.0]), NOTHING)
    # The 21st block counts for 1/22: at most a factor of 1 + 8/22.
    assert test.noise[0] / before[0] == pytest.approx(1.0 + 8.0 / 22.0)
    assert test.noise[1] < before[1]


def test_what_a_turn_needs_is_learnt_and_forgotten_again():
    test = watch(inputs=(0.2,))
    rng = np.random.default_rng(4)
    turns = rng.normal(0.0, 1.0, 80)
    run(test, np.outer(0.1 * turns, [1, 1]), [np.full((2, 1), u) for u in turns])
    learnt = test.means[2, 0].copy()
    assert learnt == pytest.approx([0.1, 0.1], abs=0.01)
    run(test, np.zeros((100, 2)), [np.zeros((2, 1))] * 100)
    assert test.means[2, 0] == pytest.approx(learnt * math.exp(-100 * BLOCK / MEMORY), rel=1e-4)


def test_changes_are_counted_by_the_age_at_which_they_show():
    test = watch()
    rng = np.random.default_rng(5)
    y = rng.normal(0.0, 0.01, (400, 2))
    y[:, 0] += 0.3 * (np.arange(400) // 25 % 2)  # one signal jumps every 25 blocks
    run(test, y)
    last = round(WINDOW / BLOCK) - 1
    assert test._q[last, 0] > 5.0 * test._q[last, 1]
    assert test._q[last, 1] < BLOCK / SELDOM
    assert test._q[last, -1] < 0.1


def test_what_may_be_a_part_is_not_counted():
    test, other = watch(), watch()
    rng = np.random.default_rng(6)
    for k in range(60):
        y = rng.normal(0.0, 0.01, 2) + 0.3 * (k > 30)
        test.add(y, NOTHING, 1.0)
        other.add(y, NOTHING, 0.0)
    assert np.all(other._q[:-1, :-1] == BLOCK / SELDOM)
    assert np.any(test._q[:-1, :-1] != BLOCK / SELDOM)


def test_one_signal_alone_gives_no_more_than_the_bound():
    """However large the jump of one signal: a part must show in all."""
    ratios = []
    for jump in (0.1, 1.0):
        test = watch()
        rng = np.random.default_rng(7)
        for k in range(90):
            test.add(rng.normal(0.0, 0.01, 2) + np.array([jump * (k >= 80), 0.0]), NOTHING)
        found = test.change(np.array([[jump, jump]]), np.full((1, 2), 0.01), -50.0)
        assert found is not None
        ratios.append(found.log_ratio)
    assert max(ratios) < 3.0
    both = watch()
    rng = np.random.default_rng(7)
    for k in range(90):
        both.add(rng.normal(0.0, 0.01, 2) + 0.1 * (k >= 80), NOTHING)
    found = both.change(np.array([[0.1, 0.1], [0.1, -0.1]]), np.full((2, 2), 0.01), 0.0)
    assert found is not None
    assert found.log_ratio > 5.0
    assert found.share[0] > 0.999


def test_the_ratio_is_the_formula_by_plain_numbers():
    test = watch()
    for _ in range(10):
        test.add(np.zeros(2), NOTHING)
    a, b = np.array([400.0, 900.0]), np.array([40.0, -9.0])
    test._sums[:] = 0.0
    test._sums[0][2], test._sums[1][2], test._age[2] = a, b, 9
    test._q[8] = 0.2, 0.1, 0.05
    test._weigh()
    steps = np.array([[0.1, 0.0], [0.1, 0.1]])
    own = np.exp(log_own(a, b))
    q = np.array([0.2, 0.1])
    each = [np.prod((1 - q) * np.exp(b * d - a * d**2 / 2) + q * own) for d in steps]
    none = 0.95 * np.prod(1 - q + q * own) + 0.05 * np.prod((1 + own) / 2)
    found = test.change(steps, np.zeros((2, 2)), -50.0)
    assert found is not None
    assert found.log_ratio == pytest.approx(math.log(np.mean(each) / none))
    assert found.share == pytest.approx(np.array(each) / np.sum(each))


def test_under_the_noise_a_ratio_of_a_is_passed_by_less_than_one_start_in_a():
    """Ville's inequality: counted over 40 flights of noise, each with some 30 starts."""
    steps = np.array([[0.03, 0.03], [0.03, -0.03], [-0.02, 0.02]])
    rng = np.random.default_rng(8)
    starts, passed = 0, {2.0: 0, 8.0: 0}
    for _ in range(40):
        test, highest = watch(), 0.0
        for k in range(70):
            test.add(rng.normal(0.0, 0.01, 2), NOTHING)
            found = test.change(steps, np.zeros(steps.shape), 0.0)
            highest = max(highest, found.log_ratio if found else 0.0)
            starts += k % SETTLE == 0
        for a in passed:
            passed[a] += highest > math.log(a)
    for a, count in passed.items():
        assert count < starts / a


def test_a_change_that_is_known_is_marginalised():
    """After `settle` the same level is no news, and the way back is."""
    test = watch()
    rng = np.random.default_rng(9)
    for _ in range(60):
        test.add(rng.normal(0.0, 0.01, 2), NOTHING)
    for _ in range(10):
        test.add(rng.normal(0.1, 0.01, 2), NOTHING)
    step = np.array([[0.1, 0.1]])
    found = test.change(step, np.full((1, 2), 0.003), 0.0)
    assert found is not None
    test.settle(found.filter, step[0])
    quiet = []
    for _ in range(30):
        test.add(rng.normal(0.1, 0.01, 2) - step[0], NOTHING)
        quiet.append(test.change(-step, np.full((1, 2), 0.003), 1.0))
    assert all(found is None or found.log_ratio < 0.0 for found in quiet)
    for _ in range(8):
        test.add(rng.normal(0.0, 0.01, 2) - step[0], NOTHING)
    back = test.change(-step, np.full((1, 2), 0.003), 1.0)
    assert back is not None
    assert back.log_ratio > 3.0


def test_after_a_change_was_marginalised_the_filter_is_as_if_there_had_been_none():
    values = np.random.default_rng(3).normal(0.0, 0.01, (28, 2))
    step = np.array([0.2, -0.1])
    sound, changed = frozen(trim=0.1), frozen(trim=0.1)
    run(sound, values)
    run(changed, values + (np.arange(28) >= 20)[:, None] * step)
    (which,) = np.flatnonzero(changed._age == 8)  # that began with the change
    assert not np.allclose(changed.means[:, which], sound.means[:, which])
    changed.settle(int(which), step)
    np.testing.assert_allclose(changed.means[:, 0], sound.means[:, which], atol=1e-9)


def test_what_good_flights_showed_makes_a_start_that_is_off_less_likely():
    for given, share in (({}, 0.5), ({"flights": 3}, 0.125)):
        np.testing.assert_allclose(watch(**given)._q[-1], share)


def test_no_hypothesis_passes_what_the_bound_of_all_hypotheses_leaves_out():
    test, draw = watch(), np.random.default_rng(11)
    run(test, draw.normal(0.0, 0.1, (80, 2)) + (np.arange(80)[:, None] >= 40) * [0.3, -0.2])
    a, b = test._sums[0][1:], test._sums[1][1:]
    # Of each start the likeliest steps, exactly: nothing can be likelier.
    steps, none = b / np.maximum(a, 1e-300), np.zeros((1, 2))
    found = [test.change(row[None], none, -np.inf) for row in steps]
    best = max(change.log_ratio for change in found if change is not None)
    likeliest = steps[[int(np.argmax([c.log_ratio for c in found if c is not None]))]]
    assert best > 5.0
    assert test.change(likeliest, none, best + 1e-6) is None
    change = test.change(likeliest, none, best - 1e-6)
    assert change is not None
    assert change.log_ratio == pytest.approx(best)


def test_the_start_of_a_change_is_the_same_whether_or_not_the_others_are_weighed():
    test, draw = watch(), np.random.default_rng(12)
    step = np.array([[0.3, -0.2]])
    run(test, draw.normal(0.0, 0.01, (60, 2)) + (np.arange(60) >= 52)[:, None] * step)
    every = test.change(step, np.zeros((1, 2)), -np.inf)
    assert every is not None
    alone = test.change(step, np.zeros((1, 2)), every.log_ratio - 1e-6)
    assert alone is not None
    assert alone.filter == every.filter > 1
    assert (every.log_ratio, every.share) == (alone.log_ratio, alone.share)
