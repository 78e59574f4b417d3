"""Resample channels reported at their own times to the rows of one table.

`linear` interpolates between the reports on both sides, for recorded flights; `hold` takes the last
report, as a live listener must. With both, a value older than the channel's age limit becomes NaN.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.models.flight import TRACK_CHANNELS, Bools, Floats, TrackChannel

Sampling = Literal["linear", "hold"]

#: Rows closer than this to the one before are thinned out: at most 10 Hz, with room for jitter.
ROW_SPACING = 0.09
GRID = 0.1  # s between rows when no report triggers them
_BLOCK = 1 << 14


def within(channel: str, values: Floats) -> bool:
    """Return True if there are values and all are in the channel's range."""
    limit = TRACK_CHANNELS[channel]
    return bool(
        values.size
        and np.minimum.reduce(values, axis=None) >= limit.low
        and np.maximum.reduce(values, axis=None) <= limit.high
    )


def plausible(channel: str, values: Floats) -> Floats:
    """Return the values, with NaN for those out of the channel's range or not finite."""
    limit = TRACK_CHANNELS[channel]
    good = (values >= limit.low) & (values <= limit.high)
    return values if good.all() else np.where(good, values, np.nan)


def all_true(flags: Bools) -> bool:
    """Return True if all flags are True; five times as fast as `all` for few flags."""
    return int(np.count_nonzero(flags)) == flags.size


def known_rows(values: Floats) -> Bools:
    """Flag the rows (n,) in which every column is finite."""
    finite = np.isfinite(values)
    # Along the rows numpy is ten times as quick as along a row's few columns.
    return finite if values.ndim == 1 else np.logical_and.reduce(finite.T.copy())


def sample(channel: str, signal: Signal, time_s: Floats, sampling: Sampling) -> Floats:
    """Return the channel's signal at the times `time_s` (T,), as (T,) or (T, k).

    NaN where no report is within the channel's age limit. "linear" interpolates, after averaging
    fast reports; "hold" takes the last report.
    """
    when, values = _reports(channel, signal)
    if when.size == 0:
        return np.full((time_s.size, *values.shape[1:]), np.nan)
    averaged = sampling == "linear" and TRACK_CHANNELS[channel].averaged and when.size > 4
    if averaged and np.median(np.diff(when)) < GRID / 2:
        when, values = _averaged(when, values)
    if time_s.size <= _BLOCK:
        return _interpolate(TRACK_CHANNELS[channel], when, values, time_s, sampling)
    # In blocks: the steps between take several times the memory of the result.
    result = np.empty((time_s.size, *values.shape[1:]))
    for low in range(0, time_s.size, _BLOCK):
        rows = slice(low, low + _BLOCK)
        result[rows] = _interpolate(TRACK_CHANNELS[channel], when, values, time_s[rows], sampling)
    return result


def _reports(channel: str, signal: Signal) -> tuple[Floats, Floats]:
    """Return times (n,) and values (n,) or (n, k) of the signal's reports in the channel's range.

    Of several at one time the last is returned.
    """
    limit, values, time_s = TRACK_CHANNELS[channel], signal.values, signal.time_s
    if within(channel, values) and all_true(time_s[1:] > time_s[:-1]):
        return time_s, values
    keep = (values >= limit.low) & (values <= limit.high)
    keep = keep if keep.ndim == 1 else np.logical_and.reduce(keep, axis=1)
    if time_s.size:
        keep[:-1] &= (time_s[1:] > time_s[:-1]) | ~keep[1:]
    return (time_s, values) if keep.all() else (time_s[keep], values[keep])


def _averaged(when: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return means of times `when` (n,) and `values` (n,) or (n, k) over each GRID s.

    So vibration faster than the rows is not aliased.
    """
    bins = np.floor(when / GRID)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(bins)) + 1])
    counts = np.diff(edges, append=when.size).astype(np.float64)
    sums = np.add.reduceat(values, edges, axis=0)
    return np.add.reduceat(when, edges) / counts, sums / _shaped(counts, values)


def _interpolate(
    limit: TrackChannel, when: Floats, values: Floats, time_s: Floats, sampling: Sampling
) -> Floats:
    after = when.searchsorted(time_s, side="right")
    previous = np.maximum(after - 1, 0)
    before, earlier = values.take(previous, axis=0), when.take(previous)
    fresh = (after > 0) & (time_s - earlier <= limit.max_age)
    if sampling == "hold" or limit.kind == "state":
        return _masked(before, fresh)
    right = np.minimum(after, when.size - 1)
    later = when.take(right)
    near = (after < when.size) & (later - time_s <= limit.max_age)
    # With a report on one side only (the ends, or a pause) that one is held.
    share = (time_s - earlier) / np.where(fresh & near, later - earlier, np.inf)
    share[near & ~fresh] = 1.0
    step = values.take(right, axis=0) - before
    if limit.kind == "angle":
        interpolated = _wrapped(before + _shaped(share, values) * _wrapped(step))
    else:
        interpolated = before + _shaped(share, values) * step
    return _masked(interpolated, fresh | near)


def _wrapped(angle: Floats) -> Floats:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _shaped(rows: NDArray[Any], like: Floats) -> NDArray[Any]:
    """Return (n,) as (n, 1) if `like` has columns."""
    return rows[:, None] if like.ndim == 2 else rows


def _masked(values: Floats, keep: Bools) -> Floats:
    return values if all_true(keep) else np.where(_shaped(keep, values), values, np.nan)


def first_known(
    channel: str, sources: Iterable[Signal], time_s: Floats
) -> tuple[Floats | None, list[Signal]]:
    """Return a channel's values at `time_s` (T,) as a live listener has them, and the sources used.

    Each row has the value of the first source, in the order given, with a recent report, NaN
    without. The values are (T,) or (T, k), None without any source.
    """
    values, used = None, []
    for signal in sources:
        sampled = sample(channel, signal, time_s, "hold")
        if values is None:
            values, used = sampled, [signal]
        else:
            missing = ~known_rows(values)
            if np.any(known_rows(sampled) & missing):
                values = np.where(_shaped(missing, values), sampled, values)
                used.append(signal)
        if all_true(np.isfinite(values)):
            break
    return values, used


def last_before(signal: Signal, time_s: Floats) -> Floats:
    """Return the last known report at each of the times `time_s` (T,), however old.

    The result is (T,) or (T, k), NaN before the first report.
    """
    values, when = signal.values, signal.time_s
    keep = known_rows(values)
    if not all_true(keep):
        values, when = values[keep], when[keep]
    if when.size == 0:
        return np.full((time_s.size, *values.shape[1:]), np.nan)
    last = when.searchsorted(time_s, side="right") - 1
    return _masked(values[np.maximum(last, 0)], last >= 0)


def thinned(time_s: Floats, after_s: float = -np.inf) -> Floats:
    """Drop times (n,), s, so that the others are ROW_SPACING or more apart; the first one stays.

    The first is at least ROW_SPACING after `after_s`, the last row so far. NaN are dropped.
    """
    time_s = increasing(time_s[np.isfinite(time_s)])
    time_s = time_s[np.searchsorted(time_s, after_s + ROW_SPACING) :]
    if np.all(np.diff(time_s) >= ROW_SPACING):
        return time_s
    kept = []
    row = 0
    while row < time_s.size:
        kept.append(row)
        row = max(int(np.searchsorted(time_s, time_s[row] + ROW_SPACING)), row + 1)
    return time_s[np.array(kept)]


def increasing(values: Floats) -> Floats:
    """Return the sorted distinct `values` (n,), as `np.unique`, but faster if already sorted."""
    if all_true(values[1:] > values[:-1]):
        return values
    step = np.diff(values)
    if not (step >= 0.0).all():
        return np.unique(values)
    return values[np.append(True, step > 0.0)]


def coverage(signal: Signal) -> int:
    """Return the number of whole seconds with a finite value of the signal."""
    return increasing(np.floor(signal.time_s[known_rows(signal.values)])).size


def in_time_order(time_s: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return times and values sorted by time, infinite values as NaN."""
    if np.isinf(values).any():
        values = np.where(np.isinf(values), np.nan, values)
    if time_s.size < 2 or np.all(time_s[1:] >= time_s[:-1]):
        return time_s, values
    order = np.argsort(time_s, kind="stable")
    return time_s[order], values[order]
