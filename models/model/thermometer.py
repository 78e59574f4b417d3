"""Learn from good flights how far a log's thermometer reads above the air.

A log from a table has a temperature, but no statement whether it is of the air or of a warm circuit
board. Rotor speeds show it: at one weight and pressure N² is proportional to the air's temperature,
T (Eq. 1 with T_i ~ rho N²). If good flights agree better with the thermometer's differences than
without, its reading is used, less its mean excess over the standard atmosphere. The mean difference
of the flights' air from the standard is in the model's effect `air_density`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import (
    FARTHEST_FROM_STANDARD,
    G0,
    isa_temperature,
    pressure_altitude,
    track_air,
)
from thrustmargin.models.physics.flight_phases import training_rows
from thrustmargin.models.provenance import Meaning, Provenance, SourceKind
from thrustmargin.models.scores import t_quantile

SURE = 0.95  # probability required: standard air is off by the weather, a wrong reading by more
FEWEST_FLIGHTS = 3  # so that without one of them the others still differ


@dataclass(frozen=True, slots=True, kw_only=True)
class Thermometer:
    """The offset and error of one aircraft's thermometer as a measure of air temperature."""

    warmer_k: float  # reading minus air temperature
    error_k: float  # standard error of the air temperature, between flights


def with_air_temperature(track: FlightTrack, thermometer: Thermometer | None) -> FlightTrack:
    """Replace a thermometer's reading of unknown meaning by the air temperature estimated from it.

    Return the track unchanged without a thermometer or such a reading.
    """
    if thermometer is None or not needs_thermometer(track):
        return track
    source = Provenance(
        kind=SourceKind.INFERRED,
        name=f"the thermometer less {thermometer.warmer_k:.1f} K, as good flights show",
        parts=(track.source("temperature"),),
    )
    return replace(
        track,
        temperature=track.temperature - thermometer.warmer_k,
        sources={**track.sources, "temperature": source},
        standard_errors={
            **track.standard_errors,
            "temperature": np.full(track.time_s.size, thermometer.error_k),
        },
    )


def learnt_thermometer(tracks: Sequence[FlightTrack], airframe: Airframe) -> Thermometer | None:
    """Estimate the thermometer's offset, K, from fault-free flights.

    The offset is how much warmer the thermometer reads than the air. Return it only if it makes
    flights agree better in ln N² than the standard atmosphere does (each against the mean of the
    others; Student's t test of the squared differences); else None. Also None with fewer than
    FEWEST_FLIGHTS flights, or if a flight needs no correction.
    """
    used = [track for track in tracks if training_rows(track, ("tank_kg",)).any()]
    if len(used) < FEWEST_FLIGHTS or not all(map(needs_thermometer, used)):
        return None
    above, standard, speed = _readings_and_speeds(used, airframe)
    warmer = float(above.mean())
    if np.any(np.abs(above - warmer) > FARTHEST_FROM_STANDARD):
        return None
    by_it = speed - np.log1p((above - warmer) / standard)
    gain = (speed - _others(speed)) ** 2 - (by_it - _others(by_it)) ** 2
    limit = t_quantile(gain.size - 1, SURE)
    if not gain.mean() > limit * np.std(gain, ddof=1) / np.sqrt(gain.size):
        return None
    error = float(np.std(by_it, ddof=1) * standard.mean())
    return Thermometer(warmer_k=warmer, error_k=error)


def needs_thermometer(track: FlightTrack) -> bool:
    """Return True if a temperature is reported, and nothing states that it is that of the air or
    of a board."""
    stated = "temperature" in track.standard_errors
    board = track.source("temperature").meaning is Meaning.BOARD_TEMPERATURE
    return track.reports("temperature") and not (stated or board)


def _readings_and_speeds(
    tracks: Sequence[FlightTrack], airframe: Airframe
) -> tuple[Floats, Floats, Floats]:
    """Return three values (F,) of each flight, from its training rows.

    They are the reading's median excess over standard air, K; the temperature of standard air, K;
    and the mean of ln(sum N² rho / mass), rho by standard air, corrected for the influence of
    airspeed, climb and load factor within flights.
    """
    above, standard, speed, motion = [], [], [], []
    for track in tracks:
        rows = training_rows(track, ("tank_kg",))
        air = track_air(track)
        altitude = (
            track.altitude if track.reports("altitude") else pressure_altitude(track.pressure)
        )
        isa = isa_temperature(np.nan_to_num(altitude))[rows]
        above.append(float(np.nanmedian(track.temperature[rows] - isa)))
        standard.append(float(np.median(isa)))
        n2 = np.sum(track.rotor_speed_rpm[rows] ** 2, axis=1)
        mass = airframe.empty_mass + track.tank_kg[rows]
        speed.append(np.log(n2 * air.density[rows] / mass))
        v, down = track.airspeed[rows], track.velocity_ned[rows, 2]
        load = np.linalg.norm(track.specific_force_frd[rows], axis=1) / G0
        motion.append(np.nan_to_num(np.stack([v, v**2, v**3, down, load], axis=1)))
    within = [m - m.mean(axis=0) for m in motion]
    wanted = np.concatenate([s - s.mean() for s in speed])
    slope = np.linalg.lstsq(np.concatenate(within), wanted, rcond=None)[0]
    means = [float(np.mean(s - m @ slope)) for s, m in zip(speed, motion, strict=True)]
    return np.array(above), np.array(standard), np.array(means)


def _others(values: Floats) -> Floats:
    """Return, for each of F values, the mean of the remaining F - 1; shape (F,)."""
    return (values.sum() - values) / (values.size - 1)
