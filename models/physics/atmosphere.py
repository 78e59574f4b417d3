"""Compute the density of the air that the rotors work in.

International Standard Atmosphere, troposphere (ISO 2533:1975, U.S. Standard Atmosphere 1976):
    T = T0 - L h          p = p0 (T/T0)^(g0/(R L))          rho = p/(R T)
with h the altitude in m AMSL, taken as geopotential (0.05 % apart at 3 km).
A temperature offset changes T at a given altitude, not p ("ISA + 15").
Air is taken as dry: at 30 degC and 80 % humidity the true density is 1.5 % lower.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike

from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.provenance import Meaning
from thrustmargin.models.statement import Statement, state
from thrustmargin.models.units import G0

GAS_CONSTANT = 287.05287  # J/(kg K), dry air
SEA_LEVEL_TEMPERATURE = 288.15  # K
SEA_LEVEL_PRESSURE = 101_325.0  # Pa
LAPSE_RATE = 0.0065  # K/m
SEA_LEVEL_DENSITY = 1.225  # kg/m³
_EXPONENT = G0 / (GAS_CONSTANT * LAPSE_RATE)

#: Pa. A static pressure outside these (about 9200 m, and 700 m below the sea) is a sensor fault.
PLAUSIBLE_PRESSURE = (30_000.0, 110_000.0)

#: K: the autopilot's sensor sits on a warm board. Median and scatter over five flights of a
#: Pixhawk 6X (11 to 23 K); ArduPilot's own simulator has 20 K too.
BOARD_WARMER, BOARD_ERROR = 20.0, 6.0
#: K, standard error of an air temperature that a person states: a thermometer in the shade, a
#: weather report.
STATED_TEMPERATURE_ERROR = 2.0
#: K: weather about the standard atmosphere, from a cold morning to a hot noon of the season
STANDARD_ERROR = 10.0
FARTHEST_FROM_STANDARD = 40.0  # K beyond which a reading is a fault
#: Standard errors as shares of density: a static sensor with dry air assumed; with unknown weather
SENSOR_ERROR, WEATHER_ERROR = 0.005, 0.012
ASSUMED_ERROR = 0.1  # kg/m³ of air of which nothing is known: sea level to 2 km


def isa_temperature(altitude: ArrayLike) -> Floats:
    """Return the temperature, K, at `altitude` in m AMSL (any shape); ISO 2533."""
    return SEA_LEVEL_TEMPERATURE - LAPSE_RATE * _floats(altitude)


def isa_pressure(altitude: ArrayLike) -> Floats:
    """Return the static pressure, Pa, at `altitude` in m AMSL (any shape); ISO 2533."""
    return SEA_LEVEL_PRESSURE * (isa_temperature(altitude) / SEA_LEVEL_TEMPERATURE) ** _EXPONENT


def pressure_altitude(pressure: ArrayLike) -> Floats:
    """Return the altitude, m, at which the standard atmosphere has `pressure` in Pa; ISO 2533
    inverted."""
    ratio = _floats(pressure) / SEA_LEVEL_PRESSURE
    return SEA_LEVEL_TEMPERATURE / LAPSE_RATE * (1.0 - ratio ** (1.0 / _EXPONENT))


def air_density(pressure: ArrayLike, temperature: ArrayLike) -> Floats:
    """Return the density, kg/m³, of dry air at `pressure` in Pa and outside `temperature` in K."""
    return _floats(pressure) / (GAS_CONSTANT * _floats(temperature))


def isa_air(density: ArrayLike) -> tuple[Floats, Floats]:
    """Return the pressure, Pa, and temperature, K, of the standard atmosphere where it has
    `density`, kg/m³; ISO 2533 inverted."""
    density = _floats(density)
    ratio = (density / SEA_LEVEL_DENSITY) ** (1.0 / (_EXPONENT - 1.0))
    temperature = SEA_LEVEL_TEMPERATURE * ratio
    return density * GAS_CONSTANT * temperature, temperature


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Air:
    """The air of T rows of a flight, with its origin in words."""

    density: Floats  # (T,) kg/m³
    density_error: Floats  # (T,) kg/m³, standard error
    temperature: Floats  # (T,) K, outside, consistent with the density
    basis: Statement


#: Cache by track and temperature offset: several parts of an analysis need the air.
_AIR: WeakKeyDictionary[FlightTrack, dict[float, Air]] = WeakKeyDictionary()


def track_air(track: FlightTrack, temperature_offset: float = 0.0) -> Air:
    """Return the air of a flight, from the best pressure and outside temperature in each row.

    Pressure: static; else by altitude AMSL in the standard atmosphere; else the flight's median
    density (over a field altitude differs by some tens of metres, and 1 % of density is 100 m).
    With neither in the whole flight, density is assumed as 1.225 kg/m³. Temperature: outside, if
    the track has it with a standard error; else a reading of the autopilot's board less
    BOARD_WARMER; else the standard atmosphere. 10 K are 3.5 % of density. `temperature_offset`, K,
    is added to the temperature.
    """
    fields = _AIR.setdefault(track, {})
    if temperature_offset not in fields:
        fields[temperature_offset] = _compute_air(track, temperature_offset)
    return fields[temperature_offset]


def _compute_air(track: FlightTrack, temperature_offset: float) -> Air:
    """Compute density, kg/m³, its standard error, temperature, K, and the basis of the air of each
    row.

    Density is by pressure where it is plausible, else by altitude. Rows with neither have the
    median of the other rows; without any the density is that at sea level, stated as assumed.
    `temperature_offset`, K, is added to the temperature.
    """
    low, high = PLAUSIBLE_PRESSURE
    reported = np.isfinite(track.pressure)
    by_pressure = reported & (track.pressure >= low) & (track.pressure <= high)
    by_altitude = ~by_pressure & np.isfinite(track.altitude)
    altitude = np.where(np.isfinite(track.altitude), track.altitude, np.nan)
    pressure = np.where(by_pressure, track.pressure, np.nan)
    level = np.where(np.isfinite(altitude), altitude, pressure_altitude(pressure))
    temperature, error, source = _outside_temperature(track, np.nan_to_num(level))
    temperature = temperature + temperature_offset
    density = air_density(np.where(by_pressure, pressure, isa_pressure(altitude)), temperature)
    known = np.isfinite(density)
    if not np.any(known):
        basis = state("air assumed", density=SEA_LEVEL_DENSITY)
        rows = np.ones(track.time_s.size)
        return Air(
            density=SEA_LEVEL_DENSITY * rows,
            density_error=ASSUMED_ERROR * rows,
            temperature=temperature,
            basis=basis,
        )
    if temperature_offset:
        offset = dict(source.values) | {"offset": temperature_offset}
        source = state(source.kind, *source.clauses, "temperature offset", **offset)
    parts = []
    if np.any(by_pressure):
        parts.append(state("air by pressure", of=source))
    if np.any(by_altitude):
        by_it = state("air by altitude in rows", rows=_rows(by_altitude))
        parts.append(by_it if parts else state("air by altitude", of=source))
    if not np.all(known):
        parts.append(state("median air", rows=_rows(~known)))
    faulty = reported & ~by_pressure
    if np.any(faulty):
        ignored = {"low": low / 100.0, "high": high / 100.0, "rows": _rows(faulty)}
        parts.append(state("pressure ignored", **ignored))
    if not np.all(known):
        density = np.where(known, density, np.nanmedian(density))
    pressure_error = np.where(by_pressure, SENSOR_ERROR, WEATHER_ERROR)
    return Air(
        density=density,
        density_error=density * np.hypot(error / temperature, pressure_error),
        temperature=temperature,
        basis=state("air", parts=tuple(parts)),
    )


def _outside_temperature(track: FlightTrack, level: Floats) -> tuple[Floats, Floats, Statement]:
    """Return the outside temperature (T,), K, at `level` (T,), m AMSL, its standard error, and a
    source."""
    standard = isa_temperature(level)
    if "temperature" in track.standard_errors:
        temperature, error = track.temperature, track.standard_errors["temperature"]
        source = state("outside air", source=track.source("temperature"))
    elif track.source("temperature").meaning is Meaning.BOARD_TEMPERATURE:
        temperature, error = track.temperature - BOARD_WARMER, np.full(level.size, BOARD_ERROR)
        source = state("air by board", warmer=BOARD_WARMER, within=BOARD_ERROR)
    else:
        temperature = error = np.full(level.size, np.nan)
        source = state("standard atmosphere", within=STANDARD_ERROR)
    with np.errstate(invalid="ignore"):
        there = np.abs(temperature - standard) <= FARTHEST_FROM_STANDARD
    if not np.any(there):
        source = state("standard atmosphere", within=STANDARD_ERROR)
    return np.where(there, temperature, standard), np.where(there, error, STANDARD_ERROR), source


def _floats(values: ArrayLike) -> Floats:
    """Convert to an array of float64."""
    return np.asarray(values, dtype=np.float64)


def _rows(mask: np.ndarray) -> Statement:
    """Return the number of rows that are True."""
    count = int(np.count_nonzero(mask))
    return state("row" if count == 1 else "rows", count=float(count))
