"""Where a network may be asked, and conformal intervals of a few rows, worked out by hand."""

from typing import Any

import numpy as np
import pytest
from scipy import stats

from thrustmargin.models.network.validity import (
    Interval,
    TrainingDomain,
    calibrate,
    flights_needed,
    hierarchical_quantile,
    measure_coverage,
)

#: As the code has them, written down by hand: a change there is to be seen here.
SCATTER_FLOOR_RPM = 1.0


def one_row_flights(sizes, airspeed: Any = 3.0):
    """A flight of one row for each residual size, all at one airspeed, one rotor, no spread."""
    count = len(sizes)
    residual = np.array(sizes, dtype=float)[:, None]
    speeds = np.broadcast_to(np.asarray(airspeed, dtype=float), (count,)).copy()
    return residual, np.zeros((count, 1)), speeds, np.arange(count)


def test_the_half_width_by_hand():
    interval = Interval(
        coverage=0.9, flights=9, airspeed=(0.0, 2.0), scatter_rpm=((3.0,), (9.0,)), factor=(2.0,)
    )
    # At 1 m/s the scatter is half way, 6; a spread of 8/z makes sqrt(6² + 8²) = 10, times 2.
    z = stats.norm.ppf(0.95)
    assert interval.half_width_rpm(np.array([1.0]), np.array([[8.0 / z]])) == pytest.approx(20.0)
    # Without spread: 0.5 m/s is a quarter of the way, 4.5; beyond the ends the ends hold.
    airspeed = np.array([0.5, 1.5, -1.0, 0.0, 2.0, 9.0])
    half = interval.half_width_rpm(airspeed, np.zeros((6, 1)))[:, 0]
    np.testing.assert_allclose(half, 2.0 * np.array([4.5, 7.5, 3.0, 3.0, 9.0, 9.0]))


def test_each_rotor_has_its_own_scatter_and_factor():
    interval = Interval(
        coverage=0.5,
        flights=3,
        airspeed=(0.0, 1.0, 2.0),
        scatter_rpm=((1.0, 10.0), (3.0, 10.0), (7.0, 40.0)),
        factor=(1.0, 0.5),
    )
    half = interval.half_width_rpm(np.array([1.5, 1.0]), np.zeros((2, 2)))
    np.testing.assert_allclose(half, [[5.0, 12.5], [3.0, 5.0]])


def test_the_quantile_needs_no_order_of_rows_or_labels():
    # Three flights of one row weigh 1/4 each: 1/4, 1/2 and 3/4 are reached at 1, 2 and 3.
    scores, flight = np.array([3.0, 1.0, 2.0]), np.array([5, 9, 7])
    for level, by_hand in ((0.25, 1.0), (0.26, 2.0), (0.5, 2.0), (0.75, 3.0), (0.76, np.inf)):
        assert hierarchical_quantile(scores, flight, level) == by_hand


@pytest.mark.parametrize(("coverage", "needed"), [(0.9, 9), (0.95, 19), (0.5, 1), (0.67, 3)])
def test_flights_needed_is_where_the_quantile_becomes_finite(coverage, needed):
    # K/(K+1) >= coverage, so K >= coverage/(1 - coverage)
    assert flights_needed(coverage) == needed
    for flights in (needed, needed - 1):
        scores = np.arange(float(flights))
        found = hierarchical_quantile(scores, np.arange(flights), coverage)
        assert np.isfinite(found) == (flights == needed)


def test_a_calibration_of_nine_flights_by_hand():
    # Sizes 10 .. 90: the 0.9 quantile of nine equal weights is the ninth, 90, at both knots;
    # scores 1/9 .. 9/9, each flight weighs 1/10, so 0.9 is reached by the last: factor 1.
    interval = calibrate(*one_row_flights(range(10, 100, 10)), coverage=0.9)
    assert interval.airspeed == (3.0, 3.0)
    assert interval.scatter_rpm == ((90.0,), (90.0,))
    assert interval.factor == pytest.approx((1.0,))
    assert interval.flights == 9
    # 0.8: seven of nine weights are 0.78 and eight 0.89, so 80; eight tenths at score 80/80.
    assert calibrate(*one_row_flights(range(10, 100, 10)), coverage=0.8).scatter_rpm[0] == (80.0,)


def test_a_factor_is_above_one_where_small_scores_of_the_spread_hide_the_scatter():
    # All residuals 10 with the sign of the row: the scatter is 10. Spread 10/z makes each scale
    # sqrt(10² + 10²), so that every score, and the factor, is 1/sqrt(2).
    residual, spread, airspeed, flight = one_row_flights([10.0, -10.0] * 5)
    spread += 10.0 / stats.norm.ppf(0.95)
    interval = calibrate(residual, spread, airspeed, flight, coverage=0.9)
    assert interval.scatter_rpm[0] == (10.0,)
    assert interval.factor == pytest.approx((np.sqrt(0.5),))


def test_no_scatter_is_below_what_a_sensor_can_tell():
    interval = calibrate(*one_row_flights([0.0] * 9), coverage=0.9)
    assert interval.scatter_rpm[0] == (SCATTER_FLOOR_RPM,) == (1.0,)


def test_knots_are_half_a_metre_a_second_apart():
    residual, spread, airspeed, flight = one_row_flights([5.0] * 7, np.arange(7) * 0.5 + 1.0)
    interval = calibrate(residual, spread, airspeed, flight, coverage=0.5)
    assert interval.airspeed == pytest.approx((1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0))


@pytest.mark.parametrize(("coverage", "low"), [(0.62, 10.0), (0.63, 20.0)])
def test_like_airspeeds_weigh_by_a_normal_curve_of_half_a_metre_a_second(coverage, low):
    # Seen from 0 m/s the flight at 0.5 m/s weighs exp(-1/2) = 0.6065: of 1.6065 in all, the smaller
    # residual has 0.6225. Seen from 0.5 m/s it has 0.3775.
    interval = calibrate(*one_row_flights([10.0, 20.0], [0.0, 0.5]), coverage=coverage)
    assert interval.airspeed == (0.0, 0.5)
    assert interval.scatter_rpm == ((low,), (20.0,))


def test_a_long_flight_weighs_as_much_as_a_short_one():
    # 100 rows of size 1 in one flight, one row each of sizes 2 .. 10 in nine: 0.55 of ten flights
    # is reached by the sixth, of size 6.
    residual, spread, airspeed, _ = one_row_flights([1.0] * 100 + list(range(2, 11)))
    flight = np.concatenate([np.zeros(100, dtype=int), np.arange(1, 10)])
    interval = calibrate(residual, spread, airspeed, flight, coverage=0.55)
    assert interval.scatter_rpm[0] == (6.0,)


def test_coverage_of_two_flights_measured_by_hand():
    # On 10 alone the interval is 10 wide each way and 20 lies outside; on 20 alone 10 lies inside.
    measured = measure_coverage(*one_row_flights([10.0, 20.0]), coverage=0.5)
    assert measured is not None
    assert measured.per_flight == (1.0, 0.0)
    assert measured.per_rotor == (0.5,)
    assert measured.mean == 0.5
    assert measured.width_rpm == pytest.approx((2 * 20.0 + 2 * 10.0) / 2)
    assert measure_coverage(*one_row_flights([10.0]), coverage=0.5) is None


def test_coverage_is_told_for_each_rotor_and_each_flight():
    residual, _, airspeed, flight = one_row_flights([10.0, 20.0, 15.0])
    residual = np.hstack([residual, 5.0 * np.ones((3, 1))])  # rotor 2 is always inside
    measured = measure_coverage(residual, np.zeros((3, 2)), airspeed, flight, coverage=0.5)
    assert measured is not None
    # Two flights of weights 1/3: 0.5 is reached by the larger of the two.
    assert measured.per_rotor == pytest.approx((2.0 / 3.0, 1.0))
    assert measured.per_flight == (1.0, 0.5, 1.0)
    assert measured.mean == pytest.approx(5.0 / 6.0)
    widths = [(2 * 20 + 2 * 5) / 2, (2 * 15 + 2 * 5) / 2, (2 * 20 + 2 * 5) / 2]
    assert measured.width_rpm == pytest.approx(np.mean(widths))


NAN = float("nan")
DOMAIN = TrainingDomain(
    airspeed=(2.0, 6.0),
    tank_kg=(4.0, 16.0),
    density=(1.0, 1.2),
    height_agl=(NAN, NAN),
    wind_speed=(NAN, NAN),
    flights=("one",),
)


def test_a_quarter_of_a_metre_a_second_and_of_a_kilogram_beyond_are_covered():
    airspeed = np.array([1.75, 1.74, 6.25, 6.26, 4.0, NAN, 4.0, 4.0, 4.0, 4.0, 4.0])
    tank = np.array([9.0, 9.0, 9.0, 9.0, 9.0, 9.0, 3.75, 3.74, 16.25, 16.26, NAN])
    expected = [True, False, True, False, True, False, True, False, True, False, False]
    assert DOMAIN.covers_inputs(airspeed, tank).tolist() == expected
    assert DOMAIN.covers(airspeed, tank, np.full(11, 1.1)).tolist() == expected


def test_two_percent_of_density_beyond_are_covered():
    # 2 % of the upper limit, 1.2, is 0.024 at either end.
    density = np.array([0.977, 0.975, 1.223, 1.225, 1.1, NAN])
    inside = DOMAIN.covers(np.full(6, 4.0), np.full(6, 9.0), density)
    assert inside.tolist() == [True, False, True, False, True, False]
