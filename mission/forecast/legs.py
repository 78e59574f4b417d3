"""Divide a plan into sorties, and choose the legs of a long plan to simulate.

A sortie ends at the last line end that tank and battery reach. Of a long plan only legs unlike
those simulated before are simulated. Two legs are alike in speed, climb angle, the corner that
follows and, in wind, heading. A simulated leg represents those like it with no more in the tank and
no more drawn from the battery.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from thrustmargin.mission.forecast.battery import used_since_change
from thrustmargin.mission.forecast.limits import FlightLimits
from thrustmargin.mission.forecast.plan_flight import PlanConditions, PlanFlight, Used, energy_home
from thrustmargin.mission.forecast.way import TimedLeg, WayLeg
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.rotor_model import RotorModel

#: Of a battery's charge, and of a tank, that a sortie brings home.
CHARGE_KEPT, TANK_KEPT = 0.25, 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Sortie:
    """The part of a plan that is flown on one filling of the tank."""

    first_item: int  # number of the first mission item that is flown to
    last_item: int  # and of the last: the refill is there
    kg: float  # sprayed
    lines: float  # m flown over ground with the pump on
    seconds: float
    energy_wh: float  # with the ways to and from a refill


@dataclass(frozen=True, slots=True, kw_only=True)
class Needs:
    """The sorties of a plan; `short_of` names the resource that one line alone exceeds, empty if
    none.
    """

    refill_after: tuple[int, ...]  # numbers of the legs, from 0
    sorties: tuple[Sortie, ...]
    short_of: str = ""  # "tank" or "battery": one line alone takes more


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LegEnds:
    """The cumulative use of tank, battery and time at the end of each of the L legs, without
    refills.
    """

    items: NDArray[np.intp]  # (L,) numbers of the mission items flown to
    time_s: Floats  # (L,)
    sprayed_kg: Floats  # (L,)
    energy_wh: Floats  # (L,)
    lines: Floats  # (L,) m flown over ground with the pump on
    home_wh: Floats  # (L,) Wh used to fly home from there with a full tank


def leg_ends(
    flight: PlanFlight,
    legs: Sequence[TimedLeg],
    given: PlanConditions,
    limits: FlightLimits,
    model: RotorModel,
) -> LegEnds:
    """Compute time, s, liquid, kg, and energy, Wh, used from the start to the end of each of
    `legs`.

    `flight` has simulated the first of `legs`. Of the remaining ones time and liquid follow from
    speed and length, energy from the mean power of `flight`. The energy to fly home from each leg's
    end, with the full tank, is a field of its own (`home_wh`) and not in the energy used.
    """
    count = len(flight.course.legs)
    rows = np.maximum(np.searchsorted(flight.course.active, np.arange(1, count + 1)) - 1, 0)
    parts = [flight.track.time_s[rows], flight.sprayed_kg[rows], flight.energy_wh[rows]]
    rest = legs[count:]
    if rest:
        starts = np.array([t.active_s for t in legs[count:]])
        last = rest[-1]
        end = np.append(starts[1:], last.end_s + last.leg.wait_s)
        way = np.array([np.hypot(*t.leg.vector[:2]) * t.leg.pump for t in rest])
        speed = np.array([t.leg.level_speed for t in rest])
        rate = given.flow_per_metre if given.flow_per_metre > 0.0 else given.flow / speed
        rate = np.minimum(rate, given.most_flow / speed)
        power = flight.energy_wh[-1] / flight.track.time_s[-1]
        parts = [
            np.append(parts[0], end),
            np.append(parts[1], flight.sprayed_kg[-1] + np.cumsum(rate * way)),
            np.append(parts[2], flight.energy_wh[-1] + power * (end - flight.track.time_s[-1])),
        ]
    items = np.array([t.leg.item for t in legs], dtype=np.intp)
    place = np.array([t.leg.end_ned for t in legs])
    full, density = np.full(len(legs), given.fill_kg), np.full(len(legs), given.density)
    home = energy_home(place, full, density, limits, model, given.wind_ned)
    return LegEnds(
        items=items,
        time_s=parts[0],
        sprayed_kg=parts[1],
        energy_wh=parts[2],
        lines=np.cumsum([np.hypot(*t.leg.vector[:2]) * t.leg.pump for t in legs]),
        home_wh=home,
    )


def needs(of_legs: LegEnds, line_ends: Sequence[int], *, fill_kg: float, usable_wh: float) -> Needs:
    """Divide a plan into sorties between refills, and name what the plan lacks.

    A refill may follow the items numbered in `line_ends`, in any order. `usable_wh` is the energy
    that a battery may give; NaN: unknown, and then only the tank limits a sortie. Each sortie but
    the last includes the energy of the flight home; each but the first, of the flight back to its
    start. `short_of` in the result is "tank" or "battery" if a part without a line end exceeds it,
    else "".
    """
    ends, used, given = of_legs.time_s, of_legs.sprayed_kg, of_legs.energy_wh
    at_line_end = np.isin(of_legs.items, list(line_ends))
    most = (1.0 - TANK_KEPT) * fill_kg
    refills: list[int] = []
    short, before, last = "", -1, -1

    def energy(a: int, b: int) -> float:
        """Return the energy, Wh, from the end of leg `a` (-1: take-off) to the end of leg `b`.

        Flights from and to the refills are included.
        """
        out = float(given[a] - of_legs.home_wh[a]) if a >= 0 else 0.0
        home = float(of_legs.home_wh[b]) if b + 1 < ends.size else 0.0
        return float(given[b]) - out + home

    for k in range(ends.size):
        exceeded = ""
        if used[k] - (used[before] if before >= 0 else 0.0) > most + 1e-6:
            exceeded = "tank"
        elif energy(before, k) > usable_wh:
            exceeded = "battery"
        if exceeded and last > before:
            refills.append(last)
            before = last
        elif exceeded:
            short = short or exceeded
        if at_line_end[k]:
            last = k
    cuts = [-1, *refills, ends.size - 1]
    sorties = [
        Sortie(
            first_item=int(of_legs.items[a + 1]),
            last_item=int(of_legs.items[b]),
            kg=float(used[b] - (used[a] if a >= 0 else 0.0)),
            lines=float(of_legs.lines[b] - (of_legs.lines[a] if a >= 0 else 0.0)),
            seconds=float(ends[b] - (ends[a] if a >= 0 else 0.0)),
            energy_wh=energy(a, b),
        )
        for a, b in pairwise(cuts)
        if b > a
    ]
    return Needs(refill_after=tuple(refills), sorties=tuple(sorties), short_of=short)


#: Of the mass at take-off, and of the battery, by which a leg may be harder: a point of thrust.
MASS_SHARE, BATTERY_SHARE = 0.02, 0.05
SPEED, ANGLE, CORNER = 0.5, 10.0, 15.0  # m/s and degrees that are the same


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PartsFlown:
    """The legs to simulate, part after part, and the use of tank and battery at the start of each
    part.
    """

    legs: tuple[WayLeg, ...]
    renewed: dict[int, Used]
    unlike: int  # legs that none of them represents


def parts_flown(
    legs: Sequence[TimedLeg],
    first: int,
    ends: LegEnds,
    refill_after: Sequence[int],
    *,
    mass: float,
    usable_wh: float,
    windy: bool,
    longest_s: float,
) -> PartsFlown:
    """Choose the legs to simulate: the `first` ones, and later ones that differ from the legs
    already chosen.

    Two legs are alike if motion (`_kind`), mass and battery charge are about equal. `ends` covers
    all `legs`. Tank and battery are full after the legs numbered `refill_after`, from 0; `mass`,
    kg, is that at take-off; `usable_wh` is NaN if unknown; `windy`: the direction of flight
    matters. A chosen leg is simulated with its neighbours. Later legs last `longest_s` s at most in
    total; `unlike` in the result counts the legs left out for that.
    """
    fresh = np.asarray(refill_after, dtype=np.intp)
    kg, wh = used_since_change(ends.sprayed_kg, fresh), used_since_change(ends.energy_wh, fresh)
    # The state at the start of a leg is that at the end of the one before.
    kg, wh = (np.append(0.0, used)[:-1] for used in (kg, wh))
    # In steps of mass and energy; a leg one step harder represents a leg too.
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
    renewed: dict[int, Used] = {}
    legs_flown: list[WayLeg] = []
    for place, (k, following) in enumerate(pairwise([*numbers, -1])):
        separate = following != k + 1 and following >= 0
        legs_flown.append(replace(legs[k].leg, stops=True) if separate else legs[k].leg)
        if separate:
            renewed[place + 1] = Used(float(kg[following]), float(wh[following]))
        elif k in refill_after and following >= 0:
            renewed[place + 1] = Used(0.0, 0.0)
    return PartsFlown(legs=tuple(legs_flown), renewed=renewed, unlike=unlike)


def _kind(one: TimedLeg, two: TimedLeg | None, *, windy: bool) -> Hashable:
    """Return a key that is equal for legs of about equal speed, climb angle and corner afterwards.

    `two` is the leg after `one`. The direction counts too with wind or a commanded heading.
    """
    key: list[float | None] = [one.leg.stops]
    for timed in (one, two):
        if timed is None:
            key.append(None)
            continue
        north, east, down = timed.leg.vector.tolist()
        key += [
            round(timed.profile.top_speed / SPEED),
            round(math.degrees(math.atan2(-down, math.hypot(north, east))) / ANGLE),
            timed.leg.heading is None,
        ]
        if windy or timed.leg.heading is not None:
            key.append(round(math.degrees(math.atan2(east, north)) / ANGLE))
    if two is not None:
        (a, b, _), (c, d, _) = one.leg.vector.tolist(), two.leg.vector.tolist()
        bend = math.degrees(math.atan2(a * d - b * c, a * c + b * d))
        key.append(round(bend / CORNER))
    return tuple(key)
