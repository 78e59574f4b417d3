"""A bench table's curve, exponent, ceiling and their intervals, on tables made from known laws."""

import numpy as np
import pytest

from thrustmargin.models.errors import DataError
from thrustmargin.models.physics.thrust_fits import fit_bench

SPEED = np.linspace(1000.0, 3000.0, 9)


def test_an_exact_curve_is_found_with_no_width():
    fit = fit_bench(rotor_speed_rpm=SPEED, thrust=2e-5 * SPEED**2)
    assert fit.coefficient.value == pytest.approx(2e-5)
    assert fit.coefficient.high - fit.coefficient.low < 1e-12
    assert fit.exponent.value == pytest.approx(2.0)
    assert fit.max_rotor_speed_rpm == 3000.0
    assert fit.max_thrust == pytest.approx(180.0)
    assert not fit.full_throttle


@pytest.mark.parametrize("points", [7, 12, 200])
def test_intervals_hold_the_truth_where_scatter_grows_with_thrust(points: int):
    held = 0
    for seed in range(60):
        random = np.random.default_rng(seed)
        speed = np.linspace(1000.0, 3000.0, points)
        thrust = 2e-5 * speed**2 * (1.0 + 0.03 * random.normal(size=points))
        found = fit_bench(rotor_speed_rpm=speed, thrust=thrust).coefficient
        held += found.low <= 2e-5 <= found.high
    assert held / 60 >= 0.88  # 95 % is promised


def test_a_curve_of_another_power_says_so():
    random = np.random.default_rng(0)
    thrust = 1e-6 * SPEED**2.3 * (1.0 + 0.005 * random.normal(size=SPEED.size))
    exponent = fit_bench(rotor_speed_rpm=SPEED, thrust=thrust).exponent
    assert 2.0 < exponent.low < 2.3 < exponent.high < 2.5


def test_a_typing_error_is_named_and_does_not_move_the_curve():
    speed = SPEED.copy()
    speed[3] = 149.0
    fit = fit_bench(rotor_speed_rpm=speed, thrust=2e-5 * SPEED**2)
    assert fit.left_out == (3,)
    assert fit.coefficient.value == pytest.approx(2e-5)


@pytest.mark.parametrize(
    ("scatter", "off", "left_out"),
    [
        (0.001, 0.14, ()),  # 15 % off is far, however little the others scatter
        (0.001, 0.16, (4,)),
        (0.04, 0.28, ()),  # five times their scatter of 1.4826 x 0.04 is 29.7 %
        (0.04, 0.31, (4,)),
    ],
)
def test_a_point_far_off_is_left_out(scatter, off, left_out):
    """Logarithms of T/N² of +- the scatter by turns, the median of nine 0, one point far off."""
    logs = scatter * np.array([1, -1, 1, -1, 0, 1, -1, 0, -1], float)
    logs[4] = off
    thrust = 2e-5 * SPEED**2 * np.exp(logs)
    assert fit_bench(rotor_speed_rpm=SPEED, thrust=thrust).left_out == left_out


def test_a_scatter_of_more_than_15_percent_is_no_curve():
    # The median distance is 1.4826 standard deviations' worth: 0.101 is 0.1497, 0.102 is 0.1512.
    signs = np.array([1, -1, 1, -1, 0, 1, -1, 1, -1], float)
    for size, fits in ((0.101, True), (0.102, False)):
        thrust = 2e-5 * SPEED**2 * np.exp(size * signs)
        if fits:
            assert fit_bench(rotor_speed_rpm=SPEED, thrust=thrust).points == 9
        else:
            with pytest.raises(DataError, match="15 % about"):
                fit_bench(rotor_speed_rpm=SPEED, thrust=thrust)


@pytest.mark.parametrize(("top", "full"), [(0.92, False), (0.94, True)])
def test_full_throttle_is_from_93_percent_on(top, full):
    throttle = np.linspace(0.4, top, 9)
    fit = fit_bench(rotor_speed_rpm=SPEED, thrust=2e-5 * SPEED**2, throttle=throttle)
    assert fit.full_throttle == full


@pytest.mark.parametrize(("throttle", "top"), [(0.98, 3000.0), (0.99, 3100.0)])
def test_rows_within_1_5_percent_of_the_largest_throttle_are_at_it(throttle, top):
    speed = np.append(SPEED, 3100.0)
    of = np.append(np.linspace(0.2, 1.0, 9), throttle)
    fit = fit_bench(rotor_speed_rpm=speed, thrust=2e-5 * speed**2, throttle=of)
    assert fit.max_rotor_speed_rpm == top


@pytest.mark.parametrize(("lowest", "known"), [(47.6, False), (47.4, True)])
def test_voltages_must_differ_by_five_percent_for_an_exponent(lowest, known):
    volts = np.linspace(lowest, 50.0, 8)
    speed = np.append(SPEED, 3000.0 * (volts / 50.0) ** 0.8)
    fit = fit_bench(
        rotor_speed_rpm=speed,
        thrust=2e-5 * speed**2,
        throttle=np.append(np.linspace(20.0, 90.0, 9), np.full(8, 100.0)),
        voltage=np.append(np.full(9, 45.0), volts),
    )
    assert np.isfinite(fit.voltage_exponent.value) == known


def test_a_load_cell_that_is_pushed_reads_negative():
    fit = fit_bench(rotor_speed_rpm=SPEED, thrust=-2e-5 * SPEED**2)
    assert fit.coefficient.value == pytest.approx(2e-5)


@pytest.mark.parametrize(
    ("low", "high"), [(0.5, 1.0), (0.5, 1.02), (50.0, 100.0), (1500.0, 2000.0)]
)
def test_full_throttle_in_any_unit_gives_the_ceiling(low: float, high: float):
    throttle = np.linspace(low, high, SPEED.size)
    fit = fit_bench(
        rotor_speed_rpm=SPEED, thrust=2e-5 * SPEED**2, throttle=throttle, voltage=48.0 + 0 * SPEED
    )
    assert fit.full_throttle
    assert (fit.max_rotor_speed_rpm, fit.ceiling_voltage) == (3000.0, 48.0)


def test_a_table_that_stops_at_half_throttle_does_not_claim_a_ceiling():
    fit = fit_bench(
        rotor_speed_rpm=SPEED, thrust=2e-5 * SPEED**2, throttle=np.linspace(10.0, 50.0, 9)
    )
    assert not fit.full_throttle


def test_the_exponent_of_voltage_is_that_of_the_rows_at_full_throttle():
    volts = np.linspace(40.0, 50.0, 8)
    top = 3000.0 * (volts / 50.0) ** 0.8
    speed = np.concatenate([SPEED, top])
    fit = fit_bench(
        rotor_speed_rpm=speed,
        thrust=2e-5 * speed**2,
        throttle=np.concatenate([np.linspace(20.0, 90.0, 9), np.full(8, 100.0)]),
        voltage=np.concatenate([np.full(9, 45.0), volts]),
    )
    assert fit.voltage_exponent.value == pytest.approx(0.8)
    assert fit.max_rotor_speed_rpm == pytest.approx(3000.0)
    assert fit.ceiling_voltage == 50.0


def test_tables_of_several_propellers_are_refused():
    speed = np.tile(SPEED, 2)
    thrust = np.concatenate([2e-5 * SPEED**2, 1e-5 * SPEED**2])
    with pytest.raises(DataError, match="too far for one curve"):
        fit_bench(rotor_speed_rpm=speed, thrust=thrust)


def test_too_little_is_refused():
    with pytest.raises(DataError, match="3 bench points"):
        fit_bench(rotor_speed_rpm=SPEED[:3], thrust=SPEED[:3])
    with pytest.raises(DataError, match="different speeds"):
        fit_bench(rotor_speed_rpm=np.full(5, 2000.0), thrust=np.full(5, 80.0))


@pytest.mark.parametrize("speed", [[750, 1, 1, 1, 1], [1, 1, 1, 1, 1, 1, 1, 2]])
def test_points_that_agree_at_one_speed_alone_are_refused(speed, capfd):
    """Of all that agree, or of what a block that is left out leaves."""
    thrust = np.where(np.array(speed) == 750, 22.5, 5.0 * np.array(speed) ** 2.0)
    with pytest.raises(DataError, match="different speeds are needed"):
        fit_bench(rotor_speed_rpm=speed, thrust=thrust)
    assert "DLASCL" not in capfd.readouterr().out, "LAPACK was given what it cannot solve"


def test_an_exponent_of_voltage_that_hangs_on_one_row_is_none():
    fit = fit_bench(
        rotor_speed_rpm=[3000, 3010, 3020, 2700],
        thrust=2e-5 * np.array([3000, 3010, 3020, 2700]) ** 2.0,
        throttle=[100] * 4,
        voltage=[50, 50, 50, 45],
    )
    assert np.isnan(fit.voltage_exponent.value)
    assert fit.max_rotor_speed_rpm == 3020.0
