"""Measure what one flight teaches the model of its aircraft: offsets of its modes, and power."""

from __future__ import annotations

import math

import numpy as np

from thrustmargin.models.errors import DataError
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.mode_walk import FlightOffsets, local_day, mode_columns
from thrustmargin.models.model.rotor_model import predict, without_state
from thrustmargin.models.physics.electric_power import FlightPower

FEWEST_ROWS = 100  # in flight, of a flight that may update the walk, or whose power counts
BLOCK_S = 5.0  # of the blocks from whose scatter the standard error of a flight's mean follows
FEWEST_BLOCKS = 4
MEDIAN_ABSOLUTE = 1.4826  # standard deviation over median absolute deviation, of a normal variable
MEDIAN_ERROR = 1.2533  # standard error of a median over that of the mean, of a normal variable


def flight_offsets(
    analysis: FlightAnalysis, *, flight: str, start_unix_s: float, longitude_deg: float
) -> FlightOffsets | None:
    """Measure the mode offsets of a flight against its model without a mode state.

    Rows count in flight, with all rotor speeds and the load measured. None with fewer than
    FEWEST_ROWS rows or FEWEST_BLOCKS blocks, or for an unknown aircraft. Raises DataError for
    a log without the time of day.
    """
    if not math.isfinite(start_unix_s):
        raise DataError("the log does not say when it was flown; the order of flights is by time")
    if analysis.no_verdict:
        return None
    track, model = analysis.track, without_state(analysis.model)
    predicted = analysis.prediction.rotor_speed_rpm
    if model is not analysis.model:
        predicted = predict(model, track, analysis.density, start=analysis.start).rotor_speed_rpm
    share = (track.measured("rotor_speed_rpm") - predicted) / np.mean(
        predicted, axis=1, keepdims=True
    )
    rows = track.flying & np.isfinite(track.measured("tank_kg")) & np.isfinite(share).all(axis=1)
    if np.count_nonzero(rows) < FEWEST_ROWS:
        return None
    columns = mode_columns(model.airframe)
    modes = share[rows] @ columns / len(columns)
    block = np.floor(track.time_s[rows] / BLOCK_S).astype(np.int64)
    _, which, counts = np.unique(block, return_inverse=True, return_counts=True)
    if counts.size < FEWEST_BLOCKS:
        return None
    means = np.stack([np.bincount(which, mode) / counts for mode in modes.T], axis=1)
    # Medians: the first and last seconds off the ground are not those of a flight.
    middle = np.median(means, axis=0)
    scatter = MEDIAN_ABSOLUTE * np.median(np.abs(means - middle), axis=0)
    error = MEDIAN_ERROR * scatter / math.sqrt(counts.size)
    return FlightOffsets(
        flight=flight,
        start_unix_s=start_unix_s,
        longitude_deg=longitude_deg,
        offset=tuple(middle.tolist()),
        error=tuple(error.tolist()),
        rows=int(np.count_nonzero(rows)),
    )


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

    `flight` is the digest of the log. A flight without a date counts as of the earliest day.
    """
    coefficient, track = power_coefficient(analysis), analysis.track
    if not coefficient > 0.0:
        return None
    start = 0.0 if track.start_unix_s is None else track.start_unix_s
    longitude = track.origin.longitude_deg if track.origin else math.nan
    return FlightPower(flight=flight, day=local_day(start, longitude), coefficient=coefficient)
