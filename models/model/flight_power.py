"""Measure the power coefficient of a flight from its voltage, current and rotor speeds."""

from __future__ import annotations

import math

import numpy as np

from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.mode_walk import local_day
from thrustmargin.models.physics.electric_power import FlightPower

FEWEST_ROWS = 100  # in flight, of a flight whose power counts


def power_coefficient(analysis: FlightAnalysis) -> float:
    """Return k, W/rpm³, of electric power = k rho / rho_ref sum of N³ over the rotors.

    By least squares over rows in flight with all rotor speeds measured; rho_ref is the model's
    reference density. NaN with fewer than FEWEST_ROWS rows. `models.physics.electric_power` has the
    source of the law.
    """
    track, model = analysis.track, analysis.model
    cubes = np.sum(track.measured("rotor_speed_rpm") ** 3, axis=1)
    cubes = cubes * analysis.density / model.reference_density
    power = track.voltage * track.current
    rows = track.flying & np.isfinite(cubes) & np.isfinite(power) & (power > 0.0)
    if np.count_nonzero(rows) < FEWEST_ROWS:
        return math.nan
    return float(cubes[rows] @ power[rows] / (cubes[rows] @ cubes[rows]))


def flight_power(analysis: FlightAnalysis, flight: str) -> FlightPower | None:
    """Return the power coefficient of a flight with its day; None where it cannot be measured.

    `flight` is the digest of the log. A flight without a date counts as of the first day of all.
    """
    coefficient, track = power_coefficient(analysis), analysis.track
    if not coefficient > 0.0:
        return None
    start = 0.0 if track.start_unix_s is None else track.start_unix_s
    longitude = track.origin.longitude_deg if track.origin else math.nan
    return FlightPower(flight=flight, day=local_day(start, longitude), coefficient=coefficient)
