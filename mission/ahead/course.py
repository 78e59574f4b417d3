"""A plan's way in time, by the vehicle's own limits alone: no load, wind or air is in it yet."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from thrustmargin.mission.ahead.limits import FlightLimits
from thrustmargin.mission.ahead.nose import followed, heading
from thrustmargin.mission.ahead.way import TimedLeg, WayLeg, target, timed_legs
from thrustmargin.models.flight import Floats

SpanKind = Literal["leg", "turn", "climb", "wait"]
STEP = 0.1  # s between rows
BEND = math.radians(15.0)  # by which a way bends at least in a turn
UNEASY = math.radians(3.0)  # rad off its heading, or rad/s, with which a turn is not over


@dataclass(frozen=True, slots=True, kw_only=True)
class Span:
    """A stretch of the flight: rows from `first` up to `last`, which is not in it."""

    item: int  # number of the mission item flown to; of a turn, that at its corner
    kind: SpanKind
    first: int
    last: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Course:
    """Where the aircraft is meant to be, in T rows."""

    legs: tuple[TimedLeg, ...]
    limits: FlightLimits
    time_s: Floats  # (T,)
    place_ned: Floats  # (T, 3) m
    velocity_ned: Floats  # (T, 3) m/s
    gained_ned: Floats  # (T, 3) m/s²
    yaw: Floats  # (T,) rad
    active: NDArray[np.intp]  # (T,) number of the leg being flown, from 0
    spans: tuple[Span, ...]


def course(legs: Sequence[WayLeg], limits: FlightLimits) -> Course:
    """The way along `legs`, from the ground to where the last one ends."""
    timed = timed_legs(legs)
    end = timed[-1].end_s + legs[-1].wait_s
    time_s = np.linspace(0.0, end, max(math.ceil(end / STEP), 2) + 1)
    place, velocity, gained = target(timed, time_s)
    active = np.searchsorted([t.active_s for t in timed], time_s, side="right") - 1
    active = np.maximum(active, 0)
    ordered = np.array([np.nan if t.leg.heading is None else t.leg.heading for t in timed])[active]
    first = next((x.vector for x in legs if not x.vertical), legs[0].vector)
    start = float(np.arctan2(first[1], first[0]))
    target_yaw, off = heading(time_s, velocity, gained, ordered, limits, start)
    yaw = followed(time_s, target_yaw, limits)
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


def _spans(
    timed: Sequence[TimedLeg], time_s: Floats, active: NDArray[np.intp], off: Floats
) -> tuple[Span, ...]:
    """Turns, from braking to where speed is regained and the nose is at rest; what is between them
    is the leg, climb or wait that it is part of."""
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
    found = []
    for first, last in pairwise(cuts.tolist()):
        code = int(mark[first])
        if code < 0:
            found.append(Span(item=turns[-1 - code][2], kind="turn", first=first, last=last))
            continue
        leg = timed[code // 2].leg
        kind: SpanKind = "wait" if code % 2 else "climb" if leg.vertical else "leg"
        found.append(Span(item=leg.item, kind=kind, first=first, last=last))
    return tuple(found)
