"""Figures of the known numbers of a flight: NaN is left out, and is the answer where all is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from thrustmargin.models.flight import Bools, FlightTrack, Floats

#: Share of the airborne rows that counts as the start and as the end of a flight.
END_SHARE = 0.1


def _of_known(figure: Callable[[Floats], Any]) -> Callable[[Floats], float]:
    def of(values: Floats) -> float:
        known = values[np.isfinite(values)]
        return float(figure(known)) if known.size else float("nan")

    return of


median, mean, most, least = map(_of_known, (np.median, np.mean, np.max, np.min))


def share(part: float, whole: float) -> float:
    """Part over whole; NaN of nothing."""
    return part / whole if whole > 0.0 else float("nan")


def end_rows(track: FlightTrack) -> tuple[Bools, Bools]:
    """(T,) the first and (T,) the last tenth of the airborne rows."""
    airborne = np.flatnonzero(track.flying)
    count = max(1, round(END_SHARE * airborne.size))
    first, last = np.zeros((2, track.time_s.size), dtype=np.bool_)
    first[airborne[:count]] = True
    last[airborne[-count:]] = True
    return first, last
