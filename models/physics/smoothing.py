"""Slopes and means of channels that have gaps."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.ndimage import convolve1d, uniform_filter1d

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


@lru_cache(maxsize=64)
def _slope_weights(window: int, step: float) -> Floats:
    """(window,) that a local quadratic's slope is the convolution with, s⁻¹, `window` odd.

    Savitzky and Golay (1964): k over the sum of k². `scipy.signal` would take as long to import as
    all else.
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
    slope: Floats = convolve1d(values, _slope_weights(window, step), axis=0, mode="nearest")
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
    total = uniform_filter1d(np.where(known, values, 0.0), width, mode="constant")
    share = uniform_filter1d(known.astype(float), width, mode="constant")
    return np.where(share > 0.5 / width, total / np.maximum(share, 1e-9), np.nan)
