"""Spraying missions: boustrophedon lines, turned or flown backwards, flat, hilly or with climbs.

A mission is a list of legs, each a trapezoid of one speed (along, across, up or turning); the
speeds are interpolated on a fine time base, rounded by a filter as a position controller would,
and integrated. So position, velocity and acceleration agree with each other by construction.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]

FINE_STEP = 0.02  # s


class Motion(NamedTuple):
    """What the aircraft does, on a fine time base; T rows."""

    time: Array  # (T,) s
    position: Array  # (T, 3) m NED
    velocity: Array  # (T, 3) m/s NED
    acceleration: Array  # (T, 3) m/s² NED
    heading: Array  # (T,) rad
    height: Array  # (T,) m above ground
    spraying: Array  # (T,) 0 or 1
    flying: NDArray[np.bool_]  # (T,)


@dataclass(frozen=True, kw_only=True)
class Style:
    """How a mission is flown."""

    cruise: float = 4.0  # m/s
    acceleration: float = 1.2  # m/s²
    line_length: float = 90.0  # m
    spacing: float = 4.5  # m
    field_heading: float = 0.0  # rad
    turns: bool = True  # turn round at line ends; else fly back tail first
    turn_rate: float = 1.0  # rad/s
    turn_acceleration: float = 0.45  # rad/s²
    height: float = 3.0  # m above ground of the lines
    hills: float = 0.0  # m, half of the change of height above ground along the way
    hill_period: float = 25.0  # s
    climb: float = 0.0  # m climbed and descended between some lines
    climb_speed: float = 2.0  # m/s
    hover_first: float = 8.0  # s
    from_ground: bool = False
    sway: float = 0.15  # m/s² of the unsteadiness of hand and gust
    duration: float = 240.0  # s at least; the mission ends with its last line


@dataclass
class Legs:
    """Knots of the four commanded speeds while a mission is written down."""

    time: list[float] = field(default_factory=lambda: [0.0])
    speed: list[tuple[float, float, float, float]] = field(
        default_factory=lambda: [(0.0, 0.0, 0.0, 0.0)]
    )
    pump: list[tuple[float, float]] = field(default_factory=list)

    def wait(self, seconds: float) -> None:
        self.time.append(self.time[-1] + seconds)
        self.speed.append((0.0, 0.0, 0.0, 0.0))

    def go(self, axis: int, distance: float, top: float, acceleration: float) -> None:
        """Cover a distance, signed, on one axis: 0 along, 1 across, 2 up, 3 turning."""
        length = abs(distance)
        top = min(top, np.sqrt(length * acceleration))
        ramp, cruise = top / acceleration, length / top - top / acceleration
        row = [0.0, 0.0, 0.0, 0.0]
        row[axis] = float(np.copysign(top, distance))
        start = self.time[-1]
        self.time += [start + ramp, start + ramp + cruise + 1e-6, start + 2 * ramp + cruise + 2e-6]
        self.speed += [tuple(row), tuple(row), (0.0, 0.0, 0.0, 0.0)]  # type: ignore[arg-type]

    def line(self, length: float, style: Style) -> None:
        start = self.time[-1]
        self.go(0, length, style.cruise, style.acceleration)
        self.pump.append((start + 1.0, self.time[-1] - 1.0))


def fly_lines(style: Style) -> tuple[Legs, float]:
    """The legs of a mission and the time at which the aircraft leaves the ground."""
    legs, lift_off = Legs(), -1.0
    if style.from_ground:
        legs.wait(3.0)
        lift_off = legs.time[-1]
        legs.go(2, style.height, 1.0, 0.6)
    legs.wait(style.hover_first)
    ahead, side, line = 1.0, 1.0, 0
    while legs.time[-1] < style.duration:
        legs.line(ahead * style.line_length, style)
        legs.wait(0.8)
        if style.climb and line % 2 == 0:
            legs.go(2, style.climb, style.climb_speed, 0.9)
            legs.wait(2.0)
            legs.go(2, -style.climb, 0.8 * style.climb_speed, 0.7)
            legs.wait(1.0)
        legs.go(1, side * style.spacing, 2.0, 0.8 * style.acceleration)
        legs.wait(0.5)
        if style.turns:
            legs.go(3, side * np.pi, style.turn_rate, style.turn_acceleration)
            legs.wait(0.7)
            side = -side
        else:
            ahead = -ahead
        line += 1
    legs.wait(4.0)
    return legs, lift_off


def rounded(signal: Array, lag: float) -> Array:
    """The signal through five equal first-order lags, starting settled.

    Five, because rotor moments follow the third derivative of velocity.
    """
    keep = float(np.exp(-FINE_STEP / lag))
    for _ in range(5):
        signal = lfilter([1.0 - keep], [1.0, -keep], signal - signal[0], axis=0) + signal[0]
    return np.asarray(signal)


def coloured(rng: np.random.Generator, rows: int, columns: int, tau: float) -> Array:
    """(rows, columns) noise of unit variance and correlation time tau [s] on the fine base."""
    keep = np.exp(-FINE_STEP / tau)
    white = rng.standard_normal((rows, columns)) * np.sqrt(1.0 - keep**2)
    white[0] = rng.standard_normal(columns)
    return np.asarray(lfilter([1.0], [1.0, -keep], white, axis=0))


def motion_of(style: Style, rng: np.random.Generator) -> Motion:
    """Fly a mission: what the aircraft does every 20 ms, with the unsteadiness of real flight."""
    legs, lift_off = fly_lines(style)
    time = np.arange(0.0, legs.time[-1], FINE_STEP)
    speed = np.stack([np.interp(time, legs.time, c) for c in zip(*legs.speed, strict=True)], axis=1)
    speed = rounded(speed, 0.16)
    heading = style.field_heading + np.cumsum(speed[:, 3]) * FINE_STEP
    flying = time >= lift_off + 1.0 if style.from_ground else np.ones(time.size, dtype=np.bool_)
    steady = np.clip((time - lift_off - 3.0) / 4.0, 0.0, 1.0) if style.from_ground else 1.0
    cosine, sine = np.cos(heading), np.sin(heading)
    hills = style.hills * np.sin(
        2 * np.pi * time / style.hill_period + rng.uniform(0.0, 2.0 * np.pi)
    )
    if style.from_ground:
        hills = hills * np.clip((time - lift_off - 8.0) / 8.0, 0.0, 1.0)
    velocity = np.stack(
        [
            speed[:, 0] * cosine - speed[:, 1] * sine,
            speed[:, 0] * sine + speed[:, 1] * cosine,
            -speed[:, 2],
        ],
        axis=1,
    )
    # Sway is a wobble about the commanded way that comes back to it: made as a displacement, with
    # the asked acceleration, less up and down than sideways.
    wobble = np.gradient(rounded(coloured(rng, time.size, 3, 1.0), 0.2), FINE_STEP, axis=0)
    wobble *= style.sway * 0.8 / np.std(np.gradient(wobble, FINE_STEP, axis=0), axis=0)
    wobble[:, 2] *= 0.7
    velocity = velocity + wobble * np.broadcast_to(steady, time.shape)[:, None]
    # Rolling ground under a level path changes the height above it without any motion.
    up = np.cumsum(-velocity[:, 2]) * FINE_STEP
    start = 0.0 if style.from_ground else style.height
    height = np.maximum(start + up + hills, 0.0 if style.from_ground else 0.4)
    acceleration = np.gradient(velocity, FINE_STEP, axis=0)
    pump = np.zeros(time.size)
    for on, off in legs.pump:
        pump[(time >= on) & (time < off)] = 1.0
    return Motion(
        time=time,
        position=np.cumsum(velocity, axis=0) * FINE_STEP,
        velocity=velocity,
        acceleration=acceleration,
        heading=heading,
        height=np.where(flying, height, 0.0),
        spraying=pump,
        flying=np.asarray(flying, dtype=np.bool_),
    )


def random_style(rng: np.random.Generator, radius: float) -> Style:
    """A mission of the season: level lines, well above the ground for propellers of that radius."""
    cruise = float(rng.uniform(2.0, 8.0))
    return Style(
        cruise=cruise,
        acceleration=float(rng.uniform(0.8, 1.8)),
        line_length=cruise * float(rng.uniform(12.0, 24.0)),
        spacing=float(rng.uniform(3.5, 6.0)),
        field_heading=float(rng.uniform(-np.pi, np.pi)),
        turns=bool(rng.random() < 0.75),
        turn_rate=float(rng.uniform(0.7, 1.4)),
        turn_acceleration=float(rng.uniform(0.25, 0.6)),
        height=float(max(rng.uniform(2.5, 3.5), 7.0 * radius)),
        hover_first=float(rng.uniform(5.0, 20.0)),
        from_ground=bool(rng.random() < 0.3),
        sway=float(rng.uniform(0.05, 0.25)),
        duration=float(rng.uniform(180.0, 290.0)),
    )


def hand_flown(rng: np.random.Generator, radius: float) -> Style:
    """Short stretches by the sticks: unsteady, quick to turn, now and then up and down."""
    cruise = float(rng.uniform(1.5, 6.0))
    return replace(
        random_style(rng, radius),
        cruise=cruise,
        line_length=cruise * float(rng.uniform(4.0, 10.0)),
        turn_acceleration=float(rng.uniform(0.5, 1.2)),
        climb=float(rng.choice([0.0, 2.0, 5.0])),
        sway=float(rng.uniform(0.4, 0.8)),
    )


def hard_flown(rng: np.random.Generator, radius: float) -> Style:
    """Fast lines with hard stops and turns."""
    cruise = float(rng.uniform(5.0, 11.0))
    return replace(
        random_style(rng, radius),
        cruise=cruise,
        acceleration=float(rng.uniform(2.5, 4.0)),
        line_length=cruise * float(rng.uniform(8.0, 16.0)),
        turn_rate=float(rng.uniform(1.5, 2.2)),
        turn_acceleration=float(rng.uniform(1.0, 2.0)),
        climb=float(rng.choice([0.0, 4.0, 8.0])),
    )


def hover_only(style: Style) -> Style:
    """The same with hardly any way."""
    return replace(style, cruise=0.8, line_length=2.0, spacing=1.0, climb=0.0)


STYLES = {"missions": random_style, "by hand": hand_flown, "hard": hard_flown}
