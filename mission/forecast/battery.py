"""Compute the voltage and energy of a battery along a flight.

    V = n V_cell(charge) - n r I      I = P/V      P = k rho / rho_ref sum of N³

The coefficient k is that of the flights that measured it (`RotorModel.power`). Without any, P is
the sum of torque x rotor speed over an efficiency. `electric_power` is the one function that
computes power, and `power_error` the one that computes its error.

The cells are lithium polymer. Without a capacity the voltage is constant, and the forecast lists
that as an assumption.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.flight import Floats
from thrustmargin.models.model.mode_walk import DAY_STEP, FLIGHT_STEP
from thrustmargin.models.model.rotor_model import Prediction, RotorModel, identified_airframe
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.electric_power import NORMAL, UNMEASURED_POWER_ERROR, power_factors
from thrustmargin.models.physics.margin import rotor_thrust

#: Charge of a cell -> V at rest, of lithium polymer.
_CHARGE = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
_AT_REST = (3.30, 3.68, 3.74, 3.77, 3.80, 3.84, 3.88, 3.94, 4.01, 4.09, 4.20)
CELL = 3.7  # V, nominal
FULL = 4.2  # V a cell
#: Ohm x Ah of a cell: usual for batteries of sprayers (about 1.5 mOhm at 16 Ah).
RESISTANCE = 0.025
#: Standard error of ln of that. Source: a heavy quad, Quiver PT1, 2.2 times as much.
RESISTANCE_ERROR = 0.5
#: Of motor and speed controller together at work.
EFFICIENCY = 0.85
UNSET = 3300.0  # mAh of ArduPilot's BATT_CAPACITY where nobody has set it
LEAST_USABLE = 1e-3  # share of the usable energy that counts as none
LEAST = 0.05  # of a charge below which nothing is known


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightBattery:
    """A battery before take-off; NaN where a value is unknown."""

    voltage: float = math.nan  # V at rest; with no capacity: V under load, held
    capacity_ah: float = math.nan
    resistance: float = math.nan  # ohm of the whole battery
    voltage_error: float = 0.0  # standard error, V
    resistance_error: float = 0.0  # standard error, ohm

    @property
    def falls(self) -> bool:
        """Return True if the voltage can be computed from the charge: the capacity is known."""
        return self.capacity_ah > 0.0


UNKNOWN = FlightBattery()


def used_since_change(
    total: Floats, changed: NDArray[np.intp], before: Floats | float = 0.0
) -> Floats:
    """Return the amount used (T,) since the last refill or battery change, from a running total
    (T,).

    `changed` are the indices of the rows of a new tank or battery. `before` is the amount already
    used of it in each such row: one number, or one for each row. Rows before the first change keep
    the whole total.
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


def electric_power(model: RotorModel, prediction: Prediction) -> Floats:
    """Compute the battery power (T,), W, of predicted rotor speeds.

    By the coefficient that flights of the aircraft measured, else by `rotor_power`.
    """
    craft = identified_airframe(model)
    power = rotor_power(craft, prediction.thrust, prediction.rotor_speed_rpm)
    if model.power is None:
        return power
    return power * (model.power.coefficient / formula_coefficient(model))


def formula_coefficient(model: RotorModel) -> float:
    """Return k, W/rpm³ in air of the model's reference density, by the formula of `rotor_power`."""
    craft = identified_airframe(model)
    one = np.ones((1, craft.rotor_count))
    density = np.array([model.reference_density])
    return float(rotor_power(craft, rotor_thrust(craft, one, density), one)[0] / craft.rotor_count)


def power_error(model: RotorModel, prediction: Prediction) -> float:
    """Return the standard error of ln of the mean power of a predicted flight.

    It combines that of the power coefficient and three times that of the rotors' common speed. The
    latter is computed from the prediction's interval, as if all modes of the rotors were equally
    unsure; without an interval it is the change between days of a measured aircraft.
    """
    of_law = UNMEASURED_POWER_ERROR if model.power is None else model.power.error
    reach = (prediction.upper_rpm - prediction.rotor_speed_rpm) / prediction.rotor_speed_rpm
    known = np.isfinite(reach).all(axis=1)
    of_speed = math.hypot(FLIGHT_STEP, DAY_STEP)
    if known.any():
        normal = NormalDist().inv_cdf((1.0 + prediction.coverage) / 2.0)
        rotors = math.sqrt(float(np.mean(reach[known] ** 2))) / normal
        of_speed = rotors / math.sqrt(model.airframe.rotor_count)
    return math.hypot(of_law, 3.0 * of_speed)


def discharge(
    battery: FlightBattery,
    airframe: Airframe,
    power: Floats,
    seconds: Floats,
    changed: NDArray[np.intp],
    before_wh: Floats | float = 0.0,
) -> tuple[Floats, Floats]:
    """Compute the voltage under load (T,), V, and the energy drawn so far (T,), Wh.

    `power` (T,) W is drawn for `seconds` (T,) s. In each of the rows `changed` a battery replaces
    the last one and has already given `before_wh`; the energy is summed over all batteries. The
    voltage is NaN where the charge is used up. Without a capacity or a nominal voltage it is
    constant: `battery.voltage`, else the nominal voltage.
    """
    energy = np.cumsum(np.nan_to_num(power) * seconds) / 3600.0
    cells = round(airframe.nominal_voltage / CELL) if airframe.nominal_voltage > 0.0 else 0
    if not battery.falls or not cells:
        load_voltage = battery.voltage if battery.voltage > 0.0 else airframe.nominal_voltage
        return np.full(power.size, load_voltage), energy
    start = battery.voltage if battery.voltage > 0.0 else FULL * cells
    full = charge_at_rest(start / cells)
    resistance = resistance_of_battery(battery, cells)[0]
    # Charge goes with the current, which goes with the voltage: energy over nominal is near enough
    # to start from, and one turn more settles it.
    volts = np.full(power.size, start)
    charge = np.full(power.size, full)
    for _ in range(3):
        before = np.asarray(before_wh) / (cells * CELL) * 3600.0
        drawn = used_since_change(np.cumsum(power / volts * seconds), changed, before) / 3600.0
        charge = full - drawn / battery.capacity_ah
        rest = cells * np.interp(charge, _CHARGE, _AT_REST)
        inside = np.maximum(rest**2 - 4.0 * resistance * power, 0.0)
        volts = 0.5 * (rest + np.sqrt(inside))
    return np.where(charge > LEAST, volts, np.nan), energy


def charge_at_rest(cell_voltage: float) -> float:
    """Return the state of charge, 0 to 1, of a cell whose voltage at rest is `cell_voltage` V."""
    return float(np.interp(cell_voltage, _AT_REST, _CHARGE))


def resistance_of_battery(battery: FlightBattery, cells: int) -> tuple[float, float]:
    """Return the resistance of a battery, ohm, and its standard error, ohm.

    Without a measured or stated one it is the usual value for the capacity, with the relative error
    RESISTANCE_ERROR.
    """
    if battery.resistance >= 0.0:
        return battery.resistance, battery.resistance_error
    usual = cells * RESISTANCE / battery.capacity_ah
    return usual, RESISTANCE_ERROR * usual


def usable_energy(battery: FlightBattery, airframe: Airframe, kept: float) -> float:
    """Return the energy, Wh, that a battery delivers until the share `kept` of its charge remains.

    It starts from the charge at the battery's voltage at rest, or full if that is unknown. NaN
    without a capacity or a nominal voltage.
    """
    cells = round(airframe.nominal_voltage / CELL) if airframe.nominal_voltage > 0.0 else 0
    if not battery.falls or not cells:
        return math.nan
    charge = charge_at_rest(battery.voltage / cells) if battery.voltage > 0.0 else 1.0
    return max(charge - kept, 0.0) * battery.capacity_ah * cells * CELL


def usable_error(battery: FlightBattery, airframe: Airframe, kept: float) -> float:
    """Return the standard error of ln `usable_energy` that the error of the voltage at rest causes;
    0 without such an error or usable energy."""
    usable = usable_energy(battery, airframe, kept)
    if not (battery.voltage_error > 0.0 and usable > 0.0):
        return 0.0
    emptier = replace(battery, voltage=battery.voltage - NORMAL * battery.voltage_error)
    least = max(usable_energy(emptier, airframe, kept), LEAST_USABLE * usable)
    return math.log(usable / least) / NORMAL


def voltage_ends(
    battery: FlightBattery,
    airframe: Airframe,
    power: Floats,
    error: float,
    seconds: Floats,
    changed: NDArray[np.intp],
    before_wh: Floats | float = 0.0,
) -> tuple[Floats, Floats]:
    """Compute the lower and upper ends of the 90 % interval of the voltage under load (T,), V.

    `error` is the standard error of ln power; `power` (T,) W is drawn for `seconds` (T,) s, and in
    the rows `changed` a battery replaces the last one and has already given `before_wh`. The errors
    of power, voltage at rest and resistance add up in quadrature. NaN throughout without a
    capacity; in the lower ends also where the charge may be used up.
    """
    cells = round(airframe.nominal_voltage / CELL) if airframe.nominal_voltage > 0.0 else 0
    if not battery.falls or not cells:
        unknown = np.full(power.size, np.nan)
        return unknown, unknown
    rest = battery.voltage if battery.voltage > 0.0 else FULL * cells
    resistance, unsure = resistance_of_battery(battery, cells)
    battery = replace(battery, voltage=rest, resistance=resistance)

    def volts(one: FlightBattery, factor: float = 1.0) -> Floats:
        return discharge(one, airframe, factor * power, seconds, changed, before_wh)[0]

    middle, (factor_less, factor_more) = volts(battery), power_factors(error)
    by_rest, by_ohm = NORMAL * battery.voltage_error, NORMAL * unsure
    # Of a battery no emptier than empty and no fuller than full, and of no negative resistance.
    fuller = min(rest + by_rest, max(FULL * cells, rest))
    low = [
        volts(battery, factor_more),
        volts(replace(battery, voltage=rest - by_rest)),
        volts(replace(battery, resistance=resistance + by_ohm)),
    ]
    high = [
        volts(battery, factor_less),
        volts(replace(battery, voltage=fuller)),
        volts(replace(battery, resistance=max(resistance - by_ohm, 0.0))),
    ]
    down, up = (np.sqrt(np.sum(np.square(np.array(ends) - middle), axis=0)) for ends in (low, high))
    return middle - down, middle + up
