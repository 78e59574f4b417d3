"""Estimate the vehicle's own time of every message in a telemetry log or on a link.

Every frame of a .tlog carries the ground computer's time, late by the link's delay; many messages
also carry the vehicle's time since boot. Results are in the vehicle's time. A message without such
a clock (VFR_HUD, WIND, Unix time in `time_usec`) gets the ground's stamp minus the median offset of
the last nine clocked messages before it. Only earlier messages are used, so that a live listener
gets equal times.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.mavlink.rules import Columns
from thrustmargin.gcs_plugin.mavlink.scan import Frames, Index, named
from thrustmargin.gcs_plugin.telemetry.recording import (
    BACKWARD,
    FORWARD,
    Stretch,
    restarts,
    stretches,
    without_leaps,
)
from thrustmargin.models.errors import LogError
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.physics.smoothing import median_of_five
from thrustmargin.models.statement import Statement, state

#: Messages whose clock is read when they are sent; others carry the time of a fix or of a change.
REFERENCES = (
    *("ATTITUDE", "ATTITUDE_QUATERNION", "GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"),
    *("RAW_IMU", "SCALED_IMU", "HIGHRES_IMU", "SCALED_PRESSURE", "NAMED_VALUE_FLOAT"),
)
WINDOW = 9  # clocked messages whose median offset counts
TRUST = 2.0  # s; an own clock further than this from the estimate counts something else
COAST = 1.0  # s without a clocked message after which, on arrival, the stamps extrapolate the clock
LEAD = 0.1  # s by which a message may be taken to be later than the newest clock
RESTART_AFTER = 3  # clocked messages running that must agree on a restart
_LONG_AGO = -(2**62)  # ns
JUMP = 30.0  # s forward between two messages that is reported as a jump
_NEAR = 0.5  # s round a restart in which messages without a clock are still distinguished
_US_WRAP = 2**32 * 1e-6  # s; SERVO_OUTPUT_RAW counts µs in 32 bits and wraps after 71 minutes
_BOOT_MOST = 2**32 * 1e-3  # s since boot that `time_boot_ms` can say; more in µs is Unix time


@dataclass(frozen=True, slots=True, eq=False)
class Clock:
    """The vehicle's time of every frame, for the frames between two restarts."""

    first_row: int  # the stretch between two restarts that it is the clock of
    last_row: int
    estimate_s: Floats  # (n,) s since boot of all frames, by the ground's stamps
    stamp_minus_clock: float | None  # typical, or a listener's first; None without an own clock
    jumps: tuple[tuple[float, float], ...] = ()  # every restart in the file
    notes: tuple[Statement, ...] = ()
    on_arrival: bool = False  # every message has the time at which a listener got it

    def times(self, fields: NDArray[np.void], rows: Index) -> Floats:
        """Return the times (n,), s since boot, of messages: the times they carry, else the
        estimate.

        `fields` (n,) are those of one message type, `rows` (n,) their frames. A carried time is
        used only where it is within TRUST s of the estimate, and never `on_arrival`.
        """
        estimate = self.estimate_s[rows]
        own = own_clock(fields)
        if own is None or self.stamp_minus_clock is None or self.on_arrival:
            return estimate
        if "time_usec" in (fields.dtype.names or ()) and fields["time_usec"].itemsize == 4:
            own = own + np.round((estimate - own) / _US_WRAP) * _US_WRAP
        return np.where(np.abs(own - estimate) <= TRUST, own, estimate)


def own_clock(fields: NDArray[np.void]) -> Floats | None:
    """Return the times (n,), s since boot, that messages carry; None if their type carries no time.

    NaN where a message carries 0, no time, or Unix time, as `time_usec` may once there is a fix.
    """
    names = fields.dtype.names or ()
    if "time_boot_ms" in names:
        clock_s = fields["time_boot_ms"].astype(np.float64) * 1e-3
    elif "time_usec" in names:
        clock_s = fields["time_usec"].astype(np.float64) * 1e-6
    else:
        return None
    return np.where((clock_s > 0.0) & (clock_s < _BOOT_MOST), clock_s, np.nan)


def unix_minus_clock(system_time: Columns) -> float | None:
    """Return Unix time minus the vehicle's clock, s, from the first SYSTEM_TIME with a Unix time.

    None if no message has one. The first one is used, not a mean, so that a live listener gets an
    equal value.
    """
    known = np.flatnonzero(gps_times(system_time))
    if known.size == 0:
        return None
    unix_us, boot_ms = (float(system_time[n][known[0]]) for n in ("time_unix_usec", "time_boot_ms"))
    return unix_us * 1e-6 - boot_ms * 1e-3


def gps_times(system_time: Columns) -> Bools:
    """Flag the SYSTEM_TIME messages (n,) with Unix time; without GPS their time counts from boot or
    is 0.
    """
    return system_time["time_unix_usec"] > 1e15


def vehicle_clocks(
    name: str, frames: Frames, pilot: Bools, stamps_s: Floats, *, listened: Bools | None = None
) -> Iterator[Clock]:
    """Yield one clock for each run between restarts of the autopilot, flagged by `pilot` (n,).

    `name` is the log's, for errors; `stamps_s` (n,) are the ground's times, s. Frames in `listened`
    (n,), if given, get the time that a live listener would give them. Without any carried clock the
    ground's is used, with a note. Raise LogError if two clocks alternate, as when two vehicles
    share a system id.
    """
    stamps_s = _repaired(stamps_s)
    own = np.full(stamps_s.size, np.nan)
    for reference in REFERENCES:
        rows, fields = named(frames, reference, pilot)
        if rows.size:
            own[rows] = own_clock(fields)
            _refuse_two_starts(name, (stamps_s - own)[rows])
    rows = np.flatnonzero(np.isfinite(own))
    last = stamps_s.size - 1
    if rows.size == 0:
        note = state("clock of the ground")
        first = int(np.argmax(pilot))
        yield Clock(0, last, stamps_s - stamps_s[first], None, notes=(note,))
        return
    own = own[rows]
    clocks = stretches(own, name)
    jumps = restarts(own, clocks)
    for stretch in clocks:
        clock = _clock_of(stretch, rows, own, stamps_s, listened)
        if stretch is clocks[-1]:  # it waits while as much is read of the messages
            del rows, own, stamps_s
        yield replace(clock, jumps=jumps)


def _clock_of(
    stretch: Stretch, rows: Index, own: Floats, stamps_s: Floats, listened: Bools | None
) -> Clock:
    """Return the clock of one run between restarts, rows `stretch.first` to `.last` of the m below.

    `rows` (m,) are the frames with a clock of their own, `own` (m,) these clocks, s; `stamps_s`
    (n,) the ground's times, s, of all frames. Frames in `listened` (n,), if given, get the time
    that a live listener would give them.
    """
    last = stamps_s.size - 1
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
        rows_between = np.arange(int(rows[step - 1]) + 1, int(rows[step]))
        after = np.abs(estimate[rows_between] - own[step]) > TRUST
        estimate[rows_between[after]] = stamps_s[rows_between[after]] - offset[step]
    if listened is not None:
        own_s = np.full(stamps_s.size, np.nan)
        own_s[rows] = own
        mine = np.arange(before, behind)[listened[before:behind]]
        stamps_us = np.round(stamps_s[mine] * 1e6).astype(np.int64)
        estimate[mine] = arrival_times(ArrivalClock(), stamps_us, own_s[mine])[0]
    # Of the frames between two stretches, those close by belong to this one.
    near = (estimate >= own[0] - _NEAR) & (estimate <= own[-1] + _NEAR)
    near[rows] = True
    inside = np.flatnonzero(near[before:behind]) + before
    return Clock(
        int(inside[0]) if a else 0,
        int(inside[-1]) if behind < stamps_s.size else last,
        estimate,
        float(stamps_s[rows[0]] - own[0]) if listened is not None else float(np.median(offset)),
        on_arrival=listened is not None,
    )


def _refuse_two_starts(name: str, offset: Floats) -> None:
    """Raise LogError if the clock of one message type alternates between two starts.

    `offset` (n,) is the ground's time minus that clock, s. After a restart, or a change of the
    ground's clock, the old offset does not return.
    """
    offset = offset[np.isfinite(offset)]
    if not offset.size:
        return
    order = np.argsort(offset)
    start = np.empty(offset.size, dtype=np.int64)
    start[order] = np.cumsum(np.diff(offset[order], prepend=offset[order[:1]]) > TRUST)
    known = np.flatnonzero(np.bincount(start) > RESTART_AFTER)
    start = start[np.isin(start, known)]
    returns = np.count_nonzero(np.diff(start)) + 1 - known.size
    if returns > RESTART_AFTER:
        raise LogError(
            f"{name}: its clock goes back {returns} times to one that was left, as when two "
            "vehicles share one system id; give each its own and record again"
        )


@dataclass(frozen=True, slots=True)
class ArrivalClock:
    """A listener's knowledge of one vehicle's clock after its last message; times in ns."""

    offsets: tuple[int, ...] = ()  # ground's stamp less own clock, of the last WINDOW clocked ones
    newest: int = 0  # the highest own clock
    stamp: int = 0  # when that came
    last: int = _LONG_AGO  # time given to the last message
    boot: int = 0  # restarts seen
    earlier: tuple[int, int] | None = None  # a clock behind the newest, and how often it was seen
    late: int = 0  # clocked messages left out because their clock was behind

    @property
    def known(self) -> bool:
        """Return True if a clocked message has arrived."""
        return bool(self.offsets)

    def now_s(self, stamp_us: int) -> float:
        """Return the vehicle's time, s, at the ground's `stamp_us`, µs; NaN while unknown."""
        if not self.known:
            return float("nan")
        known = np.array([self.goes_by]).T
        return float(_held_back(known, np.array([1000 * stamp_us]))[0]) * 1e-9

    @property
    def goes_by(self) -> tuple[int, int, int]:
        """Return the newest own clock, its arrival, and the median offset, all ns."""
        return self.newest, self.stamp, sorted(self.offsets)[len(self.offsets) // 2]

    def after(self, own: int, stamp: int) -> tuple[ArrivalClock, Statement | None]:
        """Update the clock by one message: `own`, the vehicle's time, `stamp`, its arrival, ns.

        Return the new clock and a note, None if there is none. A time behind the newest by more
        than BACKWARD s counts as late, until RESTART_AFTER in a row agree: a restart. Restarts and
        jumps forward by more than JUMP s are noted.
        """
        if not self.known:
            return replace(self, offsets=(stamp - own,), newest=own, stamp=stamp), None
        jump, note = own - self.newest, None
        if jump < -1e9 * BACKWARD:
            before, times = self.earlier or (own, 0)
            times = times + 1 if -1e9 * BACKWARD <= own - before < 1e9 * JUMP else 1
            if times < RESTART_AFTER:
                late = self.late + 1
                return replace(self, earlier=(own, times), late=late), None
            note = state("restarted", before=self.newest * 1e-9, after=own * 1e-9)
            new = ArrivalClock((stamp - own,), own, stamp, boot=self.boot + 1, late=self.late)
            return new, note
        if jump - (stamp - self.stamp) > 1e9 * JUMP:
            note = state("clock jumped", jump=jump * 1e-9)
        offsets = (*self.offsets, stamp - own)[-WINDOW:]
        newest = max(own, self.newest)
        return ArrivalClock(offsets, newest, stamp, self.last, self.boot, None, self.late), note


def _held_back(known: NDArray[np.int64], stamps: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return stamps (n,) minus the median offset, clipped to just after the newest clock.

    The clip keeps the vehicle's times in a burst after a stalled link, or in a recording played
    fast. After COAST s without a clocked message the stamps extrapolate the clock. `known` (3, n)
    is newest clock, its stamp and the median offset for each stamp; all ns.
    """
    newest, stamp, median = known
    since = np.maximum(stamps - stamp, 0)
    most = np.minimum(since, int(1e9 * LEAD)) + np.maximum(since - int(1e9 * COAST), 0)
    return newest + np.clip(stamps - median - newest, 0, most)


def arrival_times(
    clock: ArrivalClock, stamps_us: NDArray[np.int64], own_s: Floats
) -> tuple[Floats, NDArray[np.int64], ArrivalClock, tuple[tuple[int, Statement], ...]]:
    """Compute the time of each message, s, on the vehicle's clock, as known when it arrived.

    `stamps_us` (n,) are the ground's times, µs; `own_s` (n,) the vehicle's clock, s, that a message
    carries, NaN where it carries none. Return the times (n,), strictly increasing within a boot;
    the boot numbers (n,); the clock to pass with the next batch; and notes, each with its stamp,
    µs. The boot number is -1 for messages from a clock's step back until later clocks decide if the
    vehicle restarted. Cutting the messages into batches does not change the times, if the first
    batch has a clock: earlier messages of that batch are dated back from it. Raise ValueError if
    `clock` is not known yet and no message carries one.
    """
    stamps = 1000 * stamps_us.astype(np.int64)
    clocked = np.flatnonzero(np.isfinite(own_s)).tolist()
    if not clock.known and not clocked:
        raise ValueError("no message carries the vehicle's clock")
    states, notes = [clock], []
    for row in clocked:
        state, note = states[-1].after(round(1e9 * own_s[row]), int(stamps[row]))
        states.append(state)
        notes += [(int(stamps_us[row]), note)] if note else []
    which = np.cumsum(np.isfinite(own_s))
    early = 0 if clock.known else int(clocked[0])
    if not clock.known:
        states[0] = replace(states[1], last=_LONG_AGO)
    boots = np.array([state.boot for state in states], dtype=np.int64)[which]
    known = np.array([state.goes_by for state in states], dtype=np.int64)
    delayed = _held_back(known[which].T, stamps)
    delayed[:early] = stamps[:early] - states[0].offsets[0]
    for boot in np.unique(boots).tolist():
        rows = np.flatnonzero(boots == boot)
        delayed[rows] = _rising(delayed[rows], states[0].last if boot == clock.boot else _LONG_AGO)
    # While a clock that went back may be a restart, nothing is sure of either start.
    boots[np.array([state.earlier is not None for state in states])[which]] = -1
    after = replace(states[-1], last=int(delayed[-1])) if delayed.size else states[-1]
    return delayed.astype(np.float64) * 1e-9, boots, after, tuple(notes)


def _rising(delayed: NDArray[np.int64], last: int) -> NDArray[np.int64]:
    """Return times (n,), ns, each raised to 1 or more above the one before, the first above `last`.

    So the order of messages is kept.
    """
    count = np.arange(1, delayed.size + 1)
    return np.maximum.accumulate(np.concatenate([[last], delayed - count]))[1:] + count


def _steps(offset: Floats) -> Index:
    """Return the indices from which the offset (n,), s, stays changed by over FORWARD s.

    There the ground's clock was set. Empty with fewer than five values.
    """
    if offset.size < 5:
        return np.empty(0, dtype=np.int64)
    smooth = median_of_five(offset)
    return np.flatnonzero(np.abs(np.diff(smooth)) > FORWARD) + 1


def _running_median(offset: Floats) -> Floats:
    """Return the median (n,) of each value and the WINDOW - 1 before it; the first share one.

    n must not be 0.
    """
    window = min(WINDOW, offset.size)
    middle = np.median(np.lib.stride_tricks.sliding_window_view(offset, window), axis=1)
    return np.concatenate([np.full(window - 1, middle[0]), middle])


def _repaired(stamps_s: Floats) -> Floats:
    """Return the stamps (n,), s, with single outliers (damage) replaced by the one before."""
    known = without_leaps(stamps_s)
    bad = np.flatnonzero(~np.isfinite(known))
    good = np.flatnonzero(np.isfinite(known))
    known[bad] = known[good[np.maximum(np.searchsorted(good, bad) - 1, 0)]]
    return known
