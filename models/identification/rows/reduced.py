"""Average flights over short bins of time: the means that the search works on.

Rotor inertia, gusts and late messages move a residual for tenths of a second; an effect lasts. So
channels and measured speeds are averaged over bins of BIN seconds and effects are evaluated on the
means: seven times fewer rows at 10 Hz, with nearly independent noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.effects.channels import concatenate, froude_time_scale
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.identification.rows.fast_rows import UNKNOWN, delay_of_rows
from thrustmargin.models.identification.rows.noise import base_uncertainty_rpm
from thrustmargin.models.identification.rows.output_shares import of_outputs
from thrustmargin.models.identification.rows.problem import (
    Problem,
    RowsToFit,
    assemble_flight,
    join_flights,
    row_stride,
    thin_rows,
    usable_seconds,
)
from thrustmargin.models.model.rotor_model import RotorModel

#: s, for an aircraft of the F16's size: longer than rotor lag and most gusts, shorter than a
#: manoeuvre; times scale with the root of the size (Froude)
BIN = 0.7
#: means of all flights together; in a season each flight keeps stretches at shifted times
MOST_MEANS, STRETCH = 5_000, 30
LEAST_STRETCH = 17  # means for any number of flights: fewer do not determine a flight's noise
LEAST_FILL = 0.5  # share of the usual rows that a bin needs


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reduced(RowsToFit):
    """N means of F flights."""

    #: (D, N, R) error directions of the base model, one standard deviation each
    uncertainty_rpm: Floats
    delay_s: Floats  # (F, 2) delay of each flight's rotor speeds and its error

    @property
    def scored_modes(self) -> Bools:
        """Flag the modes (R,) that carry information: all, but not the collective of motor
        outputs."""
        return np.arange(self.measured_rpm.shape[1]) >= int(self.of_outputs)


def reduce_flights(
    model: RotorModel, tracks: Sequence[FlightTrack], *, delays: bool = True
) -> Reduced:
    """Return the means of the rows that can be fitted; raises like `problem.assemble`."""
    return rows_and_means(model, tracks, delays=delays)[1]


def rows_and_means(
    model: RotorModel, tracks: Sequence[FlightTrack], *, delays: bool = True
) -> tuple[Problem, Reduced]:
    """Return the rows of all flights, thinned to about MOST_ROWS, and the means over bins of time.

    The means are of all rows; bins with too few rows are dropped, and stretches of bins beyond
    about MOST_MEANS. With `delays`, the delay of the rotor speeds of each flight is estimated too.
    Only one flight is in memory at its full rate at a time.
    """
    of_outputs(tracks)  # raises if measured speeds and outputs are mixed
    stride = row_stride(model, tracks)
    seconds = sum(usable_seconds(model, track) for track in tracks)
    every = -(-int(seconds / (BIN * froude_time_scale(model.airframe))) // MOST_MEANS)
    length = min(STRETCH, max(LEAST_STRETCH, MOST_MEANS // len(tracks)))
    rows, parts, late = [], [], []
    for index, track in enumerate(tracks):
        whole = assemble_flight(model, track)
        rows.append(thin_rows(whole, stride))
        parts.append(_select_stretches(_bin_means(whole, index), index, every, length))
        late.append(delay_of(whole) if delays else UNKNOWN)
    first = parts[0]
    channels = concatenate([p.channels for p in parts])
    means = replace(
        first,
        channels=channels,
        measured_rpm=np.concatenate([p.measured_rpm for p in parts]),
        flight=np.concatenate([p.flight for p in parts]),
        follows=np.concatenate([p.follows for p in parts]),
        uncertainty_rpm=base_uncertainty_rpm(model, first.base, channels),
        delay_s=np.array(late),
        names=tuple(name for p in parts for name in p.names),
    )
    return join_flights(rows), means


def delay_of(flight: Problem) -> Floats:
    """Return the delay (2,) s of one flight's rotor speeds and its error; see `delay_of_rows`."""
    return delay_of_rows(flight, _bin_numbers(flight))


def _bin_numbers(flight: Problem) -> NDArray[np.intp]:
    """Return the number (T,) of the bin that each row is in."""
    time_s = flight.channels.time_s
    long = BIN * froude_time_scale(flight.model.airframe)
    return ((time_s - time_s[0]) / long).astype(np.intp)


def _select_stretches(means: Reduced, flight: int, every: int, length: int) -> Reduced:
    """Keep every `every`-th stretch of `length` consecutive means of one flight, at least one.

    `flight` is the number of the flight, which shifts the first kept stretch: over many flights all
    times are covered.
    """
    place = np.arange(means.flight.size) // length
    kept = np.flatnonzero((place + flight) % every == 0)
    if kept.size < length:
        kept = np.flatnonzero(place == flight % max(1, place.size // length))
    return replace(
        means,
        channels=means.channels.rows(kept),
        measured_rpm=means.measured_rpm[kept],
        flight=means.flight[kept],
        follows=means.follows[kept] & (np.diff(kept, prepend=-2) == 1),
        uncertainty_rpm=means.uncertainty_rpm[:, kept],
    )


def _bin_means(problem: Problem, index: int) -> Reduced:
    """Average the rows of one flight over bins of time; `index` becomes the flight's number.

    Bins with less than LEAST_FILL of the median number of rows are dropped.
    """
    bins, start, count = np.unique(_bin_numbers(problem), return_index=True, return_counts=True)
    full = count >= LEAST_FILL * np.median(count)

    def mean(values: Floats) -> Floats:
        """Average values (T, ...) over the rows of each kept bin."""
        sums = np.add.reduceat(values, start, axis=0)
        return (sums / count.reshape(-1, *[1] * (values.ndim - 1)))[full]

    channels = problem.channels
    heading = np.mod(mean(np.unwrap(channels.heading)), 2 * np.pi)
    kept = bins[full]
    return Reduced(
        model=problem.model,
        base=problem.base,
        modes=problem.modes,
        channels=replace(channels.each(mean), heading=heading),
        measured_rpm=mean(problem.measured_rpm),
        flight=np.full(kept.size, index),
        follows=np.diff(kept, prepend=kept[0] - 2) == 1,
        uncertainty_rpm=np.zeros((0, kept.size, problem.measured_rpm.shape[1])),
        delay_s=np.zeros((0, 2)),
        names=problem.names,
        of_outputs=problem.of_outputs,
    )
