"""Quantiles of Student's t: those of scipy, by hand where they have a short form."""

import math

import pytest
from scipy.special import stdtrit

from thrustmargin.models.student_t import t_quantile


@pytest.mark.parametrize("freedom", [1, 2, 3, 4, 5, 10, 31, 1000])
@pytest.mark.parametrize("level", [0.05, 0.6, 0.975, 0.9995])
def test_quantiles_are_those_of_scipy(freedom, level):
    assert t_quantile(freedom, level) == pytest.approx(stdtrit(freedom, level), rel=1e-9)


def test_one_and_two_degrees_by_hand():
    # Cauchy: tan(pi (p - 1/2)). Of two: (2p - 1) / sqrt(2 p (1 - p)).
    assert t_quantile(1, 0.75) == pytest.approx(1.0)
    assert t_quantile(2, 0.9) == pytest.approx(0.8 / math.sqrt(0.18))
    assert t_quantile(7, 0.5) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("freedom", "level"), [(0, 0.9), (3, 0.0), (3, 1.0), (3, math.nan)])
def test_what_is_no_quantile_is_no_number(freedom, level):
    assert math.isnan(t_quantile(freedom, level))
