"""A fitting problem: rows of several flights with channels, measured speeds and blocks of time.

Rows without information about the model are dropped: on the ground, within take-off and landing, or
with a rotor speed, airspeed or tank level missing. Statistics use blocks (BLOCK_SECONDS of one
flight) and flights as units, because rows within one are correlated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.checks.instruments import with_air_temperature
from thrustmargin.models.effects import effects_for
from thrustmargin.models.effects.base import Effect, Placed
from thrustmargin.models.effects.channels import STEADY_SPAN, Channels, concatenate
from thrustmargin.models.effects.compose import BaseTable, fill_neutral, rotor_speed_rpm
from thrustmargin.models.errors import AirframeError, DataError
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.identification.rows.modes import Modes, modes
from thrustmargin.models.identification.rows.output_shares import (
    of_outputs,
    scaled_to,
    spread_of_flights,
)
from thrustmargin.models.model.rotor_model import RotorModel, model_channels, table_of
from thrustmargin.models.physics.flight_phases import training_rows
from thrustmargin.models.physics.smoothing import moving_mean
from thrustmargin.models.provenance import Meaning

BLOCK_SECONDS = 10.0  # rows of one block are correlated, blocks are not
LEAST_ROWS = 100  # rows that a flight needs
MOST_ROWS = 9_000  # rows of all flights together
ENOUGH_ROWS = 3_000  # rows enough to refit values: about as many as the search has means
#: a window channel is optional if more of the rows lack it (ends and gaps of short flights)
WINDOW_SHARE = 0.5
MISSING_SHARE = 0.02  # a channel with a larger share of missing rows counts as unreported


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RowsToFit:
    """T rows of F flights, one flight after the other, R rotors."""

    model: RotorModel
    base: BaseTable  # of numpy arrays
    modes: Modes
    channels: Channels  # numpy
    measured_rpm: Floats  # (T, R)
    flight: NDArray[np.intp]  # (T,) flight of each row, 0-based
    follows: Bools  # (T,) the row directly follows the row before it
    names: tuple[str, ...]  # of the flights
    of_outputs: bool  # speeds are from motor outputs: only each rotor's share counts

    @property
    def flights(self) -> int:
        """Return the number of flights F."""
        return len(self.names)

    @property
    def placed(self) -> tuple[Placed, ...]:
        """Return the effects that the model already has."""
        return self.model.placed

    def lacks(self, effect: Effect) -> tuple[str, ...]:
        """Return the channels that the effect needs or reads and that are missing on any row."""
        read = dict.fromkeys((*effect.needs, *effect.neutral))
        return tuple(name for name in read if not _is_complete(self.channels.read(name)))

    def speeds(self, placed: Sequence[Placed] = (), *, without: int | None = None) -> Floats:
        """Predict rotor speeds (T, R), rpm, by the model with the additional effects `placed`.

        `without` removes the model's own effect of that index. For motor outputs, speeds are scaled
        to the measured sum of squares of each row.
        """
        own = [item for k, item in enumerate(self.placed) if k != without]
        with np.errstate(invalid="ignore", over="ignore"):
            speed = rotor_speed_rpm(self.base, (*own, *placed), self.channels)
            if self.of_outputs:
                speed = scaled_to(np.sum(self.measured_rpm**2, axis=1), speed)
        return speed

    def mode_amplitudes(self, speed_rpm: Floats) -> Floats:
        """Return the mode amplitudes (..., R), rpm, of speeds or speed differences (..., R)."""
        return speed_rpm @ self.modes.directions


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Problem(RowsToFit):
    """Rows of flights, divided into B blocks of time."""

    block: NDArray[np.intp]  # (T,) block of each row, increasing
    block_flight: NDArray[np.intp]  # (B,) flight of each block
    durations: Floats  # (F,) s from first to last row
    background_rpm: Floats  # (R,) between-flight standard deviation of each mode's mean

    @property
    def stride(self) -> int:
        """Return the stride that leaves about ENOUGH_ROWS rows, enough to refit values."""
        return max(1, self.measured_rpm.shape[0] // ENOUGH_ROWS)

    @property
    def flight_start_unix_s(self) -> Floats:
        """Return the Unix time (F,) of each flight's first row, NaN where the log has no clock."""
        first = np.unique(self.flight, return_index=True)[1]
        return self.channels.clock_s[first]

    @property
    def first_row_s(self) -> Floats:
        """Return the time (F,) s of each flight's first row since the flight's start."""
        return self.channels.time_s[np.unique(self.flight, return_index=True)[1]]

    def rows(self, which: NDArray[np.intp]) -> Problem:
        """Return the rows with the increasing indices `which`.

        Flights and blocks without a selected row are dropped and the others renumbered.
        """
        flights, flight = np.unique(self.flight[which], return_inverse=True)
        blocks, block = np.unique(self.block[which], return_inverse=True)
        return replace(
            self,
            channels=self.channels.rows(which),
            measured_rpm=self.measured_rpm[which],
            flight=flight,
            follows=self.follows[which] & (np.diff(which, prepend=-2) == 1),
            names=tuple(self.names[f] for f in flights),
            block=block,
            block_flight=np.searchsorted(flights, self.block_flight[blocks]),
            durations=self.durations[flights],
        )


def airspeed_is_ground_speed(track: FlightTrack) -> bool:
    """Return True if the airspeed is ground speed, for lack of a sensor and of a wind."""
    return track.source("airspeed").meaning is Meaning.GROUND_SPEED


def _is_complete(channel: Any) -> bool:
    """Return True if a channel, or each of a tuple of channels, is finite on every row."""
    if isinstance(channel, tuple):
        return all(_is_complete(c) for c in channel)
    return isinstance(channel, np.ndarray) and bool(np.isfinite(channel).all())


def assemble(model: RotorModel, tracks: Sequence[FlightTrack]) -> Problem:
    """Assemble the rows of the flights that can be fitted, thinned to about MOST_ROWS.

    Raises AirframeError for a wrong rotor count, and DataError when a flight has too few rows or
    when measured speeds and motor outputs are mixed.
    """
    of_outputs(tracks)  # raises if measured speeds and outputs are mixed
    stride = row_stride(model, tracks)
    return join_flights([thin_rows(assemble_flight(model, track), stride) for track in tracks])


def row_stride(model: RotorModel, tracks: Sequence[FlightTrack]) -> int:
    """Return the stride that leaves about MOST_ROWS rows of all flights together."""
    rows = sum(int(training_rows(track, model.inputs).sum()) for track in tracks)
    return max(1, -(-rows // MOST_ROWS))


def usable_seconds(model: RotorModel, track: FlightTrack) -> float:
    """Return the time, s, that the fittable rows of a flight cover."""
    rows = training_rows(track, model.inputs)
    return float(rows.sum() * np.median(np.diff(track.time_s))) if rows.any() else 0.0


def assemble_flight(model: RotorModel, track: FlightTrack) -> Problem:
    """Assemble all rows of one flight that can be fitted, not thinned.

    Rows without an input that the model needs are dropped; so are rows without an optional channel,
    if there are few of them. Raise AirframeError for a wrong rotor count, DataError with fewer than
    LEAST_ROWS rows.
    """
    airframe = model.airframe
    if track.rotor_count != airframe.rotor_count:
        raise AirframeError(
            f"{track.name}: {track.rotor_count} rotors, but airframe {airframe.name} has "
            f"{airframe.rotor_count}; give the right airframe with --airframe"
        )
    if model.network is None and airspeed_is_ground_speed(track):
        track = replace(track, airspeed=np.full_like(track.airspeed, np.nan))
    track = with_air_temperature(track, model.thermometer)
    track = replace(track, voltage=_smooth_voltage(track))
    channels = model_channels(model, track, effects=effects_for(airframe))
    keep = training_rows(track, model.inputs)
    if "airspeed" in model.inputs:
        keep &= np.isfinite(channels.airspeed_shifts).all(axis=1)
    for optional in (
        channels.airspeed_shifts,
        channels.load_factor_shifts,
        channels.rate_shifts[2],
    ):
        good = np.isfinite(optional).all(axis=1)
        if np.sum(keep & ~good) < WINDOW_SHARE * np.sum(keep):
            keep &= good
    for optional in (channels.voltage, channels.radius_over_height, channels.advance_ratio):
        good = np.isfinite(optional)
        if np.sum(keep & ~good) < MISSING_SHARE * np.sum(keep):
            keep &= good
    rows = np.flatnonzero(keep)
    if rows.size < LEAST_ROWS:
        raise DataError(
            f"{track.name}: {rows.size} rows in flight with rotor speeds and all that the "
            f"model needs; {LEAST_ROWS} are needed. Look at it with: thrustmargin inspect"
        )
    channels = channels.rows(rows)
    for item in model.placed:
        channels = fill_neutral(item.effect, item.values, channels)
    elapsed = track.time_s[rows] - track.time_s[rows[0]]
    whole = max(1, round(float(elapsed[-1]) / BLOCK_SECONDS))
    block = np.minimum((elapsed / (elapsed[-1] / whole + 1e-9)).astype(np.intp), whole - 1)
    block = np.unique(block, return_inverse=True)[1]
    return Problem(
        model=model,
        base=table_of(model),
        channels=channels,
        measured_rpm=track.rotor_speed_rpm[rows],
        flight=np.zeros(rows.size, dtype=np.intp),
        block=block,
        block_flight=np.zeros(int(block.max()) + 1, dtype=np.intp),
        follows=np.concatenate([[False], np.diff(rows) == 1]),
        names=(track.name,),
        durations=np.array([float(elapsed[-1])]),
        modes=modes(airframe),
        background_rpm=np.array(model.background_rpm or np.zeros(airframe.rotor_count)),
        of_outputs=of_outputs([track]),
    )


def _smooth_voltage(track: FlightTrack) -> Floats:
    """Return the voltage (T,), V, averaged over STEADY_SPAN in flight, NaN where unreported.

    Noise in a regressor biases an exponent towards zero. Source: Fuller 1987, Measurement Error
    Models, chapter 1 (attenuation).
    """
    in_flight = np.where(track.flying, track.voltage, np.nan)
    mean = moving_mean(track.time_s, in_flight, STEADY_SPAN)
    return np.where(np.isfinite(track.voltage), mean, np.nan)


def thin_rows(problem: Problem, stride: int) -> Problem:
    """Return every `stride`-th row."""
    which = np.arange(0, problem.measured_rpm.shape[0], stride)
    return problem if stride == 1 else problem.rows(which)


def join_flights(parts: Sequence[Problem]) -> Problem:
    """Concatenate the problems of single flights of one aircraft, and number flights and blocks
    anew.

    For motor outputs, `background_rpm` becomes the larger of the model's and these flights' spread.
    """
    counts = np.cumsum([0, *(p.block_flight.size for p in parts)])
    problem = replace(
        parts[0],
        channels=concatenate([p.channels for p in parts]),
        measured_rpm=np.concatenate([p.measured_rpm for p in parts]),
        flight=np.concatenate([p.flight + k for k, p in enumerate(parts)]),
        block=np.concatenate([p.block + k for p, k in zip(parts, counts[:-1], strict=True)]),
        block_flight=np.concatenate([p.block_flight + k for k, p in enumerate(parts)]),
        follows=np.concatenate([p.follows for p in parts]),
        names=tuple(name for p in parts for name in p.names),
        durations=np.concatenate([p.durations for p in parts]),
    )
    if not problem.of_outputs:
        return problem
    residual = problem.mode_amplitudes(problem.measured_rpm - problem.speeds())
    spread = spread_of_flights(residual, problem.flight, problem.background_rpm)
    return replace(problem, background_rpm=spread)
