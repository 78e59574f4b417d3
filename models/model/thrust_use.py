"""Summarise how much of the rotors' thrust a flight used: lasting use, passing use, no reserve.

    lasting use    of each rotor the running median of its thrust utilisation over 15 s
    passing use    above the limit for a shorter time: a turn, a climb, a gust
    spent          over 90 % of the largest thrust for a second or more

The limit is on lasting use: at 50 % a quad that loses a rotor can still carry its weight
(margin.py), which depends on weight, not on a turn. Turns at a line end take 4 to 7 s; a median
over 15 s follows use that lasts longer than half of that, and ignores a shorter turn. Where the log
pauses within the window, the seconds with data must suffice. In a turn the question is whether
thrust is left to hold the attitude: ArduPilot's own check for a loss of thrust begins at 90 %, for
a second (ArduCopter, crash_check.cpp).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.checks.loss_of_control import FULL_OUTPUT
from thrustmargin.models.checks.speed_readings import reading_scatter
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.model.analysis import FlightAnalysis, worst_rotor
from thrustmargin.models.model.inferred.utilisation_error import INTERVAL
from thrustmargin.models.physics.smoothing import known_median

LASTING_S = 15  # s
SPENT = 0.9  # of the largest thrust
MEDIAN_ERROR = 1.2533  # standard error of a median over that of the mean, of normal scatter
ALONE_S = 2.0  # s in which only one rotor had no reserve


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThrustUse:
    """Thrust utilisation of the worst rotor of one flight; NaN where unknown."""

    lasting_most: float  # with the ends of its 90 % interval
    lasting_low: float
    lasting_high: float
    lasting_above_s: float  # s with the lasting use above the limit
    above_s: float  # s above the limit in all
    known_s: float  # s in flight with a known use
    step_s: float  # median s from one such row to the next
    peak: float
    passing: int  # number of times above the limit, lasting use excepted
    passing_longest_s: float
    #: s in which a rotor surely had no reserve, by the outputs too where they are known
    spent_s: float
    spent_alone: int | None  # rotor, from 0, that most of this time was the only one
    lasting: Floats  # (T,)
    reach: Floats  # (T,) high end of its 90 % interval minus `lasting`
    surely_above: Bools  # (T,) rows whose lasting use is above the limit with its whole interval
    maybe_above: Bools  # (T,) rows whose interval reaches above the limit


def thrust_use(analysis: FlightAnalysis, limit: float) -> ThrustUse:
    """Summarise the utilisation of a flight; `limit` is the share of a rotor's largest thrust
    that may last."""
    track, outputs = analysis.track, analysis.claim.outputs
    use = np.where(track.flying[:, None], analysis.known_utilisation, np.nan)
    second, means = _second_means(track.time_s, use)
    above, beyond = (
        _second_means(track.time_s, INTERVAL * np.where(np.isfinite(use), error, np.nan))[1]
        for error in (analysis.utilisation_error, analysis.utilisation_beyond)
    )
    seen = np.isfinite(means)
    silent = _silent_seconds(track, second, seen.shape[0])
    medians = _lasting_use(means, silent)[_window_centres(np.any(seen, axis=1) | silent)]
    medians[~seen] = np.nan
    most, which = worst_rotor(medians)
    known = np.isfinite(most)
    up, down = np.zeros((2, most.size))
    cells = np.flatnonzero(known), which[known].astype(int)
    up[known] = np.nan_to_num(above[cells])
    down[known] = up[known] - np.nan_to_num(beyond[cells])
    scatter = reading_scatter(track)
    of_second, of_median = (2.0 * INTERVAL * scatter.of_mean(s) for s in (1.0, LASTING_S))
    single = MEDIAN_ERROR * of_median[cells[1]] * most[known]
    up[known], down[known] = np.hypot(up[known], single), np.hypot(down[known], single)
    now = worst_rotor(means)[0]
    flown = np.where(track.flying, track.row_seconds, 0.0)
    length = np.bincount(second, weights=flown).astype(np.float64)
    with np.errstate(invalid="ignore"):
        lasting_above, over = most > limit, now > limit
        surely, maybe = most - down > limit, most + up > limit
        # Speeds that read high reach the largest thrust while the outputs are lower.
        least = means * (1.0 if outputs is None else outputs.share_of_speeds)
        spent = least - np.hypot(np.nan_to_num(above - beyond), of_second * means) > SPENT
    if not known.any():  # without an airframe: full output means no reserve
        output = np.where(track.flying[:, None], track.throttle, np.nan)
        full = np.nan_to_num(_second_means(track.time_s, output)[1]) >= FULL_OUTPUT
        # No aircraft flies for long with all outputs full: their range was misread.
        spent = full & (length[full.all(axis=1)].sum() < 0.5 * length.sum())
    passed = _run_lengths(over & ~lasting_above, length)
    rows = np.isfinite(use).any(axis=1)
    top = int(np.nanargmax(most)) if known.any() else 0
    nothing = float("nan")
    return ThrustUse(
        lasting_most=float(most[top]) if known.any() else nothing,
        lasting_low=float(max((most - down)[top], 0.0)) if known.any() else nothing,
        lasting_high=float(max(most[top], min((most + up)[top], 1.0))) if known.any() else nothing,
        lasting_above_s=float(length[lasting_above].sum()),
        above_s=float(track.row_seconds[analysis.above_limit(limit)].sum()),
        known_s=float(track.row_seconds[rows].sum()),
        step_s=known_median(np.diff(track.time_s[rows])),
        peak=float(np.nanmax(use)) if rows.any() else nothing,
        passing=len(passed),
        passing_longest_s=max(passed, default=0.0),
        spent_s=float(length[spent.any(axis=1)].sum()),
        spent_alone=_exhausted_rotor(spent, length),
        lasting=most[second],
        reach=up[second],
        surely_above=surely[second] & track.flying,
        maybe_above=maybe[second] & track.flying,
    )


def _exhausted_rotor(spent: Bools, length: Floats) -> int | None:
    """Return the rotor, from 0, that most of the time was exhausted while no other was; else None.

    `spent` (S, R) flags exhausted rotors by second, `length` (S,) s flown in each. A turn exhausts
    two rotors, a climb all; one alone is weak, or carries a load that is off-centre.
    """
    alone = np.where((spent.sum(axis=1) == 1)[:, None], spent, False) * length[:, None]
    seconds = alone.sum(axis=0)
    most = float(seconds.max(initial=0.0))
    lasting = most >= ALONE_S and most > 0.5 * length[spent.any(axis=1)].sum()
    return int(np.argmax(seconds)) if lasting else None


def _window_centres(known: Bools) -> NDArray[np.intp]:
    """Return, for each of (S,) seconds, the nearest one whose whole window is in the same stretch
    of flight.

    Half a window, at the end of a stretch, would count passing use as lasting.
    """
    at, half, rows = np.arange(known.size), LASTING_S // 2, np.flatnonzero(known)
    for stretch in np.split(rows, np.flatnonzero(np.diff(rows) > half) + 1) if rows.size else ():
        first, last = int(stretch[0]), int(stretch[-1])
        middle = (first + last) // 2
        inside = min(first + half, middle), max(last - half, middle)
        at[first : last + 1] = np.clip(at[first : last + 1], *inside)
    return at


def _silent_seconds(track: FlightTrack, second: NDArray[np.int64], count: int) -> Bools:
    """Flag the seconds (S,) in flight in pauses of the log; `second` (T,) numbers each row's,
    `count` is S."""
    on = np.diff(track.time_s) > track.row_seconds[:-1]
    on &= track.flying[:-1] & track.flying[1:]
    found = np.zeros(count, dtype=np.bool_)
    for row in np.flatnonzero(on).tolist():
        found[second[row] + 1 : second[row + 1]] = True
    return found


def _lasting_use(means: Floats, silent: Bools) -> Floats:
    """Return a lower bound (S, R) of the running median of the means (S, R) over LASTING_S.

    Seconds in a pause of the log, `silent` (S,), count as 0, but the result is at least the lowest
    known mean of the window. NaN without a known mean in the window.
    """
    seen = np.isfinite(means)
    least = running_median(np.where(silent[:, None] & ~seen, 0.0, means), LASTING_S)
    half = LASTING_S // 2
    padded = np.pad(np.where(seen, means, np.inf), ((half, half), (0, 0)), constant_values=np.inf)
    lowest = np.lib.stride_tricks.sliding_window_view(padded, LASTING_S, axis=0).min(axis=-1)
    return np.fmax(least, np.where(np.isfinite(lowest), lowest, np.nan))


def running_median(values: Floats, window: int) -> Floats:
    """Return the median (S, R) of the known values among `window` rows around each; NaN where
    none is."""
    half = window // 2
    padded = np.pad(values, ((half, half), (0, 0)), constant_values=np.nan)
    around = np.sort(np.lib.stride_tricks.sliding_window_view(padded, window, axis=0), axis=-1)
    count = np.isfinite(around).sum(axis=-1, keepdims=True)
    low, high = np.maximum(count - 1, 0) // 2, count // 2
    pick = np.take_along_axis(around, np.minimum(low, window - 1), axis=-1)
    other = np.take_along_axis(around, np.minimum(high, window - 1), axis=-1)
    return np.where(count > 0, 0.5 * (pick + np.where(count > 0, other, pick)), np.nan)[..., 0]


def _second_means(time_s: Floats, values: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Return the number of the second (T,) of each row, and the means (S, R) of known values by
    second.

    A pause of the log is shortened to LASTING_S + 1 s. A mean without values is NaN.
    """
    whole = np.floor(time_s - time_s[0]) if time_s.size else time_s
    steps = np.clip(np.diff(whole, prepend=0.0), 0.0, LASTING_S + 1.0)
    second = np.cumsum(steps).astype(np.int64)
    count, total = (
        np.zeros((int(second[-1]) + 1 if second.size else 0, values.shape[1])) for _ in range(2)
    )
    known = np.isfinite(values)
    np.add.at(count, second, known)
    np.add.at(total, second, np.where(known, values, 0.0))
    return second, np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0)


def _run_lengths(on: Bools, seconds: Floats) -> list[float]:
    """List the lengths, s, of the runs of True in `on` (S,), with `seconds` (S,) s in each."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], on.astype(np.int8), [0]])))
    sums = np.concatenate([[0.0], np.cumsum(seconds)])
    return [float(sums[b] - sums[a]) for a, b in zip(edges[::2], edges[1::2], strict=True)]
