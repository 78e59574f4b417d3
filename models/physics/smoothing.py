"""Compute slopes, means and medians of channels with gaps.

`scipy.ndimage` and `scipy.signal` have similar functions, but each takes as long to import as a
flight takes to analyse.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from thrustmargin.models.flight import Floats

_Beyond = Literal["symmetric", "constant", "edge"]


def row_step(time_s: Floats) -> float:
    """Return the median s between rows, rounded to 1 ms if near that, so that it is equal in
    each window of a flight."""
    step = known_median(time_s[1:] - time_s[:-1])
    whole = round(step, 3)
    return whole if abs(step - whole) < 0.008 * step else float(f"{step:.4g}")


def known_median(values: Floats) -> float:
    """Return the median of the finite values, NaN without one.

    np.nanmedian takes several times as long for a minute of rows.
    """
    known = values[np.isfinite(values)]
    if not known.size:
        return float("nan")
    low, high = (known.size - 1) // 2, known.size // 2
    known.partition((low, high))
    return float(known[low] + known[high]) / 2.0


def _over_known(figure: Callable[[Floats], Any]) -> Callable[[Floats], float]:
    """Return a function of an array: `figure` of its finite values; NaN if none is finite."""

    def figure_of_known(values: Floats) -> float:
        """Apply the figure to the finite values; NaN without one."""
        known = values[np.isfinite(values)]
        return float(figure(known)) if known.size else float("nan")

    return figure_of_known


#: Mean, maximum and minimum of the finite values; NaN without one.
known_mean, known_most, known_least = _over_known(np.mean), _over_known(np.max), _over_known(np.min)


def known_means(values: Floats) -> Floats:
    """Return the row means (T,) of the finite values (T, R); NaN in rows without one."""
    known = np.isfinite(values)
    total = np.sum(values, axis=1, where=known)
    return np.divide(
        total, known.sum(axis=1), out=np.full(total.size, np.nan), where=known.any(axis=1)
    )


@lru_cache(maxsize=64)
def _slope_weights(window: int, step: float) -> Floats:
    """Return the convolution weights (window,) of a local quadratic's slope, s⁻¹; `window` is odd.

    Savitzky and Golay (1964): k over the sum of k².
    """
    place = np.arange(window // 2, -(window // 2) - 1.0, -1.0)
    return place / (step * np.sum(place**2))


def derivative(time_s: Floats, values: Floats, span: float) -> Floats:
    """Differentiate `values` (T, ...) by a local quadratic over `span` s, in units per s.

    NaN next to a gap in `time_s` (T,), s, and at the ends; all NaN with fewer than 9 rows.
    """
    if time_s.size < 9:
        return np.full_like(values, np.nan)
    step = row_step(time_s)
    window = max(3, 2 * int(span / step / 2) + 1)
    window = min(window, time_s.size - (time_s.size + 1) % 2)
    columns = _pad(values, window // 2, window // 2, "edge").reshape(-1, values[0].size).T
    weights = _slope_weights(window, step)
    slope = np.array([np.convolve(c, weights, "valid") for c in columns]).T.reshape(values.shape)
    gap = np.flatnonzero(np.abs(np.diff(time_s) - step) > 0.5 * step)
    half = window // 2 + 1
    near = (gap[:, None] + np.arange(-half, half + 1)).ravel()
    slope[np.clip(near, 0, time_s.size - 1)] = np.nan
    slope[:half] = slope[-half:] = np.nan
    return slope


def moving_mean(time_s: Floats, values: Floats, span: float) -> Floats:
    """Return the mean (T,) of the finite `values` (T,) in a window of `span` s centred on each row.

    NaN where the window has none. A single row is returned as it is.
    """
    if time_s.size < 2:
        return values
    width = max(1, round(span / row_step(time_s)))
    known = np.isfinite(values)
    total = running_mean(np.where(known, values, 0.0), width, padding="constant")
    share = running_mean(known.astype(float), width, padding="constant")
    return np.where(share > 0.5 / width, total / np.maximum(share, 1e-9), np.nan)


def running_mean(values: Floats, width: int, *, padding: _Beyond = "symmetric") -> Floats:
    """Return means (T, ...) over `width` rows about each; `padding` is the mode of `np.pad` at
    the ends."""
    if not len(values):
        return values
    total = np.cumsum(_pad(values, width // 2, (width - 1) // 2, padding), axis=0)
    total[width:] -= total[:-width].copy()
    return total[width - 1 :] / width


def median_of_five(values: Floats) -> Floats:
    """Return the running median (n,) over five values; the end values are repeated outwards."""
    a, b, c, d, e = np.lib.stride_tricks.sliding_window_view(np.pad(values, 2, "edge"), 5).T
    # Without the least and the largest of four, the middle of the two left and the fifth; in place,
    # as a long log's times are as large as the log.
    low = np.maximum(np.minimum(a, b), np.minimum(c, d))
    high = np.minimum(np.maximum(a, b), np.maximum(c, d))
    least = np.minimum(low, high)
    np.maximum(low, high, out=high)
    return np.maximum(least, np.minimum(high, e, out=high), out=high)


def _pad(values: Floats, before: int, after: int, padding: _Beyond) -> Floats:
    """Pad the first axis by `before` and `after` rows."""
    return np.pad(values, [(before, after)] + [(0, 0)] * (values.ndim - 1), padding)
