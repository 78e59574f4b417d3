"""Scatter between flights: by hand, and on flights whose scatter is known."""

import numpy as np
import pytest

from thrustmargin.models.network.records import scatter_between


def test_flights_of_like_errors_differ_by_what_their_variance_has_beyond_the_errors():
    # variance of 1, 2, 6 is 7; less the error of each flight, 4
    assert scatter_between(np.array([1.0, 2.0, 6.0]), np.full(3, 2.0)) == pytest.approx(3**0.5)
    assert scatter_between(np.array([1.0, 2.0, 6.0]), np.full(3, 3.0)) == 0.0


def test_flights_of_unlike_errors_weigh_by_them():
    # weights 1, 1, 1/4: mean 4/3, Q = 16/9 + 4/9 + 16/9, and 9/4 - (33/16)/(9/4) = 4/3
    tau = scatter_between(np.array([0.0, 2.0, 4.0]), np.array([1.0, 1.0, 2.0]))
    assert tau**2 == pytest.approx((4.0 - 2.0) / (4.0 / 3.0))


def test_one_flight_shows_no_scatter():
    assert np.isnan(scatter_between(np.array([1.0]), np.array([1.0])))


def test_where_one_flight_alone_is_known_how_they_differ_is_not():
    assert np.isnan(scatter_between(np.array([1.0, 5.0]), np.array([1e-9, 1.0])))
    assert np.isnan(scatter_between(np.array([1.0, 5.0]), np.array([1.0, np.inf])))


@pytest.mark.parametrize("true", [0.0, 1.0, 3.0])
def test_the_scatter_of_drawn_flights_is_found(true):
    rng = np.random.default_rng(1)
    errors = rng.uniform(0.5, 2.0, (400, 12))
    drawn = rng.normal(0.0, true, errors.shape) + rng.normal(0.0, errors)
    found = np.array([scatter_between(*flights) for flights in zip(drawn, errors, strict=True)])
    if true:
        assert np.sqrt(np.mean(found**2)) == pytest.approx(true, rel=0.1)
    else:
        assert np.median(found) < 0.35  # nothing beyond the errors in half of the sets
