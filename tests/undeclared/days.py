"""The day of a flight: air, wind, fill, pack, and how good its instruments are."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tests.undeclared.missions import FINE_STEP, coloured, rounded
from tests.undeclared.physics import (
    GRAVITY,
    Motion,
    Physics,
    Surroundings,
    air_density,
    standard_air,
)


@dataclass(frozen=True, kw_only=True)
class Day:
    """Air and instruments of one flight."""

    altitude: float = 0.0  # m of the field above the sea
    pressure: float = 101325.0  # Pa
    temperature: float = 288.15  # K of the air
    board_heat: float = 25.0  # K by which the autopilot's thermometer reads warm
    wind: tuple[float, float] = (0.0, 0.0)  # m/s north, east
    turbulence: float = 0.4  # m/s
    fill: float = 12.0  # kg in the tank at take-off
    flow: float = 2.5  # L/min while the pump is on
    charge: float = 0.97  # of the pack at take-off
    pack_wh: float = 800.0  # Wh
    gauge_offset: float = 0.0  # kg
    gauge_gain: float = 1.0
    rotor_noise_rpm: float = 8.0
    gusts: float = 1.0  # size of the pushes that no law explains
    clock_start: float = 0.0  # s of the season
    wind_reported: bool = True
    barometer: bool = True
    thermometer: bool = True

    @property
    def density(self) -> float:
        return air_density(self.pressure, self.temperature)


def random_day(rng: np.random.Generator, *, still: bool = False) -> Day:
    """A day at the calibration field: sea level, standard air but for small changes."""
    strength, direction = rng.uniform(0.0, 2.5), rng.uniform(0.0, 2 * np.pi)
    return Day(
        pressure=101325.0 * (1.0 + 0.0004 * float(rng.standard_normal())),
        temperature=288.15 * (1.0 + 0.0004 * float(rng.standard_normal())),
        board_heat=25.0 + 0.5 * float(rng.standard_normal()),
        wind=(float(strength * np.cos(direction)), float(strength * np.sin(direction))),
        turbulence=0.05 if still else float(rng.uniform(0.1, 0.6)),
        fill=float(rng.uniform(4.0, 16.0)),
        flow=float(rng.uniform(1.5, 4.5)),
        charge=float(rng.uniform(0.85, 1.0)),
        pack_wh=float(rng.uniform(450.0, 1000.0)),
        gauge_offset=0.04 * float(rng.standard_normal()),
        gauge_gain=1.0 + 0.003 * float(rng.standard_normal()),
        rotor_noise_rpm=float(rng.uniform(6.0, 10.0)),
        gusts=float(rng.uniform(0.5, 1.5)),
        wind_reported=bool(rng.random() < 0.75),
    )


def surroundings(
    physics: Physics, motion: Motion, day: Day, rng: np.random.Generator
) -> Surroundings:
    """Wind, tank, pack and pushes along a motion."""
    rows = motion.time.size
    # An aircraft a metre wide does not lean after what changes within a tenth of a second.
    swirl = rounded(coloured(rng, rows, 3, 3.0), 0.16) * day.turbulence * np.array([1.0, 1.0, 0.35])
    wind = np.array([day.wind[0], day.wind[1], 0.0]) + swirl
    used = np.cumsum(motion.spraying) * FINE_STEP * day.flow / 60.0
    tank = np.maximum(day.fill * physics.gauge_gain - used, 0.0)
    weight = (physics.empty_mass + physics.hidden_mass + tank) * GRAVITY
    # Hover power by momentum theory with a figure of merit of 0.6; a 14-cell pack of 4.2 V a
    # cell full and 0.05 ohm.
    disc = np.pi * physics.propeller_diameter**2 / 4.0
    power = weight**1.5 / np.sqrt(2.0 * day.density * disc * physics.layout.rotors) / 0.6
    left = day.charge - np.cumsum(power) * FINE_STEP / (day.pack_wh * 3600.0)
    voltage = 14.0 * (3.4 + 0.8 * np.maximum(left, 0.0)) - 0.05 * power / 52.0
    push = coloured(rng, rows, 4, 0.7) * np.array([1.2, 0.35, 0.35, 0.06]) * day.gusts
    return Surroundings(wind, day.density, tank, voltage, day.clock_start, push)


def elsewhere(day: Day, altitude: float, warmer: float) -> Day:
    """The day moved to a field at another altitude and that much warmer than standard air."""
    pressure, temperature = standard_air(altitude)
    return replace(
        day,
        altitude=altitude,
        pressure=pressure * day.pressure / 101325.0,
        temperature=(temperature + warmer) * day.temperature / 288.15,
    )
