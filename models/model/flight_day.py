"""Read the day of a flight from its analysis: air, wind and battery, each with its source.

The air is that in which the analysis saw the flight. Where no thermometer was there, that is the
standard atmosphere, which counts as assumed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.rotor_model import temperature_offset
from thrustmargin.models.physics.atmosphere import (
    G0,
    GAS_CONSTANT,
    PLAUSIBLE_PRESSURE,
    SENSOR_ERROR,
    WEATHER_ERROR,
    track_air,
)
from thrustmargin.models.physics.day import UNKNOWN_DAY, UNKNOWN_VALUE, Day, DaySource, DayValue
from thrustmargin.models.physics.known_battery import battery_resistance
from thrustmargin.models.provenance import Meaning, SourceKind

REST_S = 10.0  # s before take-off in which the battery is looked at
IDLE = 0.05  # motor output below which a motor draws next to nothing
MOST_UNSURE = 0.3  # standard error of a resistance as a share, with which it still counts
FEWEST_AT_REST = 3  # rows of voltage at rest that count


def flight_day(
    analysis: FlightAnalysis, row: int, *, heard: DaySource = DaySource.LOG, voltage: float | None
) -> Day:
    """Return the day (air, wind, battery) of a flight, with the air and battery of one `row`.

    `heard` is the source of measured values, log or link. `voltage` is the V under load in that row
    that the fill is computed with; None: the day has no battery. It counts as assumed if the row
    reports none. The wind is the flight's mean; unknown where none is reported.
    """
    track = analysis.track
    at_s = float(track.time_s[row])
    day = replace(_air(analysis, row, heard), wind=flight_wind(track, heard=heard)[0])
    if voltage is None:
        return day
    shown = track.voltage[row] > 0.0
    loaded = DayValue(float(voltage), heard if shown else DaySource.DEFAULT, at_s=at_s)
    return replace(day, loaded_voltage=loaded)


def day_before_take_off(analysis: FlightAnalysis, *, heard: DaySource = DaySource.LOG) -> Day:
    """Return the day (air, battery at rest) of a flight as known before it takes off.

    A standard-atmosphere temperature is left out, because nobody measured it. Voltage and air are
    unknown where the log begins in flight or reports none. Wind is left out: an aircraft on the
    ground cannot measure it. The battery's resistance is estimated from the flight.
    """
    flying = np.flatnonzero(analysis.track.flying)
    first = int(flying[0]) if flying.size else analysis.track.time_s.size
    day = _day_at_rest(analysis, slice(0, first), heard)
    return replace(day, battery_resistance=_resistance(analysis.track, heard))


def day_on_ground(analysis: FlightAnalysis, *, heard: DaySource = DaySource.LINK) -> Day:
    """Return the day (air, battery at rest) of an aircraft that is on the ground now, by its rows
    since the last landing.

    A temperature of the standard atmosphere is left out, since nobody measured it; so are wind and
    the battery's resistance. Voltage and air are unknown without a row on the ground or a report.
    `heard` is the source of the values.
    """
    flying = np.flatnonzero(analysis.track.flying)
    since = int(flying[-1]) + 1 if flying.size else 0
    return _day_at_rest(analysis, slice(since, analysis.track.time_s.size), heard)


def _day_at_rest(analysis: FlightAnalysis, rows: slice, heard: DaySource) -> Day:
    """Return the day of `rows` on the ground: air of the last row, voltage of the battery at rest.

    An assumed temperature counts as unknown. `heard` is the source to name.
    """
    if analysis.track.time_s.size == 0:
        return UNKNOWN_DAY
    air = _air(analysis, max(rows.stop - 1, 0), heard)
    if air.air_temperature.source.assumed:
        air = replace(air, air_temperature=UNKNOWN_VALUE)
    return replace(air, battery_voltage=_rest_voltage(analysis.track, rows, heard))


def flight_wind(track: FlightTrack, *, heard: DaySource = DaySource.LOG) -> tuple[DayValue, float]:
    """Return the mean wind of a flight, m/s, and where it comes from, degrees clockwise from north.

    Both are unknown (NaN) where no row in flight reports the wind.
    """
    winds = track.wind_ned[track.flying, :2]
    winds = winds[np.isfinite(winds).all(axis=1)]
    if not len(winds):
        return UNKNOWN_VALUE, float("nan")
    north, east = winds.mean(axis=0)
    from_deg = float(np.degrees(np.arctan2(-east, -north))) % 360.0
    return DayValue(float(np.hypot(north, east)), heard), from_deg


def _air(analysis: FlightAnalysis, row: int, heard: DaySource) -> Day:
    """Return the air of a row as a `Day`: temperature, and pressure or else height, with their
    errors.

    Empty (UNKNOWN_DAY) where the density was given. Without a measured temperature its source is
    the standard atmosphere. Pressure counts only if plausible; with neither pressure nor height the
    day has only the temperature. `heard` is the source of measured values.
    """
    track = analysis.track
    if analysis.density_given:
        return UNKNOWN_DAY
    air = track_air(track, temperature_offset(analysis.model))
    source = track.source("temperature")
    measured = "temperature" in track.standard_errors or (
        source.meaning is Meaning.BOARD_TEMPERATURE
    )
    found = DaySource.STANDARD
    if measured and track.reports("temperature"):
        found = DaySource.OPTION if source.kind is SourceKind.STATED else heard
    low, high = PLAUSIBLE_PRESSURE
    pressure, height = float(track.pressure[row]), float(track.altitude[row])
    by_pressure = low <= pressure <= high
    of_pressure = SENSOR_ERROR if by_pressure else WEATHER_ERROR
    kelvin, share = float(air.temperature[row]), float(air.density_error[row] / air.density[row])
    error = kelvin * float(np.sqrt(max(share**2 - of_pressure**2, 0.0)))
    day = Day(air_temperature=DayValue(kelvin, found, error))
    if by_pressure:
        return replace(day, pressure=DayValue(pressure, heard, of_pressure * pressure))
    if np.isfinite(height):
        # As pressure falls with height: by g/(R T) a metre.
        metres = of_pressure * GAS_CONSTANT * kelvin / G0
        return replace(day, height=DayValue(height, heard, metres))
    return day


def _resistance(track: FlightTrack, heard: DaySource) -> DayValue:
    """Return the resistance of the battery as the flight shows it; unknown where it is unsure by
    MOST_UNSURE or more."""
    ohm, error = battery_resistance(track.time_s, track.voltage, track.current, track.flying)
    if not (ohm > 0.0 and error < MOST_UNSURE * ohm):
        return UNKNOWN_VALUE
    return DayValue(ohm, heard, error)


def _rest_voltage(track: FlightTrack, rows: slice, heard: DaySource) -> DayValue:
    """Return the median voltage of the last REST_S s at rest in `rows`.

    A row is at rest while no motor output or rotor speed shows a turning motor. Unknown with fewer
    than FEWEST_AT_REST such rows.
    """
    output, speed = track.throttle[rows], track.rotor_speed_rpm[rows]
    with np.errstate(invalid="ignore"):
        idle = ~np.any(output > IDLE, axis=1) & ~np.any(speed > 0.0, axis=1)
    known = np.flatnonzero(idle & (track.voltage[rows] > 0.0))
    if known.size < FEWEST_AT_REST:
        return UNKNOWN_VALUE
    time_s, volts = track.time_s[rows], track.voltage[rows]
    last = known[time_s[known] >= time_s[known[-1]] - REST_S]
    return DayValue(float(np.median(volts[last])), heard, at_s=float(time_s[last[-1]]))
