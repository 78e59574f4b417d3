"""A rotor that goes bad at a moment: which rotor, when, and in which flights.

About a set without any bad rotor, the gain of a loss that begins at a time is g²/2h of its column,
the loss's derivative from that time on. Four kinds of step are looked for: in one flight, in it for
a while, at one time of every flight, and from a moment of one flight on through all later ones. The
best of each rotor and kind becomes a candidate of the search; that it was chosen among many times
is in its prior.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from thrustmargin.models.effects.rotor_degradation import (
    ROTOR_DEGRADATION,
    ROTOR_DEGRADATION_EACH,
    ROTOR_DEGRADATION_ONSET,
    ROTOR_DEGRADATION_SINCE,
    ROTOR_DEGRADATION_WHILE,
)
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.candidates import (
    ROTOR_PRIOR,
    Candidate,
    Held,
    Term,
    candidate,
    derivatives,
)
from thrustmargin.models.identification.linear_sets import FittedSet, Key
from thrustmargin.models.identification.set_search import Search

LEAST_AFTER = 8.0  # s of flight before and after a step, for it to be one
GRID, FINE = 5.0, 0.35  # s between the times that are tried, and about the best of them
LEAST_GAIN = 3.0  # of the log likelihood, beyond the choice among all times
MOST_FLIGHTS = 24  # of which single steps are looked for; a season is looked at by flights

#: kind -> effect, name of its time
KINDS = {
    "one": (ROTOR_DEGRADATION_ONSET, "onset_time"),
    "while": (ROTOR_DEGRADATION_WHILE, "onset_time"),
    "each": (ROTOR_DEGRADATION_EACH, "onset_time"),
    "since": (ROTOR_DEGRADATION_SINCE, "onset_clock"),
}


def without_rotors(search: Search, key: Key) -> Key:
    """A set of which bad rotors are taken out."""
    return frozenset(
        c for c in key if search.candidates[c].term.effect.name != ROTOR_DEGRADATION.name
    )


def onset_candidates(search: Search, about: FittedSet) -> list[Candidate]:
    """Steps worth a place among the candidates, about a set without its bad rotors."""
    sound = without_rotors(search, about.key)
    near = dict(zip(sorted(about.key), about.held, strict=True))
    fitted = search.fitted.get(sound) or search.fit_near(sound, near)
    reduced, rotors = search.reduced, search.reduced.measured_rpm.shape[1]
    found = []
    for rotor in range(rotors):
        loss = candidate(Term(effect=ROTOR_DEGRADATION, rotor=rotor), reduced.flights)
        held = [*fitted.held, Held(candidate=loss, values=loss.start)]
        column = np.nan_to_num(derivatives(reduced, held, len(held) - 1)[:, :, 0])
        best: dict[str, tuple[float, int, tuple[float, ...]]] = {}
        tries = 0
        for kind, flight, times, step in _steps(search):
            if not times.size:
                continue
            gains = _gains(search, fitted, column, step(times))
            tries += times.size
            k = int(np.argmax(gains))
            if kind not in best or gains[k] > best[kind][0]:
                fine = times[k] + np.arange(-GRID, GRID + FINE, FINE)
                closer = _gains(search, fitted, column, step(fine))
                k = int(np.argmax(closer))
                best[kind] = (float(closer[k]), flight, (float(fine[k]),))
            if kind == "one":
                tries += times.size * (times.size - 1) // 2
                gain, ends = _while(search, fitted, column, step, times)
                if gain > best.get("while", (0.0,))[0]:
                    best["while"] = (gain, flight, ends)
        for kind, (gain, flight, when) in best.items():
            if gain > LEAST_GAIN + np.log(tries):
                found.append((gain, _candidate(search, kind, rotor, flight, when, tries)))
    found.sort(key=lambda pair: -pair[0])
    return [one for _, one in found[: 2 * len(KINDS)]]


def _steps(search: Search) -> Iterator[tuple[str, int, Floats, Callable[[Floats], Floats]]]:
    """(kind, flight, times (S,), times -> steps (N, S) of 0 and 1) of every family of steps."""
    x, flight = search.reduced.channels, search.reduced.flight
    flights = search.reduced.flights
    starts = np.array([x.clock_s[flight == f][0] for f in range(flights)])
    dated = flights > 1 and bool(np.isfinite(starts).all())

    def after(times: Floats) -> Floats:
        return x.time_s[:, None] >= times

    def in_one(f: int, times: Floats) -> Floats:
        return after(times) & (flight == f)[:, None]

    def since(f: int, times: Floats) -> Floats:
        return in_one(f, times) | (starts[flight] > starts[f])[:, None]

    for f in range(flights) if flights <= MOST_FLIGHTS else ():
        times = _grid(x.time_s[flight == f])
        yield "one", f, times, partial(in_one, f)
        if dated:
            yield "since", f, times, partial(since, f)
    if flights > 1:
        yield "each", 0, _grid(x.time_s), after


def _grid(time_s: Floats) -> Floats:
    return np.arange(time_s.min() + LEAST_AFTER, time_s.max() - LEAST_AFTER, GRID)


def _gram(search: Search, fitted: FittedSet, column: Floats, steps: Floats) -> Floats:
    """(S + 1, S + 1) Gram matrix of a loss in each step and of the residual, at the set's level."""
    columns = column[:, :, None] * steps.astype(np.float64)[:, None, :]
    whole = np.concatenate([columns, np.nan_to_num(fitted.residual)[:, :, None]], axis=2)
    level = slice(fitted.best_level, fitted.best_level + 1)
    return search.solved.reduce(search.nuisance.sums(whole), level)[0]


def _gains(search: Search, fitted: FittedSet, column: Floats, steps: Floats) -> Floats:
    """(S,) gain of a loss in each step."""
    gram = _gram(search, fitted, column, steps)
    power = np.maximum(np.diag(gram)[:-1], 1e-12)
    return np.maximum(gram[:-1, -1], 0.0) ** 2 / power / 2


def _while(
    search: Search,
    fitted: FittedSet,
    column: Floats,
    step: Callable[[Floats], Floats],
    times: Floats,
) -> tuple[float, tuple[float, ...]]:
    """The largest gain of a loss between two times, and the two: a step less a later step."""
    best: tuple[float, tuple[float, ...]] = (0.0, (0.0, 0.0))
    for _ in range(2):  # on the grid, then about the best of it
        gram = _gram(search, fitted, column, step(times))
        inner, power = gram[:-1, -1], np.diag(gram)[:-1]
        between = power[:, None] + power - 2.0 * gram[:-1, :-1]
        score = np.maximum(inner[:, None] - inner, 0.0) ** 2 / np.maximum(between, 1e-12) / 2
        score[times[None, :] - times[:, None] < LEAST_AFTER] = 0.0
        i, j = np.unravel_index(int(np.argmax(score)), score.shape)
        best = (float(score[i, j]), (float(times[i]), float(times[j])))
        near = np.arange(-GRID, GRID + FINE, FINE)
        times = np.unique(np.concatenate([near + best[1][0], near + best[1][1]]))
    return best


def _candidate(
    search: Search, kind: str, rotor: int, flight: int, when: tuple[float, ...], tries: int
) -> Candidate:
    effect, clock = KINDS[kind]
    plain = candidate(Term(effect=effect, rotor=rotor), search.reduced.flights)
    names = [p.name for p in effect.parameters]
    start = plain.start.copy()
    time = when[0]
    if kind == "while":
        start[:, names.index("end_time")] = when[1]
    if kind == "since":
        x = search.reduced.channels
        first = int(np.argmax(search.reduced.flight == flight))
        time += float(x.clock_s[first] - x.time_s[first])
    start[:, names.index(clock)] = time
    free = plain.free
    if kind in ("one", "while"):
        free = tuple((k, f) for k, f in plain.free if f == flight)
    prior = float(np.log(ROTOR_PRIOR / len(KINDS)) - np.log(tries))
    return replace(plain, start=start, free=free, log_prior=prior)
