"""What can be wrong with an aircraft and has no name in any table.

The names here are the scorer's own; the code under test has none for them. Each law pushes to both
sides, so that no constant part of it is honestly something that the table does name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy.signal import lfilter

from tests.undeclared.changes import between
from tests.undeclared.missions import FINE_STEP
from tests.undeclared.physics import Array, Attitude, Motion, Surroundings


@dataclass(frozen=True, kw_only=True)
class Outside:
    """A change that no table names, with a size and a number of its own for each data set."""

    name: str
    size: float
    number: float  # 0..1, whatever the law below makes of it
    rotor: int


Push = Callable[[Outside, Motion, Surroundings, Attitude], Array]


def of_axis(axis: int, values: Array) -> Array:
    push = np.zeros((values.size, 4))
    push[:, axis] = values
    return push


def turning_swell(o: Outside, motion: Motion, around: Surroundings, attitude: Attitude) -> Array:
    """A roll disturbance that swells with heading rate and takes seconds to fade."""
    del motion, around
    fade = 2.0 + 5.0 * o.number
    keep = np.exp(-FINE_STEP / fade)
    swell = lfilter([1.0 - keep], [1.0, -keep], np.abs(attitude.rate[:, 2]))
    return of_axis(1, 25.0 * o.size * np.asarray(swell))


def half_tank_step(o: Outside, motion: Motion, around: Surroundings, attitude: Attitude) -> Array:
    """Liquid that changes its side of a baffle when half of it is gone."""
    del motion, attitude
    share = 0.35 + 0.3 * o.number
    span = around.tank[0] - around.tank[-1]
    return of_axis(2, 5.0 * o.size * np.sign(around.tank - (around.tank[0] - share * span)))


def surge(o: Outside, motion: Motion, around: Surroundings, attitude: Attitude) -> Array:
    """The collective swings with a period of its own."""
    del around
    period = 6.0 * 4.0**o.number
    swing = np.sin(2.0 * np.pi * motion.time / period)
    return of_axis(0, 0.06 * o.size * attitude.thrust * swing)


def thermals(o: Outside, motion: Motion, around: Surroundings, attitude: Attitude) -> Array:
    """Rising and sinking air over patches of ground."""
    del around
    length = 25.0 + 50.0 * o.number
    east, north = motion.position[:, 1] / length, motion.position[:, 0] / length
    lift = np.sin(2 * np.pi * north + 0.7) * np.cos(2 * np.pi * east + 1.9)
    return of_axis(0, 0.07 * o.size * attitude.thrust * lift)


def loose_tank(o: Outside, motion: Motion, around: Surroundings, attitude: Attitude) -> Array:
    """A tank with play leans to the side of the last hard push and stays there."""
    del around, motion
    limit = np.deg2rad(1.5 + 2.0 * o.number)
    lean = attitude.euler[:, 1]
    mark = np.where(lean > limit, 1.0, np.where(lean < -limit, -1.0, 0.0))
    last = np.maximum.accumulate(np.where(mark != 0.0, np.arange(mark.size), -1))
    return of_axis(2, 4.0 * o.size * np.where(last >= 0, mark[np.maximum(last, 0)], 0.0))


def see_saw(o: Outside, motion: Motion, around: Surroundings, attitude: Attitude) -> Array:
    """Two motor controllers that beat against each other: a yaw moment with a slow beat."""
    del around, attitude
    slow = np.sin(2 * np.pi * motion.time / (30.0 + 40.0 * o.number))
    return of_axis(3, 0.7 * o.size * slow * np.sin(2 * np.pi * motion.time / 9.0))


def sun_side(o: Outside, motion: Motion, around: Surroundings, attitude: Attitude) -> Array:
    """A roll moment that goes twice round with the compass."""
    del around, attitude
    return of_axis(1, 5.0 * o.size * np.sin(2.0 * motion.heading + 2 * np.pi * o.number))


def slosh(o: Outside, motion: Motion, around: Surroundings, attitude: Attitude) -> Array:
    """Liquid that swings for several seconds after every change of lean."""
    del motion
    period, damping = 2.5 + 2.5 * o.number, 0.08
    w = 2 * np.pi / period * FINE_STEP
    # A pendulum pushed by every change of pitch: y'' = pitch'' - 2 d w y' - w² y.
    jolt = np.gradient(attitude.rate[:, 1])
    swing = lfilter([1.0], [1.0, -(2.0 - 2.0 * damping * w - w**2), 1.0 - 2.0 * damping * w], jolt)
    return of_axis(2, 150.0 * o.size * FINE_STEP * np.asarray(swing) * around.tank / 16.0)


PUSHES: Mapping[str, Push] = MappingProxyType(
    {
        "turning swell": turning_swell,
        "half-tank step": half_tank_step,
        "surge": surge,
        "thermals": thermals,
        "loose tank": loose_tank,
        "see-saw": see_saw,
        "sun side": sun_side,
        "slosh": slosh,
    }
)
STICKING = "sticking sensor"
ALIASING = "wandering sensor"
OUTSIDE = (*PUSHES, STICKING, ALIASING)


def outside_push(o: Outside, motion: Motion, around: Surroundings, attitude: Attitude) -> Array:
    """(T, 4) what the change adds to the needed wrench; nothing for a sensor's fault."""
    law = PUSHES.get(o.name)
    return np.zeros((motion.time.size, 4)) if law is None else law(o, motion, around, attitude)


def faulty_sensor(o: Outside, rpm: Array, rng: np.random.Generator) -> Array:
    """(T, R) rotor speeds as a faulty sensor reports them; unchanged for other changes."""
    rpm = rpm.copy()
    rows = np.arange(rpm.shape[0])
    if o.name == STICKING:
        # Holds its last value for seconds, then jumps to the present one.
        start = rng.random(rows.size) < 0.012
        hold = rng.integers(10, 10 + int(60 * o.size), rows.size)
        until = np.maximum.accumulate(np.where(start, rows + hold, -1))
        begun = np.maximum.accumulate(np.where(start, rows, 0))
        rpm[:, o.rotor] = np.where(rows <= until, rpm[begun, o.rotor], rpm[:, o.rotor])
    elif o.name == ALIASING:
        # Beats against its sampling: wanders to either side with no pattern in the flight.
        keep = np.exp(-0.1 / (2.0 + 8.0 * o.number))
        wander = lfilter([1.0], [1.0, -keep], rng.standard_normal(rows.size))
        rpm[:, o.rotor] += 120.0 * o.size * np.asarray(wander) * np.sqrt(1.0 - keep**2)
    return rpm


def draw_outside(name: str, rng: np.random.Generator, rotors: int) -> Outside:
    return Outside(
        name=name,
        size=between(rng, 0.3, 1.0),
        number=float(rng.random()),
        rotor=int(rng.integers(rotors)),
    )
