"""Put channels that were reported at their own times onto the rows of one table.

`linear` interpolates between the reports on both sides and is for recorded flights; `hold` takes
the last report, as a live listener must. Either way a value older than the channel's age limit is
not used: NaN.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.models.flight import Bools, Floats

Sampling = Literal["linear", "hold"]

#: Rows closer than this to the one before are thinned out: at most 10 Hz, with room for jitter.
ROW_SPACING = 0.09
GRID = 0.1  # s between rows when nothing gives a rhythm
#: Channels that are one signal each, whichever source is best.
PLAIN = (
    "attitude",
    "angular_rate_frd",
    "specific_force_frd",
    "velocity_ned",
    "airspeed",
    "wind_ned",
    "altitude",
    "height_agl",
    "pressure",
    "temperature",
)
#: Channels that vibration reaches: reports faster than the rows are averaged over them.
AVERAGED = ("specific_force_frd",)
_BLOCK = 1 << 14


@dataclass(frozen=True, slots=True)
class Limit:
    """How one channel is sampled, and the range outside which a number cannot be true."""

    max_age: float  # s
    low: float
    high: float
    kind: Literal["linear", "angle", "state"] = "linear"


#: State channels are always held. Ranges are wide: they catch damage, not odd flights.
LIMITS: Mapping[str, Limit] = MappingProxyType(
    {
        "position_ned": Limit(1.0, -1e6, 1e6),
        "geodetic": Limit(1.0, -1e5, 1e5),
        "velocity_ned": Limit(1.0, -200.0, 200.0),
        "attitude": Limit(0.5, -7.0, 7.0, "angle"),
        "angular_rate_frd": Limit(0.5, -100.0, 100.0),
        "specific_force_frd": Limit(0.5, -500.0, 500.0),
        "airspeed": Limit(1.0, 0.0, 200.0),
        "wind_ned": Limit(5.0, -100.0, 100.0),
        "tank_kg": Limit(3.0, -5.0, 1000.0),
        "rotor_speed_rpm": Limit(0.5, -100_000.0, 100_000.0),
        "throttle": Limit(0.5, 0.0, 1.0),
        "voltage": Limit(3.0, 0.0, 1000.0),
        "current": Limit(3.0, -2000.0, 5000.0),
        "pressure": Limit(5.0, 10_000.0, 120_000.0),
        "temperature": Limit(5.0, 180.0, 420.0),
        "altitude": Limit(1.0, -1000.0, 30_000.0),
        "height_agl": Limit(1.0, -1000.0, 10_000.0),
        "spraying": Limit(2.0, 0.0, 1.0, "state"),
    }
)


def plausible(channel: str, values: Floats) -> Floats:
    """The values with numbers that cannot be true (infinite, out of range) as NaN."""
    limit = LIMITS[channel]
    with np.errstate(invalid="ignore"):
        bad = ~((values >= limit.low) & (values <= limit.high))
    return np.where(bad, np.nan, values)


def known_rows(values: Floats) -> Bools:
    """(n,) rows in which every column has a number."""
    finite = np.isfinite(values)
    return finite if values.ndim == 1 else np.logical_and.reduce(finite, axis=1)


def sample(channel: str, signal: Signal, time_s: Floats, sampling: Sampling) -> Floats:
    """The signal at `time_s` (T,): (T,) or (T, k), NaN where no report is young enough."""
    when, values = _reports(channel, signal)
    result = np.full((time_s.size, *values.shape[1:]), np.nan)
    if when.size == 0:
        return result
    if sampling == "linear" and channel in AVERAGED and _is_fast(when):
        when, values = _averaged(when, values)
    # In blocks: the steps between take several times the memory of the result.
    for low in range(0, time_s.size, _BLOCK):
        rows = slice(low, low + _BLOCK)
        result[rows] = _at(LIMITS[channel], when, values, time_s[rows], sampling)
    return result


def _reports(channel: str, signal: Signal) -> tuple[Floats, Floats]:
    """Times and values of the reports that can be true; of those at one instant, the last."""
    values = plausible(channel, signal.values)
    keep = known_rows(values)
    if signal.time_s.size:
        keep[:-1] &= (np.diff(signal.time_s) > 0) | ~keep[1:]
    return signal.time_s[keep], values[keep]


def _is_fast(when: Floats) -> bool:
    return when.size > 4 and float(np.median(np.diff(when))) < GRID / 2


def _averaged(when: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Means over GRID: vibration that is faster than the rows must not fold into them."""
    bins = np.floor(when / GRID)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(bins)) + 1])
    counts = np.diff(edges, append=when.size).astype(np.float64)
    sums = np.add.reduceat(values, edges, axis=0)
    return np.add.reduceat(when, edges) / counts, sums / _shaped(counts, values)


def _at(limit: Limit, when: Floats, values: Floats, time_s: Floats, sampling: Sampling) -> Floats:
    after = np.searchsorted(when, time_s, side="right")
    left = np.maximum(after - 1, 0)
    age = time_s - when[left]
    fresh = (after > 0) & (age <= limit.max_age)
    if sampling == "hold" or limit.kind == "state":
        return _masked(values[left], fresh)
    right = np.minimum(after, when.size - 1)
    near = (after < when.size) & (when[right] - time_s <= limit.max_age)
    both = fresh & near
    span = when[right] - when[left]
    share = np.divide(age, span, out=np.zeros(span.size), where=both & (span > 0))
    # With a report on one side only (the ends, or a pause) that one is held.
    share[near & ~fresh] = 1.0
    step = values[right] - values[left]
    if limit.kind == "angle":
        between = _wrapped(values[left] + _shaped(share, values) * _wrapped(step))
    else:
        between = values[left] + _shaped(share, values) * step
    return _masked(between, fresh | near)


def _wrapped(angle: Floats) -> Floats:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _shaped(rows: NDArray[Any], like: Floats) -> NDArray[Any]:
    """(n,) as (n, 1) where `like` has columns."""
    return rows[:, None] if like.ndim == 2 else rows


def _masked(values: Floats, keep: Bools) -> Floats:
    return np.where(_shaped(keep, values), values, np.nan)


def thinned(time_s: Floats) -> Floats:
    """Strictly increasing times with at least ROW_SPACING between them, the first kept."""
    time_s = np.unique(time_s[np.isfinite(time_s)])
    if time_s.size == 0 or np.all(np.diff(time_s) >= ROW_SPACING):
        return time_s
    kept = []
    at = 0
    while at < time_s.size:
        kept.append(at)
        at = max(int(np.searchsorted(time_s, time_s[at] + ROW_SPACING)), at + 1)
    return time_s[np.array(kept)]


def coverage(signal: Signal) -> int:
    """Number of whole seconds in which the signal has a number."""
    known = known_rows(signal.values)
    return int(np.unique(np.floor(signal.time_s[known])).size)


def in_time_order(time_s: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Both sorted by time; as they are when they already are."""
    if time_s.size < 2 or np.all(time_s[1:] >= time_s[:-1]):
        return time_s, values
    order = np.argsort(time_s, kind="stable")
    return time_s[order], values[order]
