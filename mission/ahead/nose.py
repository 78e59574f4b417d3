"""Where the nose points: it follows the way flown, as fast as the vehicle may turn.

ArduPilot's rule (AC_AttitudeControl, input_shaping_angle): the wanted rate is that at which the way
turns, and what an error of heading e asks for, min(e/t, sqrt(2 a (|e| - a t²/2))); the rate is cut
at its limit and changes by no more than a. So a nose that is slow to turn goes on beyond.
"""

from __future__ import annotations

import math
from itertools import accumulate

import numpy as np

from thrustmargin.mission.ahead.limits import FlightLimits
from thrustmargin.models.flight import Floats

SLOW = 0.05  # of the speed limit, below which the nose stays where it is (AC_PosControl)
PART_S = 0.02  # s of a step of the rule
SETTLED = 1e-3  # rad and rad/s that are nothing


def heading(
    time_s: Floats,
    velocity_ned: Floats,
    gained_ned: Floats,
    ordered: Floats,
    limits: FlightLimits,
    start: float,
) -> tuple[Floats, Floats]:
    """Yaw (T,) rad, going on beyond a full turn, and how far (T,) rad it has still to turn.

    The way is that of a target with velocity m/s and acceleration m/s² (T, 3) NED. `ordered` (T,)
    rad is what the plan orders, NaN where the nose is free.
    """
    wanted, turning = _wanted(velocity_ned, gained_ned, ordered, limits, start)
    yaw = np.empty_like(time_s)
    at, rate = start, 0.0
    most, gain = limits.yaw_rate, limits.yaw_acceleration
    slack = gain * limits.yaw_time**2
    for row in range(time_s.size):
        goal, ahead = float(wanted[row]), float(turning[row])
        step = float(time_s[row] - time_s[row - 1]) if row else 0.0
        parts = math.ceil(step / PART_S)
        if abs(goal - at) < SETTLED and abs(rate) < SETTLED and ahead == 0.0:
            at, rate, parts = goal, 0.0, 0
        for part in range(parts):
            length = step / parts
            aim = goal - ahead * length * (parts - 1 - part)
            error = aim - at
            size = abs(error)
            asked = size / limits.yaw_time
            if size > slack:
                asked = math.sqrt(2.0 * gain * (size - 0.5 * slack))
            asked = math.copysign(min(asked, size / length), error) + ahead
            asked = min(max(asked, -most), most)
            rate += min(max(asked - rate, -gain * length), gain * length)
            at += rate * length
        yaw[row] = at
    return yaw, wanted - yaw


def followed(time_s: Floats, target: Floats, limits: FlightLimits) -> Floats:
    """The yaw (T,) rad of an aircraft that is asked to turn as `target` (T,) rad does, at times
    evenly spaced: behind it by the time of the loop of angle, 1/p."""
    steps = limits.yaw_gain * float(time_s[1] - time_s[0])
    keep = math.exp(-steps)
    gone = 1.0 - keep
    # Between rows the target is a straight line, so that this is exact.
    added = gone * target[:-1] + (1.0 - gone / steps) * np.diff(target)
    way = accumulate(added.tolist(), lambda at, more: keep * at + more, initial=float(target[0]))
    return np.fromiter(way, dtype=np.float64, count=target.size)


def _wanted(
    velocity: Floats, gained: Floats, ordered: Floats, limits: FlightLimits, start: float
) -> tuple[Floats, Floats]:
    """Heading wanted (T,) rad without leaps of a full turn, and its rate (T,) rad/s."""
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    way = np.arctan2(velocity[:, 1], velocity[:, 0])
    free = np.isnan(ordered)
    known = np.where(free, (speed > SLOW * limits.speed) & limits.nose_ahead, True)
    goal = np.where(free, way, ordered)
    last = np.maximum.accumulate(np.where(known, np.arange(speed.size), -1))
    goal = np.where(last >= 0, goal[np.maximum(last, 0)], start)
    across = velocity[:, 0] * gained[:, 1] - velocity[:, 1] * gained[:, 0]
    turning = across / np.maximum(speed, 1e-9) ** 2
    turning[~known | ~free | (np.abs(turning) < SETTLED)] = 0.0
    return np.unwrap(np.append(start, goal))[1:], turning
