"""The day of a flight: air, wind, fill, battery, and what else differs from flight to flight."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tests.lab.undeclared.crafts import GRAVITY, Craft
from tests.lab.undeclared.missions import FINE_STEP, Motion, coloured, rounded
from tests.lab.undeclared.rotor_aero import Array

if TYPE_CHECKING:
    from tests.lab.undeclared.conditions import Condition

AIR_GAS_CONSTANT = 287.053  # J/(kg K)


@dataclass(frozen=True, kw_only=True)
class Day:
    """Air, scatter and instruments of one flight."""

    altitude: float = 0.0  # m of the field above the sea
    pressure: float = 101325.0  # Pa
    temperature: float = 288.15  # K of the air
    board_heat: float = 18.0  # K by which the autopilot's thermometer reads warm
    wind: tuple[float, float] = (0.0, 0.0)  # m/s north, east
    turbulence: float = 0.4  # m/s
    fill: float = 0.7  # of the tank at take-off
    flow: float = 0.15  # of a full tank a minute while the pump is on
    charge: float = 0.97  # of the battery at take-off
    minutes: float = 14.0  # of hover at the typical mass from a full battery
    cg: tuple[float, float] = (0.0, 0.0)  # of the arm, forward and right, how it was loaded today
    mass: float = 0.0  # of the typical mass: another battery
    gauge_offset: float = 0.0  # of a full tank
    gauge_gain: float = 1.0
    noise: float = 0.004  # of hover rotor speed
    gusts: float = 1.0  # size of the pushes that no law explains
    clock_start: float = 0.0  # s of the season
    wind_reported: bool = True

    @property
    def density(self) -> float:
        """kg/m³ of dry air."""
        return self.pressure / (AIR_GAS_CONSTANT * self.temperature)


class Surroundings(NamedTuple):
    """What the aircraft meets, T rows of the fine base."""

    air_velocity: Array  # (T, 3) m/s NED
    density: float  # kg/m³
    tank: Array  # (T,) kg really in the tank
    voltage: Array  # (T,) V
    clock_start: float  # s of take-off on the season's clock
    push: Array  # (T, 4) N and N m beyond all laws: collective, roll, pitch, yaw


def random_day(rng: np.random.Generator) -> Day:
    """A day at the calibration field, sea level: weather, loading and battery of that flight."""
    strength, direction = rng.uniform(0.0, 2.5), rng.uniform(0.0, 2 * np.pi)
    forward, right, mass, zero, gain = rng.standard_normal(5)
    return Day(
        pressure=101325.0 + 300.0 * float(rng.standard_normal()),
        temperature=288.15 + 3.0 * float(rng.standard_normal()),
        board_heat=18.0 + 1.0 * float(rng.standard_normal()),
        wind=(float(strength * np.cos(direction)), float(strength * np.sin(direction))),
        turbulence=float(rng.uniform(0.1, 0.6)),
        fill=float(rng.uniform(0.25, 1.0)),
        flow=float(rng.uniform(0.1, 0.28)),
        charge=float(rng.uniform(0.85, 1.0)),
        minutes=float(rng.uniform(9.0, 18.0)),
        cg=(0.0012 * float(forward), 0.0012 * float(right)),
        mass=0.001 * float(mass),
        gauge_offset=0.003 * float(zero),
        gauge_gain=1.0 + 0.004 * float(gain),
        noise=float(rng.uniform(0.003, 0.005)),
        gusts=float(rng.uniform(0.5, 1.5)),
        wind_reported=bool(rng.random() < 0.75),
    )


def surroundings(
    craft: Craft, condition: Condition, motion: Motion, day: Day, rng: np.random.Generator
) -> Surroundings:
    """Wind, tank, battery and pushes along a motion; the same draws whatever the condition."""
    rows = motion.time.size
    # An aircraft a metre wide does not lean after what changes within a tenth of a second.
    swirl = rounded(coloured(rng, rows, 3, 3.0), 0.16) * day.turbulence * np.array([1.0, 1.0, 0.35])
    wind = np.array([day.wind[0], day.wind[1], 0.0]) + swirl
    if condition.thermal:
        north, east = motion.position[:, 0] / 40.0, motion.position[:, 1] / 40.0
        wind[:, 2] -= condition.thermal * np.sin(2 * np.pi * north) * np.cos(2 * np.pi * east + 1.9)
    used = np.cumsum(motion.spraying) * FINE_STEP * day.flow / 60.0
    tank = craft.tank_litres * np.maximum(day.fill * condition.gauge_gain - used, 0.0)
    more = condition.hidden_mass + condition.hung
    mass = craft.empty_mass * (1.0 + day.mass) + more + tank
    power = (mass / craft.typical_mass) ** 1.5  # of that at the typical mass
    left = day.charge - np.cumsum(power) * FINE_STEP / (60.0 * day.minutes)
    voltage = craft.cells * (3.4 + 0.8 * np.maximum(left, 0.0) - 0.06 * power)
    weight = craft.typical_mass * GRAVITY
    sizes = weight * np.array([0.004, 0.0012 * craft.arm, 0.0012 * craft.arm, 0.0002 * craft.arm])
    push = coloured(rng, rows, 4, 0.7) * sizes * day.gusts
    return Surroundings(wind, day.density, tank, voltage, day.clock_start, push)


def elsewhere(day: Day, altitude: float, warmer: float) -> Day:
    """The day moved to a field at another altitude and that much warmer than standard air."""
    temperature = 288.15 - 0.0065 * altitude
    pressure = (temperature / 288.15) ** (GRAVITY / (0.0065 * AIR_GAS_CONSTANT))
    return replace(
        day,
        altitude=altitude,
        pressure=pressure * day.pressure,
        temperature=(temperature + warmer) * day.temperature / 288.15,
    )
