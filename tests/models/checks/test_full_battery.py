"""A fresh battery checks the voltmeter: no lithium cell has more than its charger leaves in it."""

from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.models.checks.voltage import beyond_full, ceiling_too_high, full_voltage
from thrustmargin.models.physics.airframe import load_airframe

F16 = load_airframe("topxgun-f16-sitl")  # 51.8 V nominal, 58.8 V at its ceiling


def battery(nominal: float):
    return replace(F16, nominal_voltage=nominal, ceiling_voltage=nominal)


@pytest.mark.parametrize(
    ("nominal", "full"),
    [
        (51.8, 58.8),  # 14 cells of 3.7 V
        (44.4, 50.4),  # 12 of them
        (50.4, 58.8),  # 14 cells of 3.6 V
        (45.6, 52.2),  # 12 cells of 3.8 V, full at 4.35 V
        (53.9, 61.6),  # 14 cells of 3.85 V, full at 4.4 V
    ],
)
def test_the_kind_of_cell_is_the_one_whose_number_comes_out_whole(nominal, full):
    assert full_voltage(battery(nominal)) == pytest.approx(full, abs=0.01)


def test_a_ceiling_that_was_measured_at_more_was_there():
    assert full_voltage(replace(F16, ceiling_voltage=60.9)) == 60.9


@pytest.mark.parametrize(
    ("most", "beyond"), [(58.8, 0.0), (59.3, 0.0), (60.564, 0.03), (61.152, 0.04)]
)
def test_a_rest_voltage_beyond_a_full_battery_is_the_share_that_is_read_too_much(most, beyond):
    volts = np.append(np.full(30, most), np.full(500, 54.0))
    assert beyond_full(volts, F16) == pytest.approx(beyond, abs=1e-6)


def test_a_spike_or_a_gauge_that_fails_is_no_voltmeter_that_reads_too_much():
    sound = np.full(500, 56.0)
    for wrong, rows in ((61.0, 19), (100.0, 200), (0.0, 200), (np.nan, 200)):
        volts = sound.copy()
        volts[:rows] = wrong
        assert beyond_full(volts, F16) == 0.0
    assert beyond_full(np.full(500, np.nan), F16) == 0.0


@pytest.mark.parametrize(("exponent", "share"), [(1.0, 0.0816), (0.5, 0.04), (0.0, 0.0)])
def test_thrust_goes_with_it_as_the_ceiling_does(exponent, share):
    craft = replace(F16, ceiling_voltage_exponent=exponent)
    assert ceiling_too_high(np.full(50, 1.04 * 58.8), craft) == pytest.approx(share, abs=1e-6)
