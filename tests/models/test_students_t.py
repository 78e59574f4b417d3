"""Student's t beside printed tables and scipy."""

import math

import pytest
from scipy.special import stdtrit

from thrustmargin.models.students_t import t_quantile

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
