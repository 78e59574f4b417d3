"""Decide where the pump is on in a plan that does not switch it.

Many spray planners export places only: the sprayer's own switch, or the pilot, turns the pump on.
The owner names one of two rules. "always": on from the first place of the mission to the last.
"lines": on along the spray lines, which are adjacent parallel legs, at the speed
of most of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
import pymap3d
import shapely
from numpy.typing import NDArray

from thrustmargin.mission.plan_items import MissionPlan
from thrustmargin.mission.steps import PlanSteps, Step
from thrustmargin.models.errors import PlanError
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.physics.airframe import Airframe

PumpRule = Literal["always", "lines"]

#: Degrees by which the headings of legs of one line, or of two lines, differ at most: planners draw
#: them parallel, and a way across to the next line of 150 m already turns by 2.
PARALLEL_DEG = 1.5
#: m between neighbouring lines at most, as for --swath.
WIDEST = 100.0
#: Shares of the usual spacing within which neighbouring lines lie. Legs that overlap at less are
#: one line flown twice, or turns at one edge of the field; at more they are no neighbours.
SPACING_SHARES = (0.5, 2.0)
#: Share of the shorter of two lines that must lie next to the other.
BESIDE_SHARE = 0.5
#: Share of the working speed by which the speed of a line may differ.
SAME_SPEED = 0.1
_BETWEEN_PLACES = ("fly", "spline", "turns")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SprayLines:
    """The spray lines of a plan with S steps."""

    spraying: Bools  # (S,) the path to this step is part of a line
    count: int  # lines
    spacing: float  # m between neighbouring lines, the median by length; NaN without a line


def orders_pump(steps: PlanSteps) -> int | None:
    """Return the number of the first item flown after the plan has switched its pump; None if it
    never does.
    """
    return next((step.item for step in steps.steps if step.pump is not None), None)


def with_pump_rule(
    plan: MissionPlan, steps: PlanSteps, rule: PumpRule
) -> tuple[PlanSteps, SprayLines | None]:
    """Return the steps with the pump switched by `rule`, and the lines that the rule "lines" found.

    Raise PlanError for "lines" in a plan without two parallel, neighbouring legs.
    """
    if rule == "always":
        return _switched(steps, _along_places(steps.steps)), None
    lines = spray_lines(plan, steps)
    if not lines.count:
        raise PlanError(
            "no spray lines are found: no two legs of one speed lie parallel beside each other; "
            "give --pump always, or switch the pump in the plan"
        )
    return _switched(steps, lines.spraying), lines


def pumped_by_airframe(plan: MissionPlan, steps: PlanSteps, airframe: Airframe) -> PlanSteps:
    """Return the steps with the pump switched by the rule of the airframe file.

    They are unchanged where the plan switches the pump, the file has no rule, or no line is found.
    """
    rule = airframe_rule(airframe)
    if rule is None or orders_pump(steps) is not None:
        return steps
    try:
        return with_pump_rule(plan, steps, rule)[0]
    except PlanError:
        return steps


def airframe_rule(airframe: Airframe) -> PumpRule | None:
    """Return the rule that the airframe file has for plans that do not switch the pump; None
    without one.
    """
    return next((rule for rule in get_args(PumpRule) if rule == airframe.pump_on), None)


def _switched(steps: PlanSteps, spraying: Bools) -> PlanSteps:
    switched = tuple(
        replace(step, pump=bool(on)) for step, on in zip(steps.steps, spraying, strict=True)
    )
    return replace(steps, steps=switched, pump_at_end=False, pump_by_rule=True)


def _along_places(steps: Sequence[Step]) -> Bools:
    """Flag the steps (S,) that are flown to from another place of the mission."""
    flown = np.array([s.kind in _BETWEEN_PLACES and s.place is not None for s in steps], bool)
    # The way to the first place comes from home, or from wherever the take-off was.
    return flown & (np.cumsum(flown) > 1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Runs:
    """The K straight runs of a plan: legs in a row that keep one heading and speed."""

    start: Floats  # (K, 2) m east, north
    end: Floats  # (K, 2)
    speed: Floats  # (K,) m/s over ground; 0: the vehicle's own setting
    steps: tuple[tuple[int, ...], ...]  # indexes of the steps that each run leads to

    @property
    def vector(self) -> Floats:
        return self.end - self.start

    @property
    def length(self) -> Floats:
        return np.hypot(*self.vector.T)


def spray_lines(plan: MissionPlan, steps: PlanSteps) -> SprayLines:
    """Find the spray lines of a plan, by spacing and speed; none: count 0 and spacing NaN.

    A line is a run of legs of one heading with a parallel neighbour at about the usual spacing; the
    longer of both exceeds their distance. Its speed is the one at which most of the length of such
    runs is flown. Legs that only extend a line, as for a turn outside of the field, cannot be
    distinguished from it and count as part of it.
    """
    runs = _runs(plan, steps.steps)
    spraying = np.zeros(len(steps.steps), dtype=np.bool_)
    nothing = SprayLines(spraying=spraying, count=0, spacing=math.nan)
    one, two, distance = _neighbours(runs)
    long_enough = np.maximum(runs.length[one], runs.length[two]) > distance
    one, two, distance = one[long_enough], two[long_enough], distance[long_enough]
    if not one.size:
        return nothing
    candidates = np.unique(one)
    working = _weighted_mode(runs.speed[candidates], runs.length[candidates])
    at_work = np.abs(runs.speed - working) <= SAME_SPEED * working
    both = at_work[one] & at_work[two]
    one, two, distance = one[both], two[both], distance[both]
    if not one.size:
        return nothing
    spacing = _usual_spacing(one, distance, runs.length)
    low, high = (share * spacing for share in SPACING_SHARES)
    lines = np.unique(one[(distance >= low) & (distance <= high)])
    for run in lines.tolist():
        spraying[list(runs.steps[run])] = True
    return SprayLines(spraying=spraying, count=lines.size, spacing=spacing)


def _runs(plan: MissionPlan, steps: Sequence[Step]) -> _Runs:
    """Join successive legs of one heading and speed, flown from place to place, to straight runs.

    Places are east and north of home, m.
    """
    legs = _along_places(steps)
    placed = [k for k, s in enumerate(steps) if s.kind in _BETWEEN_PLACES and s.place is not None]
    degrees = np.array([(steps[k].place or ())[:2] for k in placed]).reshape(-1, 2)
    east, north, _ = pymap3d.geodetic2enu(degrees[:, 0], degrees[:, 1], 0.0, *plan.home[:2], 0.0)
    points = np.column_stack([east, north])
    start: list[Floats] = []
    end: list[Floats] = []
    speed: list[float] = []
    joined: list[tuple[int, ...]] = []
    before, heading = -1, math.nan
    for row, k in enumerate(placed):
        if not legs[k]:
            continue
        way = points[row] - points[row - 1]
        toward = math.atan2(way[1], way[0])
        bend = abs((toward - heading + math.pi) % (2.0 * math.pi) - math.pi)
        ordered = steps[k].speed or 0.0
        straight = bend <= math.radians(PARALLEL_DEG)
        if row - 1 == before and straight and speed[-1] == ordered:
            end[-1], joined[-1] = points[row], (*joined[-1], k)
        elif np.hypot(*way) > 0.0:
            start.append(points[row - 1])
            end.append(points[row])
            speed.append(ordered)
            joined.append((k,))
            heading = toward
        before = row
    return _Runs(
        start=np.array(start).reshape(-1, 2),
        end=np.array(end).reshape(-1, 2),
        speed=np.array(speed),
        steps=tuple(joined),
    )


def _neighbours(runs: _Runs) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats]:
    """Return pairs of neighbouring parallel runs, as two index arrays (P,), and their distances
    (P,), m.

    Each pair occurs in both orders. Neighbours overlap along their length and are at most WIDEST
    apart; runs 0.5 m apart or less, on one straight line, are not neighbours.
    """
    lines = shapely.linestrings(np.stack([runs.start, runs.end], axis=1))
    shapes = np.array(lines, dtype=object)
    tree = shapely.STRtree(shapes)
    one, two = tree.query(shapes, predicate="dwithin", distance=WIDEST)
    unit = runs.vector / runs.length[:, None]
    cross = unit[one, 0] * unit[two, 1] - unit[one, 1] * unit[two, 0]
    parallel = (one != two) & (np.abs(cross) <= math.sin(math.radians(PARALLEL_DEG)))
    one, two = one[parallel], two[parallel]
    # Along and across the first run of a pair, from its start.
    projections = [
        np.sum((point[two] - runs.start[one]) * unit[one], axis=1)
        for point in (runs.start, runs.end)
    ]
    middle = 0.5 * (runs.start + runs.end)
    offset = middle[two] - middle[one]
    distance = np.abs(offset[:, 1] * unit[one, 0] - offset[:, 0] * unit[one, 1])
    overlap = np.minimum(np.maximum(*projections), runs.length[one]) - np.maximum(
        np.minimum(*projections), 0.0
    )
    enough = overlap >= BESIDE_SHARE * np.minimum(runs.length[one], runs.length[two])
    kept = enough & (distance > 0.5) & (distance <= WIDEST)
    return one[kept], two[kept], distance[kept]


def _weighted_mode(values: Floats, weights: Floats) -> float:
    """Return the value with the largest sum of weights."""
    distinct, which = np.unique(values, return_inverse=True)
    return float(distinct[np.argmax(np.bincount(which, weights=weights))])


def _usual_spacing(one: NDArray[np.intp], distance: Floats, length: Floats) -> float:
    """Return the median, by length, of the distance of each run to its nearest neighbour, m."""
    nearest = np.full(length.size, np.inf)
    np.minimum.at(nearest, one, distance)
    known = np.flatnonzero(np.isfinite(nearest))
    order = known[np.argsort(nearest[known])]
    share = np.cumsum(length[order])
    return float(nearest[order[np.searchsorted(share, 0.5 * share[-1])]])
