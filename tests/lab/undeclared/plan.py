"""Three frozen plans: which data set each seed is.

Of the first, seeds 1 to 999 are open and those from 5000 sealed; of the second, on other aircraft
flown otherwise, 20000 to 29999 are open and those from 30000 sealed; of the third, a hexacopter of
30 kg with a model of eight good flights, 40000 to 40999 are open and those from 41000 sealed.

A round is sixty sets in an order of its own: ten sound, one or more of each single change, pairs,
triples (a cut propeller beside hidden mass and a shifted centre of gravity among them), changes
that no table has, poor instruments. Sizes are drawn evenly in the logarithm and never drawn again
for being small; so some sets ask for what no method can see, and the table says how many.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tests.lab.undeclared.conditions import (
    EVERY_OUTSIDE,
    FLIGHTS,
    INSTRUMENTS,
    OUTSIDE,
    PAUSE_S,
    SINGLE,
    Condition,
    Implant,
    draw,
)
from tests.lab.undeclared.crafts import CRAFTS, HEXACOPTER, OTHER_CRAFTS, SEA_LEVEL_DENSITY, Craft
from tests.lab.undeclared.days import Day, random_day
from tests.lab.undeclared.missions import STYLES, Style, hover_only
from tests.lab.undeclared.plant import Flight, fly

OPEN = (range(1, 1_000), range(20_000, 30_000), range(40_000, 41_000))
SECOND_FROM, THIRD_FROM = 20_000, 40_000
MIXED = ("rotor", "mass", "cg")
ROUND = (
    *["none"] * 10,
    *SINGLE,
    *["rotor"] * 3,
    *["mass", "cg", "gauge gain", "air"],
    *["pair"] * 5,
    *["mixed"] * 4,
    *["triple"] * 2,
    *OUTSIDE,
    *INSTRUMENTS,
)
#: The second: more sound sets, what began or ended, what gains, and more causes without a name.
SECOND_ROUND = (
    *["none"] * 14,
    *["rotor"] * 8,
    *["longer blade"] * 4,
    *["late rotor", "repaired rotor", "rotor onset", "fouling"] * 2,
    *["mass", "cg", "gauge gain", "air", "pair"] * 2,
    *["mixed"] * 2,
    *["wake", "flex", "slosh", "jet", "shed", "flap", "worn", "sail"] * 2,
)
#: The third: what leans, sprays, swings or hangs, and a worn rotor beside a shifted load.
THIRD_ROUND = (
    *["none", "tilted arm", "hung weight"] * 3,
    *["recoil", "swing", "worn and shifted"] * 2,
    "rotor",
)
HOVER_SHARE = 0.1  # of the sets of the second plan
_CRAFT_SHARES = (0.4, 0.12, 0.12, 0.12, 0.12, 0.12)


@dataclass(frozen=True, kw_only=True, eq=False)
class DataSet:
    """Flights and, for the scorer only, the truth about them."""

    seed: int
    kind: str
    craft: Craft
    implants: tuple[Implant, ...]
    fit: tuple[Flight, ...]
    held_out: tuple[Flight, ...]
    #: For each implant all flights without it, with the same way, air and noise; held out last.
    without: tuple[tuple[Flight, ...], ...]
    #: Of each flight, ln of the air's density over standard, what the implants do to it left out.
    dense: tuple[float, ...]

    @property
    def group(self) -> str:
        """One of none, single, pair, triple, outside, instrument."""
        if self.kind in EVERY_OUTSIDE:
            return "outside"
        if self.kind in INSTRUMENTS:
            return "instrument"
        return ("none", "single", "pair", "triple")[len(self.implants)]


def case_of(seed: int) -> tuple[str, Craft]:
    """The kind and the aircraft of a seed."""
    rng = np.random.default_rng([seed, 12])
    if seed >= THIRD_FROM:
        return planned_kind(seed - THIRD_FROM + 1, THIRD_ROUND), HEXACOPTER
    if seed >= SECOND_FROM:
        craft = OTHER_CRAFTS[int(rng.integers(len(OTHER_CRAFTS)))]
        return planned_kind(seed - SECOND_FROM + 1, SECOND_ROUND), craft
    return planned_kind(seed), CRAFTS[int(rng.choice(len(CRAFTS), p=_CRAFT_SHARES))]


def planned_kind(seed: int, kinds: Sequence[str] = ROUND) -> str:
    """The kind of a seed: each round holds all kinds, in an order of its own."""
    number, place = divmod(seed - 1, len(kinds))
    return kinds[int(np.random.default_rng([number, 11]).permutation(len(kinds))[place])]


def draw_implants(
    kind: str, rng: np.random.Generator, craft: Craft, size: float | None = None
) -> list[Implant]:
    """The changes of a set of a kind; `size` is that of a single one, otherwise drawn."""
    if kind == "none":
        return []
    if kind == "mixed":
        return [draw(k, rng, craft) for k in MIXED]
    if kind == "worn and shifted":
        worn, shifted = (
            float(np.exp(rng.uniform(*np.log(of)))) for of in ((0.03, 0.1), (0.01, 0.03))
        )
        return [draw("rotor", rng, craft, worn), draw("cg", rng, craft, shifted)]
    if kind not in ("pair", "triple"):
        return [draw(kind, rng, craft, size)]
    chosen: list[Implant] = []
    while len(chosen) < (2 if kind == "pair" else 3):
        one = draw(str(rng.choice(list(SINGLE))), rng, craft)
        if one.name not in [c.name for c in chosen]:
            chosen.append(one)
    return chosen


def fly_season(
    craft: Craft, implants: Sequence[Implant], missions: Sequence[tuple[Style, Day]], seed: int
) -> list[Flight]:
    """The flights of a season with these changes; the same seed gives the same air and noise."""
    condition = replace(Condition(), **dict(craft.telemetry))
    for implant in implants:
        condition = implant.on(condition)
    flights = []
    for i, (style, day) in enumerate(missions):
        for implant in implants:
            day = implant.at(day)
        flights.append(fly(craft, condition, style, day, [seed, i], f"flight {i + 1}"))
    return flights


def missions_of(craft: Craft, rng: np.random.Generator, count: int) -> list[tuple[Style, Day]]:
    """Missions and days of one season; what a vehicle does not report it never reports."""
    style = STYLES[craft.flown]
    missions = [(style(rng, craft.radius), random_day(rng)) for _ in range(count)]
    heat, reported = missions[0][1].board_heat, missions[0][1].wind_reported
    return [
        (s, replace(d, board_heat=heat, wind_reported=reported, clock_start=PAUSE_S * i))
        for i, (s, d) in enumerate(missions)
    ]


def good_flights(craft: Craft, count: int | None = None, seed: int = 0) -> list[Flight]:
    """Flights of the sound aircraft over the range of missions and fills, to train on."""
    count, missions = craft.good_flights if count is None else count, []
    for i, (style, day) in enumerate(missions_of(craft, np.random.default_rng([seed, 1]), count)):
        day = replace(day, fill=0.25 + 0.75 * ((i * 0.618) % 1.0))
        if craft.flown == "missions":
            cruise = 2.0 + 6.0 * ((i * 0.382 + 0.1) % 1.0)
            style = replace(style, cruise=cruise, line_length=16.0 * cruise)
        missions.append((style, day))
    return fly_season(craft, (), missions, 10_000_000 + seed)


def build(
    seed: int, kind: str | None = None, craft: Craft | None = None, size: float | None = None
) -> DataSet:
    """The data set of a seed; with another kind, craft or size than the plan's a set beside it."""
    planned, flown = case_of(seed)
    kind, craft = kind or planned, craft or flown
    implants = tuple(draw_implants(kind, np.random.default_rng([seed, 16]), craft, size))
    rng = np.random.default_rng([seed, 13])
    held = int(rng.integers(1, 3))
    count = FLIGHTS.get(kind) or int(rng.integers(3, 5 if seed >= THIRD_FROM else 6))
    missions = missions_of(craft, rng, count + held)
    if THIRD_FROM > seed >= SECOND_FROM and rng.random() < HOVER_SHARE:
        missions = [(hover_only(s), d) for s, d in missions]
    for implant in implants:
        missions = [
            (replace(s, **implant.style), replace(d, wind=implant.wind or d.wind))  # type: ignore[arg-type]
            for s, d in missions
        ]
    flights = fly_season(craft, implants, missions, seed)
    return DataSet(
        seed=seed,
        kind=kind,
        craft=craft,
        implants=implants,
        fit=tuple(flights[:-held]),
        held_out=tuple(flights[-held:]),
        without=tuple(
            tuple(
                fly_season(craft, [*implants[:k], one.absent, *implants[k + 1 :]], missions, seed)
            )
            for k, one in enumerate(implants)
            if kind not in INSTRUMENTS
        ),
        dense=tuple(float(np.log(d.density / SEA_LEVEL_DENSITY)) for _, d in missions),
    )
