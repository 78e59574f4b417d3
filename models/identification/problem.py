"""A fitting problem: the rows of several flights, with channels, measured speeds and blocks.

Rows that say nothing about the model are left out: on the ground, within take-off and landing, or
with a rotor speed, airspeed or tank level missing. The unit of everything statistical is the block
(BLOCK_SECONDS of one flight) and the flight; rows within one are correlated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.effects import effects_for
from thrustmargin.models.effects.base import Effect, Placed
from thrustmargin.models.effects.channels import Channels, concatenate
from thrustmargin.models.effects.compose import BaseTable, filled, rotor_speed_rpm
from thrustmargin.models.errors import AirframeError, DataError
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.identification.base_uncertainty import base_uncertainty_rpm
from thrustmargin.models.identification.modes import Modes, modes
from thrustmargin.models.identification.output_shares import (
    of_outputs,
    scaled_to,
    spread_of_flights,
)
from thrustmargin.models.model.predict import model_channels, table_of
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.physics.flight_phases import training_rows

BLOCK_SECONDS = 10.0
LEAST_ROWS = 100
MOST_ROWS = 9_000
WINDOW_SHARE = 0.5  # rows beside an end or a gap lack what lies around them, most in short flights
MISSING_SHARE = 0.02  # a channel with more rows missing than this is not there


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Background:
    """Errors of the base model that new flights meet whatever is missing, in scales of the modes.

    A `constant` (R,) of its own in each flight, known from `degrees` of freedom, and `directions`
    (D, T, R) that all flights share.
    """

    constant: Floats
    directions: Floats
    degrees: float = np.inf


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Problem:
    """T rows of F flights in B blocks, R rotors."""

    model: RotorModel
    base: BaseTable  # of numpy arrays
    channels: Channels  # numpy
    measured_rpm: Floats  # (T, R)
    flight: NDArray[np.intp]  # (T,) which flight
    block: NDArray[np.intp]  # (T,) which block, increasing
    block_flight: NDArray[np.intp]  # (B,) flight of each block
    follows: Bools  # (T,) the row comes right after the one before it
    names: tuple[str, ...]  # of the flights
    durations: Floats  # (F,) s
    modes: Modes
    uncertainty_rpm: Floats  # (D, T, R) by which the base model may be off, one deviation each
    background_rpm: Floats  # (R,) by which each mode differs from flight to flight, whatever is new
    background_degrees: float = np.inf  # of freedom of that spread
    of_outputs: bool = False  # speeds are from motor outputs: only each rotor's share counts

    @property
    def flights(self) -> int:
        return len(self.names)

    @property
    def flight_start_unix_s(self) -> Floats:
        """(F,) Unix time of the first row of each flight, NaN where the log does not tell it."""
        first = np.unique(self.flight, return_index=True)[1]
        return self.channels.clock_s[first]

    @property
    def first_row_s(self) -> Floats:
        """(F,) time of the first row of each flight since its start."""
        return self.channels.time_s[np.unique(self.flight, return_index=True)[1]]

    @property
    def placed(self) -> tuple[Placed, ...]:
        """Effects that the model already has."""
        return self.model.placed

    def background(self, scales: Floats, uncertainty: Floats | None = None) -> Background:
        """What of the residual is the base model's own error, in scales of the modes.

        `uncertainty` (D, T, R) rpm takes the place of what the reported channels say of it.
        """
        if uncertainty is None:
            uncertainty = self.uncertainty_rpm
        return Background(
            constant=self.background_rpm / scales,
            directions=uncertainty @ (self.modes.directions / scales),
            degrees=self.background_degrees,
        )

    def known_square(self, directions: Floats) -> Floats:
        """(M,) rpm²: by how much the base model is known to be off along directions (R, M)."""
        known = np.sum((self.uncertainty_rpm @ directions) ** 2, axis=0).mean(axis=0)
        return known + self.background_rpm**2 @ (self.modes.directions.T @ directions) ** 2

    def lacks(self, effect: Effect) -> tuple[str, ...]:
        """The channels that the effect needs or reads and that not every row has."""
        read = dict.fromkeys((*effect.needs, *effect.neutral))
        return tuple(name for name in read if not _reported(self.channels.read(name)))


def airspeed_is_ground_speed(track: FlightTrack) -> bool:
    """True when the airspeed is the speed over ground for want of a sensor and of a wind."""
    return "ground speed" in track.sources.get("airspeed", "")


def _reported(channel: Any) -> bool:
    if isinstance(channel, tuple):
        return all(_reported(c) for c in channel)
    return isinstance(channel, np.ndarray) and bool(np.isfinite(channel).all())


def assemble(model: RotorModel, tracks: Sequence[FlightTrack], *, thin: bool = True) -> Problem:
    """Rows of the flights that can be fitted, with `thin` thinned alike to MOST_ROWS.

    Raises AirframeError for a wrong rotor count and DataError when a flight has too few rows.
    """
    airframe = model.airframe
    parts: list[Channels] = []
    measured, flight, block, block_flight, follows, durations = [], [], [], [], [], []
    for index, track in enumerate(tracks):
        if track.rotor_count != airframe.rotor_count:
            raise AirframeError(
                f"{track.name}: {track.rotor_count} rotors, but airframe {airframe.name} has "
                f"{airframe.rotor_count}; give the right airframe with --airframe"
            )
        if model.network is None and airspeed_is_ground_speed(track):
            track = replace(track, airspeed=np.full_like(track.airspeed, np.nan))
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
        parts.append(channels.rows(rows))
        measured.append(track.rotor_speed_rpm[rows])
        flight.append(np.full(rows.size, index))
        elapsed = track.time_s[rows] - track.time_s[rows[0]]
        whole = max(1, round(float(elapsed[-1]) / BLOCK_SECONDS))
        local = np.minimum((elapsed / (elapsed[-1] / whole + 1e-9)).astype(np.intp), whole - 1)
        local = np.unique(local, return_inverse=True)[1]
        start = len(block_flight)
        block.append(start + local)
        block_flight += [index] * (int(local.max()) + 1)
        follows.append(np.concatenate([[False], np.diff(rows) == 1]))
        durations.append(float(elapsed[-1]))
    table, channels = table_of(model), concatenate(parts)
    shares = of_outputs(tracks)
    for item in model.placed:
        channels = filled(item.effect, item.values, channels)
    problem = Problem(
        model=model,
        base=table,
        channels=channels,
        measured_rpm=np.concatenate(measured),
        flight=np.concatenate(flight),
        block=np.concatenate(block),
        block_flight=np.array(block_flight),
        follows=np.concatenate(follows),
        names=tuple(t.name for t in tracks),
        durations=np.array(durations),
        modes=modes(airframe),
        uncertainty_rpm=base_uncertainty_rpm(model, table, channels),
        background_rpm=np.array(model.background_rpm or np.zeros(airframe.rotor_count)),
        of_outputs=shares,
    )
    problem = _with_spread(problem) if shares else problem
    return _thinned(problem) if thin else problem


def _with_spread(problem: Problem) -> Problem:
    """The problem of motor outputs, with how flights differ by themselves."""
    predicted = rotor_speed_rpm(problem.base, problem.placed, problem.channels)
    predicted = scaled_to(np.sum(problem.measured_rpm**2, axis=1), predicted)
    residual = (problem.measured_rpm - predicted) @ problem.modes.directions
    spread, degrees = spread_of_flights(residual, problem.flight, problem.background_rpm)
    return replace(problem, background_rpm=spread, background_degrees=degrees)


def _thinned(problem: Problem) -> Problem:
    stride = -(-problem.measured_rpm.shape[0] // MOST_ROWS)
    if stride == 1:
        return problem
    which = np.arange(0, problem.measured_rpm.shape[0], stride)
    return replace(
        problem,
        channels=problem.channels.rows(which),
        measured_rpm=problem.measured_rpm[which],
        flight=problem.flight[which],
        block=problem.block[which],
        follows=np.zeros(which.size, dtype=np.bool_),
        uncertainty_rpm=problem.uncertainty_rpm[:, which],
    )
