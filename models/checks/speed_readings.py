"""Which readings of a rotor's speed are no measurement of it, and how fine the others are.

A reading is none where
- it is zero although thrust is asked of the rotor: most ESCs and simulators report 0 for "unknown".
  A rotor that really stands still in flight reads the same, and no log alone can distinguish
  the two; either way there is no speed from which a margin could be had;
- it stays the same to the last bit while what drives the rotor changes: the last value, repeated;
- it stands alone far above the readings around it, or above what a propeller can survive.
Whether a reading counts depends on earlier ones only, so that a listener comes to the same, unless
the whole flight is there to look ahead in.

Slow or coarse readings are used like any others: that they are is for a reader of the result to
know, since they look like a speed that lags or a rotor that jumps.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.flight import TRACK_CHANNELS, Bools, FlightTrack, Floats
from thrustmargin.models.physics.smoothing import row_step

TURNING = 30.0  # rpm; no propeller that lifts an aircraft turns slower
HELD_S = 3.0  # s; slow ESC telemetry repeats a value for one or two
MOVED = 0.02  # of a motor output: moves the speed by half of that, ten turns a minute and more
STEPS = 2.0  # of the sensor that the speed should have moved by
COARSE = 0.05  # of the speed: the step of a sensor that has not shown its own
FLOOR = 0.2  # motor output up to which a motor may turn at its idle speed whatever is asked
JUMP = 2.0  # times the last reading and the other rotors: not within one report
SLOW = 1000.0  # rpm up to which a rotor idles, and a jump is one that starts
SOUND = 343.0  # m/s: no propeller of an aircraft turns with its tips at the speed of sound

MEASURED, ZERO, HELD, LONE = range(4)
REASONS = MappingProxyType(
    {
        ZERO: "zero speed while thrust was asked (its ESC does not measure, or it stood still)",
        HELD: "one value held while what drives the rotor changed",
        LONE: "a lone value that no rotor can have",
    }
)


@dataclass(frozen=True, slots=True)
class LastReading:
    """What is known of one sensor up to its last reading, for the next ones."""

    value: float = np.nan  # rpm
    since_s: float = np.nan  # its time, or that of the first like it
    low: float = np.inf  # of what drove the rotor since then
    high: float = -np.inf
    held: bool = False  # found to be repeated
    step: float = np.inf  # rpm, the smallest change that the sensor has shown


def checked_readings(
    time_s: Floats,
    rpm: Floats,
    *,
    output: Floats,
    asked: Bools,
    others: Floats,
    before: LastReading,
    look_ahead: bool,
) -> tuple[NDArray[np.uint8], LastReading]:
    """(n,) MEASURED, ZERO, HELD or LONE of the readings of one rotor, and its last reading.

    `rpm` (n,) are finite; at each reading `output` (n,) is the motor output, NaN where unknown,
    `asked` says that it is above idle, and `others` (n,) is the median speed of the other rotors.
    `look_ahead`: the readings are those of the whole flight.
    """
    verdict = np.full(time_s.size, MEASURED, dtype=np.uint8)
    if time_s.size == 0:
        return verdict, before
    size = np.abs(rpm)
    last = _held(verdict, time_s, rpm, output, others, before, look_ahead=look_ahead)
    limit = JUMP * np.fmax(np.fmax(np.abs(np.append(before.value, rpm[:-1])), others), SLOW)
    if look_ahead:
        limit = np.fmax(limit, JUMP * np.append(size[1:], 0.0))
    verdict[(size > limit) | (size > TRACK_CHANNELS["rotor_speed_rpm"].high)] = LONE
    still = size < TURNING
    verdict[still & asked] = ZERO
    if look_ahead and still.all() and (asked.any() or not np.isfinite(output).any()):
        verdict[:] = ZERO  # on the ground, too, it says nothing
    return verdict, last


def too_fast(rpm: Floats, others: Floats, propeller_diameter: float) -> Bools:
    """(n,) True where the tips would outrun sound while the other rotors are well below that.

    Where all rotors are beyond, the unit of the readings or the airframe is wrong.
    """
    limit = SOUND * 60.0 / (np.pi * propeller_diameter)
    with np.errstate(invalid="ignore"):
        return (np.abs(rpm) > limit) & (others < limit / JUMP)


def _held(
    verdict: NDArray[np.uint8],
    time_s: Floats,
    rpm: Floats,
    output: Floats,
    others: Floats,
    before: LastReading,
    *,
    look_ahead: bool,
) -> LastReading:
    """Mark the readings that are repeated; the last run of equal ones for the next readings."""
    drive = np.where(np.isfinite(output), np.fmax(output, FLOOR), np.fmax(others, SLOW))
    earlier = np.concatenate([[before.value], rpm[:-1]])
    changes, change = rpm != earlier, np.abs(rpm - earlier)
    if changes.all():
        driven = float(drive[-1])
        return LastReading(
            value=float(rpm[-1]),
            since_s=float(time_s[-1]),
            low=driven,
            high=driven,
            step=min(before.step, float(np.fmin.reduce(change))),
        )
    starts = np.flatnonzero(changes)
    if not changes[0]:
        starts = np.append(0, starts)
    ends = np.append(starts[1:], time_s.size)
    step = np.minimum.accumulate(np.append(before.step, np.where(change > 0, change, np.inf)))[1:]
    last = before
    since = time_s[starts]
    if not changes[0]:
        since[0] = before.since_s
    long = time_s[ends - 1] - since >= HELD_S
    long[-1] = True
    for run in np.flatnonzero(long).tolist():
        rows = slice(int(starts[run]), int(ends[run]))
        start = before if run == 0 and not changes[0] else LastReading(since_s=float(since[run]))
        low = np.fmin.accumulate(np.append(start.low, drive[rows]))[1:]
        high = np.fmax.accumulate(np.append(start.high, drive[rows]))[1:]
        lasted = time_s[rows] - start.since_s
        value = float(rpm[rows.start])
        coarse = min(float(step[rows.start]), COARSE * abs(value)) / max(abs(value), TURNING)
        moved = max(MOVED, 2.0 * STEPS * coarse)
        found = (lasted >= HELD_S) & (high - low > moved * high)
        found = np.logical_or.accumulate(found | start.held)
        if abs(value) >= TURNING:
            verdict[rows][found] = HELD
            if look_ahead and found.any():
                verdict[rows.start + 1 : rows.stop] = HELD
        last = LastReading(
            value=value,
            since_s=start.since_s,
            low=float(low[-1]),
            high=float(high[-1]),
            held=bool(found[-1]),
            step=float(step[-1]),
        )
    return last


OFTEN = 0.5  # s: no manoeuvre that effects are read from is over sooner
FINE = 0.004  # of the speed: less than sound rotors differ by
LEAST_ROWS = 100  # in flight, to say anything
#: Share of the speed by which readings differ from those beside them in flights whose sensors are
#: sound: manoeuvres and gusts (1.2 % at most in those recorded, of a simulated and a real quad).
USUAL_SCATTER = 0.02
#: From which a single reading is said to say little: 8 % of thrust. A simulated flight in gusts
#: that its outputs do not show has 3 %.
NOTABLE = 0.04
LEAST_READINGS = 30  # of a rotor, whose scatter is then known to 15 %


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingScatter:
    """How far the single readings of rotor speed are from the speed, beyond what rotors do."""

    share: Floats  # (R,) standard deviation of a reading, as a share of the speed; 0: not shown
    interval_s: float  # between two readings; NaN unknown
    in_steps: bool = False  # of a sensor that shows coarse steps: its error lasts

    @property
    def notable(self) -> bool:
        """Whether single readings say little: beyond NOTABLE, or by coarse steps."""
        most = float(self.share.max(initial=0.0))
        return most > (0.0 if self.in_steps else NOTABLE)

    def of_mean(self, seconds: float) -> Floats:
        """Return the standard deviation (R,) of means over `seconds`, as a share of the speed.

        A mean of steps is as far off as a step: the speed may stay between two of them.
        """
        if self.in_steps:
            return self.share
        return self.share / np.sqrt(max(np.nan_to_num(seconds / self.interval_s), 1.0))


def reading_scatter(track: FlightTrack) -> ReadingScatter:
    """Return the scatter of a flight's R rotor speeds as they were measured in flight.

    By second differences of one reading and the next, which leave out a steady change; of readings
    in coarse steps by the step. Zero within USUAL_SCATTER, or with too few readings.
    """
    if (known := _SCATTER.get(track)) is None:
        known = _SCATTER[track] = _scatter(track)
    return known


#: Of the tracks in use: what one flight shows is asked for by several parts of its analysis.
_SCATTER: WeakKeyDictionary[FlightTrack, ReadingScatter] = WeakKeyDictionary()


def _scatter(track: FlightTrack) -> ReadingScatter:
    speeds, interval_s = track.measured("rotor_speed_rpm")[track.flying], np.nan
    in_steps = False
    share = np.zeros(track.rotor_count)
    for rotor, values in enumerate(speeds.T):
        known = values[np.isfinite(values)]
        new = known[np.flatnonzero(np.diff(known, prepend=np.nan) != 0.0)]
        if new.size < LEAST_READINGS:
            continue
        interval_s = np.fmin(interval_s, row_step(track.time_s) * known.size / new.size)
        size, step = float(np.median(np.abs(new))), _step(known)
        bend = np.abs(new[2:] - 2.0 * new[1:-1] + new[:-2])
        spread = _NORMAL * float(np.median(bend)) / np.sqrt(6.0)
        if step > FINE * size:
            spread, in_steps = step / np.sqrt(12.0), True
        share[rotor] = np.sqrt(max((spread / size) ** 2 - USUAL_SCATTER**2, 0.0))
    return ReadingScatter(share=share, interval_s=float(interval_s), in_steps=in_steps)


_NORMAL = 1.4826  # standard deviation of a normal distribution over its median absolute deviation


def resolution_words(track: FlightTrack) -> str:
    """Return what is slow, coarse or scattered of the rotor speeds in flight, as a sentence; empty
    if nothing is."""
    rows = track.flying & np.isfinite(track.rotor_speed_rpm).all(axis=1)
    rpm = track.rotor_speed_rpm[rows]
    if rpm.shape[0] < LEAST_ROWS or not rpm.shape[1]:
        return ""
    step = float(np.median([_step(values) for values in rpm.T]))
    share = step / float(np.median(np.abs(rpm)) or np.inf)
    if share > FINE:
        return (
            f"rotor speeds come in steps of {step:.0f} rpm ({100 * share:.1f} %): they are used, "
            "and what is smaller shows in their mean only"
        )
    if (scatter := reading_scatter(track)).notable:
        return (
            f"rotor speeds scatter by {100 * scatter.share.max():.0f} % from one reading to the "
            "next: single ones say little, check the ESC telemetry"
        )
    changed = float(np.median(np.mean(np.diff(rpm, axis=0) != 0.0, axis=0)))
    interval = row_step(track.time_s) / changed if changed > 0.0 else np.inf
    if interval <= OFTEN:
        return ""
    return (
        f"rotor speeds are new every {interval:.1f} s only, and repeated in between: they are "
        "used, as readings that come late"
    )


def _step(values: Floats) -> float:
    """Return the grid, rpm, that readings (T,) are on: the least distance of two different ones."""
    apart = np.diff(np.unique(values))
    return float(apart.min()) if apart.size else 0.0
