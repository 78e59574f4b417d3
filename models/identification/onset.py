"""A rotor that goes bad at a moment: when, which, how much, and is it more than chance.

With loss columns j and weighted residuals e, a step that is on in some rows lowers the cost by
(sum j e)^2 / sum j^2 over those rows. Three kinds of step are looked for: in one flight, at one
time of every flight, and from a moment of one flight on through all later ones. The largest over
kinds, rotors, flights and times is compared with the same maximum on surrogates.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.identification.problem import Problem

LEAST_AFTER = 8.0  # s of flight that must follow an onset, and precede it
GRID = 1.0  # s between the times at which steps of several flights are added up

ONE, EACH, SINCE = "onset", "in each flight", "since"  # kinds, as variants of the effect


@dataclass(frozen=True, slots=True, kw_only=True)
class Onset:
    """The best step of a kind: rotor and flight 0-based, time in s from the start of the flight."""

    kind: str
    rotor: int
    flight: int
    time_s: float
    loss: float
    gain: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Steps:
    """Sums over the rows after each time: `inner` (N, S) of j e, `weight` (N,) of j²."""

    flight: int
    times: Floats  # (N,) s
    allowed: Bools  # (N,)
    inner: Floats
    weight: Floats

    def at(self, times: Floats) -> tuple[Floats, Floats]:
        """The sums after other times, (M, S) and (M,); nothing is after the end."""
        place = np.searchsorted(self.times, times)
        inner = np.concatenate([self.inner, np.zeros((1, self.inner.shape[1]))])
        return inner[place], np.append(self.weight, 0.0)[place]


def scan(problem: Problem, columns: Floats, whitened: Floats) -> Mapping[str, Onset]:
    """The step of each kind that lowers the cost most; kinds that the flights cannot show are out.

    `columns` (R, T, R) is the weighted derivative by each rotor's loss; `whitened` (T, R).
    """
    best: dict[str, Onset] = {}
    for kind, rotor, flight, times, allowed, inner, weight in _steps(
        problem, columns, whitened[:, :, None]
    ):
        gain = np.where(allowed, inner[:, 0] ** 2 / weight, 0.0)
        k = int(np.argmax(gain))
        if kind not in best or gain[k] > best[kind].gain:
            best[kind] = Onset(
                kind=kind,
                rotor=rotor,
                flight=flight,
                time_s=float(times[k]),
                loss=float(inner[k, 0] / weight[k]),
                gain=float(gain[k]),
            )
    return best


def gain_all_along(column: Floats, whitened: Floats) -> float:
    """What the same loss gains without a beginning; a step that gains less is none."""
    return float(np.sum(column * whitened) ** 2 / max(np.sum(column**2), 1e-12))


def best_gains(problem: Problem, columns: Floats, surrogates: NDArray[np.float32]) -> Floats:
    """(S,) the largest gain of `scan` on each surrogate residual (T, R, S)."""
    best = np.zeros(surrogates.shape[2])
    for _, _, _, _, allowed, inner, weight in _steps(problem, columns, surrogates):
        gain = np.where(allowed[:, None], inner**2 / weight[:, None], 0.0)
        best = np.maximum(best, gain.max(axis=0))
    return best


def _steps(problem: Problem, columns: Floats, residual: NDArray) -> Iterator[tuple]:
    """(kind, rotor, flight, times, allowed, inner (N, S), weight (N,)) of every family of steps."""
    start = problem.flight_start_unix_s
    dated = bool(np.isfinite(start).all()) and problem.flights > 1
    later_first = np.argsort(-start) if dated else np.arange(0)
    for rotor in range(columns.shape[0]):
        flights = [_of_flight(problem, f, columns[rotor], residual) for f in range(problem.flights)]
        for s in flights:
            yield ONE, rotor, s.flight, s.times, s.allowed, s.inner, _positive(s.weight)
        if problem.flights < 2:
            continue
        grid = np.arange(0.0, max(s.times[-1] for s in flights), GRID)
        sums = [s.at(grid) for s in flights]
        allowed = np.any([(grid > s.times[0]) & (grid < s.times[-1]) for s in flights], axis=0)
        allowed &= (grid > LEAST_AFTER) & (grid < grid[-1] - LEAST_AFTER)
        inner, weight = (np.sum(part, axis=0) for part in zip(*sums, strict=True))
        yield EACH, rotor, 0, grid, allowed, inner, _positive(weight)
        after, heavy = np.zeros(residual.shape[2]), 0.0
        for f in later_first:
            s = flights[f]
            whole = s.inner + after, _positive(s.weight + heavy)
            yield SINCE, rotor, s.flight, s.times, s.allowed, *whole
            after, heavy = after + s.inner[0], heavy + s.weight[0]


def _of_flight(problem: Problem, flight: int, column: Floats, residual: NDArray) -> _Steps:
    rows = np.flatnonzero(problem.flight == flight)
    times, j = problem.channels.time_s[rows], column[rows]
    inner = np.einsum("tm,tms->ts", j, residual[rows])
    return _Steps(
        flight=flight,
        times=times,
        allowed=(times > times[0] + LEAST_AFTER) & (times < times[-1] - LEAST_AFTER),
        inner=np.cumsum(inner[::-1], axis=0)[::-1],
        weight=np.cumsum(np.sum(j * j, axis=1)[::-1])[::-1],
    )


def _positive(weight: Floats) -> Floats:
    return np.maximum(weight, 1e-12)
