"""Where a plan has to be refilled: at the last line end that tank and battery still reach."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from thrustmargin.mission.ahead.plan_flight import PlanFlight
from thrustmargin.models.flight import Floats

#: Of a battery's charge, and of a tank, that a sortie brings home.
CHARGE_KEPT, TANK_KEPT = 0.25, 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Sortie:
    """One filling of the tank."""

    first_item: int  # number of the first mission item that is flown to
    last_item: int  # and of the last: the refill is there
    kg: float  # sprayed
    seconds: float
    energy_wh: float  # with the ways to and from a refill


@dataclass(frozen=True, slots=True, kw_only=True)
class Needs:
    """The sorties of a plan; `short_of` says why no split of it is possible."""

    refill_after: tuple[int, ...]  # numbers of the legs, from 0
    sorties: tuple[Sortie, ...]
    short_of: str = ""  # "tank" or "battery": one line alone takes more


def needs(
    flight: PlanFlight,
    line_ends: Sequence[int],
    *,
    fill_kg: float,
    usable_wh: float,
    back_wh: Floats,
) -> Needs:
    """The sorties of a plan flown without a refill; `line_ends` are item numbers, in any order.

    `usable_wh` NaN: the battery is not known, and does not decide. Each sortie but the last one
    ends with the way home, and each but the first starts with as much: `back_wh` (T,) Wh.
    """
    ends, used, given, back = _at_ends(flight, back_wh)
    at_line_end = np.isin([t.leg.item for t in flight.legs], list(line_ends))
    most = (1.0 - TANK_KEPT) * fill_kg
    refills: list[int] = []
    short, before, last = "", -1, -1

    def taken(a: int, b: int) -> float:
        """Wh from the end of leg `a` (-1: take-off) to that of `b`, ways there and home too."""
        out = float(given[a] - back[a]) if a >= 0 else 0.0
        home = float(back[b]) if b + 1 < len(flight.legs) else 0.0
        return float(given[b]) - out + home

    for k in range(len(flight.legs)):
        over = ""
        if used[k] - (used[before] if before >= 0 else 0.0) > most + 1e-6:
            over = "tank"
        elif taken(before, k) > usable_wh:
            over = "battery"
        if over and last > before:
            refills.append(last)
            before = last
        elif over:
            short = short or over
        if at_line_end[k]:
            last = k
    cuts = [-1, *refills, len(flight.legs) - 1]
    sorties = [
        Sortie(
            first_item=flight.legs[a + 1].leg.item,
            last_item=flight.legs[b].leg.item,
            kg=float(used[b] - (used[a] if a >= 0 else 0.0)),
            seconds=float(ends[b] - (ends[a] if a >= 0 else 0.0)),
            energy_wh=taken(a, b),
        )
        for a, b in pairwise(cuts)
        if b > a
    ]
    return Needs(refill_after=tuple(refills), sorties=tuple(sorties), short_of=short)


def _at_ends(flight: PlanFlight, back_wh: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """(L,) s, kg sprayed and Wh given by the end of each leg, and Wh of the way home from there."""
    rows = np.searchsorted(flight.active, np.arange(1, len(flight.legs) + 1)) - 1
    rows = np.maximum(rows, 0)
    flown = flight.track.time_s[rows], flight.sprayed_kg[rows], flight.energy_wh[rows]
    return *flown, back_wh[rows]
