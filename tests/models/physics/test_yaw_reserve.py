"""Yaw authority that is left: by hand on a quad, and against a linear program on other layouts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from thrustmargin.models.physics.airframe import Airframe, load_airframe
from thrustmargin.models.physics.margin import mixer, yaw_reserve

F16 = load_airframe("topxgun-f16-sitl")
SPIN = F16.rotor_spin


def by_program(craft: Airframe, thrust: np.ndarray) -> float:
    """The same share by a program for either direction."""
    kept = mixer(craft)[:3]
    bounds = [(0.0, float(e)) for e in craft.rotor_effectiveness]
    ends = [
        linprog(-way * craft.rotor_spin, A_eq=kept, b_eq=kept @ thrust, bounds=bounds)
        for way in (1.0, -1.0)
    ]
    yaw = craft.rotor_spin @ thrust
    left = [-end.fun - way * yaw for end, way in zip(ends, (1.0, -1.0), strict=True)]
    return float(np.clip(2.0 * min(left) / sum(left), 0.0, 1.0))


def test_an_even_hover_has_all_of_it():
    assert yaw_reserve(F16, np.full((3, 4), 0.5)) == pytest.approx(np.ones(3))


@pytest.mark.parametrize(("use", "authority"), [(0.5, 0.5), (0.25, 0.25), (0.75, 0.25)])
def test_a_standing_moment_takes_its_share(use: float, authority: float):
    # Each pair can go up to its ceiling and down to 0, whichever is nearer.
    thrust = use + 0.1 * SPIN
    assert yaw_reserve(F16, thrust[None])[0] == pytest.approx(1.0 - 0.1 / authority, abs=1e-6)


def test_a_rotor_at_its_ceiling_leaves_none_on_one_side():
    full = np.where(SPIN > 0, 1.0, 0.6)
    assert yaw_reserve(F16, full[None])[0] == pytest.approx(0.0, abs=1e-6)
    assert yaw_reserve(F16, np.ones((1, 4)))[0] == 0.0


def test_an_unknown_rotor_is_unknown():
    thrust = np.full((2, 4), 0.5)
    thrust[1, 2] = np.nan
    reserve = yaw_reserve(F16, thrust)
    assert reserve[0] == pytest.approx(1.0)
    assert np.isnan(reserve[1])


@pytest.mark.parametrize("name", ["topxgun-f16", "agras-t20", "agras-t40"])
def test_it_is_that_of_a_linear_program(name: str):
    craft = load_airframe(name)
    rng = np.random.default_rng(3)
    thrust = rng.uniform(0.3, 0.8, (6, craft.rotor_count)) * craft.rotor_effectiveness
    expected = [by_program(craft, row) for row in thrust]
    assert yaw_reserve(craft, thrust) == pytest.approx(np.array(expected), abs=1e-5)
