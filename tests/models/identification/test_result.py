"""Errors with intervals: blocks are drawn within a flight, and flights of one block as blocks."""

import numpy as np
import pytest

from tests.models.effects.test_slung_load import flown_with_load
from thrustmargin.models.identification.errors import errors_of
from thrustmargin.models.identification.problem import BLOCK_SECONDS, assemble
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

SMALL = load_airframe("crazyflie-rpm")


def interval(seconds: float, flights: int, spread: np.ndarray) -> tuple[float, float]:
    """Interval of an error whose size is `spread` (flights,) rpm in each flight."""
    tracks = [
        flown_with_load(k, mass=SMALL.empty_mass, load=0.0, cable=0.5, seconds=seconds)
        for k in range(flights)
    ]
    problem = assemble(physics_model(SMALL), tracks)
    residual = np.repeat(spread[problem.flight][:, None], 4, axis=1)
    return errors_of(problem, residual).rmse_ci95_rpm


def test_flights_of_a_single_block_give_an_interval_from_their_spread():
    low, high = interval(0.6 * BLOCK_SECONDS, 6, np.array([50.0, 60, 70, 80, 90, 100.0]))
    assert 50.0 < low < 70.0
    assert 80.0 < high < 100.0


def test_flights_that_are_alike_give_a_narrow_interval():
    low, high = interval(0.6 * BLOCK_SECONDS, 4, np.full(4, 75.0))
    assert (low, high) == pytest.approx((75.0, 75.0))
