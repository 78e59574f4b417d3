"""Decide whether an aircraft with its motors on flies, or is held on a bench or in hands.

Over BLOCK seconds of flight the mean acceleration follows from thrust T and tilt, except for
wind and drag:
    upwards  T cos(tilt) / m - g        level  g tan(tilt), towards the lower side
A held aircraft does neither. So it counts as held if, never HANDS above its first height and never
faster than RUN,
- its tilt stays within TILTED for CALM seconds (within CLAMPED if it rose by RISEN); or
- it leans to and fro, and its ground speed lacks LEANS of the acceleration that follows; or
- its steady thrust over a block is LIFTS times that of another block that could carry it, at
  most NEAR seconds away, and there is no accelerometer: the larger thrust would make it rise, and
  no tank empties so soon.
A test without its height, tilt or speed does not count.

The accelerometer decides before all of these, because an aircraft carried by its thrust feels that
thrust and nothing else:
- it is held where one-second means about the axis of thrust stay within FELT while thrust changes
  by LIFTS, or those about all axes while ASKED of tilt is asked for and not done;
- it is held where, half of the time, attitude and accelerometer together would make it fall or
  rise by FALLS for SUSTAINED, and the barometer moves by less than RISEN: then the attitude turns,
  of a gyro with an offset, and not the aircraft.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.flight import Bools, Floats, body_axes, down_axis
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0

#: m above the first height up to which hands reach, or a barometer wanders in minutes
HANDS = 2.5
#: m above home at which it flies if it is not held: most barometers wander less in minutes
RISEN = 1.0
#: rad by which roll or pitch of what flies moves at least, between their 5th and 95th percentile,
#: and that of a clamped aircraft at most: simulated flights of still air pass it in a minute
TILTED, CLAMPED = np.radians(0.5), np.radians(0.1)
#: Rows from which a tilt that never changes is that of a frozen instrument.
FEWEST_ROWS = 20
STOOD = 5.0  # s out of flight after which the test starts anew
MOST_ROWS = 1200  # kept between live updates
BLOCK = 3.0  # s: over which bodies follow their thrust, and wind evens out
FEWEST_BLOCKS = 4
CALM = 20.0  # s
RUN = 5.0  # m/s over ground
WALK = 2.0  # m/s over ground up to which it can be carried, and drag is small
#: m/s² between the 10th and 90th percentile of what tilt asks and speed does not do: a gust of
#: 5 m/s changes the drag of a large sprayer by half as much
LEANS = 2.5
LIFTS = 1.5
NEAR = 60.0  # s
CARRIES = 0.5  # share of the largest block thrust: with less its legs carry it
#: Share of the empty weight in thrust with which it may hover: the ground and the wind help.
HOVERS = 0.8
STEADY = 0.35  # of a block's mean, between its 10th and 90th percentile: no step within it
TURNED = np.radians(60.0)  # tilt from which it is turned over, and not held
#: m/s² between the 5th and 95th percentile of one-second means: at most 0.05 of benches and of
#: aircraft that are held down, 0.4 and more of flights that change their thrust so.
FELT = 0.15
FEWEST_SECONDS = 5
ASKED = np.radians(20.0)  # tilt asked for that a body in the air would take
#: m/s² down or up, and s: a fall of 10 m, or a loop; nothing flies so at one height.
FALLS, SUSTAINED = 5.0, 2.0


def is_held(time_s: Floats, body: Floats) -> bool:
    """Return True if an aircraft with motors on does not fly but is held, on a bench or by hand.

    `body` (T, 15): height m, roll, pitch and yaw rad, velocity north, east and down m/s, two
    measures of thrust (mean squared rotor speed and mean output, in any unit), specific force m/s²
    along three body axes, and commanded roll and pitch, rad; then barometric height, m. NaN where
    unknown. Unless the accelerometer shows it, the result is False without a height, after a rise
    of HANDS m, and at a speed of RUN m/s or more.
    """
    height, attitude, velocity_ned, thrusts = body[:, 0], body[:, 1:4], body[:, 4:7], body[:, 7:9].T
    if feels_nothing(time_s, body):
        return True
    known = np.flatnonzero(np.isfinite(height))
    if known.size == 0 or np.nanmax(height) - height[known[0]] >= HANDS:
        return False
    if np.any(np.hypot(velocity_ned[:, 0], velocity_ned[:, 1]) >= RUN):
        return False
    rose = float(np.nanmax(np.abs(height - height[known[0]])))
    if time_s[-1] - time_s[0] >= CALM and _stands_still(attitude, rose < RISEN):
        return True
    block = np.floor((time_s - time_s[0]) / BLOCK).astype(np.intp)
    starts = np.flatnonzero(np.diff(block, prepend=-1))
    slices = [slice(a, b) for a, b in zip(starts, [*starts[1:], time_s.size], strict=True)]
    whole = [s for s in slices if time_s[s.stop - 1] - time_s[s.start] >= 0.8 * BLOCK]
    if len(whole) < FEWEST_BLOCKS:
        return False
    if _speed_ignores_lean(time_s, attitude, velocity_ned, whole):
        return True
    if _felt_seconds(time_s, body) >= FEWEST_SECONDS:
        return False
    return any(_thrust_too_uneven(time_s, attitude, thrust, whole) for thrust in thrusts)


def feels_nothing(time_s: Floats, body: Floats) -> bool:
    """Return True if the accelerometer, over T rows, shows that thrust does not carry the aircraft.

    It does if the felt force is constant while thrust changes or tilt is commanded, or if force and
    pressure deny the attitude in half of the rows. `body` (T, 15) has the motion columns that
    `is_held` lists. False with fewer than FEWEST_SECONDS of accelerometer data.
    """
    if time_s.size == 0:
        return False
    if _felt_seconds(time_s, body) < FEWEST_SECONDS:
        return False
    seconds = np.floor(time_s - time_s[0]).astype(np.intp)
    force = _means(seconds, body[:, 9:12])
    if np.mean(attitude_denied(time_s, body[:, 1:4], body[:, 9:12], body[:, 14])) >= 0.5:
        return True
    felt = _spread(force)
    if felt[2] > FELT:
        return False
    for thrust in body[:, 7:9].T:
        alive = thrust[np.isfinite(thrust) & (thrust > 0.0)]
        if alive.size >= FEWEST_ROWS:
            low, high = np.percentile(alive, (5, 95))
            if high >= LIFTS * low:
                return True
    tilt, asked = (_spread(_means(seconds, body[:, k])) for k in (slice(1, 3), slice(12, 14)))
    return bool(np.max(felt) <= FELT and np.max(asked) >= ASKED + np.max(tilt))


def _felt_seconds(time_s: Floats, body: Floats) -> int:
    """Return the number of seconds, of T rows, that have accelerometer data."""
    known = np.isfinite(body[:, 9:12]).all(axis=1)
    return int(np.unique(np.floor(time_s[known])).size)


def attitude_denied(
    time_s: Floats, attitude: Floats, force_frd: Floats, barometer: Floats
) -> Bools:
    """Flag the rows (T,) where attitude and specific force cannot both be true.

    Together they would mean a fall or rise at FALLS m/s² for SUSTAINED s or more, while the
    barometric height stays within RISEN.

    `attitude` (T, 3) rad, `force_frd` (T, 3) m/s², `barometer` (T,) m. False where one is unknown.
    """
    denied = np.zeros(time_s.size, dtype=np.bool_)
    downward = G0 + np.sum(body_axes_down(attitude) * force_frd, axis=1)
    known = np.isfinite(downward) & np.isfinite(barometer)
    wild = known & (np.abs(downward) > FALLS)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], wild.astype(np.int8), [0]])))
    for first, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        lasted = time_s[end - 1] - time_s[first]
        if lasted >= SUSTAINED and np.ptp(barometer[first:end]) < RISEN:
            denied[first:end] = True
    return denied


def body_axes_down(attitude: Floats) -> Floats:
    """Return the downward components (T, 3) of the body axes forward, right, down.

    `attitude` (T, 3) is roll, pitch, yaw, rad.
    """
    return np.stack([axis[:, 2] for axis in body_axes(attitude)], axis=1)


def _means(seconds: NDArray[np.intp], values: Floats) -> Floats:
    """Return the means (S, K) of the finite `values` (T, K) per second; NaN without a finite one.

    `seconds` (T,) is each row's second, counted from 0.
    """
    return np.stack([_mean_by(seconds, column) for column in values.T], axis=1)


def _mean_by(seconds: NDArray[np.intp], values: Floats) -> Floats:
    """Return the means (S,) of the finite `values` (T,) per second (T,); NaN without any."""
    known = np.isfinite(values)
    count = np.bincount(seconds[known], minlength=seconds[-1] + 1)
    total = np.bincount(seconds[known], values[known], minlength=seconds[-1] + 1)
    return np.divide(total, count, out=np.full(count.size, np.nan), where=count > 0)


def _spread(values: Floats) -> Floats:
    """Return the distance (K,) between the 5th and 95th percentile of rows (S, K) without NaN.

    0 with fewer than FEWEST_SECONDS such rows.
    """
    known = values[np.isfinite(values).all(axis=1)]
    if len(known) < FEWEST_SECONDS:
        return np.zeros(values.shape[1])
    return np.diff(np.percentile(known, (5, 95), axis=0), axis=0)[0]


def drop_held(
    flying: Bools, runs: Iterable[tuple[int, int]], time_s: Floats, body: Floats
) -> Bools:
    """Return a copy of `flying` (T,) with False in runs in which the aircraft is held.

    `flying` flags flight by all other tests. `runs` are its (first, end) rows, end excluded; only
    those that start on the ground are tested. `body` (T, 15) has the motion columns that `is_held`
    lists. All rows become False if the accelerometer shows that thrust carried the aircraft in none
    of them.
    """
    result = flying.copy()
    if feels_nothing(time_s[flying], body[flying]):  # all runs together, as each may be too short
        return np.zeros_like(flying)
    for first, end in runs:
        rows = first + np.flatnonzero(flying[first:end])
        from_ground = rows.size and (first > 0 or body[rows[0], 0] <= RISEN)
        if from_ground and is_held(time_s[rows], body[rows]):
            result[rows] = False
    return result


def may_hover(squares: Floats, rotors: int, airframe: Airframe | None) -> Floats:
    """Return `squares` (T,), mean squared rotor speeds in rpm², with NaN where too low to hover.

    `rotors` is the number of rotors. All NaN without an airframe, whose weight is needed.
    """
    if airframe is None:
        return np.full(squares.size, np.nan)
    thrust = airframe.thrust_coefficient * rotors * squares
    with np.errstate(invalid="ignore"):
        return np.where(thrust >= HOVERS * airframe.empty_mass * G0, squares, np.nan)


def _stands_still(attitude: Floats, low: bool) -> bool:
    """Return True if roll and pitch of (n, 3) change less than in any flight, but are not frozen.

    `low`: the aircraft did not rise, so that the larger limit applies. False with fewer than
    FEWEST_ROWS known rows.
    """
    known = attitude[np.isfinite(attitude).all(axis=1), :2]
    if len(known) < FEWEST_ROWS or np.all(np.ptp(known, axis=0) == 0.0):
        return False
    moved = np.diff(np.percentile(known, (5, 95), axis=0), axis=0)
    return bool(np.all(moved < (TILTED if low else CLAMPED)))


def _speed_ignores_lean(
    time_s: Floats, attitude: Floats, velocity_ned: Floats, blocks: list[slice]
) -> bool:
    """Return True if the aircraft, below walking speed, tilts to and fro without accelerating.

    A free aircraft accelerates by g times the tangent of its tilt. `attitude` (T, 3) is roll,
    pitch, yaw, rad; `velocity_ned` (T, 3) in m/s; `blocks` are slices of rows. False with too few
    blocks that are slow and known.
    """
    down = down_axis(attitude)  # of the body, in north, east, down
    upright = down[:, 2] > np.cos(TURNED)
    with np.errstate(invalid="ignore", divide="ignore"):
        asked = np.where(upright[:, None], -G0 * down[:, :2] / down[:, 2:], np.nan)
    level = velocity_ned[:, :2]
    missing = []
    for rows in blocks:
        ends = level[[rows.start, rows.stop - 1]]
        if not np.hypot(*level[rows].T).max() < WALK or not np.isfinite(asked[rows]).all():
            continue
        done = (ends[1] - ends[0]) / (time_s[rows.stop - 1] - time_s[rows.start])
        missing.append(asked[rows].mean(axis=0) - done)
    if len(missing) < FEWEST_BLOCKS:
        return False
    return bool(np.any(np.diff(np.percentile(missing, (10, 90), axis=0), axis=0) > LEANS))


def _thrust_too_uneven(
    time_s: Floats, attitude: Floats, thrust: Floats, blocks: list[slice]
) -> bool:
    """Return True if steady vertical thrusts within NEAR s of each other cannot both carry the
    weight.

    `attitude` (T, 3) is roll, pitch, yaw, rad; `thrust` (T,) the total along the body's axis, in
    any unit; `blocks` are slices of rows, each one value if its thrust is steady. False with fewer
    than FEWEST_BLOCKS of them.
    """
    upwards = thrust * np.cos(attitude[:, 0]) * np.cos(attitude[:, 1])
    steady = []
    for rows in blocks:
        if not np.isfinite(upwards[rows]).all():
            continue
        low, high = np.percentile(upwards[rows], (10, 90))
        mean = float(upwards[rows].mean())
        if high - low <= STEADY * mean:
            steady.append((float(time_s[rows.start]), mean))
    if len(steady) < FEWEST_BLOCKS:
        return False
    at_s, means = np.array(steady).T
    near = np.abs(at_s[:, None] - at_s) <= NEAR
    most = np.max(np.where(near, means, 0.0), axis=1)
    return bool(np.any((means > CARRIES * np.max(means)) & (means < most / LIFTS)))


@dataclass(frozen=True, slots=True, eq=False)
class HeldSoFar:
    """State, carried between live updates, that decides if an aircraft is held."""

    ground: float = np.nan  # m, the last height with its motors off
    seen_down: bool = False  # it was observed on the ground
    risen: bool = False  # it has left the ground since
    flies: bool = False  # higher or faster than hands go, or never observed on the ground
    held: bool = False
    down_s: float = np.nan  # since when it does not fly; NaN while it does
    first: float = np.nan  # m, the ground, or the height of the first row that seemed to fly
    rows: Floats = field(default_factory=lambda: np.empty((0, 16)))  # time and body of such rows


def flag_held(
    before: HeldSoFar, time_s: Floats, flying: Bools, off: Bools, body: Floats, *, clear: float
) -> tuple[Bools, HeldSoFar]:
    """Flag rows (T,) in flight where the aircraft is held or has not yet left the ground.

    No row depends on later ones. `before` is the state from the last call; also return the state
    for the next one. `flying` (T,) flags flight by all other tests, `off` (T,) motors off; `body`
    (T, 15) as in `is_held`. The aircraft leaves the ground at `clear` m above its last height with
    motors off.
    """
    found, now = np.zeros(time_s.size, dtype=np.bool_), before
    for k in range(time_s.size):
        at_s, height = float(time_s[k]), float(body[k, 0])
        if off[k]:
            ground = height if np.isfinite(height) else now.ground
            now = HeldSoFar(ground=ground, seen_down=True)
        elif not flying[k]:
            since_s = at_s if np.isnan(now.down_s) else now.down_s
            kept = now if at_s - since_s < STOOD else HeldSoFar(ground=now.ground, risen=now.risen)
            now = replace(kept, down_s=since_s, seen_down=True)
        elif not now.flies:
            now = _seems_to_fly(now, at_s, body[k], clear)
            found[k] = now.held or not now.risen
        elif not np.isnan(now.down_s):
            now = replace(now, down_s=np.nan)
    return found, now


def _seems_to_fly(now: HeldSoFar, at_s: float, body: Floats, clear: float) -> HeldSoFar:
    """Update the state by a row that other tests count as flight, though hands may hold the craft.

    `body` (15,) is the row at time `at_s`, s, as in `is_held`; `clear` is the height above ground,
    m, from which the aircraft counts as off the ground.
    """
    height, speed = float(body[0]), float(np.hypot(body[4], body[5]))
    risen = now.risen or not height <= now.ground + clear
    if not risen:
        return replace(now, down_s=np.nan)
    began = height if np.isnan(now.ground) else now.ground
    first = began if np.isnan(now.first) else now.first
    if not (now.seen_down or height <= RISEN) or height - first >= HANDS or speed >= RUN:
        return replace(HeldSoFar(ground=now.ground, seen_down=True), risen=True, flies=True)
    rows = np.vstack([now.rows[-MOST_ROWS:], np.append(at_s, body)])
    if now.rows.size and np.floor(at_s) > np.floor(now.rows[-1, 0]):  # once a second is enough
        seen = is_held(now.rows[:, 0], now.rows[:, 1:])
    else:
        seen = now.held
    return replace(now, risen=True, held=seen, down_s=np.nan, first=first, rows=rows)
