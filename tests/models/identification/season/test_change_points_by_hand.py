"""Changes of a value against weighted least squares with every cut and every bend tried."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import curve_fit
from scipy.stats import norm

from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.season.change_points import (
    SeasonEntry,
    changes,
    clip_outliers,
    fit_hinge,
    penalty_of,
    recount_flights,
    scatter_of,
    segments,
    spread_beyond,
    spread_of,
)

QUARTILE = norm.ppf(0.75)
DATED = 1.959964**2  # chi-squared of one value, 95 %


def squares(values: Floats, errors: Floats, *columns: Floats) -> float:
    """What weighted least squares on columns leaves."""
    wide = np.stack(columns, axis=1) / errors[:, None]
    left = values / errors - wide @ np.linalg.lstsq(wide, values / errors)[0]
    return float(left @ left)


def piece_cost(values: Floats, errors: Floats, penalty: float) -> float:
    """Of one segment: a constant, or from five flights on a line where that is worth a penalty."""
    one = np.ones(values.size)
    constant = squares(values, errors, one)
    if values.size < 5:
        return constant
    line = squares(values, errors, one, np.arange(values.size, dtype=np.float64))
    return min(constant, line + penalty)


def every_cut(size: int, cuts: int) -> list[tuple[int, ...]]:
    """All places of so many cuts with three flights between them."""
    if not cuts:
        return [(0, size)]
    return [
        (*rest[:-1], at, size)
        for at in range(3, size - 2)
        for rest in every_cut(at, cuts - 1)
        if all(b - a >= 3 for a, b in pairwise((*rest[:-1], at, size)))
    ]


def made(shape: Callable[[Floats], Floats], size: int, seed: int = 0) -> tuple[Floats, Floats]:
    """A curve with noise, each flight of another error."""
    rng = np.random.default_rng(seed)
    errors = rng.uniform(0.2, 0.5, size)
    t = np.arange(size, dtype=np.float64)
    return shape(t) + errors * rng.standard_normal(size), errors


SHAPES: dict[str, Callable[[Floats], Floats]] = {
    "step": lambda t: np.where(t < 9, 0.0, 2.0),
    "small step": lambda t: np.where(t < 9, 0.0, 0.7),
    "there and back": lambda t: np.where((t < 7) | (t >= 15), 0.0, 2.0),
    "wear": lambda t: 0.4 * np.maximum(t - 8.0, 0.0),
    "wear from the start": lambda t: 0.4 * t,
    "wear and swap": lambda t: np.where(t < 15, 0.4 * np.maximum(t - 5.0, 0.0), 0.0),
    "step and wear": lambda t: np.where(t < 9, 0.0, 3.0 + 0.5 * (t - 9.0)),
    "wear that gets worse": lambda t: 0.3 * t + 0.8 * np.maximum(t - 11.0, 0.0),
}


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", SHAPES)
def test_no_other_segments_cost_less(name, seed):
    values, errors = made(SHAPES[name], 22, seed)
    values = clip_outliers(values, errors)

    def cost(ends) -> float:
        parts = [piece_cost(values[a:b], errors[a:b], 9.0) for a, b in ends]
        return sum(parts) + 9.0 * (len(parts) - 1)

    best = min(cost(list(pairwise(cut))) for n in range(3) for cut in every_cut(22, n))
    assert cost(segments(values, errors, 9.0)) == pytest.approx(best)


def entries(name: str, seed: int = 0) -> tuple[list[SeasonEntry], Floats, Floats, list]:
    values, errors = made(SHAPES[name], 22, seed)
    drawn = clip_outliers(values, errors)
    return changes(values, errors, 9.0)[0], drawn, errors, segments(drawn, errors, 9.0)


def line_of(values: Floats, errors: Floats, start: int, end: int) -> tuple[Floats, Floats]:
    """Of a segment by scipy: value at its middle and slope, and their covariance."""
    t, w = np.arange(start, end, dtype=np.float64), errors[start:end] ** -2.0
    about = t - np.sum(w * t) / w.sum()
    return curve_fit(
        lambda x, a, b: a + b * x,
        about,
        values[start:end],
        sigma=errors[start:end],
        absolute_sigma=True,
    )


@pytest.mark.parametrize("name", ["step", "small step"])
@pytest.mark.parametrize("seed", [0, 1, 2, 10])
def test_a_step_is_between_two_means_and_dated_by_the_cuts_that_are_nearly_as_good(name, seed):
    (step,), values, errors, parts = entries(name, seed)
    at = parts[1][0]
    assert parts == [(0, at), (at, 22)]
    assert (step.ramp, step.flight, step.until) == (False, at, 22)
    w = errors**-2.0
    before, after = (np.average(values[a:b], weights=w[a:b]) for a, b in parts)
    assert (step.before, step.after) == (pytest.approx(before), pytest.approx(after))
    error = np.sqrt(sum(1.0 / w[a:b].sum() for a, b in parts))
    assert step.size_error == pytest.approx(error)
    assert step.score == pytest.approx(abs(after - before) / error)
    assert (step.per_flight, step.per_flight_error) == (0.0, 0.0)
    costs = {
        cut: piece_cost(values[:cut], errors[:cut], 0.0)
        + piece_cost(values[cut:], errors[cut:], 0.0)
        for cut in range(3, 20)
    }
    good = [cut for cut in costs if costs[cut] <= min(costs.values()) + DATED]
    assert (step.earliest, step.latest) == (min(at, good[0]), max(at, good[-1]))


@pytest.mark.parametrize(("name", "seed"), [("wear", 0), ("wear", 4), ("wear that gets worse", 2)])
def test_wear_begins_where_two_lines_meet_best(name, seed):
    found, values, errors, parts = entries(name, seed)
    assert len(parts) == 2
    ramp, cut = found[-1], parts[1][0]
    t = np.arange(22.0)
    own = [t] if name != "wear" else []  # what was flat before stays flat before
    costs = {
        bend: squares(values, errors, np.ones(22), np.maximum(t - bend, 0.0), *own)
        for bend in range(1, 20)
    }
    best = min(costs, key=lambda bend: costs[bend])
    good = [bend for bend in costs if costs[bend] <= costs[best] + DATED]
    assert ramp.ramp
    assert (ramp.flight, ramp.earliest, ramp.latest) == (best + 1, good[0] + 1, good[-1] + 1)
    (middle, slope), covariance = line_of(values, errors, cut, 22)
    error = np.sqrt(covariance[1, 1])
    assert (ramp.per_flight, ramp.per_flight_error) == pytest.approx((slope, error))
    assert ramp.score == pytest.approx(slope / error)
    assert ramp.size_error == pytest.approx(error * (22 - cut))
    w = errors[cut:] ** -2.0
    at_end = middle + slope * (21.0 - np.sum(w * t[cut:]) / w.sum())
    assert ramp.after == pytest.approx(at_end)
    assert ramp.until == 22
    if name == "wear":
        assert ramp.before == pytest.approx(np.average(values[:cut], weights=errors[:cut] ** -2.0))
    else:  # what went on before is an entry of its own, from the first flight on
        first = found[0]
        assert (first.flight, first.earliest, first.latest, first.until) == (0, 0, 0, cut)
        assert ramp.before == pytest.approx(first.after)


@pytest.mark.parametrize("line", [True, False])
def test_a_bend_may_be_from_the_second_flight_to_the_last_but_two(line):
    """Of what does not bend any date is as good: the first flight after it is the third to the
    last but one."""
    straight = 2.0 + 0.3 * line * np.arange(20.0)
    left, dates = fit_hinge(straight, np.full(20, 0.5), 4, 16, line=line)
    assert (left, dates[1:]) == (pytest.approx(0.0, abs=1e-9), (6, 14))


def test_wear_from_the_first_flight_on_is_one_line():
    (ramp,), values, errors, parts = entries("wear from the start")
    assert parts == [(0, 22)]
    (middle, slope), covariance = line_of(values, errors, 0, 22)
    w = errors**-2.0
    about = np.sum(w * np.arange(22.0)) / w.sum()
    assert ramp.before == pytest.approx(middle - slope * about)
    assert ramp.after == pytest.approx(middle + slope * (21.0 - about))
    assert ramp.per_flight_error == pytest.approx(np.sqrt(covariance[1, 1]))
    assert (ramp.flight, ramp.earliest, ramp.latest, ramp.until) == (0, 0, 0, 22)


def test_a_step_from_which_on_it_wears_is_two_entries():
    (step, ramp), values, errors, parts = entries("step and wear")
    (start, end) = parts[1]
    assert (start, end) == (9, 22)
    (middle, slope), covariance = line_of(values, errors, 9, 22)
    w = errors[9:] ** -2.0
    off = 9.0 - np.sum(w * np.arange(9.0, 22.0)) / w.sum()
    assert (step.ramp, ramp.ramp) == (False, True)
    assert step.after == ramp.before == pytest.approx(middle + slope * off)
    of_line = covariance[0, 0] + covariance[1, 1] * off**2
    assert step.size_error == pytest.approx(np.sqrt(of_line + 1.0 / np.sum(errors[:9] ** -2.0)))
    assert (ramp.flight, ramp.earliest, ramp.latest) == (9, 9, 9)


def test_a_swap_after_wear_is_as_sure_as_the_mean_after_and_the_line_on_the_flight_before():
    (_, swap), values, errors, parts = entries("wear and swap", 2)
    (began, cut), (_, end) = parts[-2:]
    (_, _), covariance = line_of(values, errors, began, cut)
    w = errors**-2.0
    off = cut - 1.0 - np.average(np.arange(began, cut), weights=w[began:cut])
    before = covariance[0, 0] + covariance[1, 1] * off**2
    assert swap.size_error == pytest.approx(np.sqrt(before + 1.0 / w[cut:end].sum()))


def test_a_cut_and_a_slope_must_each_be_worth_the_penalty():
    """Six flights at 0 and six at 1 with errors of 0.5: a step takes 12, a line less."""
    values, errors = np.repeat([0.0, 1.0], 6), np.full(12, 0.5)
    assert len(changes(values, errors, 11.9)[0]) == 1
    assert changes(values, errors, 12.1)[0] == []
    ramp = 0.5 * np.arange(5.0)  # of five flights; a slope takes 10 x 0.25 / 0.25
    assert changes(np.append(ramp, 2.5), errors[:6], 1e-6)[0][0].ramp
    t = np.arange(12.0)
    assert len(changes(0.1 * t, errors, 5.7)[0]) == 1  # 143 x 0.01 / 0.25 = 5.72
    assert changes(0.1 * t, errors, 5.74)[0] == []


def test_six_flights_are_enough_for_a_step_and_five_are_not():
    (step,), curve = changes(np.repeat([0.0, 9.0], 3), np.ones(6), 10.0)
    assert (step.flight, step.earliest, step.latest) == (3, 3, 3)
    np.testing.assert_allclose(curve, np.repeat([0.0, 9.0], 3))
    found, curve = changes(np.array([0.0, 0.0, 9.0, 9.0, 9.0]), np.ones(5), 10.0)
    assert found == []
    np.testing.assert_allclose(curve, 5.4)
    assert changes(np.zeros(0), np.ones(0), 10.0)[1].size == 0


def test_a_line_takes_five_flights():
    values = np.array([0.0, 0.0, 0.0, 50.0, 51.0, 52.0, 53.0, 54.0])
    (step,), _ = changes(values[:7], np.full(7, 0.1), 10.0)
    assert (step.flight, step.after) == (3, pytest.approx(51.5))
    step, ramp = changes(values, np.full(8, 0.1), 10.0)[0]
    assert (step.after, ramp.per_flight) == (pytest.approx(50.0), pytest.approx(1.0))


def test_flights_scatter_by_the_median_of_second_differences():
    values = np.array([0.0, 1.0, 0.0, 3.0, 0.0, 2.0, 7.0])
    # -2, 4, -6, 5 and 3: the median of their sizes is 4.
    assert spread_of(values) == pytest.approx(4.0 / QUARTILE / np.sqrt(6.0))
    np.testing.assert_allclose(scatter_of(values), np.full(7, 4.0 / QUARTILE / np.sqrt(6.0)))
    assert spread_of(values[:2]) == 0.0
    np.testing.assert_array_equal(scatter_of(np.ones(4)), np.full(4, 1e-12))
    errors = np.array([1.0, 0.5, 0.5, 0.2, 0.1, 0.4, 0.3])
    each = [
        abs(d) / np.sqrt(errors[k] ** 2 + 4 * errors[k + 1] ** 2 + errors[k + 2] ** 2)
        for k, d in enumerate([-2.0, 4.0, -6.0, 5.0, 3.0])
    ]
    assert spread_beyond(values, errors) == pytest.approx(sorted(each)[2] / QUARTILE)
    assert spread_beyond(values[:4], errors[:4]) == 1.0
    assert spread_beyond(values[:5], errors[:5]) == pytest.approx(sorted(each[:3])[1] / QUARTILE)
    for seed in range(9):
        values = np.random.default_rng(seed).normal(size=5)
        errors = np.random.default_rng(seed + 9).uniform(0.02, 0.2, 5)
        of = [np.sqrt(errors[k : k + 3] ** 2 @ [1.0, 4.0, 1.0]) for k in range(3)]
        middle = sorted(np.abs(np.diff(values, 2)) / of)[1]
        assert spread_beyond(values, errors) == pytest.approx(middle / QUARTILE)


def test_a_wild_flight_is_drawn_in_to_three_errors_of_its_neighbours_median():
    values = np.array([0.0, 1.0, 2.0, 90.0, 3.0, 4.0, -50.0])
    errors = np.array([1.0, 1.0, 1.0, 2.0, 1.0, 1.0, 3.0])
    # About 90 the median is 3 and the errors' 1; at the end, which repeats itself, -50 and 3.
    by_hand = values.copy()
    by_hand[3] = 3.0 + 3.0 * np.hypot(2.0, 1.0)
    by_hand[4] = 3.0
    np.testing.assert_allclose(clip_outliers(values, errors)[:6], by_hand[:6])


def test_an_entry_of_some_flights_is_counted_over_all():
    entry = SeasonEntry(
        ramp=False,
        flight=2,
        earliest=1,
        latest=3,
        until=4,
        before=0.0,
        after=1.0,
        size_error=0.1,
        per_flight=0.0,
        per_flight_error=0.0,
        score=10.0,
    )
    found = recount_flights(entry, np.array([3, 5, 6, 9]))
    assert (found.flight, found.earliest, found.latest, found.until) == (6, 5, 9, 10)


@pytest.mark.parametrize(("flights", "series"), [(1, 1), (40, 7)])
def test_a_penalty_is_bonferronis_of_steps_and_slopes(flights, series):
    two_sided = 0.01 / (2 * flights * series)
    assert penalty_of(flights, series) == pytest.approx(norm.ppf(1.0 - two_sided / 2.0) ** 2)
    assert penalty_of(flights, series, 0.05) == pytest.approx(
        norm.ppf(1.0 - 5.0 * two_sided / 2.0) ** 2
    )
    assert penalty_of(0, 0) == penalty_of(1) == penalty_of(1, 1)
