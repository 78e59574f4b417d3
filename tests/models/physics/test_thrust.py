"""Thrust curve: the paper's printed numbers, and the laws that hold for any propeller."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from thrustmargin.models.errors import DataError
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.physics.thrust import (
    blade_coefficient,
    dimensionless_coefficient,
    fit_thrust_curve,
    load_matching,
    speed_from_thrust,
    thrust_coefficient_range,
    thrust_from_speed,
)

PROPELLER_36115 = {"pitch": 0.292, "diameter": 0.914, "blades": 2}
#: As the paper prints them below equation 3.
COEFFICIENT_RANGES = {
    "aspect_ratio": (5.0, 8.0),
    "downwash_correction": (0.85, 0.95),
    "blade_area_correction": (0.7, 0.9),
    "mean_radius_ratio": (0.4, 0.7),
    "zero_lift_angle": (-np.pi / 36.0, 0.0),
}


def table7_points():
    """21 bench points made so that their one-parameter fit has the statistics of Table 7."""
    square = np.linspace(0.0, 3150.0, 21) ** 2
    noise = np.random.default_rng(7).normal(size=21)
    noise -= square * (square @ noise) / (square @ square)
    noise *= np.sqrt(31.0007 / (noise @ noise))
    return np.sqrt(square), 2.011e-5 * square + noise


def test_fit_has_the_statistics_of_table_7():
    fit = fit_thrust_curve(*table7_points())
    assert fit.coefficient == pytest.approx(2.011e-5, rel=1e-9)
    assert fit.sse == pytest.approx(31.0007, rel=1e-9)
    assert round(fit.r2, 4) == 0.9996
    assert round(fit.rmse, 4) == 1.2450
    assert fit.points == 21


def test_a_fit_of_three_points_by_hand():
    # N² = 1, 4, 9 (10⁶ rpm²) and T = 2, 9, 19 N: a = (2 + 36 + 171)/(1 + 16 + 81) = 209/98,
    # residuals 2 - 209/98 = -13/98, 9 - 836/98 = 46/98, 19 - 1881/98 = -19/98:
    # SSE = (169 + 2116 + 361)/98² = 2646/9604 = 0.2755102; mean 10, SST = 64 + 1 + 81 = 146.
    fit = fit_thrust_curve([1000.0, 2000.0, 3000.0], [2.0, 9.0, 19.0])
    assert fit.coefficient == pytest.approx(209.0 / 98.0 * 1e-6)
    assert fit.sse == pytest.approx(0.2755102)
    assert fit.r2 == pytest.approx(1.0 - 0.2755102 / 146.0)
    assert fit.rmse == pytest.approx(np.sqrt(0.2755102 / 2.0))
    assert fit.points == 3


def test_two_speeds_are_enough_and_equal_thrusts_have_no_r2():
    fit = fit_thrust_curve([1000.0, 2000.0], [5.0, 5.0])
    assert fit.coefficient == pytest.approx(25.0 / 17.0 * 1e-6)  # (5 + 20)/(1 + 16)
    assert np.isnan(fit.r2)


def test_thrust_and_speed_by_hand():
    assert thrust_from_speed(2000.0, coefficient=2e-5) == pytest.approx(80.0)
    assert speed_from_thrust(80.0, coefficient=2e-5) == pytest.approx(2000.0)
    thin = {"coefficient": 2e-5, "density": 0.9, "reference_density": 1.2}
    assert thrust_from_speed(2000.0, **thin) == pytest.approx(60.0)
    assert speed_from_thrust(60.0, **thin) == pytest.approx(2000.0)
    assert speed_from_thrust(0.0, coefficient=2e-5) == 0.0


def test_the_dimensionless_coefficient_by_hand():
    # C_T = a 3600/(rho D⁴) = 2e-5 x 3600/(1.2 x 0.5⁴) = 0.072/0.075 = 0.96
    assert dimensionless_coefficient(2e-5, density=1.2, diameter=0.5) == pytest.approx(0.96)


def test_fit_leaves_out_points_without_a_number():
    speed, thrust = table7_points()
    with_gap = fit_thrust_curve(np.append(speed, 2500.0), np.append(thrust, np.nan))
    assert with_gap == fit_thrust_curve(speed, thrust)


def test_fit_minimises_the_squared_error():
    speed, thrust = table7_points()
    fit = fit_thrust_curve(speed, thrust)
    for other in (fit.coefficient * 0.999, fit.coefficient * 1.001):
        assert np.sum((thrust - other * speed**2) ** 2) > fit.sse


@pytest.mark.parametrize(
    ("speed", "thrust", "message"),
    [
        ([1000.0], [20.0], "at least two different speeds"),
        ([1000.0, 1000.0], [20.0, 21.0], "at least two different speeds"),
        ([np.nan, 1000.0, 2000.0], [1.0, 20.0, np.nan], "1 usable bench points"),
        ([1000.0, 2000.0], [20.0], "one thrust for each rotor speed"),
    ],
)
def test_too_few_bench_points_are_refused(speed, thrust, message):
    with pytest.raises(DataError, match=message):
        fit_thrust_curve(speed, thrust)


def test_equation_3_range_of_the_papers_propeller():
    # By hand: 0.25 pi^3 x 2 x 6.11 = 94.72; atan(0.292/(0.914 pi)) = 0.10134 rad;
    # least  0.7 x 0.4^2 x 94.72 x 0.85 x 0.10134 / (8 pi + 6.11) = 0.02925
    # most   0.9 x 0.7^2 x 94.72 x (0.95 x 0.10134 + pi/36) / (5 pi + 6.11) = 0.35141
    low, high = thrust_coefficient_range(**PROPELLER_36115)
    assert low == pytest.approx(0.02925, abs=1e-5)
    assert high == pytest.approx(0.35141, abs=2e-5)


@given(st.tuples(*(st.floats(0.0, 1.0) for _ in COEFFICIENT_RANGES)))
def test_no_point_of_the_printed_ranges_lies_outside_equation_3s_range(shares):
    inside = {
        name: low + share * (high - low)
        for share, (name, (low, high)) in zip(shares, COEFFICIENT_RANGES.items(), strict=True)
    }
    low, high = thrust_coefficient_range(**PROPELLER_36115)
    value = blade_coefficient(**PROPELLER_36115, **inside)
    assert low - 1e-12 <= value <= high + 1e-12


def test_fitted_coefficient_of_the_f16_lies_in_equation_3s_range():
    fitted = dimensionless_coefficient(2.011e-5, density=1.1934, diameter=0.914)
    low, high = thrust_coefficient_range(**PROPELLER_36115)
    assert fitted == pytest.approx(0.0869, abs=5e-5)
    assert low < fitted < high


def test_equation_1_is_the_curve_with_the_dimensionless_coefficient():
    c_t = dimensionless_coefficient(2.011e-5, density=1.1934, diameter=0.914)
    by_eq1 = c_t * 1.1934 * (2127.0 / 60.0) ** 2 * 0.914**4
    assert thrust_from_speed(2127.0, coefficient=2.011e-5) == pytest.approx(by_eq1)


@given(st.floats(0.0, 6000.0), st.floats(1e-7, 1e-3), st.floats(0.5, 1.4), st.floats(0.5, 1.4))
def test_thrust_and_speed_undo_each_other(speed, coefficient, density, reference):
    air = {"coefficient": coefficient, "density": density, "reference_density": reference}
    thrust = thrust_from_speed(speed, **air)
    assert speed_from_thrust(thrust, **air) == pytest.approx(speed, rel=1e-12, abs=1e-12)


def test_batch_is_the_loop():
    speed = np.random.default_rng(1).uniform(0, 3000, (6, 4))
    density = np.linspace(0.9, 1.3, 6)
    batch = thrust_from_speed(
        speed, coefficient=2e-5, density=density[:, None], reference_density=1.2
    )
    for row in range(6):
        for rotor in range(4):
            one = thrust_from_speed(
                speed[row, rotor],
                coefficient=2e-5,
                density=density[row],
                reference_density=1.2,
            )
            assert batch[row, rotor] == pytest.approx(one, rel=1e-15)


def test_thin_air_makes_less_thrust_in_proportion():
    thin = thrust_from_speed(2000.0, coefficient=2e-5, density=0.9, reference_density=1.2)
    assert thin == pytest.approx(0.75 * thrust_from_speed(2000.0, coefficient=2e-5))


def test_no_speed_makes_a_negative_thrust():
    assert np.isnan(speed_from_thrust(-1.0, coefficient=2e-5))


def test_one_density_without_the_other_is_refused():
    with pytest.raises(ValueError, match="together"):
        thrust_from_speed(2000.0, coefficient=2e-5, density=1.0)
    with pytest.raises(ValueError, match="together"):
        thrust_from_speed(2000.0, coefficient=2e-5, reference_density=1.0)


def test_f16_load_matching_is_equations_6_to_8():
    load = load_matching(load_airframe("topxgun-f16"))
    assert load.full_load == pytest.approx(9.275)
    assert load.empty_load == pytest.approx(5.275)
    assert f"{load.full_load:.2f} {load.empty_load:.2f}" == "9.28 5.28"
    assert f"{load.load_increase:.2%}" == "75.83%"
