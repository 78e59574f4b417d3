"""The vehicle's own clock in a telemetry log.

Every frame of a .tlog carries the ground computer's time, late by the link's delay; many messages
also carry the vehicle's time since boot. Times here are the vehicle's. A message without an own
clock (ESC_TELEMETRY, VFR_HUD, BATTERY_STATUS, WIND) gets the ground's stamp less the median offset
of the last nine clocked messages before it, which a live listener can do just the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from thrustmargin.gcs_plugin.mavlink.layouts import layouts
from thrustmargin.gcs_plugin.mavlink.scan import Frames, Index, columns
from thrustmargin.gcs_plugin.telemetry.timeline import FORWARD, longest_stretch, without_leaps
from thrustmargin.models.flight import Bools, Floats

#: Messages whose clock is read when they are sent; others carry the time of a fix or of a change.
REFERENCES = (
    "ATTITUDE",
    "ATTITUDE_QUATERNION",
    "GLOBAL_POSITION_INT",
    "LOCAL_POSITION_NED",
    "RAW_IMU",
    "SCALED_IMU",
    "HIGHRES_IMU",
    "SCALED_PRESSURE",
    "NAMED_VALUE_FLOAT",
)
WINDOW = 9  # clocked messages whose median offset counts
TRUST = 2.0  # s; an own clock further than this from the estimate counts something else
COAST = 1.0  # s without a clocked message after which, on arrival, the stamps carry the clock on
_NEAR = 0.5  # s round a restart in which messages without a clock are still told apart
_US_WRAP = 2**32 * 1e-6  # s; SERVO_OUTPUT_RAW counts µs in 32 bits and wraps after 71 minutes


@dataclass(frozen=True, slots=True, eq=False)
class Clock:
    """The vehicle's time of every frame."""

    first_row: int  # the stretch between two restarts that is kept
    last_row: int
    estimate_s: Floats  # (n,) s since boot of all frames, by the ground's stamps
    stamp_minus_clock: float | None  # typical; None without a clock of its own
    jumps: tuple[tuple[float, float], ...]
    notes: tuple[str, ...]
    on_arrival: bool = False  # every message has the time at which a listener got it

    def of(self, fields: NDArray[np.void], rows: Index) -> Floats:
        """(n,) s since boot of messages: their own clock where it agrees, else the estimate."""
        estimate = self.estimate_s[rows]
        own = own_clock(fields)
        if own is None or self.stamp_minus_clock is None or self.on_arrival:
            return estimate
        if own_clock_wraps(fields):
            own = own + np.round((estimate - own) / _US_WRAP) * _US_WRAP
        return np.where(np.abs(own - estimate) <= TRUST, own, estimate)


def own_clock(fields: NDArray[np.void]) -> Floats | None:
    """(n,) s since boot that the messages carry; None when their type carries none."""
    names = fields.dtype.names or ()
    if "time_boot_ms" in names:
        return fields["time_boot_ms"].astype(np.float64) * 1e-3
    if "time_usec" in names:
        return fields["time_usec"].astype(np.float64) * 1e-6
    return None


def own_clock_wraps(fields: NDArray[np.void]) -> bool:
    """True for the messages that count µs in 32 bits."""
    names = fields.dtype.names or ()
    return "time_usec" in names and fields.dtype["time_usec"].itemsize == 4


def vehicle_clock(
    name: str, frames: Frames, pilot: Bools, stamps_s: Floats, *, on_arrival: bool = False
) -> Clock:
    """The clock of the component whose frames `pilot` (n,) marks, between two restarts.

    With `on_arrival` a frame's time is that of the last clocked message up to it, as a live
    listener has it, so that frames keep the order in which they came.
    Raises LogError when two clocks run in turns, as two vehicles of one system id do.
    """
    stamps_s = _mended(stamps_s)
    numbers = {layout.name: number for number, layout in layouts().items()}
    own = np.full(stamps_s.size, np.nan)
    for reference in REFERENCES:
        rows = np.flatnonzero(pilot & (frames.id == numbers[reference]))
        if rows.size:
            own[rows] = own_clock(columns(frames, rows, layouts()[numbers[reference]]))
    rows = np.flatnonzero(np.isfinite(own))
    last = stamps_s.size - 1
    if rows.size == 0:
        note = "no message carries the vehicle's clock: times are the ground computer's"
        first = int(np.argmax(pilot))
        return Clock(0, last, stamps_s - stamps_s[first], None, (), (note,))
    own = own[rows]
    stretch = longest_stretch(own, name)
    a, b = stretch.first, stretch.last + 1
    before = int(rows[a - 1]) + 1 if a else 0
    behind = int(rows[b]) if b < rows.size else stamps_s.size
    rows, own = rows[a:b], own[a:b]
    offset = stamps_s[rows] - own
    steps = _steps(offset)
    for part in np.split(np.arange(rows.size), steps):
        offset[part] = _running_median(offset[part])
    # Every frame takes the offset of the last clocked one before it; the first ones, the first.
    counts = np.diff(rows, append=stamps_s.size)
    counts[0] += rows[0]
    estimate = stamps_s - np.repeat(offset, counts)
    for step in steps.tolist():
        # Frames between a clocked one before the ground's clock was set and one after it.
        between = np.arange(int(rows[step - 1]) + 1, int(rows[step]))
        after = np.abs(estimate[between] - own[step]) > TRUST
        estimate[between[after]] = stamps_s[between[after]] - offset[step]
    if on_arrival:
        estimate = _on_arrival(own, stamps_s - np.repeat(stamps_s[rows], counts), counts)
    # Of the frames between two stretches, those close by belong to this one.
    near = (estimate >= own[0] - _NEAR) & (estimate <= own[-1] + _NEAR)
    inside = np.flatnonzero(near[before:behind]) + before
    return Clock(
        int(inside[0]) if a else 0,
        int(inside[-1]) if behind < stamps_s.size else last,
        estimate,
        float(np.median(offset)),
        stretch.jumps,
        stretch.notes,
        on_arrival,
    )


def _on_arrival(own: Floats, since: Floats, counts: NDArray[np.int64]) -> Floats:
    """(n,) s: the newest clock (m,) up to each frame, carried on by the stamps after COAST.

    `since` (n,) is the ground's time since the last clocked frame, which leads `counts` (m,)
    frames. A nanosecond a frame keeps frames of one clock in the order in which they came.
    """
    newest = np.repeat(np.maximum.accumulate(own), counts)
    return newest + np.maximum(since - COAST, 0.0) + 1e-9 * np.arange(since.size, dtype=np.float64)


def _steps(offset: Floats) -> Index:
    """Where the ground computer's clock was set: the offset changes by over FORWARD and stays."""
    if offset.size < 5:
        return np.empty(0, dtype=np.int64)
    smooth = median_filter(offset, 5, mode="nearest")
    return np.flatnonzero(np.abs(np.diff(smooth)) > FORWARD) + 1


def _running_median(offset: Floats) -> Floats:
    """Median of each value and the eight before it; the first ones look ahead instead."""
    if offset.size <= WINDOW:
        return np.full(offset.size, np.median(offset))
    # The origin shifts the window so that it ends at the value itself.
    causal = median_filter(offset, WINDOW, mode="nearest", origin=WINDOW // 2)
    causal[: WINDOW - 1] = np.median(offset[:WINDOW])
    return causal


def _mended(stamps_s: Floats) -> Floats:
    """Stamps with lone leaps (damaged stamp bytes) replaced by the stamp before."""
    known = without_leaps(stamps_s)
    bad = np.flatnonzero(~np.isfinite(known))
    if bad.size == 0:
        return stamps_s
    good = np.flatnonzero(np.isfinite(known))
    known[bad] = known[good[np.maximum(np.searchsorted(good, bad) - 1, 0)]]
    return known
