"""Slopes and means of channels: polynomials worked out by hand, and what gaps do."""

import numpy as np
import pytest

from thrustmargin.models.physics.smoothing import (
    derivative,
    known_median,
    median_of_five,
    moving_mean,
    row_step,
    running_mean,
)

STEP = 0.1


def times(rows: int, step: float = STEP) -> np.ndarray:
    return np.arange(rows) * step


def test_the_slope_of_a_parabola_is_exact_and_unknown_at_the_ends():
    t = times(41)
    slope = derivative(t, 3.0 * t**2 - 2.0 * t + 1.0, 1.0)
    # One second at ten rows a second is a window of 11 rows, five on each side; one more is left
    # out at each end.
    np.testing.assert_allclose(slope[6:-6], 6.0 * t[6:-6] - 2.0, rtol=1e-9, atol=1e-9)
    assert np.isnan(slope[:6]).all()
    assert np.isnan(slope[-6:]).all()


@pytest.mark.parametrize(("span", "side"), [(1.0, 5), (0.5, 2), (0.65, 3), (0.01, 1)])
def test_the_window_is_that_of_the_span(span, side):
    # A line fitted to t³ over rows -m..m of step h has the slope h² sum(k⁴)/sum(k²) at the middle:
    # m = 5: 1958/110 h² = 17.8 h², m = 2: 34/10 h² = 3.4 h², m = 3: 196/28 h² = 7 h², m = 1: h².
    by_hand = {5: 17.8, 2: 3.4, 3: 7.0, 1: 1.0}[side] * STEP**2
    t = times(61) - 3.0
    assert derivative(t, t**3, span)[30] == pytest.approx(by_hand, rel=1e-9)


@pytest.mark.parametrize("rate", [400.0, 30.0, 10.0, 2.5])
def test_a_slope_is_right_at_any_rate(rate: float):
    t = times(50, 1.0 / rate)
    assert row_step(t) == pytest.approx(1.0 / rate, rel=2e-4)
    np.testing.assert_allclose(derivative(t, 5.0 * t, 8.0 / rate)[10:40], 5.0, rtol=2e-4)


def test_a_step_that_jitters_by_a_millionth_has_the_same_window():
    for off in (-2e-7, 0.0, 2e-7):
        t = times(61, STEP + off)
        assert row_step(t) == STEP
        # Window of 11 rows, as above: 17.8 h² at the middle of t³.
        assert derivative(t, (t - t[30]) ** 3, 1.0)[30] == pytest.approx(0.178, rel=1e-4)


def test_each_column_has_its_own_slope():
    t = times(30)
    slope = derivative(t, np.stack([t, -2.0 * t, 0.0 * t], axis=1), 0.5)[10]
    np.testing.assert_allclose(slope, [1.0, -2.0, 0.0], atol=1e-12)


def test_no_slope_is_read_across_a_gap():
    t = times(60)
    t[30:] += 2.0 * STEP
    slope = derivative(t, np.where(np.arange(60) < 30, 0.0, 100.0), 1.0)
    known = np.flatnonzero(np.isfinite(slope))
    # The window of row r is r-5..r+5: rows 25..34 see both sides. One more is left out each way.
    np.testing.assert_array_equal(known, [*range(6, 23), *range(36, 54)])
    np.testing.assert_allclose(slope[known], 0.0, atol=1e-9)


@pytest.mark.parametrize("rows", [2, 57])
def test_a_gap_at_either_end_does_not_fail(rows):
    t = times(60)
    t[rows:] += 2.0 * STEP
    known = np.flatnonzero(np.isfinite(derivative(t, t.copy(), 1.0)))
    # A gap behind row g takes rows g-6 .. g+6, the ends take six.
    np.testing.assert_array_equal(known, range(8, 54) if rows == 2 else range(6, 50))


@pytest.mark.parametrize(("gap", "is_gap"), [(0.4, False), (0.6, True)])
def test_a_gap_is_more_than_half_a_step(gap, is_gap):
    t = times(40)
    t[20:] += gap * STEP
    assert np.isnan(derivative(t, t.copy(), 0.5)[20]) == is_gap


@pytest.mark.parametrize("rows", [0, 1, 8])
def test_fewer_than_nine_rows_have_no_slope(rows):
    slope = derivative(times(rows), np.ones((rows, 3)), 0.3)
    assert slope.shape == (rows, 3)
    assert np.isnan(slope).all()


def test_nine_rows_have_one():
    t = times(9)
    slope = derivative(t, 4.0 * t, 0.3)  # window of 3 rows, two left out at each end
    np.testing.assert_allclose(slope[2:-2], 4.0)
    assert np.isnan(slope[[0, 1, 7, 8]]).all()


@pytest.mark.parametrize("rows", [9, 10, 11, 12])
def test_a_span_longer_than_the_flight_gives_nothing_and_does_not_fail(rows):
    assert np.isnan(derivative(times(rows), times(rows), 100.0)).all()


@pytest.mark.parametrize("rows", [9, 11, 13, 15, 17])
def test_a_window_as_long_as_the_flight_leaves_no_row(rows):
    t = np.arange(rows) / 10
    assert np.isnan(derivative(t, 4.0 * t, (rows - 0.5) / 10)).all()
    # Two rows fewer leave the middle one: of 11 rows, five and five are left out at the ends.
    shorter = derivative(t, 4.0 * t, (rows - 2.5) / 10)
    np.testing.assert_allclose(shorter[np.isfinite(shorter)], 4.0)
    assert np.flatnonzero(np.isfinite(shorter)).tolist() == [rows // 2]


def test_a_mean_over_three_rows_by_hand():
    # 0.3 s of rows 0.1 s apart are three rows; at the ends two are there.
    mean = moving_mean(times(5), np.array([3.0, 6.0, 0.0, 9.0, 1.0]), 0.3)
    np.testing.assert_allclose(mean, [4.5, 3.0, 5.0, 10.0 / 3.0, 5.0])


def test_a_mean_is_of_what_is_known():
    nan = np.nan
    values = np.array([2.0, nan, nan, nan, 5.0, nan, 1.0])
    mean = moving_mean(times(7), values, 0.3)
    np.testing.assert_allclose(mean, [2.0, 2.0, nan, 5.0, 5.0, 3.0, 1.0])


def test_a_span_below_one_row_changes_nothing():
    values = np.array([2.0, np.nan, 7.0])
    np.testing.assert_allclose(moving_mean(times(3), values, 0.01), values)
    np.testing.assert_allclose(moving_mean(times(1), values[:1], 9.0), values[:1])


def test_a_long_gap_does_not_widen_the_rows_of_a_mean():
    t = times(9)
    t[8] += 50.0
    np.testing.assert_allclose(moving_mean(t, np.arange(9.0), 0.3)[4], 4.0)


def test_two_rows_have_a_mean():
    np.testing.assert_allclose(moving_mean(times(2), np.array([1.0, 3.0]), 0.3), [2.0, 2.0])


@pytest.mark.parametrize("width", [3, 4, 7])
def test_a_mean_is_that_of_each_window_by_itself(width):
    """Of an even number of rows there is one more before than after."""
    rng = np.random.default_rng(width)
    values = np.where(rng.random(400) < 0.3, rng.normal(size=400), np.nan)
    by_hand = np.full(400, np.nan)
    for row in range(400):
        window = values[max(row - width // 2, 0) : row + (width + 1) // 2]
        if np.isfinite(window).any():
            by_hand[row] = np.nanmean(window)
    np.testing.assert_allclose(moving_mean(times(400), values, width / 10), by_hand, atol=1e-9)


@pytest.mark.parametrize("shape", [(1,), (2,), (7,), (40, 4)])
def test_a_median_is_that_of_what_is_known(shape):
    values = np.random.default_rng(5).normal(size=shape)
    assert known_median(values) == np.median(values)
    values.flat[0] = np.nan
    expected = np.nanmedian(values) if values.size > 1 else np.nan
    assert known_median(values) == pytest.approx(expected, nan_ok=True)


@pytest.mark.parametrize("width", [1, 2, 5, 51])
@pytest.mark.parametrize("beyond", ["symmetric", "edge", "constant"])
def test_a_running_mean_has_the_ends_that_are_asked_for(width, beyond):
    values = np.random.default_rng(width).normal(size=(30, 2)) * 1e7
    sides = [(width // 2, (width - 1) // 2), (0, 0)]
    longer = np.pad(values, sides, beyond)
    by_hand = [longer[row : row + width].mean(axis=0) for row in range(30)]
    np.testing.assert_allclose(running_mean(values, width, padding=beyond), by_hand, rtol=1e-9)


def test_nothing_has_no_running_mean():
    assert running_mean(np.empty((0, 3)), 5).shape == (0, 3)


def test_a_median_of_five_by_hand():
    # At the ends 4 and 6 stand for what is beyond: 4 4 4 1 9, 4 4 1 9 2 and 1 9 2 6 6, 9 2 6 6 6.
    assert median_of_five(np.array([4.0, 1.0, 9.0, 2.0, 6.0])).tolist() == [4, 4, 4, 6, 6]


def test_a_median_of_five_is_that_of_each_window():
    values = np.random.default_rng(1).integers(0, 9, 4000).astype(float)
    middle = [np.median(values[row - 2 : row + 3]) for row in range(2, 3998)]
    np.testing.assert_array_equal(median_of_five(values)[2:-2], middle)
