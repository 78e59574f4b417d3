"""Find step changes of a rotor's thrust: which rotor, when, and in which flights.

About a set without bad rotors, the gain of a loss from a given time is g²/2h, from the gradient g
and curvature h of its column: the loss's derivative from that time on. Five kinds of step are
tried: in one flight; in one flight for a while; at one time of every flight; from a time in one
flight on through all later ones; and in some consecutive flights, by their clock. The best of each
rotor and kind becomes a candidate of the search, with a prior divided by the number of tried times.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.models.effects.thrust_effects import (
    ROTOR_DEGRADATION,
    ROTOR_DEGRADATION_EACH,
    ROTOR_DEGRADATION_ONSET,
    ROTOR_DEGRADATION_SINCE,
    ROTOR_DEGRADATION_UNTIL,
    ROTOR_DEGRADATION_WHILE,
)
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.identification.rows.candidates import (
    ROTOR_PRIOR,
    Candidate,
    Term,
    candidate,
    derivatives,
)
from thrustmargin.models.identification.sets.linear_sets import EffectSet, Key
from thrustmargin.models.identification.sets.set_search import FAR, Search

LEAST_AFTER = 8.0  # least s of flight before and after a step
GRID, FINE = 5.0, 0.35  # s between tried times, and between those near the best one
LEAST_GAIN = 3.0  # least gain in log likelihood, beyond the log of the number of tried times
MOST_FLIGHTS = 24  # flights within which steps are tried; in a season only whole flights

#: kind -> effect, name of the parameter of its time
KINDS = {
    "one": (ROTOR_DEGRADATION_ONSET, "onset_time"),
    "while": (ROTOR_DEGRADATION_WHILE, "onset_time"),
    "each": (ROTOR_DEGRADATION_EACH, "onset_time"),
    "since": (ROTOR_DEGRADATION_SINCE, "onset_clock"),
    "until": (ROTOR_DEGRADATION_UNTIL, "onset_clock"),
}


def drop_rotor_effects(search: Search, key: Key) -> Key:
    """Return the set without degraded rotors and unnamed causes.

    An unnamed curve along time could absorb a step.
    """
    return frozenset(
        c
        for c in key
        if not search.candidates[c].unnamed
        and search.candidates[c].term.effect.name != ROTOR_DEGRADATION.name
    )


def onset_candidates(search: Search, effect_set: EffectSet) -> list[Candidate]:
    """Return candidates of a rotor's thrust loss that begins or ends at a time, best first.

    Each is tested on top of `effect_set` without its constant rotor losses and unnamed causes. It
    must raise the log likelihood by LEAST_GAIN and by ln of the number of times tried, and nearly
    as much as a constant loss of that rotor does.
    """
    sound = drop_rotor_effects(search, effect_set.key)
    near = effect_set.effects
    fitted = search.fitted.get(sound) or search.fit_near(sound, near)
    reduced, rotors = search.reduced, search.reduced.measured_rpm.shape[1]
    candidates = []
    for rotor in range(rotors):
        loss = candidate(Term(effect=ROTOR_DEGRADATION, rotor=rotor), reduced.flights)
        trials = [*fitted.trials, loss.initial_effect]
        column = np.nan_to_num(derivatives(reduced, trials, len(trials) - 1)[:, :, 0])
        best: dict[str, tuple[float, int, tuple[float, ...]]] = {}
        tries, sums = 0, LossSums.about_set(search, fitted, column)
        for step in step_families(search):
            times = step.times
            if not times.size:
                continue
            gains = _step_gains(sums.gram(step, times))
            tries += times.size
            k = int(np.argmax(gains))
            if step.kind not in best or gains[k] > best[step.kind][0]:
                fine = times[k] + np.arange(-GRID, GRID + FINE, FINE)
                closer = _step_gains(sums.gram(step, fine))
                k = argmax_centre(closer)[0]
                best[step.kind] = (float(closer[k]), step.flight or 0, (float(fine[k]),))
            if step.kind == "one":
                tries += times.size * (times.size - 1) // 2
                gain, ends = _best_transient(sums, step)
                if gain > best.get("while", (0.0,))[0]:
                    best["while"] = (gain, step.flight or 0, ends)
        spans = list(sums.spans())
        tries += search.reduced.flights**2 // 2 if spans else 0
        for kind, gain, flight, ends in spans:
            if gain > best.get(kind, (0.0,))[0]:
                best[kind] = (gain, flight, ends)
        # A constant loss of the rotor that gains far more rules out a step.
        least = _step_gains(sums.constant_gram())[0] - FAR
        for kind, (gain, flight, when) in best.items():
            if gain > max(least, LEAST_GAIN + np.log(tries)):
                candidates.append((gain, _step_candidate(search, kind, rotor, flight, when, tries)))
    candidates.sort(key=lambda pair: -pair[0])
    return [one for _, one in candidates[: 2 * len(KINDS)]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Step:
    """A family of losses that begin at one of several times, in one flight or in every flight
    (None)."""

    kind: str
    flight: int | None
    times: Floats  # (S,) times to try, on the family's clock
    later_flights: Bools  # (F,) other flights that have the loss from their beginning


def step_families(search: Search) -> Iterator[_Step]:
    """Yield for each flight and kind of step the times to try.

    Kinds: "one" lasts to the end of its flight, "since" also in later flights (if all are dated),
    "each" begins at one time in every flight. Steps in single flights are left out beyond
    MOST_FLIGHTS.
    """
    x, flight = search.reduced.channels, search.reduced.flight
    flights = search.reduced.flights
    starts = np.array([x.clock_s[flight == f][0] for f in range(flights)])
    dated = flights > 1 and bool(np.isfinite(starts).all())
    for f in range(flights) if flights <= MOST_FLIGHTS else ():
        times = _grid(x.time_s[flight == f])
        none = np.zeros(flights, dtype=np.bool_)
        yield _Step(kind="one", flight=f, times=times, later_flights=none)
        if dated:
            yield _Step(kind="since", flight=f, times=times, later_flights=starts > starts[f])
    if flights > 1:
        every = np.zeros(flights, dtype=np.bool_)
        yield _Step(kind="each", flight=None, times=_grid(x.time_s), later_flights=every)


def _grid(time_s: Floats) -> Floats:
    """Return possible times of a step, s: GRID s apart, at least LEAST_AFTER s from either end.

    They are on the clock of `time_s` (n,), the times of the rows. Times in a pause of the log are
    left out: all of them would explain the rows equally.
    """
    first, last = time_s.min() + LEAST_AFTER, time_s.max() - LEAST_AFTER
    inside = time_s[(time_s >= first) & (time_s < last)]
    return first + GRID * np.unique(np.floor((inside - first) / GRID))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LossSums:
    """Sums of a loss's derivative and a set's residual by flight, with the scatter marginalised."""

    search: Search
    columns: Floats  # (N, R, 2) rpm in modes: the loss throughout, and the residual
    shared: Sequence[Floats]  # (X, 2) of each flight
    own: Sequence[Floats]  # (2, 2)

    @classmethod
    def about_set(cls, search: Search, fitted: EffectSet, column: Floats) -> LossSums:
        """Compute the sums of `column` (N, R), the loss's derivative, and the residual of
        `fitted`."""
        columns = np.stack([column, np.nan_to_num(fitted.residual)], axis=2)
        flight, flights = search.nuisance.whitening.flight, search.reduced.flights
        parts = [search.nuisance.select_means(flight == f).sums(columns) for f in range(flights)]
        return cls(
            search=search,
            columns=columns,
            shared=[p[0] for p in parts],
            own=[p[1] for p in parts],
        )

    def constant_gram(self) -> Floats:
        """Return the Gram matrix (2, 2) of two columns, nuisances marginalised.

        They are a constant loss from the beginning of all flights, and the residual.
        """
        return self.search.solved.reduce(self.search.nuisance.sums(self.columns))

    def spans(self) -> Iterator[tuple[str, float, int, tuple[float, ...]]]:
        """Yield the best loss over whole consecutive flights that lasts to the last flight, and the
        best that ends before.

        Each is ("since" or "until", gain of log likelihood, -1, Unix times, s): a first time, and
        an end for "until"; -1 is in the place of a flight's index. A time between two flights is
        midway. A kind without a gain is left out. Nothing with fewer than 3 flights or a flight
        without a clock.
        """
        x, flight, flights = self.search.reduced.channels, self.search.reduced.flight, len(self.own)
        ends = np.array([x.clock_s[flight == f][[0, -1]] for f in range(flights)])
        if flights < 3 or not np.isfinite(ends).all():
            return
        order = np.argsort(ends[:, 0])
        shared, own = (np.array([sums[f] for f in order]) for sums in (self.shared, self.own))
        # Cumulative sums of the loss over flights; the residual is summed over all flights.
        loss = np.concatenate([np.zeros_like(shared[:1, :, 0]), np.cumsum(shared[:, :, 0], axis=0)])
        power = np.concatenate([[0.0], np.cumsum(own[:, 0, 0])])
        cumulative = np.concatenate([[0.0], np.cumsum(own[:, 0, 1])])
        inside = self.search.solved.shared
        residual = inside @ shared[:, :, 1].sum(axis=0)
        best: dict[str, tuple[float, int, int]] = {}
        for i in range(flights):
            stops = np.arange(i + 1, flights + (i > 0))
            part = loss[stops] - loss[i]
            size = power[stops] - power[i] - np.einsum("sx,xy,sy->s", part, inside, part)
            pull = np.maximum(cumulative[stops] - cumulative[i] - part @ residual, 0.0)
            for stop, gain in zip(stops, pull**2 / np.maximum(size, 1e-12) / 2, strict=True):
                kind = "since" if stop == flights else "until"
                if gain > best.get(kind, (0.0,))[0]:
                    best[kind] = (float(gain), i, int(stop))
        before = np.append(ends[order, 0], np.inf)  # a step between two flights is placed midway
        after = np.append(-np.inf, ends[order, 1])
        for kind, (gain, i, stop) in best.items():
            first = ends[order[i], 0] - GRID if i == 0 else (after[i] + before[i]) / 2.0
            last = (after[stop] + before[stop]) / 2.0
            times = (first,) if kind == "since" else (first, last)
            yield kind, gain, -1, times

    def gram(self, step: _Step, times: Floats) -> Floats:
        """Return the Gram matrix (S + 1, S + 1) of S step columns and the residual, nuisances
        marginalised.

        Column s is the loss from `times[s]` (s) on, in the flights of `step`; the residual is last.
        """
        reduced, nuisance = self.search.reduced, self.search.nuisance
        f, count = step.flight, times.size
        if f is None:
            shared, own = nuisance.sums(self._loss_from(times, slice(None)))
        else:
            means = slice(*np.searchsorted(reduced.flight, [f, f + 1]))
            shared, own = nuisance.select_flight(f, means.start).sums(self._loss_from(times, means))
        for g in range(reduced.flights) if f is not None else ():
            if g != f and step.later_flights[g]:
                both = [0] * count + [1]
                shared += self.shared[g][:, both]
                own += self.own[g][np.ix_(both, both)]
            elif g != f:
                shared[:, -1] += self.shared[g][:, 1]
                own[-1, -1] += self.own[g][1, 1]
        return own - shared.T @ self.search.solved.shared @ shared

    def _loss_from(self, times: Floats, means: slice) -> Floats:
        """Return the loss's column from each time on, and the residual (n, R, S + 1)."""
        later = self.search.reduced.channels.time_s[means, None] >= times
        loss = self.columns[means, :, :1] * later[:, None, :]
        return np.concatenate([loss, self.columns[means, :, 1:]], axis=2)


def _step_gains(gram: Floats) -> Floats:
    """Return the gain (S,) in log likelihood of a loss in each step; 0 for a negative loss."""
    power = np.maximum(np.diag(gram)[:-1], 1e-12)
    return np.maximum(gram[:-1, -1], 0.0) ** 2 / power / 2


def argmax_centre(gains: Floats) -> tuple[int, ...]:
    """Return the index of the largest gain, the middle one of a plateau (times between two means
    are equivalent)."""
    ties = np.argwhere(gains >= gains.max() * (1.0 - 1e-6))
    return tuple(int(np.sort(places)[places.size // 2]) for places in ties.T)


def _best_transient(sums: LossSums, step: _Step) -> tuple[float, tuple[float, ...]]:
    """Return the largest gain of a loss between two times, and the times, refined about the grid's
    best."""
    near = np.arange(-GRID, GRID + FINE, FINE)
    began, ended = _best_interval(sums, step, step.times)[1]
    return _best_interval(sums, step, np.unique(np.concatenate([near + began, near + ended])))


def _best_interval(sums: LossSums, step: _Step, times: Floats) -> tuple[float, tuple[float, ...]]:
    """Find the loss between two of `times` (n,), s, that gains most: return its gain and both
    times.

    The gain is that of the log likelihood. The second time is at least LEAST_AFTER s later.
    """
    gram = sums.gram(step, times)
    inner, power = gram[:-1, -1], np.diag(gram)[:-1]
    gain = power[:, None] + power - 2.0 * gram[:-1, :-1]
    score = np.maximum(inner[:, None] - inner, 0.0) ** 2 / np.maximum(gain, 1e-12) / 2
    score[times[None, :] - times[:, None] < LEAST_AFTER] = 0.0
    i, j = argmax_centre(score)
    return float(score[i, j]), (float(times[i]), float(times[j]))


def _step_candidate(
    search: Search, kind: str, rotor: int, flight: int, when: tuple[float, ...], tries: int
) -> Candidate:
    """Return the candidate of a step change of `rotor`, from 0, with its times as start values.

    `kind` is a key of KINDS; `flight` is its flight, -1 for none; `when` holds the begin, and for a
    loss that ends the end, s. The log prior falls by ln `tries`, the number of times that were
    tried.
    """
    effect, clock = KINDS[kind]
    steady = candidate(Term(effect=effect, rotor=rotor), search.reduced.flights)
    names = [p.name for p in effect.parameters]
    start = steady.start.copy()
    time = when[0]
    if kind in ("while", "until"):
        start[:, names.index("end_clock" if kind == "until" else "end_time")] = when[1]
    if kind == "since" and flight >= 0:
        x = search.reduced.channels
        first = int(np.argmax(search.reduced.flight == flight))
        time += float(x.clock_s[first] - x.time_s[first])
    start[:, names.index(clock)] = time
    free = steady.free
    if flight < 0:  # no row determines the time of a step between flights
        free = tuple((k, f) for k, f in free if not names[k].endswith("_clock"))
    if kind in ("one", "while"):
        free = tuple((k, f) for k, f in steady.free if f == flight)
    prior = float(np.log(ROTOR_PRIOR / len(KINDS)) - np.log(tries))
    return replace(steady, start=start, free=free, log_prior=prior)
