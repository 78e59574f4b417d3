"""What is left and lasts for seconds, though it goes with no channel.

Sensor noise and gusts forget themselves within a second or two. A residual that still resembles
itself 2 to 10 s later (of one rotor: 1 to 10 s) has a cause that the model lacks, be it one that no
channel shows: liquid that swings, a load that has moved, a sensor that sticks. The measure is the
autocovariance of the residual of a mode or of one rotor, averaged over flights, at the lag of that
range where it is largest; what the base model is known to be off by counts against it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.problem import Problem

BIN = 0.5  # s
LAGS = range(4, 21)  # bins
LAGS_OF_ROTOR = range(2, 21)  # bins; gusts take all rotors together and matter less here
LEAST_SIZE = 0.0045  # of the mean rotor speed, RMS along the mode
LEAST_OF_ROTOR = 0.0035  # the same of one rotor, beyond what the middle one of the others has


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AutocorrelatedResidual:
    """A slow residual: where, its RMS in rpm of that mode or rotor, its share of what is left."""

    mode: str
    direction: Floats  # (R,)
    rms_rpm: float
    share: float


def autocorrelated_residual(
    problem: Problem, residual_rpm: Floats
) -> AutocorrelatedResidual | None:
    """The largest slow residual (T, R) rpm of the modes and rotors; None when none is worth it."""
    rotors = residual_rpm.shape[1]
    modes, each = problem.modes.directions, np.eye(rotors)
    by_mode = _lasting(problem, residual_rpm @ modes, LAGS) - problem.known_square(modes)
    by_rotor = _lasting(problem, residual_rpm, LAGS_OF_ROTOR)
    others = np.array([np.median(np.delete(by_rotor, k)) for k in range(rotors)])
    by_rotor = by_rotor - np.maximum(2.0 * others, 0.0) - problem.known_square(each)
    speed = float(problem.measured_rpm.mean())
    # What one rotor has by itself shows in every mode, so the larger of the two is named.
    slow = np.concatenate([by_mode, by_rotor])
    least = np.repeat([LEAST_SIZE * speed, LEAST_OF_ROTOR * speed], rotors) ** 2
    slow = np.where(slow >= least, slow, 0.0)
    best = int(np.argmax(slow))
    if slow[best] <= 0.0:
        return None
    directions = np.concatenate([modes, each], axis=1)
    names = (*problem.modes.names, *(f"rotor {k + 1}" for k in range(rotors)))
    total = float(np.mean(np.sum(residual_rpm**2, axis=1)))
    return AutocorrelatedResidual(
        mode=names[best],
        direction=directions[:, best],
        rms_rpm=float(np.sqrt(slow[best])),
        share=float(slow[best] / total),
    )


def _lasting(problem: Problem, amplitude: Floats, lags: range) -> Floats:
    """(M,) rpm²: the largest autocovariance of amplitudes (T, M) over lags, all flights pooled."""
    sums = np.zeros((len(lags), amplitude.shape[1]))
    pairs = np.zeros(len(lags))
    for flight in range(problem.flights):
        rows = problem.flight == flight
        place = (problem.channels.time_s[rows] / BIN).astype(np.intp)
        place -= place.min()
        count = np.bincount(place)
        known = count > 0
        means = np.stack(
            [np.bincount(place, column) / np.maximum(count, 1) for column in amplitude[rows].T],
            axis=1,
        )
        for k, lag in enumerate(lags):
            both = known[lag:] & known[:-lag]
            sums[k] += np.sum((means[lag:] * means[:-lag])[both], axis=0)
            pairs[k] += np.count_nonzero(both)
    return np.max(sums / np.maximum(pairs, 1.0)[:, None], axis=0)
