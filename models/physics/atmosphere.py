"""Density of the air that the rotors work in.

International Standard Atmosphere, troposphere (ISO 2533:1975, U.S. Standard Atmosphere 1976):
    T = T0 - L h          p = p0 (T/T0)^(g0/(R L))          rho = p/(R T)
with h the altitude in m AMSL, taken as geopotential (0.05 % apart at 3 km).
A temperature offset moves T at a given altitude and leaves p as it is ("ISA + 15").
Air is taken as dry: at 30 degC and 80 % humidity the true density is 1.5 % lower.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from thrustmargin.models.flight import FlightTrack, Floats

G0 = 9.80665  # m/s², standard gravity
GAS_CONSTANT = 287.05287  # J/(kg K), dry air
SEA_LEVEL_TEMPERATURE = 288.15  # K
SEA_LEVEL_PRESSURE = 101_325.0  # Pa
LAPSE_RATE = 0.0065  # K/m
SEA_LEVEL_DENSITY = 1.225  # kg/m³
_EXPONENT = G0 / (GAS_CONSTANT * LAPSE_RATE)

#: Pa. A static pressure outside these (about 9200 m, and 700 m below the sea) is a sensor fault.
PLAUSIBLE_PRESSURE = (30_000.0, 110_000.0)


def isa_temperature(altitude: ArrayLike, temperature_offset: float = 0.0) -> Floats:
    """Temperature, K, at `altitude` in m AMSL (any shape); ISO 2533."""
    return SEA_LEVEL_TEMPERATURE - LAPSE_RATE * _floats(altitude) + temperature_offset


def isa_pressure(altitude: ArrayLike) -> Floats:
    """Static pressure, Pa, at `altitude` in m AMSL (any shape); ISO 2533."""
    return SEA_LEVEL_PRESSURE * (isa_temperature(altitude) / SEA_LEVEL_TEMPERATURE) ** _EXPONENT


def pressure_altitude(pressure: ArrayLike) -> Floats:
    """Altitude, m, at which the standard atmosphere has `pressure` in Pa; ISO 2533 inverted."""
    ratio = _floats(pressure) / SEA_LEVEL_PRESSURE
    return SEA_LEVEL_TEMPERATURE / LAPSE_RATE * (1.0 - ratio ** (1.0 / _EXPONENT))


def air_density(pressure: ArrayLike, temperature: ArrayLike) -> Floats:
    """Density, kg/m³, of dry air at `pressure` in Pa and outside `temperature` in K."""
    return _floats(pressure) / (GAS_CONSTANT * _floats(temperature))


def isa_density(altitude: ArrayLike, temperature_offset: float = 0.0) -> Floats:
    """Density, kg/m³, at `altitude` in m AMSL with the temperature `temperature_offset` K off."""
    return air_density(isa_pressure(altitude), isa_temperature(altitude, temperature_offset))


def track_density(track: FlightTrack, temperature_offset: float = 0.0) -> tuple[Floats, str]:
    """Density (T,) kg/m³ of a flight's air, and in words what it was made from.

    Row by row the first that is there: static pressure, with the standard temperature of its
    altitude; altitude AMSL in the standard atmosphere; the flight's own median (a field differs
    by some tens of metres, 1 % of density is 100 m). A flight with neither pressure nor altitude
    gets 1.225 kg/m³, called assumed. The autopilot's own temperature is not used: its sensor sits
    on a warm board and makes the density 6 to 12 % too low. 10 K between the true and the standard
    temperature is 3.5 % of density; `temperature_offset` in K puts a known difference in.
    """
    low, high = PLAUSIBLE_PRESSURE
    reported = np.isfinite(track.pressure)
    by_pressure = reported & (track.pressure >= low) & (track.pressure <= high)
    by_altitude = ~by_pressure & np.isfinite(track.altitude)
    altitude = np.where(np.isfinite(track.altitude), track.altitude, np.nan)
    pressure = np.where(by_pressure, track.pressure, np.nan)
    level = np.where(np.isfinite(altitude), altitude, pressure_altitude(pressure))
    density = np.where(
        by_pressure,
        air_density(pressure, isa_temperature(level, temperature_offset)),
        isa_density(altitude, temperature_offset),
    )

    isa = "standard atmosphere" + (
        f" {temperature_offset:+g} K" if temperature_offset else " (outside temperature not known)"
    )
    known = np.isfinite(density)
    if not np.any(known):
        basis = (
            f"assumed {SEA_LEVEL_DENSITY} kg/m³ (sea level, 15 °C): "
            "neither pressure nor altitude was reported"
        )
        return np.full(track.time_s.size, SEA_LEVEL_DENSITY), basis
    parts = []
    if np.any(by_pressure):
        parts.append(f"static pressure and the temperature of the {isa}")
    if np.any(by_altitude):
        where = f" in {_rows(by_altitude)}" if parts else ""
        parts.append(f"altitude in the {isa}{where}")
    if not np.all(known):
        parts.append(f"the flight's median in {_rows(~known)} that reported neither")
    faulty = reported & ~by_pressure
    if np.any(faulty):
        parts.append(
            f"pressure outside {low / 100:.0f}..{high / 100:.0f} hPa ignored in {_rows(faulty)}"
        )
    return np.where(known, density, np.nanmedian(density)), "; ".join(parts)


def _floats(values: ArrayLike) -> Floats:
    return np.asarray(values, dtype=np.float64)


def _rows(mask: np.ndarray) -> str:
    count = int(np.count_nonzero(mask))
    return f"{count} row" + ("s" if count != 1 else "")
