"""An ESC's voltmeter that reads off the others' is told from a cable that loses volts."""

import math

import numpy as np
import pytest

from tests.made_sources import sent
from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.battery_and_tank import esc_voltage_offsets
from thrustmargin.gcs_plugin.telemetry.signals import signals_by_channel

TIME = np.arange(0.0, 60.0, 0.1)
LOAD = (TIME > 20.0) * 20.0  # A through each ESC
BATTERY = 52.0 - 0.1 * LOAD + 0.05 * np.sin(TIME)


def offsets(*reads, outputs=(0, 1, 2, 3)):
    return esc_voltage_offsets(
        signals_by_channel(
            Signal("esc_voltage", sent("ESC Volt"), TIME, np.round(volts, 1), k)
            for k, volts in enumerate(reads)
        ),
        outputs,
    )


@pytest.mark.parametrize("off", [-0.5, 0.6])
def test_an_instrument_off_loaded_or_not_is_named_with_its_size(off: float):
    found = offsets(BATTERY + off, BATTERY, BATTERY + 0.1, BATTERY - 0.1)
    assert found[0] == pytest.approx(off, abs=0.05)
    assert all(map(math.isnan, found[1:]))


def test_a_spike_now_and_then_is_no_offset_and_hides_none():
    spikes = np.where(np.arange(TIME.size) % 20 == 0, 8.0, 0.0)  # one in twenty rows, 8 V up
    found = offsets(BATTERY - 0.5 + spikes, BATTERY + spikes[::-1], BATTERY, BATTERY)
    assert found[0] == pytest.approx(-0.5, abs=0.05)
    assert math.isnan(found[1])


@pytest.mark.parametrize(("share", "named"), [(45, False), (55, True)])
def test_a_voltmeter_must_be_heard_in_half_of_its_reports(share, named):
    heard = np.arange(TIME.size) % 100 < share
    found = offsets(np.where(heard, BATTERY - 0.5, 0.0), BATTERY, BATTERY, BATTERY)
    assert math.isnan(found[0]) != named


def test_three_steps_of_what_escs_report_are_an_offset():
    assert offsets(BATTERY - 0.4, BATTERY, BATTERY, BATTERY)[0] == pytest.approx(-0.4, abs=0.01)


def test_the_offset_is_of_the_motor_and_not_of_the_output():
    found = offsets(BATTERY - 0.5, BATTERY, BATTERY, BATTERY, outputs=(3, 2, 1, 0))
    assert [math.isnan(v) for v in found] == [True, True, True, False]


@pytest.mark.parametrize(
    "reads",
    [
        (BATTERY, BATTERY, BATTERY, BATTERY),
        (BATTERY - 0.2, BATTERY, BATTERY, BATTERY),  # within what ESCs resolve
        (BATTERY - 0.04 * LOAD, BATTERY, BATTERY, BATTERY),  # a thin cable
        (BATTERY - 0.5, BATTERY - 0.5, BATTERY, BATTERY),  # two batteries
        (BATTERY - 0.5, BATTERY),  # one of two is wrong: which?
        (BATTERY * 0.0, BATTERY, BATTERY, BATTERY),  # one reports none
    ],
)
def test_what_is_no_offset_of_one_instrument_is_not_named(reads):
    assert all(map(math.isnan, offsets(*reads)))
