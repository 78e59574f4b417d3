"""Compute how a multirotor's yaw follows its target: the autopilot's loops with the rotors' moment.

The angle loop demands the target's own rate plus a correction of the error of angle e: P e where
it is small, beyond that sqrt(2 c (|e| - c/(2 P²))), the rate from which it can brake with c
(ArduPilot, AC_AttitudeControl, sqrt_controller). The rate loop turns the error of rate, through a
low pass, into an output u, and u into yaw acceleration:

    u = K f + I int f dt        d(rate)/dt = a u - d rate

a is the authority: an output of 1 is half of each rotor's largest thrust (AP_MotorsMatrix), whose
torque accelerates the yaw inertia; d is the damping. A weak rate loop makes the nose overshoot, and
the reversal takes more thrust than the turn. The lag of the rotors is left out, and their inertia
too, which counters it: in flights of a heavy quad the moment was late by less than 0.1 s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from thrustmargin.models.flight import Floats
from thrustmargin.models.model.rotor_model import RotorModel, identified_airframe
from thrustmargin.models.physics.margin import ceiling

LARGEST_OUTPUT = 0.5  # share of a rotor's thrust that an output of 1 moves, in ArduPilot
PART_S = 0.02  # s of a step of the loops
SETTLED = 1e-3  # rad, rad/s and share of output that are nothing
CRITICAL = 4.0  # times the angle gain: a rate loop of unknown gain, which just does not oscillate


@dataclass(frozen=True, slots=True, kw_only=True)
class YawLoop:
    """Gains of the yaw control loops, and the yaw moment of the rotors; NaN unknown."""

    angle_gain: float  # P, 1/s
    braking: float = math.inf  # c, rad/s²
    rate_gain: float = math.nan  # K, output for a rad/s of error
    rate_integral: float = 0.0  # I, output/s for a rad/s of error
    rate_filter: float = math.inf  # rad/s of the low pass
    authority: float = math.nan  # a, rad/s² for an output of 1
    damping: float = 0.0  # d, 1/s


def yaw_authority(model: RotorModel) -> tuple[float, float]:
    """Return the yaw acceleration, rad/s², at full controller output, and the damping of yaw, 1/s.

    Both are NaN where the model has no yaw inertia. The autopilot compensates a low battery, so the
    largest thrust is that of a full one.
    """
    turning = [one.parameters for one in model.effects if one.name == "manoeuvre_moment"]
    inertia, damping = (
        sum(values[name].value for values in turning if name in values)
        for name in ("inertia_yaw", "damping_yaw")
    )
    if not inertia > 0.0:
        return math.nan, math.nan
    craft = identified_airframe(model)
    largest = ceiling(craft, craft.reference_density, craft.ceiling_voltage).max_thrust
    moment = LARGEST_OUTPUT * craft.torque_ratio * float(np.sum(largest))
    return moment / inertia, max(damping, 0.0) / inertia


def followed_yaw(time_s: Floats, target: Floats, loop: YawLoop) -> Floats:
    """Simulate the aircraft's yaw (T,), rad, under its yaw controller `loop` for a `target` (T,),
    rad.

    `time_s` (T,) are the rows' times, between which the target changes linearly. The aircraft is at
    rest on the target in the first row. Without a rate gain or authority a simpler loop is used.
    """
    yaw = np.empty_like(target)
    at, rate, filtered, held = float(target[0]), 0.0, 0.0, 0.0
    yaw[0] = at
    known = loop.rate_gain > 0.0 and loop.authority > 0.0
    most = loop.authority if loop.authority > 0.0 else math.inf
    aims, steps = target.tolist(), np.diff(time_s).tolist()
    for row, step in enumerate(steps):
        before, aim = aims[row], aims[row + 1]
        parts = max(math.ceil(step / PART_S - 1e-6), 1)
        length, turning = step / parts, (aim - before) / step
        still = abs(turning) + abs(rate) + abs(aim - at) + abs(held) < SETTLED
        if still:
            at, rate, filtered, held, parts = aim, 0.0, 0.0, 0.0, 0
        passed = -math.expm1(-length * loop.rate_filter)
        followed = -math.expm1(-length * CRITICAL * loop.angle_gain)
        for part in range(parts):
            error = before + turning * length * part - at
            wrong, was = turning + _correction(error, loop) - rate, rate
            if known:
                filtered += passed * (wrong - filtered)
                held += loop.rate_integral * filtered * length
                output = min(max(loop.rate_gain * filtered + held, -1.0), 1.0)
                rate += (loop.authority * output - loop.damping * rate) * length
            else:
                rate += min(max(followed * wrong, -most * length), most * length)
            at += 0.5 * (was + rate) * length
        yaw[row + 1] = at
    return yaw


def _correction(error: float, loop: YawLoop) -> float:
    """Return the rate, rad/s, that corrects an error of angle, rad."""
    size, gain = abs(error), loop.angle_gain
    slack = loop.braking / gain**2
    if size <= slack:
        return gain * error
    return math.copysign(math.sqrt(2.0 * loop.braking * (size - 0.5 * slack)), error)
