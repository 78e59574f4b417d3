"""Plan the speed along one straight leg from rest to rest, limited in acceleration, jerk and snap.

ArduPilot plans each leg of a mission so (AP_Math, SCurve): jerk rises and falls as a raised cosine.
A pulse of acceleration A with jerk J and ramps of t_j lasts A/J + t_j to its peak and adds

    V = A (A/J + t_j + t_flat)      in T = 2 (A/J + t_j) + t_flat,      over V T / 2

and braking is the same pulse in reverse.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from thrustmargin.models.flight import Floats

SAMPLES = 257  # of a pulse, over which it is summed
FINEST = 0.01  # m/s in steps of which a short leg's top speed is found, so that legs share pulses


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pulse:
    """Acceleration from rest to a top speed, tabulated in (SAMPLES,) rows; reversed it is
    braking."""

    top_speed: float  # m/s that is reached
    seconds: float
    at_s: Floats  # s since it began
    way: Floats  # m
    speed: Floats  # m/s
    acceleration: Floats  # m/s²

    @property
    def length(self) -> float:
        """Return the distance covered while accelerating, m."""
        return float(self.way[-1])

    def at(self, time_s: Floats) -> tuple[Floats, Floats, Floats]:
        """Return distance m, speed m/s and acceleration m/s², each (N,), at times (N,) s after the
        pulse starts.

        Outside the pulse, distance and speed are those at its nearer end, and the acceleration is
        0.
        """
        inside = np.clip(time_s, 0.0, self.seconds)
        gained = np.interp(inside, self.at_s, self.acceleration)
        return (
            np.interp(inside, self.at_s, self.way),
            np.interp(inside, self.at_s, self.speed),
            np.where((time_s < 0.0) | (time_s > self.seconds), 0.0, gained),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LegProfile:
    """The motion along one leg in time: an acceleration pulse, cruise at top speed, and braking."""

    length: float  # m
    pulse: Pulse
    cruise_s: float  # s between speeding up and braking
    brakes: bool = True  # False: it ends at top speed

    @property
    def top_speed(self) -> float:
        return self.pulse.top_speed

    @property
    def seconds(self) -> float:
        return (2.0 if self.brakes else 1.0) * self.pulse.seconds + self.cruise_s

    def at(self, time_s: Floats) -> tuple[Floats, Floats, Floats]:
        """Return distance m, speed m/s and acceleration m/s², each (N,), at times (N,) s after the
        leg starts.
        """
        pulse, remaining_s = self.pulse, self.seconds - time_s
        first, last = time_s < pulse.seconds, (remaining_s < pulse.seconds) & self.brakes
        way, speed, gained = pulse.at(np.where(first, time_s, remaining_s))
        cruise_length = (time_s - pulse.seconds) * self.top_speed + pulse.length
        return (
            np.where(first, way, np.where(last, self.length - way, cruise_length)),
            np.where(first | last, speed, self.top_speed),
            np.where(first, gained, np.where(last, -gained, 0.0)),
        )


@lru_cache(maxsize=4096)
def leg_profile(
    length: float,
    speed: float,
    acceleration: float,
    jerk: float,
    snap: float,
    *,
    brakes: bool = True,
) -> LegProfile:
    """Return the motion along a leg of `length` m from rest; a short leg has a lower top speed.

    Limits: `speed` m/s, `acceleration` m/s², `jerk` m/s³, `snap` m/s⁴. A reduced top speed is
    rounded down to FINEST. Without `brakes` the leg ends at its top speed.
    """
    low, high = 0.0, speed
    pulses = 2.0 if brakes else 1.0  # each covers half of its time at top speed
    room = 2.0 * length / pulses
    if _pulse_seconds(speed, acceleration, jerk, snap) * speed > room:
        while high - low > 1e-3 * FINEST:
            middle = 0.5 * (low + high)
            short = _pulse_seconds(middle, acceleration, jerk, snap) * middle > room
            low, high = (low, middle) if short else (middle, high)
        speed = max(math.floor(low / FINEST + 0.01) * FINEST, FINEST)
    pulse = speeding_up(speed, acceleration, jerk, snap)
    rest = max(length - pulses * pulse.length, 0.0)
    return LegProfile(length=length, pulse=pulse, cruise_s=rest / speed, brakes=brakes)


@lru_cache(maxsize=4096)
def speeding_up(speed: float, acceleration: float, jerk: float, snap: float) -> Pulse:
    """Return the motion from rest to `speed`, m/s, within limits of its derivatives; cached.

    The limits are `acceleration` m/s², `jerk` m/s³ and `snap` m/s⁴.
    """
    peak, steep, ramp, constant_s, flat = _pulse(speed, acceleration, jerk, snap)
    seconds = 2.0 * (2.0 * ramp + constant_s) + flat
    at_s = np.linspace(0.0, seconds, SAMPLES)
    rise = np.minimum(at_s, seconds - at_s)
    gained = _rise(rise, steep, ramp, constant_s)
    # The sums are those of the pulse to the last digit, so that legs end where they should.
    step = at_s[1]
    gain = np.append(0.0, np.cumsum(0.5 * (gained[1:] + gained[:-1]) * step))
    gain *= speed / gain[-1]
    way = np.append(0.0, np.cumsum(0.5 * (gain[1:] + gain[:-1]) * step))
    return Pulse(
        top_speed=speed,
        seconds=seconds,
        at_s=at_s,
        way=way,
        speed=gain,
        acceleration=np.minimum(gained, peak),
    )


def _pulse_seconds(speed: float, acceleration: float, jerk: float, snap: float) -> float:
    """Return the duration of an acceleration pulse, s."""
    _, _, ramp, constant_s, flat = _pulse(speed, acceleration, jerk, snap)
    return 2.0 * (2.0 * ramp + constant_s) + flat


def _pulse(
    speed: float, acceleration: float, jerk: float, snap: float
) -> tuple[float, float, float, float, float]:
    """Return peak acceleration, m/s², peak jerk, m/s³, and the durations of three phases, s, of
    speeding up to `speed`, m/s.

    The phases are one ramp of jerk, constant jerk, and constant acceleration; the last two are 0
    where the limits are not reached. The limits are `acceleration` m/s², `jerk` m/s³ and `snap`
    m/s⁴.
    """
    ramp = jerk * math.pi / (2.0 * snap)
    root = math.sqrt(ramp**2 + 4.0 * speed / jerk)
    peak = min(acceleration, jerk * (root - ramp) / 2.0)
    if peak < jerk * ramp:  # jerk is not reached either
        ramp = min(
            (speed * math.pi / (4.0 * snap)) ** (1.0 / 3.0),
            math.sqrt(acceleration * math.pi / (2.0 * snap)),
        )
        jerk = 2.0 * snap * ramp / math.pi
        peak = jerk * ramp
    constant_s = peak / jerk - ramp
    return peak, jerk, ramp, constant_s, max(speed / peak - peak / jerk - ramp, 0.0)


def _rise(time_s: Floats, jerk: float, ramp: float, constant_s: float) -> Floats:
    """Compute the acceleration (N,), m/s², at times (N,) s after it began to rise."""
    up = np.clip(time_s, 0.0, ramp)
    down = np.clip(time_s - ramp - constant_s, 0.0, ramp)
    bent = ramp / (2.0 * math.pi)
    first = 0.5 * jerk * (up - 2.0 * bent * np.sin(0.5 * up / bent))
    last = 0.5 * jerk * (down + 2.0 * bent * np.sin(0.5 * down / bent))
    return first + jerk * np.clip(time_s - ramp, 0.0, constant_s) + last
