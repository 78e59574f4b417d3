"""Does a battery read more than a full one has? Then the voltmeter reads too much.

The ceiling that is taken from it is then too high.
A charger ends at one voltage a cell, whatever the pack: 4.2 V of lithium polymer (3.7 V nominal)
and ion (3.6 V), 4.35 and 4.4 V of high-voltage cells (3.8 and 3.85 V). So a fresh battery at rest
checks the voltmeter. A flight on a battery that is not full shows nothing here, and a reading that
no battery of so many cells can have is a gauge that fails.
"""

from __future__ import annotations

import numpy as np

from thrustmargin.models.flight import Floats
from thrustmargin.models.physics.airframe import Airframe

POSSIBLE_VOLTAGE = (0.78, 1.22)  # over nominal, of a battery of the same cells in flight
#: V that a lithium cell is called by -> V at which its charger ends.
FULL_CELL = {3.6: 4.2, 3.7: 4.2, 3.8: 4.35, 3.85: 4.4}
TOLERANCE = 0.01  # share, of charger and voltmeter
HELD_ROWS = 20  # with so much or more: a spike is none


def full_voltage(airframe: Airframe) -> float:
    """V of the airframe's battery when full: by the kind of cell whose number comes out whole.

    The voltage at which the ceiling was measured was there too.
    """
    nominal = airframe.nominal_voltage
    if not np.isfinite(nominal):
        return float("nan")
    called = min(FULL_CELL, key=lambda volts: abs(nominal / volts - round(nominal / volts)))
    return max(nominal / called * FULL_CELL[called], airframe.ceiling_voltage)


def highest(voltage: Floats, airframe: Airframe) -> Floats:
    """The HELD_ROWS highest of (T,) V that are possible, or all of them where they are fewer."""
    possible = (voltage > 0.0) & (voltage <= POSSIBLE_VOLTAGE[1] * airframe.nominal_voltage)
    return np.sort(voltage[possible])[-HELD_ROWS:]


def most_voltage(voltage: Floats, airframe: Airframe) -> float:
    """V of (T,) that a battery had for HELD_ROWS; NaN where fewer are known and possible."""
    known = highest(voltage, airframe)
    return float(known[0]) if known.size == HELD_ROWS else float("nan")


def beyond_full(voltage: Floats, airframe: Airframe) -> float:
    """Share by which voltages (T,) read more than the full battery has; 0 where they do not."""
    share = most_voltage(voltage, airframe) / full_voltage(airframe) - 1.0
    return share if share > TOLERANCE else 0.0


def ceiling_too_high(voltage: Floats, airframe: Airframe) -> float:
    """Share of thrust by which voltages (T,) that read too much make the ceiling too high."""
    share = 1.0 + beyond_full(voltage, airframe)
    return float(share ** (2.0 * airframe.ceiling_voltage_exponent) - 1.0)
