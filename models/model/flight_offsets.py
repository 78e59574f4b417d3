"""Measure how far the rotor speeds of a flight are from their model, in each mode of the layout."""

from __future__ import annotations

import math

import numpy as np

from thrustmargin.models.errors import DataError
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.mode_walk import FlightOffsets, mode_columns
from thrustmargin.models.model.rotor_model import predict, without_state

FEWEST_ROWS = 100  # of a flight that may update the walk
BLOCK_S = 5.0  # of the blocks from whose scatter the standard error of a flight's mean follows
FEWEST_BLOCKS = 4
MEDIAN_ABSOLUTE = 1.4826  # standard deviation over median absolute deviation, of a normal variable
MEDIAN_ERROR = 1.2533  # standard error of a median over that of the mean, of a normal variable


def flight_offsets(
    analysis: FlightAnalysis, *, flight: str, start_unix_s: float, longitude_deg: float
) -> FlightOffsets | None:
    """Measure the mode offsets of a flight against its model without a mode state.

    Rows count in flight, with all rotor speeds and the load measured. None with fewer than
    FEWEST_ROWS rows or FEWEST_BLOCKS blocks, and where no margin is claimed. Raises DataError for
    a log without the time of day.
    """
    if not math.isfinite(start_unix_s):
        raise DataError("the log does not say when it was flown; the order of flights is by time")
    if analysis.withheld:
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
