"""Which legs of a long plan are flown, so that one of them stands for every other.

Alike is what is flown alike: speed, climb, the corner after it, and in wind the heading. One that
was flown stands for those with no more in the tank and no more taken from the battery.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from thrustmargin.mission.ahead.battery import since
from thrustmargin.mission.ahead.plan_flight import Used
from thrustmargin.mission.ahead.sortie_needs import LegEnds
from thrustmargin.mission.ahead.way import TimedLeg, WayLeg

#: Of the mass at take-off, and of the battery, by which a leg may be harder: a point of thrust.
MASS_SHARE, BATTERY_SHARE = 0.02, 0.05
SPEED, ANGLE, CORNER = 0.5, 10.0, 15.0  # m/s and degrees that are the same


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PartsFlown:
    """The legs to fly, one part after the other, and with what given each part begins."""

    legs: tuple[WayLeg, ...]
    anew: dict[int, Used]
    unlike: int  # legs that none of them stands for


def parts_flown(
    legs: Sequence[TimedLeg],
    first: int,
    taken: LegEnds,
    refill_after: Sequence[int],
    *,
    mass: float,
    usable_wh: float,
    windy: bool,
    longest_s: float,
) -> PartsFlown:
    """The `first` of the legs, and of the others those that none before them stands for.

    `taken` is of all `legs`, and after those numbered `refill_after` tank and battery are fresh;
    `mass` kg is at take-off. The others last `longest_s` at most.
    """
    fresh = np.asarray(refill_after, dtype=np.intp)
    kg, wh = since(taken.sprayed_kg, fresh), since(taken.energy_wh, fresh)
    # The state at the start of a leg is that at the end of the one before.
    kg, wh = (np.append(0.0, used)[:-1] for used in (kg, wh))
    # In steps that are the same; a leg one step harder stands for it too.
    heavy = np.floor(kg / (MASS_SHARE * mass)).astype(int).tolist()
    known = math.isfinite(usable_wh)
    weak = np.floor(wh / (BATTERY_SHARE * usable_wh) if known else 0.0 * wh).astype(int).tolist()
    there: set[Hashable] = set()
    chosen: set[int] = set()
    spent, unlike = 0.0, 0
    for k, (one, two) in enumerate(pairwise([*legs, None])):
        assert one is not None
        kind, i, j = _kind(one, two, windy=windy), heavy[k], weak[k]
        if k < first - 1 or first == len(legs):
            there.add((kind, i, j))
            continue
        if any((kind, i - a, j + b) in there for a in (0, 1) for b in (0, 1)):
            continue
        part = {n for n in (k - 1, k, k + 1) if first <= n < len(legs)} - chosen
        took = sum(legs[n].end_s + legs[n].leg.wait_s - legs[n].active_s for n in part)
        if spent + took > longest_s:
            unlike += 1
            continue
        spent += took
        chosen |= part
        there.add((kind, i, j))
    numbers = [*range(first), *sorted(chosen)]
    anew: dict[int, Used] = {}
    made: list[WayLeg] = []
    for place, (k, following) in enumerate(pairwise([*numbers, -1])):
        apart = following != k + 1 and following >= 0
        made.append(replace(legs[k].leg, stops=True) if apart else legs[k].leg)
        if apart:
            anew[place + 1] = Used(float(kg[following]), float(wh[following]))
        elif k in refill_after and following >= 0:
            anew[place + 1] = Used(0.0, 0.0)
    return PartsFlown(legs=tuple(made), anew=anew, unlike=unlike)


def _kind(one: TimedLeg, two: TimedLeg | None, *, windy: bool) -> Hashable:
    """What two legs have to share, with the corner after them, to be flown alike."""
    made: list[float | None] = [one.leg.stops]
    for timed in (one, two):
        if timed is None:
            made.append(None)
            continue
        north, east, down = timed.leg.vector.tolist()
        made += [
            round(timed.profile.top_speed / SPEED),
            round(math.degrees(math.atan2(-down, math.hypot(north, east))) / ANGLE),
            timed.leg.heading is None,
        ]
        if windy or timed.leg.heading is not None:
            made.append(round(math.degrees(math.atan2(east, north)) / ANGLE))
    if two is not None:
        (a, b, _), (c, d, _) = one.leg.vector.tolist(), two.leg.vector.tolist()
        bend = math.degrees(math.atan2(a * d - b * c, a * c + b * d))
        made.append(round(bend / CORNER))
    return tuple(made)
