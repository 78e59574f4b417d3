"""Where the autopilot's target is at each moment: legs one after the other, corners cut.

Each leg goes from rest to rest by its profile. At a corner that is not stopped at, the next leg
starts before the last has ended, and the two add up: as early as the middle of the corner lies
within the radius of the place, slower than both legs, and accelerates no more than allowed there
(ArduPilot, SCurve). PX4 cuts its corners by another rule; the same one stands in for it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np

from thrustmargin.mission.ahead.leg_profile import LegProfile, Pulse, leg_profile
from thrustmargin.mission.ahead.limits import FlightLimits
from thrustmargin.models.flight import Floats

TRIED_S = 0.02  # s between the moments at which a corner is tried
SHORTEST = 0.05  # m of a leg


@dataclass(frozen=True, kw_only=True, eq=False)
class WayLeg:
    """One straight leg to fly; limits are those along it."""

    item: int  # number of the mission item that it leads to
    start_ned: Floats  # (3,) m
    end_ned: Floats  # (3,) m
    speed: float  # m/s along it
    level_speed: float  # m/s over ground, as ordered: the pump's flow is that of it
    acceleration: float
    jerk: float
    snap: float
    corner_acceleration: float
    climb_acceleration: float
    radius: float
    stops: bool  # at its end
    wait_s: float = 0.0  # there
    pump: bool = False
    heading: float | None = None  # rad that the plan orders

    @cached_property
    def vector(self) -> Floats:
        return self.end_ned - self.start_ned

    @cached_property
    def length(self) -> float:
        return math.hypot(*self.vector.tolist())

    @property
    def vertical(self) -> bool:
        north, east, down = self.vector.tolist()
        return math.hypot(north, east) < abs(down)

    @cached_property
    def profile(self) -> LegProfile:
        return leg_profile(
            round(self.length, 2),
            self.speed,
            self.acceleration,
            self.jerk,
            self.snap,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimedLeg:
    """A leg with its profile, and when it is flown."""

    leg: WayLeg
    profile: LegProfile
    start_s: float  # its profile starts
    active_s: float  # it is the leg being flown from then on

    @property
    def end_s(self) -> float:
        return self.start_s + self.profile.seconds


def way_leg(
    limits: FlightLimits,
    item: int,
    start_ned: Floats,
    end_ned: Floats,
    *,
    speed: float | None = None,
    climb_speed: float | None = None,
    descent_speed: float | None = None,
    stops: bool = False,
    wait_s: float = 0.0,
    pump: bool = False,
    heading: float | None = None,
) -> WayLeg | None:
    """A leg within the limits of the vehicle; None where it leads nowhere."""
    north, east, down = (end_ned - start_ned).tolist()
    length = math.hypot(north, east, down)
    if length < SHORTEST:
        return None
    # In steps of half a degree: over uneven ground no two legs rise alike.
    rise = round(-down / length, 2)
    level = math.sqrt(1.0 - rise**2)
    vertical = limits.climb_speed if climb_speed is None else climb_speed
    if rise < 0.0:
        vertical = limits.descent_speed if descent_speed is None else descent_speed
    ordered = limits.speed if speed is None else speed
    return WayLeg(
        item=item,
        start_ned=start_ned,
        end_ned=end_ned,
        speed=_share(ordered, vertical, level, rise),
        level_speed=ordered,
        acceleration=_share(limits.acceleration, limits.climb_acceleration, level, rise),
        jerk=limits.jerk,
        snap=limits.snap,
        corner_acceleration=limits.corner_acceleration,
        climb_acceleration=limits.climb_acceleration,
        radius=limits.radius,
        stops=stops,
        wait_s=wait_s,
        pump=pump,
        heading=heading,
    )


def _share(level_most: float, vertical_most: float, level: float, rise: float) -> float:
    """The most along a leg of which these shares are level and up."""
    by_level = level_most / level if level > 1e-9 else math.inf
    by_rise = vertical_most / abs(rise) if abs(rise) > 1e-9 else math.inf
    return max(min(by_level, by_rise), 1e-3)


def timed_legs(legs: Sequence[WayLeg], start_s: float = 0.0) -> tuple[TimedLeg, ...]:
    """The legs in time; corners are cut where no leg stops."""
    made: list[TimedLeg] = []
    begun = active = start_s
    for leg, following in pairwise([*legs, None]):
        assert leg is not None
        timed = TimedLeg(leg=leg, profile=leg.profile, start_s=begun, active_s=active)
        made.append(timed)
        overlap = 0.0
        if following is not None and not leg.stops:
            overlap = _overlap(leg, following, most=timed.end_s - active)
        overlap = min(overlap, timed.end_s - active)
        begun = timed.end_s + leg.wait_s - overlap
        active = begun + 0.5 * overlap
    return tuple(made)


def _overlap(leg: WayLeg, following: WayLeg, *, most: float) -> float:
    """s before the end of a leg at which the next starts."""
    here, there = leg.profile.pulse, following.profile.pulse
    longest = min(here.seconds, there.seconds, most)
    (a, b, down_one), (c, d, down_two) = leg.vector.tolist(), following.vector.tolist()
    bend = math.atan2(a * d - b * c, a * c + b * d)
    # Fields have thousands of corners alike: to half a degree and a step of time.
    return _overlap_of(
        (round(bend, 2), round(down_one / leg.length, 2), round(down_two / following.length, 2)),
        (here, there),
        math.floor(longest / TRIED_S),
        (leg.radius, min(leg.speed, following.speed)),
        (leg.corner_acceleration, leg.climb_acceleration),
    )


@lru_cache(maxsize=4096)
def _overlap_of(
    angles: tuple[float, float, float],
    pulses: tuple[Pulse, Pulse],
    longest: int,
    near: tuple[float, float],
    gains: tuple[float, float],
) -> float:
    """The longest overlap, of `longest` steps at most, that keeps to m and m/s, and to m/s²."""
    bend, down_one, down_two = angles
    radius, top_speed = near
    level_most, climb_most = gains
    if not longest:
        return 0.0
    left: Floats = TRIED_S * np.arange(longest, 0.0, -1.0)
    flat_one, flat_two = (math.sqrt(max(1.0 - d**2, 0.0)) for d in (down_one, down_two))
    one = np.array([flat_one, 0.0, down_one])
    two = np.array([flat_two * math.cos(bend), flat_two * math.sin(bend), down_two])
    (way, speed, gained), (on, faster, gaining) = (pulse.at(0.5 * left) for pulse in pulses)
    turn = on[:, None] * two - way[:, None] * one
    moved = faster[:, None] * two + speed[:, None] * one
    pushed = gaining[:, None] * two - gained[:, None] * one
    fits = (
        (np.linalg.norm(turn, axis=1) < radius)
        & (np.linalg.norm(moved, axis=1) < top_speed)
        & (np.hypot(pushed[:, 0], pushed[:, 1]) < level_most)
        & (np.abs(pushed[:, 2]) < climb_most)
    )
    return float(left[np.argmax(fits)]) if fits.any() else 0.0


def target(legs: Sequence[TimedLeg], time_s: Floats) -> tuple[Floats, Floats, Floats]:
    """Position m, velocity m/s and acceleration m/s² of the target, (N, 3) NED, at times (N,) s
    that increase."""
    place, speed, gained = (np.zeros((time_s.size, 3)) for _ in range(3))
    done = np.zeros((time_s.size + 1, 3))
    at = legs[0].leg.start_ned
    for timed in legs:
        first, last = np.searchsorted(time_s, (timed.start_s, timed.end_s))
        vector = timed.leg.vector
        done[first] += timed.leg.start_ned - at  # of parts of a plan, flown one after the other
        at = timed.leg.end_ned
        along = vector / np.linalg.norm(vector)
        done[last] += vector
        rows = slice(first, last)
        for made, values in zip(
            (place, speed, gained), timed.profile.at(time_s[rows] - timed.start_s), strict=True
        ):
            made[rows] += values[:, None] * along
    return legs[0].leg.start_ned + np.cumsum(done, axis=0)[:-1] + place, speed, gained
