"""Slopes, means and medians of channels, some with gaps.

`scipy.ndimage` has such filters too; loading it takes as long as the rest of a report does.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

import numpy as np

from thrustmargin.models.flight import Floats


def row_step(time_s: Floats) -> float:
    """Usual s between rows, to the millisecond where it is about one: the same in each window."""
    step = known_median(time_s[1:] - time_s[:-1])
    whole = round(step, 3)
    return whole if abs(step - whole) < 0.008 * step else float(f"{step:.4g}")


def known_median(values: Floats) -> float:
    """Median of what is finite of values in any shape, NaN of nothing; np.nanmedian takes several
    times as long for a minute of rows."""
    known = values[np.isfinite(values)]
    if not known.size:
        return float("nan")
    low, high = (known.size - 1) // 2, known.size // 2
    known.partition((low, high))
    return float(known[low] + known[high]) / 2.0


def convolved(
    values: Floats, weights: Floats, *, beyond: Literal["edge", "symmetric", "constant"]
) -> Floats:
    """Of the shape of `values`, their convolution along time with `weights` (W,), the middle one
    (of an even number the later) at the row itself. Beyond the ends the last value goes on, the
    rows are mirrored, or there are zeros; `values` must hold a row."""
    before = weights.size // 2
    ends = [(before, weights.size - 1 - before)] + [(0, 0)] * (values.ndim - 1)
    padded = np.pad(values, ends, mode=beyond)
    columns = padded.reshape(len(padded), -1).T
    found = np.stack([np.convolve(column, weights, "valid") for column in columns], axis=-1)
    return found.reshape(values.shape)


def running_mean(
    values: Floats, width: int, *, beyond: Literal["edge", "symmetric", "constant"] = "symmetric"
) -> Floats:
    """Mean of `width` rows around each of `values` (T, ...); beyond the ends as `convolved`."""
    return convolved(values, np.full(width, 1.0 / width), beyond=beyond)


def median_of_five(values: Floats) -> Floats:
    """(n,) median of each value and two on either side; the first and the last go on."""
    a, b, c, d, e = np.lib.stride_tricks.sliding_window_view(np.pad(values, 2, mode="edge"), 5).T
    low = np.maximum(np.minimum(a, b), np.minimum(c, d))
    high = np.minimum(np.maximum(a, b), np.maximum(c, d))
    return np.maximum(np.minimum(e, low), np.minimum(np.maximum(e, low), high))


@lru_cache(maxsize=64)
def _slope_weights(window: int, step: float) -> Floats:
    """(window,) that a local quadratic's slope is the convolution with, s⁻¹, `window` odd.

    Savitzky and Golay (1964): k over the sum of k².
    """
    place = np.arange(window // 2, -(window // 2) - 1.0, -1.0)
    return place / (step * np.sum(place**2))


def derivative(time_s: Floats, values: Floats, span: float) -> Floats:
    """Time derivative by a local quadratic over `span` seconds; NaN next to a gap."""
    if time_s.size < 9:
        return np.full_like(values, np.nan)
    step = row_step(time_s)
    window = max(3, 2 * int(span / step / 2) + 1)
    window = min(window, time_s.size - (time_s.size + 1) % 2)
    slope: Floats = convolved(values, _slope_weights(window, step), beyond="edge")
    gap = np.flatnonzero(np.abs(np.diff(time_s) - step) > 0.5 * step)
    half = window // 2 + 1
    near = (gap[:, None] + np.arange(-half, half + 1)).ravel()
    slope[np.clip(near, 0, time_s.size - 1)] = np.nan
    slope[:half] = slope[-half:] = np.nan
    return slope


def moving_mean(time_s: Floats, values: Floats, span: float) -> Floats:
    """Mean (T,) of what is finite within `span` seconds about each row; NaN where nothing is."""
    if time_s.size < 2:
        return values
    width = max(1, round(span / row_step(time_s)))
    known = np.isfinite(values)
    total = running_mean(np.where(known, values, 0.0), width, beyond="constant")
    share = running_mean(known.astype(float), width, beyond="constant")
    return np.where(share > 0.5 / width, total / np.maximum(share, 1e-9), np.nan)
