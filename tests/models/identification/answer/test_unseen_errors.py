"""Errors of residuals by hand, of all rotors and of each."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from thrustmargin.models.identification.answer.held_out_errors import (
    HeldOutResidual,
    errors_of,
    rotor_errors,
)

MEASURED = np.array([[100.0, 200.0], [110.0, 220.0], [120.0, 240.0], [130.0, 260.0]])
RESIDUAL = np.array([[1.0, -4.0], [3.0, 4.0], [-1.0, -4.0], [5.0, 8.0]])


def problem() -> Any:
    return SimpleNamespace(
        measured_rpm=MEASURED, block=np.array([0, 0, 1, 1]), block_flight=np.array([0, 1])
    )


def test_errors_of_all_rotors_together():
    found = errors_of(problem(), RESIDUAL)
    square = 1 + 9 + 1 + 25 + 16 + 16 + 16 + 64
    assert found.rmse_rpm == pytest.approx(np.sqrt(square / 8))
    assert found.bias_rpm == pytest.approx((8 + 4) / 8)
    assert found.per_rotor_rmse_rpm == pytest.approx([3.0, np.sqrt(112 / 4)])
    # Each rotor about its own mean of 115 and 230: 225 + 25 + 25 + 225, and four times that.
    assert found.r2 == pytest.approx(1.0 - square / (500.0 + 2000.0))


@pytest.mark.parametrize("block_flight", [[0, 1], [0, 0]])
def test_an_interval_is_that_of_flights_drawn_and_blocks_drawn_in_them(block_flight):
    """Of two blocks a quarter of the draws has only the one, a quarter only the other."""
    of: Any = SimpleNamespace(**{**vars(problem()), "block_flight": np.array(block_flight)})
    low, high = errors_of(of, RESIDUAL).rmse_ci95_rpm
    first, second = (np.sqrt(np.mean(RESIDUAL[part] ** 2)) for part in (slice(2), slice(2, 4)))
    assert (low, high) == (pytest.approx(first), pytest.approx(second))


def test_each_rotor_has_its_own_errors_before_and_after():
    unseen = HeldOutResidual(
        problem=problem(), before_rpm=2 * RESIDUAL, after_rpm=RESIDUAL, role="fit"
    )
    together, *each = rotor_errors(unseen)
    assert together.rotor is None
    assert [e.rotor for e in each] == [0, 1]
    assert together.before.rmse_rpm == pytest.approx(2 * together.after.rmse_rpm)
    assert each[0].after.rmse_rpm == pytest.approx(3.0)
    assert each[1].after.bias_rpm == pytest.approx(1.0)
    assert each[1].after.r2 == pytest.approx(1.0 - 112.0 / 2000.0)
