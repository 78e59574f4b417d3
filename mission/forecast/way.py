"""Compute the course of a plan in time from the vehicle's limits alone, without load, wind or air.

Legs: the steps of a plan become straight legs, NED about home.

Position: each leg goes from rest to rest by its profile. At a corner without a stop the next leg
starts before the last has ended, and their motions add up. It starts so early that the middle of
the corner lies within the radius of the place; the corner is slower than both legs and keeps the
acceleration allowed there (ArduPilot, SCurve). PX4 cuts corners by another rule, for which this one
is used too.

Yaw: the nose follows the direction of motion as fast as the vehicle may turn. ArduPilot's rule
(AC_AttitudeControl, input_shaping_angle) demands the rate at which the direction turns plus, for an
error of heading e, min(e/t, sqrt(2 a (|e| - a t²/2))). The demand is clipped to the limit of rate
and changes by at most a. So a nose that turns slowly overshoots.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Literal

import numpy as np
import pymap3d
import shapely
from numpy.typing import NDArray

from thrustmargin.mission.forecast.leg_profile import LegProfile, Pulse, leg_profile
from thrustmargin.mission.forecast.limits import FlightLimits
from thrustmargin.mission.forecast.yaw_response import followed_yaw
from thrustmargin.mission.plan_items import FRAME_ABOVE_GROUND, FRAME_AMSL, MissionPlan
from thrustmargin.mission.steps import PlanSteps, Step
from thrustmargin.mission.terrain import Terrain
from thrustmargin.models.errors import PlanError
from thrustmargin.models.flight import Bools, Floats

SpanKind = Literal["leg", "turn", "climb", "wait"]
STEP = 0.1  # s between rows
BEND = math.radians(15.0)  # by which a way bends at least in a turn
UNEASY = math.radians(3.0)  # rad off its heading, or rad/s, with which a turn is not over


@dataclass(frozen=True, slots=True, kw_only=True)
class Span:
    """A stretch of a course: the rows from `first` up to, and without, `last`."""

    item: int  # number of the mission item flown to; of a turn, that at its corner
    kind: SpanKind
    first: int
    last: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Course:
    """The target motion along a plan in T time steps: position, velocity, acceleration and yaw."""

    legs: tuple[TimedLeg, ...]
    limits: FlightLimits
    time_s: Floats  # (T,)
    place_ned: Floats  # (T, 3) m
    velocity_ned: Floats  # (T, 3) m/s
    gained_ned: Floats  # (T, 3) m/s²
    yaw: Floats  # (T,) rad
    active: NDArray[np.intp]  # (T,) number of the leg being flown, from 0
    spans: tuple[Span, ...]


def course(legs: Sequence[WayLeg], limits: FlightLimits, *, start_yaw: float = math.nan) -> Course:
    """Compute the vehicle's motion along `legs`, from the ground to the end of the last leg.

    `start_yaw` is the heading before take-off, rad; NaN: that of the first level leg.
    """
    timed = timed_legs(legs)
    end = timed[-1].end_s + legs[-1].wait_s
    time_s = np.linspace(0.0, end, max(math.ceil(end / STEP), 2) + 1)
    place, velocity, gained = target(timed, time_s)
    active = np.searchsorted([t.active_s for t in timed], time_s, side="right") - 1
    active = np.maximum(active, 0)
    ordered = np.array([np.nan if t.leg.heading is None else t.leg.heading for t in timed])[active]
    held = np.array([t.leg.holds_nose for t in timed], dtype=np.bool_)[active]
    start = first_yaw(legs, start_yaw)
    for number, flown in enumerate(timed):
        if flown.leg.nose_back:
            ordered[(active == number) & (time_s >= flown.end_s)] = start
    target_yaw, off = heading(time_s, velocity, gained, ordered, limits, start, held=held)
    yaw = followed_yaw(time_s, target_yaw, limits.yaw_loop)
    return Course(
        legs=timed,
        limits=limits,
        time_s=time_s,
        place_ned=place,
        velocity_ned=velocity,
        gained_ned=gained,
        yaw=yaw,
        active=active,
        spans=_spans(timed, time_s, active, off + target_yaw - yaw),
    )


def first_yaw(legs: Sequence[WayLeg], start_yaw: float) -> float:
    """Return the heading before take-off, rad: `start_yaw`, or of the first level leg if NaN."""
    if math.isfinite(start_yaw):
        return start_yaw
    return _course_of(next((leg for leg in legs if not leg.vertical), legs[0]))


def _course_of(leg: WayLeg) -> float:
    """Return the direction of a leg over ground, rad from north."""
    return math.atan2(leg.vector[1], leg.vector[0])


ALIGNED = math.radians(2.0)  # off the heading before take-off, with which a return lands
LONGEST_TURN_S = 60.0


@lru_cache(maxsize=256)
def _aligned_s(turn: float, limits: FlightLimits) -> float:
    """Return the time, s, in which a hovering aircraft yaws by `turn` rad to within ALIGNED.

    Not less than the wait of `limits` over home, as in ArduPilot's RTL.
    """
    time_s = np.arange(0.0, LONGEST_TURN_S, STEP)
    still = np.zeros((time_s.size, 3))
    aim, _ = heading(time_s, still, still, np.full(time_s.size, turn), limits, 0.0)
    off = np.abs(followed_yaw(time_s, aim, limits.yaw_loop) - turn)
    late = np.flatnonzero((off <= ALIGNED) & (time_s >= limits.return_wait_s))
    return float(time_s[late[0]]) if late.size else LONGEST_TURN_S


def _spans(
    timed: Sequence[TimedLeg], time_s: Floats, active: NDArray[np.intp], off: Floats
) -> tuple[Span, ...]:
    """Divide the T rows into spans: turns, and the legs, climbs and waits between them.

    `active` (T,) is the index of each row's leg in `timed`. A turn is at a corner between level
    legs; it lasts from braking until speed is regained and `off` (T,), rad of yaw still to turn, is
    small. Turns that overlap are one, under the item of the first.
    """
    uneasy = np.abs(off) > UNEASY
    turns: list[tuple[float, float, int]] = []
    for one, two in pairwise(timed):
        a, b = one.leg.vector[:2], two.leg.vector[:2]
        if one.leg.vertical or two.leg.vertical:
            continue
        bend = abs(math.atan2(a[0] * b[1] - a[1] * b[0], float(a @ b)))
        if bend < BEND:
            continue
        begin, end = one.end_s - one.profile.pulse.seconds, two.start_s + two.profile.pulse.seconds
        row = int(np.searchsorted(time_s, end))
        while row < time_s.size and uneasy[row]:
            row += 1
        end = float(time_s[min(row, time_s.size - 1)])
        if turns and begin < turns[-1][1]:
            turns[-1] = (turns[-1][0], max(end, turns[-1][1]), turns[-1][2])
        else:
            turns.append((begin, end, one.leg.item))
    label = np.full(time_s.size, -1)
    for k, (begin, end, _) in enumerate(turns):
        label[np.searchsorted(time_s, begin) : np.searchsorted(time_s, end)] = k
    resting = time_s > np.array([t.end_s for t in timed])[active]
    mark = np.where(label >= 0, -1 - label, 2 * active + resting)
    cuts = np.concatenate([[0], np.flatnonzero(np.diff(mark)) + 1, [time_s.size]])
    spans = []
    for first, last in pairwise(cuts.tolist()):
        code = int(mark[first])
        if code < 0:
            spans.append(Span(item=turns[-1 - code][2], kind="turn", first=first, last=last))
            continue
        leg = timed[code // 2].leg
        kind: SpanKind = "wait" if code % 2 else "climb" if leg.vertical else "leg"
        spans.append(Span(item=leg.item, kind=kind, first=first, last=last))
    return tuple(spans)


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
    *,
    held: Bools | None = None,
) -> tuple[Floats, Floats]:
    """Compute the vehicle's yaw (T,), rad and unwrapped, and the yaw still to turn (T,), rad.

    The yaw follows a target within the vehicle's limits of rate and acceleration. Unless ordered,
    the target is the direction of `velocity_ned`, m/s; `gained_ned` is the acceleration, m/s², both
    (T, 3). `ordered` (T,) rad is the heading that the plan orders, NaN where it orders none.
    `start` is the first heading, rad. In rows `held` (T,) the target does not follow the path;
    None: in no row.
    """
    held = np.zeros(time_s.size, dtype=np.bool_) if held is None else held
    headings, turning = _wanted_headings(velocity_ned, gained_ned, ordered, held, limits, start)
    yaw = np.empty_like(time_s)
    angle, rate = start, 0.0
    most, gain = limits.yaw_rate, limits.yaw_acceleration
    slack = gain * limits.yaw_time**2
    for row in range(time_s.size):
        goal, feedforward = float(headings[row]), float(turning[row])
        step = float(time_s[row] - time_s[row - 1]) if row else 0.0
        parts = math.ceil(step / PART_S)
        if abs(goal - angle) < SETTLED and abs(rate) < SETTLED and feedforward == 0.0:
            angle, rate, parts = goal, 0.0, 0
        for part in range(parts):
            length = step / parts
            aim = goal - feedforward * length * (parts - 1 - part)
            error = aim - angle
            size = abs(error)
            rate_wanted = size / limits.yaw_time
            if size > slack:
                rate_wanted = math.sqrt(2.0 * gain * (size - 0.5 * slack))
            rate_wanted = math.copysign(min(rate_wanted, size / length), error) + feedforward
            rate_wanted = min(max(rate_wanted, -most), most)
            rate += min(max(rate_wanted - rate, -gain * length), gain * length)
            angle += rate * length
        yaw[row] = angle
    return yaw, headings - yaw


def _wanted_headings(
    velocity: Floats,
    gained: Floats,
    ordered: Floats,
    held: Bools,
    limits: FlightLimits,
    start: float,
) -> tuple[Floats, Floats]:
    """Compute the target heading (T,), rad and unwrapped, and its rate (T,), rad/s.

    `velocity` and `gained` (T, 2 or 3) are velocity, m/s, and acceleration, m/s², north and east;
    `ordered` (T,) rad is the heading that the plan orders, NaN where none; `start` is the first
    heading, rad. Without an order the target is the direction of the velocity. It keeps its last
    value in rows where it does not follow the path: too slow, `held`, or a vehicle that does not
    turn to its course. The rate is 0 where the heading is ordered or kept.
    """
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    way = np.arctan2(velocity[:, 1], velocity[:, 0])
    free = np.isnan(ordered)
    follows = (speed > SLOW * limits.speed) & limits.nose_ahead & ~held
    known = np.where(free, follows, True)
    goal = np.where(free, way, ordered)
    last = np.maximum.accumulate(np.where(known, np.arange(speed.size), -1))
    goal = np.where(last >= 0, goal[np.maximum(last, 0)], start)
    across = velocity[:, 0] * gained[:, 1] - velocity[:, 1] * gained[:, 0]
    turning = across / np.maximum(speed, 1e-9) ** 2
    turning[~known | ~free | (np.abs(turning) < SETTLED)] = 0.0
    return np.unwrap(np.append(start, goal))[1:], turning


FARTHEST = 100_000.0  # m from home, to which no multirotor flies
#: Kinds of step that a leg leads on from without a stop.
_ON = ("fly", "spline")


@dataclass(slots=True)
class _Way:
    """The legs built so far, and the place `at` which the last one ends."""

    limits: FlightLimits
    place: Floats
    start_yaw: float
    legs: list[WayLeg] = field(default_factory=list)

    def fly_to(self, step: Step, place: Floats, **options: float | bool | None) -> None:
        """Append the leg from the present place to `place` (3,), m NED about home.

        `step` gives the item, climb speeds, pump and heading; `options` are further arguments of
        `way_leg`. Nothing is appended where the leg has no length.
        """
        heading = None if step.heading_deg is None else math.radians(step.heading_deg)
        leg = way_leg(
            self.limits,
            step.item,
            self.place,
            place,
            climb_speed=step.climb_speed,
            descent_speed=step.descent_speed,
            pump=bool(step.pump),
            heading=heading,
            **options,  # type: ignore[arg-type]
        )
        if leg is not None:
            self.legs.append(leg)
            self.place = place

    def wait(self, seconds: float) -> None:
        """Let the last leg end with a stop and a wait of `seconds` more; do nothing without a
        leg."""
        if self.legs and seconds > 0.0:
            last = self.legs[-1]
            self.legs[-1] = replace(last, stops=True, wait_s=last.wait_s + seconds)

    def lift(self, step: Step, height: float, *, stops: bool = True) -> None:
        """Append a vertical leg to `height`, m above home, that ends in a stop if `stops`.

        If it is the first leg, its jerk is that of a take-off.
        """
        before = len(self.legs)
        self.fly_to(step, np.array([*self.place[:2], -height]), stops=stops)
        if len(self.legs) > before and before == 0:
            jerk = self.limits.climb_jerk
            self.legs[-1] = replace(
                self.legs[-1], jerk=jerk, snap=self.limits.snap * jerk / self.limits.jerk
            )

    def home(self, step: Step, height: float) -> None:
        """Append the leg to above home at `height`, m above home, and the wait there.

        If the vehicle yaws back to its first heading over home, the wait lasts at least until it
        has.
        """
        limits, before = self.limits, len(self.legs)
        there = np.array([0.0, 0.0, -height])
        self.fly_to(
            step, there, speed=limits.return_speed, stops=True, holds_nose=not limits.nose_home
        )
        wait_s = limits.return_wait_s
        if limits.turns_back and len(self.legs) > before:
            leg = self.legs[-1]
            back = first_yaw(self.legs, self.start_yaw) - _course_of(leg)
            wait_s = max(wait_s, _aligned_s(round(math.remainder(back, math.tau), 2), limits))
            self.legs[-1] = replace(leg, nose_back=True)
        self.wait(wait_s)

    def land(self, step: Step) -> None:
        """Append the descent to the ground, which slows down once and is ended by the ground."""
        limits = self.limits
        if -self.place[2] > limits.land_below:
            fast = replace(step, descent_speed=limits.fast_landing)
            self.fly_to(fast, np.array([*self.place[:2], -limits.land_below]), stops=False)
        slow = replace(step, descent_speed=limits.land_speed)
        self.fly_to(slow, np.array([*self.place[:2], 0.0]), stops=True, touches_down=True)


#: m by which straight legs over the ground may be off its height.
GROUND_ERROR = 0.5


def plan_legs(
    plan: MissionPlan,
    steps: PlanSteps,
    limits: FlightLimits,
    *,
    start: Floats | None = None,
    terrain: Terrain | None = None,
    start_yaw: float = math.nan,
) -> tuple[WayLeg, ...]:
    """Return the straight legs that a vehicle flies for `steps`, with climbs, waits and the way
    home.

    The first leg begins at `start` (3,), m NED about home; None: at home. `start_yaw`, rad, is the
    first heading, NaN if unknown. Between two places with heights above the ground the legs follow
    `terrain`; without terrain a height above the ground counts as above home. A take-off or return
    without a height uses the return height of `limits`. Raise PlanError if the plan has no place to
    fly to, is farther than a multirotor flies, or leaves the ground that `terrain` covers.
    """
    way = _Way(limits, np.zeros(3) if start is None else start, start_yaw)
    flown = steps.steps
    places = _places(plan, flown, terrain)
    above: int | None = None  # frame of the place before
    for (step, following), place in zip(pairwise([*flown, None]), places, strict=True):
        assert step is not None
        speed = step.speed
        height = -float(place[2])
        there = np.where(np.isfinite(place), place, way.place)
        if step.kind == "take-off":
            way.lift(step, height if math.isfinite(height) else limits.return_height)
        elif step.kind == "land":
            if np.isfinite(place[:2]).all():
                way.fly_to(step, np.array([*place[:2], way.place[2]]), speed=speed, stops=True)
            way.land(step)
        elif step.kind == "return":
            away = np.hypot(*way.place[:2])
            up = float(limits.return_top(-way.place[2], away))
            way.lift(step, up, stops=not limits.return_turns_early)
            way.home(step, up)
            way.land(step)
        elif step.kind == "wait":
            way.wait(step.wait_s)
        else:
            on = following is not None and following.kind in _ON and step.wait_s == 0.0
            on = on and following is not None and following.frame == step.frame
            if terrain is not None and above == step.frame == FRAME_ABOVE_GROUND:
                for waypoint in _over_ground(plan, step, way.place, there, terrain):
                    way.fly_to(step, waypoint, speed=speed, stops=False)
            way.fly_to(step, there, speed=speed, stops=not (on and step.kind in _ON))
            way.wait(step.wait_s)
            if step.turns:
                way.wait(step.turns * 2.0 * math.pi * step.radius / (speed or limits.speed))
        if step.place is not None or step.kind == "take-off":
            above = step.frame
    if not way.legs:
        unknown = next((n for n in steps.not_understood if n.why == "unknown command"), None)
        why = "" if unknown is None else f"; item {unknown.item} is MAV_CMD {unknown.command}"
        raise PlanError(f"the plan flies nowhere: it has no place but home{why}")
    return tuple(way.legs)


def _over_ground(
    plan: MissionPlan, step: Step, begin: Floats, end: Floats, terrain: Terrain
) -> Floats:
    """Return the places (P, 3), m NED about home, where a leg that follows the ground changes its
    slope.

    The leg is from `begin` to `end`, both excluded. Its height above the ground changes linearly
    with distance, as in the autopilot.
    """
    away = float(np.hypot(*(end - begin)[:2]))
    share = np.linspace(0.0, 1.0, max(math.ceil(away / terrain.spacing), 1) + 1)
    straight = begin + share[:, None] * (end - begin)
    north, east = straight[:, 0], straight[:, 1]
    home_latitude, home_longitude = plan.home[:2]
    latitude, longitude, _ = pymap3d.ned2geodetic(
        north, east, 0.0, home_latitude, home_longitude, 0.0
    )
    ground = _ground(terrain, latitude, longitude, step.item)
    relief = ground - np.interp(share, [0.0, 1.0], ground[[0, -1]])
    # In metres along and up the path: what remains after the simplification is a bend.
    line = shapely.LineString(np.column_stack([away * share, relief - straight[:, 2]]))
    kept = shapely.get_coordinates(shapely.simplify(line, GROUND_ERROR))[1:-1]
    middle = begin + (kept[:, :1] / max(away, 1e-9)) * (end - begin)
    return np.column_stack([middle[:, :2], -kept[:, 1]])


def _ground(terrain: Terrain, latitude: Floats, longitude: Floats, item: int) -> Floats:
    """Return the ground's height (N,), m AMSL; raise PlanError, naming `item`, where it is
    unknown."""
    heights = terrain.height(latitude, longitude)
    if not np.isfinite(heights).all():
        where = f"the way to item {item}" if item else "home"
        raise PlanError(
            f"{terrain.name} has no height of the ground at {where}; give one that covers the plan"
        )
    return heights


def _places(plan: MissionPlan, steps: Sequence[Step], terrain: Terrain | None = None) -> Floats:
    """Return the places of S steps (S, 3), m north, east and down from home.

    NaN where a step keeps the previous value: the whole place, or north and east where it changes
    height alone. Heights above ground are relative to the ground at home; without `terrain` the
    ground counts as level. Raise PlanError where home's height is needed for a height above the sea
    and unknown, or for a step beyond FARTHEST, m.
    """
    there = [(*(step.place or (math.nan, math.nan))[:2], step.height) for step in steps]
    degrees = np.array(there, dtype=np.float64).reshape(-1, 3)
    home = plan.home
    ground = home[2] if math.isfinite(home[2]) else 0.0
    amsl = np.array([s.frame == FRAME_AMSL for s in steps], dtype=np.bool_)
    if np.any(amsl & np.isfinite(degrees[:, 2])) and not math.isfinite(home[2]):
        raise PlanError(
            "heights above the sea need that of home; give it with --altitude, or plan above home"
        )
    north, east, down = pymap3d.geodetic2ned(
        degrees[:, 0], degrees[:, 1], np.zeros(len(degrees)), home[0], home[1], 0.0
    )
    away = np.linalg.norm([north, east, down], axis=0)
    for step, distance in zip(steps, away.tolist(), strict=True):
        if distance > FARTHEST:
            raise PlanError(
                f"item {step.item} is {distance / 1e3:.0f} km from home; check its place and home"
            )
    up = degrees[:, 2] - np.where(amsl, ground, 0.0)
    over_ground = np.array([s.frame == FRAME_ABOVE_GROUND for s in steps], dtype=np.bool_)
    if terrain is not None and over_ground.any():
        at_home = _ground(terrain, np.array(home[:1]), np.array(home[1:2]), 0)
        for k in np.flatnonzero(over_ground & np.isfinite(degrees).all(axis=1)).tolist():
            here = _ground(terrain, degrees[k : k + 1, 0], degrees[k : k + 1, 1], steps[k].item)
            up[k] += float((here - at_home)[0])
    return np.column_stack([north, east, -up])


def above_ground(steps: PlanSteps) -> bool:
    """Return True if any height of the plan is above the ground."""
    return any(step.frame == FRAME_ABOVE_GROUND and step.place for step in steps.steps)


TRIED_S = 0.02  # s between the moments at which a corner is tried
SHORTEST = 0.05  # m of a leg


@dataclass(frozen=True, kw_only=True, eq=False)
class WayLeg:
    """A straight leg to fly, with the limits of motion along it."""

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
    holds_nose: bool = False  # the nose does not follow this leg
    nose_back: bool = False  # while it waits at its end the nose turns as it was before take-off
    touches_down: bool = False  # at its end it is still moving: the ground stops it

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
            brakes=not self.touches_down,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimedLeg:
    """A leg with its motion profile and the time of its start."""

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
    holds_nose: bool = False,
    touches_down: bool = False,
) -> WayLeg | None:
    """Return the leg from `start_ned` to `end_ned` (3,), m about home, within the vehicle's limits.

    None if its length is negligible. Speeds, m/s, replace those of the limits; `heading` is rad,
    None: along the path. `stops`, `wait_s`, `pump`, `holds_nose` and `touches_down` are passed on.
    """
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
        holds_nose=holds_nose,
        touches_down=touches_down,
    )


def _share(level_most: float, vertical_most: float, level: float, rise: float) -> float:
    """Return the largest value along a leg that keeps a horizontal and a vertical limit.

    `level` and `rise` are the horizontal and vertical parts of the leg's direction.
    """
    by_level = level_most / level if level > 1e-9 else math.inf
    by_rise = vertical_most / abs(rise) if abs(rise) > 1e-9 else math.inf
    return max(min(by_level, by_rise), 1e-3)


def timed_legs(legs: Sequence[WayLeg]) -> tuple[TimedLeg, ...]:
    """Return the legs with their start and end times, s; the first starts at 0.

    At a corner without a stop the next leg starts before a leg ends, so their times overlap.
    """
    result: list[TimedLeg] = []
    begun = active = 0.0
    for leg, following in pairwise([*legs, None]):
        assert leg is not None
        timed = TimedLeg(leg=leg, profile=leg.profile, start_s=begun, active_s=active)
        result.append(timed)
        overlap = 0.0
        if following is not None and not leg.stops:
            overlap = _overlap(leg, following, most=timed.end_s - active)
        overlap = min(overlap, timed.end_s - active)
        begun = timed.end_s + leg.wait_s - overlap
        active = begun + 0.5 * overlap
    return tuple(result)


def _overlap(leg: WayLeg, following: WayLeg, *, most: float) -> float:
    """Return the time, s, between the start of leg `following` and the end of `leg`; at most `most`
    s.
    """
    here, there = leg.profile.pulse, following.profile.pulse
    longest = min(here.seconds, there.seconds, most)
    (a, b, down_one), (c, d, down_two) = leg.vector.tolist(), following.vector.tolist()
    bend = math.atan2(a * d - b * c, a * c + b * d)
    # Fields have thousands of corners alike: to half a degree and a step of time. Slopes are cut
    # towards level: rounded up, a leg at the vertical limit would exceed it.
    slope_one = math.trunc(100.0 * down_one / leg.length) / 100.0
    slope_two = math.trunc(100.0 * down_two / following.length) / 100.0
    return _overlap_of(
        (round(bend, 2), slope_one, slope_two),
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
    """Return the longest overlap, s, of two legs in which both move at once within their limits.

    `angles` are the corner's, rad, and the share of each leg's length that goes down. `pulses` are
    the speed profiles at the end of the first and the start of the second leg. `longest` counts
    time steps of TRIED_S. `near` is the largest cut of the corner, m, and top speed, m/s; `gains`
    the largest accelerations, m/s², level and vertical. 0 if no overlap fits. Cached.
    """
    bend, down_one, down_two = angles
    radius, top_speed = near
    level_most, climb_most = gains
    if not longest:
        return 0.0
    remaining_s: Floats = TRIED_S * np.arange(longest, 0.0, -1.0)
    flat_one, flat_two = (math.sqrt(max(1.0 - d**2, 0.0)) for d in (down_one, down_two))
    one = np.array([flat_one, 0.0, down_one])
    two = np.array([flat_two * math.cos(bend), flat_two * math.sin(bend), down_two])
    (way, speed, gained), (next_way, faster, gaining) = (
        pulse.at(0.5 * remaining_s) for pulse in pulses
    )
    turn = next_way[:, None] * two - way[:, None] * one
    moved = faster[:, None] * two + speed[:, None] * one
    pushed = gaining[:, None] * two - gained[:, None] * one
    fits = (
        (np.linalg.norm(turn, axis=1) < radius)
        & (np.linalg.norm(moved, axis=1) < top_speed)
        & (np.hypot(pushed[:, 0], pushed[:, 1]) < level_most)
        & (np.abs(pushed[:, 2]) <= climb_most * (1.0 + 1e-9))  # many legs are at this limit
    )
    return float(remaining_s[np.argmax(fits)]) if fits.any() else 0.0


def target(legs: Sequence[TimedLeg], time_s: Floats) -> tuple[Floats, Floats, Floats]:
    """Compute position m, velocity m/s and acceleration m/s² of the target, each (N, 3) NED.

    `time_s` (N,) s must increase.
    """
    place, speed, gained = (np.zeros((time_s.size, 3)) for _ in range(3))
    done = np.zeros((time_s.size + 1, 3))
    corner = legs[0].leg.start_ned
    for timed in legs:
        first, last = np.searchsorted(time_s, (timed.start_s, timed.end_s))
        vector = timed.leg.vector
        done[first] += timed.leg.start_ned - corner  # of parts of a plan, flown one after the other
        corner = timed.leg.end_ned
        unit = vector / np.linalg.norm(vector)
        done[last] += vector
        rows = slice(first, last)
        for part, values in zip(
            (place, speed, gained), timed.profile.at(time_s[rows] - timed.start_s), strict=True
        ):
            part[rows] += values[:, None] * unit
    return legs[0].leg.start_ned + np.cumsum(done, axis=0)[:-1] + place, speed, gained
