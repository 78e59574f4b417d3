"""Split a plan into sorties: each ends at a line end, and the next continues there.

Every sortie is a complete plan: take-off, speed, the way out with the pump off, its part of the
lines, pump off and return. Jumps are unrolled, so that no sortie refers to another.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pymap3d

from thrustmargin.mission.plan_items import (
    CHANGE_SPEED,
    FRAME_MISSION,
    RETURN_TO_LAUNCH,
    TAKEOFF,
    WAYPOINT,
    MissionPlan,
    PlanItem,
)
from thrustmargin.mission.steps import PlanSteps, PumpOutput, Step, pump_switch
from thrustmargin.models.errors import PlanError

#: m from the nearest place of the field beyond which home is no place to refill for it.
REACH = 3000.0
#: Degrees by which a way bends at least where a line ends.
BEND = 30.0
_FLOWN = ("fly", "spline")
_JUMPS = ("jump to nothing", "jump to itself", "jump without end")


def line_ends(plan: MissionPlan, steps: PlanSteps) -> tuple[int, ...]:
    """Return the indexes in `steps.steps` of the line ends, at which a sortie may end.

    A line ends where the pump is switched off, or where the path turns by more than BEND degrees.
    If no step has the pump on, lines with it off count.
    """
    flown = steps.steps
    dry = not any(step.pump for step in flown)
    known = [k for k, step in enumerate(flown) if step.place is not None]
    places = np.array([(flown[k].place or ())[:2] for k in known]).reshape(-1, 2)
    east, north, _ = pymap3d.geodetic2enu(places[:, 0], places[:, 1], 0.0, *plan.home[:2], 0.0)
    course = np.arctan2(np.diff(east), np.diff(north))
    ends = []
    for m, (k, after) in enumerate(pairwise(known[1:])):
        if flown[k].kind not in _FLOWN or not (flown[k].pump or dry):
            continue
        bend = (course[m + 1] - course[m] + math.pi) % (2.0 * math.pi) - math.pi
        if abs(bend) > math.radians(BEND) or not (flown[after].pump or dry):
            ends.append(k)
    return tuple(ends)


def split_plan(
    plan: MissionPlan,
    steps: PlanSteps,
    refill_after: Sequence[int],
    *,
    pump: PumpOutput | None = None,
) -> tuple[MissionPlan, ...]:
    """Split `plan`, flown as `steps`, into one plan per sortie.

    `refill_after` are the indexes in `steps.steps` after which to refill, each one of `line_ends`.
    `pump` is the output by which sorties switch the pump if the plan does. Raise PlanError for
    another index, for a plan with a faulty jump, and for a home out of the field's reach.
    """
    for item in steps.not_understood:
        if item.why in _JUMPS:
            raise PlanError(f"item {item.item} is a {item.why}; correct it first")
    flown, items = steps.steps, steps.executed
    ends = set(line_ends(plan, steps))
    for index in refill_after:
        if index not in ends:
            number = flown[index].item if 0 <= index < len(flown) else index
            raise PlanError(f"item {number} is no line end; a refill is at the end of a line")
    _check_reach(plan.home, flown)
    cuts = sorted(set(refill_after))
    # What switches the pump of such a plan switches that of its sorties.
    switched = any(step.pump is not None for step in flown) and not steps.pump_by_rule
    off = [pump_switch(pump or PumpOutput(), on=False)] if switched else []
    on = pump_switch(pump or PumpOutput(), on=True)
    sorties = []
    for begin, end in zip([None, *cuts], [*cuts, None], strict=True):
        body: list[PlanItem] = []
        if begin is not None:
            body += _way_out(flown[begin], flown[begin + 1], plan, off)
            body += [on] if switched and flown[begin + 1].pump else []
        low = 0 if begin is None else flown[begin].index + 1
        body += items[low : len(items) if end is None else flown[end].index + 1]
        if end is not None:
            body += [*off, _order(RETURN_TO_LAUNCH)]
        numbered = tuple(replace(item, number=k) for k, item in enumerate(body, start=1))
        sorties.append(replace(plan, items=numbered))
    return tuple(sorties)


def _check_reach(home: tuple[float, float, float], steps: Sequence[Step]) -> None:
    places = np.array([step.place[:2] for step in steps if step.place is not None])
    if not len(places):
        raise PlanError("the plan has no place to fly to, so there is nothing to split")
    offsets = pymap3d.geodetic2enu(places[:, 0], places[:, 1], 0.0, home[0], home[1], 0.0)
    nearest = float(np.min(np.linalg.norm(np.array(offsets), axis=0)))
    if not nearest <= REACH:
        raise PlanError(
            f"home, where to refill, is {nearest / 1e3:.1f} km from the nearest place of the plan; "
            f"set it within {REACH / 1e3:g} km"
        )


def _way_out(
    last: Step, following: Step, plan: MissionPlan, off: Sequence[PlanItem]
) -> list[PlanItem]:
    """Return the items of the flight, pump off, from take-off at `home` to the line end `last`.

    They include the speeds in force in the step `following`, and the items `off` that switch the
    pump off. Their numbers are 0.
    """
    assert last.place is not None  # a line end has one
    height = last.place[2]
    yaw = next((i.parameters[3] for i in plan.items if i.command == TAKEOFF), math.nan)
    climb = (0.0, 0.0, 0.0, yaw, *plan.home[:2], height)
    items = [PlanItem(number=0, command=TAKEOFF, frame=last.frame, parameters=climb)]
    for kind, speed in (
        (1.0, following.speed),
        (2.0, following.climb_speed),
        (3.0, following.descent_speed),
    ):
        if speed is not None:
            items.append(_order(CHANGE_SPEED, kind, speed, -1.0))
    items += off
    items.append(
        PlanItem(
            number=0,
            command=WAYPOINT,
            frame=last.frame,
            parameters=(0.0, 0.0, 0.0, yaw, *last.place),
        )
    )
    return items


def _order(command: int, one: float = 0.0, two: float = 0.0, three: float = 0.0) -> PlanItem:
    return PlanItem(
        number=0,
        command=command,
        frame=FRAME_MISSION,
        parameters=(one, two, three, 0.0, 0.0, 0.0, 0.0),
    )
