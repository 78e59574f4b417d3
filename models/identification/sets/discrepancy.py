"""The discrepancy: what any smooth law of the channels could do, for names to compete with.

Each mode has a sum of piecewise linear curves over the channels (hats between quantiles), and of
airspeed times tank mass; a heading has its first two harmonics, the pump a step. Each flight also
wanders: slow noise that goes with nothing, as weather does, is a curve of its own over time.
Coefficients are drawn from a normal distribution whose size is a hypothesis of the search. Source:
Kennedy and O'Hagan 2001, the discrepancy of a model as a smooth function with its own prior.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.flight import Floats

#: channel -> number of hats, and the least span over which it can be a cause: less is control
CHANNELS = {
    "airspeed": (5, 1.0),
    "tank_kg": (5, 0.0),
    "time_s": (5, 20.0),
    "voltage": (4, 0.0),
    "advance_ratio": (4, 0.01),
    "radius_over_height": (3, 0.05),
    "load_factor": (3, 0.02),
    "yaw_rate": (3, 0.1),
    "heading": (4, 0.5),
    "spraying": (1, 0.5),
}
PRODUCT = ("airspeed", "tank_kg")
WANDER = 25.0  # s between the knots of a flight's own slow noise
MEANS = 0.75  # of the scatter of knots, that of means between them: root of 1/2 to 5/8
FORM = 0.05  # of what an effect does: the laws of `models.effects` are good to a few per cent
#: along which the form of an effect may be wrong
FORMED = ("airspeed", "tank_kg", "time_s")
SLOW_MEANS = 43  # means over which voltage is averaged: faster it answers to the rotors themselves


def free_columns(x: Channels, flight: NDArray[np.intp]) -> tuple[Floats, tuple[str, ...]]:
    """(N, H) columns of size about one, and (H,) the channel that each goes along.

    Channels that are not reported throughout, or do not vary, have none.
    """
    columns: list[Floats] = [np.ones((x.time_s.size, 1))]
    names: list[str] = ["constant"]
    few: dict[str, Floats] = {}
    for name, (count, least) in CHANNELS.items():
        values = np.asarray(getattr(x, name))
        if not np.isfinite(values).all() or np.ptp(values) <= max(least, 1e-6):
            continue
        if name == "voltage":
            values = slowly(values, flight)
        if name == "heading":
            part = np.stack([f(k * values) for k in (1, 2) for f in (np.sin, np.cos)], axis=1)
        else:
            part = hats(values, count) if count > 1 else values[:, None]
        columns.append(part - part.mean(axis=0))
        names += [name] * part.shape[1]
        if name in PRODUCT:
            few[name] = hats(values, 3)
    if len(few) == len(PRODUCT):
        one, other = (few[name] for name in PRODUCT)
        product = (one[:, :, None] * other[:, None, :]).reshape(one.shape[0], -1)
        columns.append(product - product.mean(axis=0))
        names += ["airspeed x tank_kg"] * product.shape[1]
    return np.concatenate(columns, axis=1), tuple(names)


def form_columns(x: Channels) -> Floats:
    """(N, W) slow curves of size one, by which an effect may be another one than its form says."""
    parts = [np.ones((x.time_s.size, 1))]
    for name in FORMED:
        values = np.asarray(getattr(x, name))
        if np.isfinite(values).all() and np.ptp(values) > max(CHANNELS[name][1], 1e-6):
            part = hats(values, 3)
            parts.append(part - part.mean(axis=0))
    return np.concatenate(parts, axis=1)


def wander_columns(time_s: Floats, flight: NDArray[np.intp], apart: float = WANDER) -> Floats:
    """(N, W) hats over the time of each flight, `apart` seconds; flights share the columns.

    A pause has none, however long: a log may go on hours later.
    """
    first = np.searchsorted(flight, np.unique(flight))
    place = (time_s - time_s[first][flight]) / apart
    before = np.floor(place)
    knots = np.union1d(before, before[place > before] + 1.0)
    return np.maximum(1.0 - np.abs(place[:, None] - knots), 0.0)


def slow_wander(values: Floats, time_s: Floats, flight: NDArray[np.intp], apart: float) -> Floats:
    """(R,) size of slow noise within flights that values (T, R) show: knots every `apart` seconds.

    Between knots that scatter by s, means over `apart` seconds scatter by MEANS s about their
    flight's; 0 where no flight is long enough.
    """
    total, count = np.zeros(values.shape[1]), 0
    for f in np.unique(flight):
        of, at = values[flight == f], time_s[flight == f]
        long = at[-1] - at[0] + 1e-6
        pieces = ((at - at[0]) / long * max(1, round(long / apart))).astype(np.intp)
        parts = np.stack([of[pieces == k].mean(axis=0) for k in np.unique(pieces)])
        total += np.sum((parts - parts.mean(axis=0)) ** 2, axis=0)
        count += len(parts) - 1
    return np.sqrt(total / max(count, 1)) / MEANS


def hats(values: Floats, count: int) -> Floats:
    """(N, K) piecewise linear hats that sum to one, at quantiles; fewer where they coincide."""
    knots = np.quantile(values, np.linspace(0.02, 0.98, count))
    apart = 1e-3 * max(float(np.ptp(knots)), 1e-12)
    knots = knots[np.concatenate([[True], np.diff(knots) > apart])]
    if knots.size < 2:
        return np.ones((values.size, 1))
    place = np.interp(values, knots, np.arange(knots.size))
    return np.maximum(1.0 - np.abs(place[:, None] - np.arange(knots.size)), 0.0)


def slowly(values: Floats, flight: NDArray[np.intp]) -> Floats:
    """Running mean within each flight."""
    out = np.empty_like(values)
    for f in np.unique(flight):
        mine = flight == f
        ones = np.ones(min(SLOW_MEANS, int(mine.sum())))
        sums = np.convolve(values[mine], ones, mode="same")
        out[mine] = sums / np.convolve(np.ones(int(mine.sum())), ones, mode="same")
    return out
