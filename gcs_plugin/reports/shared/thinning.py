"""Fewer rows for a plot than a flight has, with the worst of each stretch kept."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.flight import Floats


def keep_extremes(values: Floats, buckets: int) -> NDArray[np.intp]:
    """Row numbers of (T,) `values` for a line plot: first, least, greatest, last of each bucket.

    The peaks of the whole stay; a bucket with a NaN keeps one, so that the line breaks there.
    """
    rows = values.size
    if rows <= 4 * buckets:
        return np.arange(rows)
    edges = np.linspace(0, rows, buckets + 1).astype(np.intp)
    starts = edges[:-1]
    which = np.repeat(np.arange(buckets), np.diff(edges))
    known = np.isfinite(values)
    # Sorting by bucket and then by value puts each bucket's extremes at its ends.
    low = np.lexsort((np.where(known, values, np.inf), which))[starts]
    high = np.lexsort((np.where(known, -values, np.inf), which))[starts]
    gap = np.flatnonzero(~known)
    gap = gap[np.diff(which[gap], prepend=-1) > 0]
    return np.unique(np.concatenate([starts, low, high, gap, edges[1:] - 1]))


def keep_worst(score: Floats, buckets: int) -> NDArray[np.intp]:
    """One row number a bucket of (T,) `score`: the greatest; buckets without a number keep none."""
    rows = score.size
    edges = np.linspace(0, rows, min(buckets, rows) + 1).astype(np.intp)
    which = np.repeat(np.arange(edges.size - 1), np.diff(edges))
    first = np.lexsort((np.where(np.isfinite(score), -score, np.inf), which))[edges[:-1]]
    return first[np.isfinite(score[first])]
