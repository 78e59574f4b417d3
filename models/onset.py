"""A rotor that goes bad in flight: when, which, how much, and is it more than chance.

With loss columns j and weighted residuals e, a step at time s in one flight lowers the cost by
(sum_{t>s} j e)^2 / sum_{t>s} j^2. The largest over rotors, flights and times is compared with the
same maximum on surrogates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.flight import Bools, Floats
from models.problem import Problem

LEAST_AFTER = 8.0  # s of flight that must follow an onset, and precede it


@dataclass(frozen=True, slots=True, kw_only=True)
class Onset:
    """The best step found: rotor and flight 0-based, time in s from the start of the flight."""

    rotor: int
    flight: int
    time_s: float
    loss: float
    gain: float


def scan(problem: Problem, columns: Floats, whitened: Floats) -> Onset:
    """The step that lowers the cost most.

    `columns` (R, T, R) is the weighted derivative by each rotor's loss; `whitened` (T, R).
    """
    best = Onset(rotor=0, flight=0, time_s=0.0, loss=0.0, gain=0.0)
    for flight in range(problem.flights):
        rows, times, allowed = _rows(problem, flight)
        for rotor in range(columns.shape[0]):
            j = columns[rotor][rows]
            gain, loss = _gains(np.sum(j * whitened[rows], axis=1), np.sum(j * j, axis=1))
            gain = np.where(allowed, gain, 0.0)
            k = int(np.argmax(gain))
            if gain[k] > best.gain:
                best = Onset(
                    rotor=rotor,
                    flight=flight,
                    time_s=float(times[k]),
                    loss=float(loss[k]),
                    gain=float(gain[k]),
                )
    return best


def best_gains(problem: Problem, columns: Floats, surrogates: NDArray[np.float32]) -> Floats:
    """(S,) the largest gain of `scan` on each surrogate residual (T, R, S)."""
    best = np.zeros(surrogates.shape[2])
    for flight in range(problem.flights):
        rows, _, allowed = _rows(problem, flight)
        for rotor in range(columns.shape[0]):
            j = columns[rotor][rows]
            inner = np.einsum("tm,tms->ts", j, surrogates[rows])
            after = np.cumsum(inner[::-1], axis=0)[::-1]
            weight = np.cumsum(np.sum(j * j, axis=1)[::-1])[::-1]
            gain = after**2 / np.maximum(weight, 1e-12)[:, None]
            best = np.maximum(best, np.where(allowed[:, None], gain, 0.0).max(axis=0))
    return best


def _rows(problem: Problem, flight: int) -> tuple[NDArray[np.intp], Floats, Bools]:
    rows = np.flatnonzero(problem.flight == flight)
    times = problem.channels.time_s[rows]
    allowed = (times > times[0] + LEAST_AFTER) & (times < times[-1] - LEAST_AFTER)
    return rows, times, allowed


def _gains(inner: Floats, weight: Floats) -> tuple[Floats, Floats]:
    after = np.cumsum(inner[::-1])[::-1]
    total = np.maximum(np.cumsum(weight[::-1])[::-1], 1e-12)
    return after**2 / total, after / total
