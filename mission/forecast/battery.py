"""Compute the voltage and energy of a battery along a flight.

    V = n V_cell(charge) - n r I      I = P/V      P = sum of torque x rotor speed / efficiency

The cells are lithium polymer. Without a capacity the voltage is constant, and the forecast lists
that as an assumption.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.flight import Floats
from thrustmargin.models.physics.airframe import Airframe

#: Charge of a cell -> V at rest, of lithium polymer.
_CHARGE = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
_AT_REST = (3.30, 3.68, 3.74, 3.77, 3.80, 3.84, 3.88, 3.94, 4.01, 4.09, 4.20)
CELL = 3.7  # V, nominal
FULL = 4.2  # V a cell
#: Ohm x Ah of a cell: usual for packs of sprayers (about 1.5 mOhm at 16 Ah).
RESISTANCE = 0.025
#: Of motor and speed controller together at work.
EFFICIENCY = 0.85
UNSET = 3300.0  # mAh of ArduPilot's BATT_CAPACITY where nobody has set it
LEAST = 0.05  # of a charge below which nothing is known


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightBattery:
    """A battery before take-off; NaN where a value is unknown."""

    voltage: float = math.nan  # V at rest; with no capacity: V under load, held
    capacity_ah: float = math.nan
    resistance: float = math.nan  # ohm of the whole pack

    @property
    def falls(self) -> bool:
        """Return whether the voltage can be computed from the charge: the capacity is known."""
        return self.capacity_ah > 0.0


UNKNOWN = FlightBattery()


def used_since_change(
    total: Floats, changed: NDArray[np.intp], before: Floats | float = 0.0
) -> Floats:
    """Subtract from a running total (T,) its value at the latest row of `changed`, the rows of a
    new tank or battery.

    `before` is the amount already used at each of those rows: one number, or one for each row. Rows
    ahead of the first change keep the whole total.
    """
    begun = np.zeros(total.size)
    begun[changed] = total[changed] - before
    last = np.zeros(total.size, dtype=np.intp)
    last[changed] = changed
    return total - begun[np.maximum.accumulate(last)]


def stated_capacity(parameters: Mapping[str, float]) -> float:
    """Return the battery capacity, Ah, from an autopilot's parameters.

    NaN where the parameter is missing, zero, or left at ArduPilot's default.
    """
    for name, scale in (("BATT_CAPACITY", 1e-3), ("BAT1_CAPACITY", 1e-3)):
        value = parameters.get(name, 0.0)
        if value > 0.0 and value != UNSET:
            return value * scale
    return math.nan


def rotor_power(airframe: Airframe, thrust: Floats, speed_rpm: Floats) -> Floats:
    """Compute the battery power (T,), W, from rotor thrusts, N, and rotor speeds, rpm, both
    (T, R).
    """
    shaft = airframe.torque_ratio * thrust * speed_rpm * (2.0 * math.pi / 60.0)
    return np.sum(shaft, axis=1) / EFFICIENCY


def climb_power(airframe: Airframe, thrust: Floats, density: Floats, climb: Floats) -> Floats:
    """Compute the battery power (T,), W, that climbing at `climb` (T,) m/s adds to that of level
    flight.

    By momentum theory for the rotors' discs: T (c/2 + sqrt(c²/4 + v²) - v) with the induced
    velocity v of hover. It is negative in a descent. `thrust` is (T, R) N, `density` (T,) kg/m³.
    """
    total = np.sum(thrust, axis=1)
    disc = airframe.rotor_count * math.pi * airframe.propeller_diameter**2 / 4.0
    induced = np.sqrt(np.maximum(total, 0.0) / (2.0 * density * disc))
    half = 0.5 * climb
    return total * (half + np.sqrt(half**2 + induced**2) - induced) / EFFICIENCY


def discharge(
    battery: FlightBattery,
    airframe: Airframe,
    power: Floats,
    seconds: Floats,
    changed: NDArray[np.intp],
    before_wh: Floats | float = 0.0,
) -> tuple[Floats, Floats]:
    """Compute the voltage under load (T,), V, and the energy drawn so far (T,), Wh.

    `power` (T,) W is drawn for `seconds` (T,) s. At each of the rows `changed` a battery takes over
    that has already given `before_wh`; the energy runs on across batteries. The voltage is NaN
    where the charge is used up. Without a capacity or a nominal voltage it is constant:
    `battery.voltage`, else the nominal voltage.
    """
    energy = np.cumsum(np.nan_to_num(power) * seconds) / 3600.0
    cells = round(airframe.nominal_voltage / CELL) if airframe.nominal_voltage > 0.0 else 0
    if not battery.falls or not cells:
        held = battery.voltage if battery.voltage > 0.0 else airframe.nominal_voltage
        return np.full(power.size, held), energy
    start = battery.voltage if battery.voltage > 0.0 else FULL * cells
    full = float(np.interp(start / cells, _AT_REST, _CHARGE))
    resistance = battery.resistance
    if not resistance >= 0.0:
        resistance = cells * RESISTANCE / battery.capacity_ah
    # Charge goes with the current, which goes with the voltage: energy over nominal is near enough
    # to start from, and one turn more settles it.
    volts = np.full(power.size, start)
    for _ in range(3):
        before = np.asarray(before_wh) / (cells * CELL) * 3600.0
        drawn = used_since_change(np.cumsum(power / volts * seconds), changed, before) / 3600.0
        charge = full - drawn / battery.capacity_ah
        rest = cells * np.interp(charge, _CHARGE, _AT_REST)
        inside = np.maximum(rest**2 - 4.0 * resistance * power, 0.0)
        volts = 0.5 * (rest + np.sqrt(inside))
    return np.where(charge > LEAST, volts, np.nan), energy
