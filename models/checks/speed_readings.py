"""Check readings of rotor speed: invalid readings, scatter and resolution, unit, and clock.

Invalid readings (`checked_readings`). A reading is rejected where
- it is zero although thrust is demanded from the rotor: most ESCs and simulators report 0 for
  "unknown". A rotor that really stands still in flight reads the same, and no log alone can
  distinguish the two; either way there is no speed to compute a margin from;
- it stays the same to the last bit while what drives the rotor changes: the last value, repeated;
- it is a single value far above the readings around it, or above what a propeller can survive.
Only earlier readings decide, so that live and recorded data give the same result, unless the whole
flight is there to read later rows of.

Scatter and resolution (`reading_scatter`, `speed_resolution`). Slow or coarse readings are used
like any others, but reported, since they look like a speed that lags or a rotor that jumps.

Unit (`check_speed_scale`). In flight the rotors together make m f, f the upward specific force
[m/s²] and m the mass. With T = a (rho/rho_ref) N^2 the true speed is known to the square root of
the mass, so a wrong factor shows: pole pairs (an ESC that reports electrical rpm), 60 (rev/s), 2
pi/60 (rad/s), powers of ten.

Clock (`late_speeds`). The sum of squared speeds rises and falls with the upward specific force. In
a table put together from two logs, or in telemetry that queues, one of the two is seconds late, and
manoeuvres would be explained by impossible inertias. Delays up to `LARGEST_DELAY` are fitted
(effect `sensor_lag` of the rotor speeds). Beyond it the speeds have another clock.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.checks.motor_order import ANSWERS, DECISIVE
from thrustmargin.models.checks.motor_order import FEWEST_ROWS as FEWEST_OF_ORDER
from thrustmargin.models.flight import TRACK_CHANNELS, Bools, FlightTrack, Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0, track_air
from thrustmargin.models.physics.smoothing import known_median, row_step, running_mean
from thrustmargin.models.statement import Statement, state

TURNING = 30.0  # rpm; no propeller that lifts an aircraft turns slower
HELD_S = 3.0  # s; slow ESC telemetry repeats a value for one or two
MOVED = 0.02  # of a motor output: moves the speed by half of that, ten turns a minute and more
STEPS = 2.0  # of the sensor that the speed should have moved by
COARSE = 0.05  # of the speed: assumed step of a sensor before its own is known
FLOOR = 0.2  # motor output up to which a motor may stay at its idle speed
JUMP = 2.0  # times the last reading and the other rotors: impossible within one report
SLOW = 1000.0  # rpm up to which a rotor idles; a jump below it is a rotor that starts
SOUND = 343.0  # m/s: no propeller of an aircraft turns with its tips at the speed of sound

MEASURED, ZERO, HELD, LONE = range(4)
#: Why a reading is rejected -> the kind of its sentence.
REASONS: Mapping[int, str] = MappingProxyType({ZERO: "zero", HELD: "held", LONE: "lone"})


@dataclass(frozen=True, slots=True)
class LastReading:
    """The state of one sensor up to its last reading, for the next readings."""

    value: float = np.nan  # rpm
    since_s: float = np.nan  # s, time of the first reading of this value
    low: float = np.inf  # least drive of the rotor since then
    high: float = -np.inf
    held: bool = False  # the value is a repetition
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
    """Classify n speed readings of one rotor; also return its last reading, for the next call.

    MEASURED is valid; ZERO: reported as stopped though driven; HELD: an old value repeated; LONE: a
    jump too large for a rotor, or a speed above the channel's range. `time_s` (n,) is the time of
    the readings, s, `rpm` (n,) the speed, finite, of either sign, `output` (n,) the motor output,
    NaN where unknown; `asked` (n,) flags outputs above idle, and `others` (n,) is the median speed,
    rpm, of the other rotors. `before` is the reading before the first. `look_ahead`: the readings
    are those of the whole flight, so later ones are used too, and all are ZERO if none turns
    although driven or without a known output.
    """
    verdict = np.full(time_s.size, MEASURED, dtype=np.uint8)
    if time_s.size == 0:
        return verdict, before
    size = np.abs(rpm)
    last = _mark_repeats(verdict, time_s, rpm, output, others, before, look_ahead=look_ahead)
    limit = JUMP * np.fmax(np.fmax(np.abs(np.append(before.value, rpm[:-1])), others), SLOW)
    if look_ahead:
        limit = np.fmax(limit, JUMP * np.append(size[1:], 0.0))
    verdict[(size > limit) | (size > TRACK_CHANNELS["rotor_speed_rpm"].high)] = LONE
    still = size < TURNING
    verdict[still & asked] = ZERO
    if look_ahead and still.all() and (asked.any() or not np.isfinite(output).any()):
        verdict[:] = ZERO  # such a sensor measures nothing on the ground either
    return verdict, last


def too_fast(rpm: Floats, others: Floats, propeller_diameter: float) -> Bools:
    """Flag readings `rpm` (n,) with supersonic blade tips while `others` are well below that.

    `others` (n,) is the other rotors' median speed, rpm; the diameter is in m. If all rotors are
    supersonic, the unit or the airframe is wrong, and none is flagged.
    """
    limit = SOUND * 60.0 / (np.pi * propeller_diameter)
    with np.errstate(invalid="ignore"):
        return (np.abs(rpm) > limit) & (others < limit / JUMP)


def _mark_repeats(
    verdict: NDArray[np.uint8],
    time_s: Floats,
    rpm: Floats,
    output: Floats,
    others: Floats,
    before: LastReading,
    *,
    look_ahead: bool,
) -> LastReading:
    """Mark in `verdict` (n,), in place, as HELD, readings that repeat for HELD_S s or more while
    the motor output changed.

    Where the output is unknown, the other rotors' speed must have changed instead. `time_s` (n,) s,
    `rpm` (n,), `output` (n,), NaN where unknown, and `others` (n,), rpm, are of the readings;
    `before` is the last run of equal readings before them. With `look_ahead` all repeats of such a
    run are marked, else only those from when it is certain. Return the last run of equal readings.
    """
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


OFTEN = 0.5  # s: shorter than the manoeuvres that effects are identified from
FINE = 0.004  # of the speed: less than sound rotors differ by
LEAST_ROWS = 100  # rows in flight that are needed
#: Share of the speed by which readings differ from the readings before and after in flights whose
#: sensors are sound: manoeuvres and gusts (1.2 % at most in those recorded, of a simulated and a
#: real quad).
USUAL_SCATTER = 0.02
#: Scatter from which single readings are reported as unreliable: 8 % of thrust. A simulated flight
#: in gusts that its outputs do not show has 3 %.
NOTABLE = 0.04
LEAST_READINGS = 30  # of a rotor, whose scatter is then known to 15 %


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingScatter:
    """The scatter of single readings of rotor speed, beyond that of the rotors themselves."""

    share: Floats  # (R,) standard deviation of a reading, as a share of the speed; 0: not shown
    interval_s: float  # between two readings; NaN unknown
    in_steps: bool = False  # of a sensor that shows coarse steps: its error lasts

    @property
    def notable(self) -> bool:
        """Return True if single readings are unreliable: scatter beyond NOTABLE, or coarse
        steps."""
        most = float(self.share.max(initial=0.0))
        return most > (0.0 if self.in_steps else NOTABLE)

    def of_mean(self, seconds: float) -> Floats:
        """Return the standard deviation (R,) of a mean of readings over `seconds`, as a share of
        the speed.

        For readings in coarse steps it is that of a single reading, since the speed may stay
        between two steps.
        """
        if self.in_steps:
            return self.share
        return self.share / np.sqrt(max(np.nan_to_num(seconds / self.interval_s), 1.0))


def reading_scatter(track: FlightTrack) -> ReadingScatter:
    """Return the scatter of a flight's R rotor speeds, as measured in flight.

    By second differences between consecutive readings, which a steady change does not affect; for
    coarse readings, by the step. Zero within USUAL_SCATTER, or with too few readings.
    """
    if (known := _SCATTER.get(track)) is None:
        known = _SCATTER[track] = _compute_scatter(track)
    return known


#: Cache by track, because several parts of an analysis need it.
_SCATTER: WeakKeyDictionary[FlightTrack, ReadingScatter] = WeakKeyDictionary()


def _compute_scatter(track: FlightTrack) -> ReadingScatter:
    """Compute the scatter, as `reading_scatter` without its cache."""
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


def speed_resolution(track: FlightTrack) -> Statement | None:
    """Report the first of: rotor speeds in flight are coarse, scattered, or slowly updated; None if
    they are not, or with fewer than LEAST_ROWS rows."""
    rows = track.flying & np.isfinite(track.rotor_speed_rpm).all(axis=1)
    rpm = track.rotor_speed_rpm[rows]
    if rpm.shape[0] < LEAST_ROWS or not rpm.shape[1]:
        return None
    step = float(np.median([_step(values) for values in rpm.T]))
    share = step / float(np.median(np.abs(rpm)) or np.inf)
    if share > FINE:
        return state("speeds in steps", step=step, percent=100.0 * share)
    if (scatter := reading_scatter(track)).notable:
        return state("speeds scatter", percent=float(100.0 * scatter.share.max()))
    changed = float(np.median(np.mean(np.diff(rpm, axis=0) != 0.0, axis=0)))
    interval = row_step(track.time_s) / changed if changed > 0.0 else np.inf
    return None if interval <= OFTEN else state("speeds slow", interval=interval)


def _step(values: Floats) -> float:
    """Return the resolution, rpm, of readings (T,): the least distance of two different ones; 0
    for equal ones."""
    apart = np.diff(np.unique(values))
    return float(apart.min()) if apart.size else 0.0


#: Pole pairs of motors that carry sprayers and their trainers.
POLE_PAIRS = (4, 6, 7, 10, 11, 12, 14, 15, 16, 18, 20, 21)
#: Reported over true, of units that are not rpm: rev/s, rad/s, and rpm in tens, hundreds and
#: hundredths.
OTHER_UNITS = (1.0 / 60.0, 2.0 * math.pi / 60.0, 0.1, 0.01, 100.0)
#: A ratio within this of 1 is a rotor's own speed: payload, wear and air explain it.
USUAL_RATIO = (0.75, 1.35)
#: A factor fits when the ratio over it is within this of 1.
CLOSE = 0.15
FEWEST_ROWS = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedScale:
    """The ratio of the reported rotor speed to the speed that the weight needs."""

    verdict: Literal["rotor", "electrical", "unit", "odd", "unknown"]
    found: Statement
    ratio: float  # with the tank as reported, else with half a tank
    low: float  # with a full tank where the level is unknown
    high: float  # with an empty one
    rows: int


def check_speed_scale(track: FlightTrack, airframe: Airframe) -> SpeedScale:
    """Compare the flight's rotor speeds with the speed that weight and thrust curve need.

    The verdict is "unknown" with fewer than FEWEST_ROWS rows or another number of rotors.
    """
    nan = float("nan")
    unknown = SpeedScale(
        verdict="unknown",
        found=state("too few speeds"),
        ratio=nan,
        low=nan,
        high=nan,
        rows=0,
    )
    if track.rotor_count != airframe.rotor_count:
        return unknown
    density = track_air(track).density
    thrust = (
        airframe.thrust_coefficient
        * (density / airframe.reference_density)
        * np.sum(airframe.rotor_effectiveness * track.rotor_speed_rpm**2, axis=1)
    )
    lift = lifted_mass(track, thrust)
    use = np.isfinite(lift)
    rows = int(np.sum(use))
    if rows < FEWEST_ROWS:
        return replace(unknown, rows=rows)

    def ratio_with(tank_kg: np.ndarray | float) -> float:
        """Return the median ratio with `tank_kg` on board."""
        return known_median(np.sqrt(lift / (airframe.empty_mass + tank_kg)))

    lift = lift[use]
    gauge = track.measured("tank_kg")
    tank_kg = np.where(gauge >= 0, gauge, np.nan)[use]
    if np.isfinite(tank_kg).any():
        ratio = full = empty = ratio_with(tank_kg)
    else:
        full, empty = ratio_with(airframe.tank_capacity_kg), ratio_with(0.0)
        ratio = ratio_with(0.5 * airframe.tank_capacity_kg)
    verdict, found = _scale_verdict(ratio, full, empty, airframe)
    return SpeedScale(verdict=verdict, found=found, ratio=ratio, low=full, high=empty, rows=rows)


def lifted_mass(track: FlightTrack, thrust: Floats) -> Floats:
    """Return the mass (T,), kg, that `thrust` (T,), N, carries at the measured acceleration.

    NaN outside flight. An unknown acceleration counts as that of level flight.
    """
    # Thrust points up the body's axis: its specific force, without the drag of the body.
    upward = -track.specific_force_frd[:, 2]
    upward = np.where(np.isfinite(upward), upward, G0)
    use = track.flying & np.isfinite(thrust) & (thrust > 0) & (upward > 0.5 * G0)
    return np.where(use, thrust / np.where(use, upward, np.nan), np.nan)


def _scale_verdict(
    ratio: float, low: float, high: float, airframe: Airframe
) -> tuple[Literal["rotor", "electrical", "unit", "odd"], Statement]:
    """Classify the `ratio` of reported to expected rotor speed, uncertain from `low` to `high`.

    "rotor": as expected; "unit": another unit; "electrical": electrical speed, by a possible pole
    count; "odd": none of them. Also return the statement for the user.
    """
    if low <= USUAL_RATIO[1] and high >= USUAL_RATIO[0]:
        return "rotor", state("speeds fit", ratio=ratio)
    unit = min(OTHER_UNITS, key=lambda factor: abs(math.log(ratio / factor)))
    if abs(math.log(ratio / unit)) <= math.log(1 + CLOSE):
        return "unit", state("other unit", f"unit {unit:.3g}", ratio=ratio)
    own = airframe.motor_poles / 2.0
    pairs = sorted({float(p) for p in POLE_PAIRS} | {own})
    fitting = [p for p in pairs if low / (1 + CLOSE) <= p <= high * (1 + CLOSE)]
    if fitting:
        nearest = own if own in fitting else min(fitting, key=lambda p: abs(math.log(ratio / p)))
        others = tuple(state("poles", poles=2.0 * p) for p in fitting if p != nearest)
        clause = "other poles fit" if others else "one pole count fits"
        found = state("electrical", clause, ratio=ratio, poles=2.0 * nearest, others=others)
        return "electrical", found
    return "odd", state("odd speeds", ratio=ratio, airframe=airframe.name)


LARGEST_DELAY = 1.4  # s, either way
REACH = 10.0  # s, either way, that are tried
TREND = 5.0  # s of the running mean that is subtracted: tank and climbs drift
SMOOTH_ROWS = 3  # rows of smoothing: the body responds within them, and noise averages out


def late_speeds(track: FlightTrack) -> Statement | None:
    """Report the delay between rotor speeds and acceleration, which have different clocks.

    None where they agree, or with too little movement.
    """
    delay_s, correlation, likelihood = delays(track)
    if not delay_s.size:
        return None
    usual = np.abs(delay_s) <= LARGEST_DELAY + (delay_s[1] - delay_s[0]) / 2.0
    best, at_usual = np.argmax(likelihood), np.argmax(np.where(usual, likelihood, -1.0))
    lead = likelihood[best] - likelihood[at_usual]
    if usual[best] or correlation[best] < ANSWERS or lead < DECISIVE:
        return None
    late = float(delay_s[best])
    return state(
        "speeds late" if late > 0.0 else "speeds early",
        delay=abs(late),
        correlation=float(correlation[best]),
        usual=float(correlation[at_usual]),
        most=LARGEST_DELAY,
        shift=-late,
    )


def delays(track: FlightTrack) -> tuple[Floats, Floats, Floats]:
    """Correlate squared rotor speeds with the upward specific force at D delays.

    Return the delays (D,), s, positive if the speeds are late; the correlation (D,) at each; and
    its log-likelihood (D,) over no correlation. All empty if either is known in fewer than
    FEWEST_OF_ORDER rows in flight, or if rows are too far apart.
    """
    time_s = track.time_s
    squares = np.sum(track.rotor_speed_rpm**2, axis=1)
    upward = -track.specific_force_frd[:, 2]
    known = track.flying & np.isfinite(squares) & np.isfinite(upward)
    empty = np.empty(0)
    if np.sum(known) < FEWEST_OF_ORDER:
        return empty, empty, empty
    step = float(np.median(np.diff(time_s[known])))
    if not REACH / 1000.0 < step <= LARGEST_DELAY / 2.0:
        return empty, empty, empty
    grid = np.arange(time_s[known][0], time_s[known][-1], step)
    # Pauses and landings are interpolated; a real delay outweighs these rows.
    together, felt = (
        band_pass(np.interp(grid, time_s[known], c[known]), step) for c in (squares, upward)
    )
    furthest = min(round(REACH / step), grid.size - FEWEST_OF_ORDER)
    if furthest < 1:
        return empty, empty, empty
    rows = np.arange(-furthest, furthest + 1)
    found = np.array([lagged_correlation(together[max(k, 0) :], felt[max(-k, 0) :]) for k in rows])
    return (rows * step).astype(np.float64), found[:, 0], found[:, 1]


def band_pass(values: Floats, step: float) -> Floats:
    """Subtract from values (n,), `step` s apart, the mean over TREND s; smooth over SMOOTH_ROWS."""
    values = values - running_mean(values, round(TREND / step) | 1)
    return running_mean(values, SMOOTH_ROWS)


def lagged_correlation(one: Floats, other: Floats) -> tuple[float, float]:
    """Return the correlation of two series, and its log-likelihood over no correlation.

    The series are cut to the length of the shorter one. Neighbours correlate, so the number of
    independent samples is reduced by Bartlett's rule (1935) for two autoregressive series of first
    order. 0 and 0 for a series of zeros.
    """
    rows = min(one.size, other.size)
    one, other = one[:rows], other[:rows]
    powers = float(one @ one), float(other @ other)
    if min(powers) <= 0.0:
        return 0.0, 0.0
    correlation = float(one @ other) / np.sqrt(powers[0] * powers[1])
    both = float(one[1:] @ one[:-1]) * float(other[1:] @ other[:-1]) / (powers[0] * powers[1])
    samples = rows * (1.0 - both) / (1.0 + both)
    explained = min(max(correlation, 0.0), 0.999999) ** 2
    return correlation, -0.5 * samples * float(np.log1p(-explained))
