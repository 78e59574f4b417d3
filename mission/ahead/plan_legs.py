"""The legs that a vehicle flies for the steps of a plan, in NED about home."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import pymap3d

from thrustmargin.mission.ahead.limits import FlightLimits
from thrustmargin.mission.ahead.way import WayLeg, way_leg
from thrustmargin.mission.plan_items import FRAME_ABOVE_GROUND, FRAME_AMSL, MissionPlan
from thrustmargin.mission.steps import PlanSteps, Step
from thrustmargin.models.errors import PlanError
from thrustmargin.models.flight import Floats

#: ArduPilot's cone about home, in which a return climbs no higher than so many times the distance.
CONE = 3.0
RETURN_WAIT_S = 5.0  # s over home before it lands (RTL_LOIT_TIME)
FARTHEST = 100_000.0  # m from home, to which no multirotor flies
#: Kinds of step that a leg leads on from without a stop.
_ON = ("fly", "spline")


@dataclass(slots=True)
class _Way:
    limits: FlightLimits
    at: Floats
    legs: list[WayLeg] = field(default_factory=list)

    def to(self, step: Step, place: Floats, **options: float | bool | None) -> None:
        heading = None if step.heading_deg is None else math.radians(step.heading_deg)
        leg = way_leg(
            self.limits,
            step.item,
            self.at,
            place,
            climb_speed=step.climb_speed,
            descent_speed=step.descent_speed,
            pump=bool(step.pump),
            heading=heading,
            **options,  # type: ignore[arg-type]
        )
        if leg is not None:
            self.legs.append(leg)
            self.at = place

    def wait(self, seconds: float) -> None:
        if self.legs and seconds > 0.0:
            last = self.legs[-1]
            self.legs[-1] = replace(last, stops=True, wait_s=last.wait_s + seconds)

    def lift(self, step: Step, height: float) -> None:
        before = len(self.legs)
        self.to(step, np.array([*self.at[:2], -height]), stops=True)
        if len(self.legs) > before and before == 0:
            jerk = self.limits.climb_jerk
            self.legs[-1] = replace(
                self.legs[-1], jerk=jerk, snap=self.limits.snap * jerk / self.limits.jerk
            )

    def land(self, step: Step) -> None:
        limits = self.limits
        if -self.at[2] > limits.land_below:
            self.to(step, np.array([*self.at[:2], -limits.land_below]), stops=True)
        slow = replace(step, descent_speed=limits.land_speed)
        self.to(slow, np.array([*self.at[:2], 0.0]), stops=True)


def plan_legs(
    plan: MissionPlan, steps: PlanSteps, limits: FlightLimits, *, start: Floats | None = None
) -> tuple[WayLeg, ...]:
    """The legs of `plan`, flown as `steps` from `start` (3,) m NED about home, or from home.

    Heights above the ground count as above home.

    Raises PlanError when the plan flies nowhere, or to where no aircraft of this kind does.
    """
    way = _Way(limits, np.zeros(3) if start is None else start)
    flown = steps.steps
    places = _places(plan, flown)
    for (step, following), place in zip(pairwise([*flown, None]), places, strict=True):
        assert step is not None
        speed = step.speed
        height = -float(place[2])
        there = np.where(np.isfinite(place), place, way.at)
        if step.kind == "take-off":
            way.lift(step, height if math.isfinite(height) else limits.return_height)
        elif step.kind == "land":
            if np.isfinite(place[:2]).all():
                way.to(step, np.array([*place[:2], way.at[2]]), speed=speed, stops=True)
            way.land(step)
        elif step.kind == "return":
            distance = float(np.hypot(*way.at[:2]))
            up = max(-way.at[2], min(limits.return_height, CONE * distance))
            way.lift(step, up)
            way.to(step, np.array([0.0, 0.0, -up]), speed=speed, stops=True)
            way.wait(RETURN_WAIT_S)
            way.land(step)
        elif step.kind == "wait":
            way.wait(step.wait_s)
        else:
            on = following is not None and following.kind in _ON and step.wait_s == 0.0
            on = on and following is not None and following.frame == step.frame
            way.to(step, there, speed=speed, stops=not (on and step.kind in _ON))
            way.wait(step.wait_s)
            if step.turns:
                way.wait(step.turns * 2.0 * math.pi * step.radius / (speed or limits.speed))
    if not way.legs:
        unknown = next((n for n in steps.not_understood if n.why == "unknown command"), None)
        why = "" if unknown is None else f"; item {unknown.item} is MAV_CMD {unknown.command}"
        raise PlanError(f"the plan flies nowhere: it has no place but home{why}")
    return tuple(way.legs)


def _places(plan: MissionPlan, steps: Sequence[Step]) -> Floats:
    """(S, 3) m NED about home of the steps; NaN where it is where it was."""
    there = [step.place or (math.nan, math.nan, math.nan) for step in steps]
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
    return np.column_stack([north, east, -up])


def above_ground(steps: PlanSteps) -> bool:
    """Whether some height is above the ground, which is taken as level."""
    return any(step.frame == FRAME_ABOVE_GROUND and step.place for step in steps.steps)
