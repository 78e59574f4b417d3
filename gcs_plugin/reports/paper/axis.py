"""An axis on paper: from values to pixels, and where its marks stand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from thrustmargin.models.flight import Floats

STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
SECONDS = (1, 2, 5, 10, 15, 20, 30, 60, 120, 300, 600, 900, 1200, 1800, 3600, 7200, 14400)
ROOM = 0.01  # of the values' span, beside them


@dataclass(frozen=True, slots=True)
class Axis:
    """Values from `low` at pixel `begin` to `high` at pixel `end`; decades where it is "log"."""

    kind: str  # plotly's type: linear, date (ms, shown as time) or log
    low: float
    high: float
    begin: float
    end: float

    def at(self, values: Any) -> Floats:
        """The pixels of values of any shape."""
        values = np.asarray(values, dtype=np.float64)
        if self.kind == "log":
            values = np.log10(values)
        share = (values - self.low) / (self.high - self.low)
        return self.begin + share * (self.end - self.begin)

    @property
    def scale(self) -> float:
        """Pixels a unit."""
        return abs(self.end - self.begin) / (self.high - self.low)

    def with_scale(self, scale: float) -> Axis:
        """The same pixels about the same middle with so many pixels a unit."""
        middle, half = 0.5 * (self.low + self.high), 0.5 * abs(self.end - self.begin) / scale
        return Axis(self.kind, middle - half, middle + half, self.begin, self.end)

    def marks(self, most: int) -> list[tuple[float, str]]:
        """About so many round values on it, and what is written there."""
        if self.kind == "log":
            decades = range(int(np.floor(self.low)), int(np.ceil(self.high)) + 1)
            inner = (1, 2, 5) if len(decades) < 4 else (1,)
            values = [m * 10.0**d for d in decades for m in inner]
            inside = [v for v in values if self.low <= np.log10(v) <= self.high]
            return [(v, f"{v:g}") for v in inside]
        if self.kind == "date":
            span = (self.high - self.low) / 1000.0
            step = 1000.0 * next((s for s in SECONDS if span / s <= most), SECONDS[-1])
            return [(value, clock(value)) for value in _multiples(step, self.low, self.high)]
        rough = (self.high - self.low) / max(most, 1)
        power = 10.0 ** np.floor(np.log10(rough))
        step = next(s * power for s in STEPS if s * power >= rough * (1.0 - 1e-9))
        return [(value, f"{value:.6g}") for value in _multiples(step, self.low, self.high)]


def axis_over(
    properties: Mapping[str, Any], values: Sequence[Any], begin: float, end: float
) -> Axis:
    """The axis with plotly's `properties`, of the values (each any shape) that are drawn on it."""
    kind = properties.get("type", "linear")
    known = np.concatenate([np.ravel(np.asarray(v, dtype=np.float64)) for v in (*values, [])])
    if kind == "log":
        known = np.log10(known[known > 0.0])
    known = known[np.isfinite(known)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    room = ROOM * (high - low) or 0.5
    low, high = properties.get("range") or (low - room, high + room)
    return Axis(kind, low, high, begin, end)


def _multiples(step: float, low: float, high: float) -> Floats:
    first, last = np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9)
    return step * (np.arange(first, last + 1) + 0.0)  # no nought below nought


def clock(milliseconds: float) -> str:
    """Minutes and seconds, from an hour on with hours."""
    seconds = round(milliseconds / 1000.0)
    hours, minutes = seconds // 3600, seconds // 60 % 60
    tail = f"{minutes:02d}:{seconds % 60:02d}"
    return f"{hours}:{tail}" if hours else tail
