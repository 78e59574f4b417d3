"""Flights as short means: what the search works on.

A rotor's inertia, a gust and a late message move a residual within tenths of a second; an effect
lasts. So rows are averaged over BIN seconds, channels and measured speeds alike, and effects are
worked out on the means: seven times fewer rows at 10 Hz, and noise that is nearly independent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.effects.base import Placed
from thrustmargin.models.effects.channels import Channels, concatenate, froude_time_scale
from thrustmargin.models.effects.compose import BaseTable, rotor_speed_rpm
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.identification.base_uncertainty import base_uncertainty_rpm
from thrustmargin.models.identification.modes import Modes
from thrustmargin.models.identification.output_shares import of_outputs, scaled_to
from thrustmargin.models.identification.problem import Problem, assemble
from thrustmargin.models.identification.terms import Term
from thrustmargin.models.model.rotor_model import RotorModel

#: s of an aircraft of the F16's size: longer than the rotors' lag and most gusts, shorter than what
#: a manoeuvre does; times go with the root of the size (Froude)
BIN = 0.7
LEAST_FILL = 0.5  # of the usual rows of a bin, for it to count


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reduced:
    """N means of F flights, R rotors; flights one after the other."""

    model: RotorModel
    base: BaseTable
    modes: Modes
    channels: Channels  # N rows
    measured_rpm: Floats  # (N, R)
    flight: NDArray[np.intp]  # (N,)
    follows: Bools  # (N,) the mean comes right after the one before it
    uncertainty_rpm: Floats  # (D, N, R) by which the base model may be off, one deviation each
    names: tuple[str, ...]
    of_outputs: bool

    @property
    def flights(self) -> int:
        return len(self.names)

    @property
    def judged(self) -> Bools:
        """(R,) modes that say something: of motor outputs the collective does not."""
        return np.arange(self.measured_rpm.shape[1]) >= int(self.of_outputs)

    def lacks(self, term: Term) -> tuple[str, ...]:
        """The channels that the effect needs or reads and that not every mean has."""
        names = dict.fromkeys((*term.effect.needs, *term.effect.neutral))
        return tuple(n for n in names if not _reported(self.channels.read(n)))

    def speeds(self, placed: Sequence[Placed], *, without: int | None = None) -> Floats:
        """(N, R) rpm with effects besides those that the model has, or all of those but one."""
        own = [item for k, item in enumerate(self.model.placed) if k != without]
        with np.errstate(invalid="ignore", over="ignore"):
            speed = rotor_speed_rpm(self.base, (*own, *placed), self.channels)
            if self.of_outputs:
                speed = scaled_to(np.sum(self.measured_rpm**2, axis=1), speed)
        return speed

    def in_modes(self, speed_rpm: Floats) -> Floats:
        """Amplitudes (..., R) rpm of the modes of speeds or their differences."""
        return speed_rpm @ self.modes.directions


def reduce_flights(model: RotorModel, tracks: Sequence[FlightTrack]) -> Reduced:
    """Means of the rows that can be fitted; raises as `problem.assemble`, flight by flight."""
    of_outputs(tracks)  # raises where flights are of both kinds
    parts = [_of_flight(assemble(model, [track], thin=False), k) for k, track in enumerate(tracks)]
    first = parts[0]
    channels = concatenate([p.channels for p in parts])
    return replace(
        first,
        channels=channels,
        measured_rpm=np.concatenate([p.measured_rpm for p in parts]),
        flight=np.concatenate([p.flight for p in parts]),
        follows=np.concatenate([p.follows for p in parts]),
        uncertainty_rpm=base_uncertainty_rpm(model, first.base, channels),
        names=tuple(name for p in parts for name in p.names),
    )


def _of_flight(problem: Problem, index: int) -> Reduced:
    time_s = problem.channels.time_s
    which = ((time_s - time_s[0]) / (BIN * froude_time_scale(problem.model.airframe))).astype(
        np.intp
    )
    bins, start, count = np.unique(which, return_index=True, return_counts=True)
    full = count >= LEAST_FILL * np.median(count)

    def mean(values: Floats) -> Floats:
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
        names=problem.names,
        of_outputs=problem.of_outputs,
    )


def _reported(channel) -> bool:
    if isinstance(channel, tuple):
        return all(_reported(c) for c in channel)
    return isinstance(channel, np.ndarray) and bool(np.isfinite(channel).all())
